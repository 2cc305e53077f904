"""Figures of matplotlib that belong to whoever asked for them: pyplot does not keep them, so that nobody has to close them."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure_with_panels(
    rows: int = 1, columns: int = 1, *, figsize: tuple[float, float] | None = None, **kwargs: Any
) -> tuple[Figure, Any]:
    """A figure with `rows` times `columns` panels, and the panels as `matplotlib.figure.Figure.subplots` gives them.

    Args:
        rows: Rows of panels.
        columns: Columns of panels.
        figsize: Width and height [inch].
        kwargs: Of `Figure.subplots`, such as `squeeze`, `sharex`, `width_ratios`.

    >>> figure, both = figure_with_panels(1, 2, figsize=(6.0, 3.0))
    >>> len(figure.axes), both.shape
    (2, (2,))
    """
    figure = _figure_class()(figsize=figsize, layout="constrained")
    return figure, figure.subplots(rows, columns, **kwargs)


@cache
def _figure_class() -> Any:
    from matplotlib.figure import Figure

    class ShownFigure(Figure):
        """A figure that a notebook shows as the last value of a cell."""

        def _repr_png_(self) -> bytes:
            from io import BytesIO

            stream = BytesIO()
            self.savefig(stream, format="png", dpi=110)
            return stream.getvalue()

    return ShownFigure
