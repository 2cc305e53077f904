"""Figures of matplotlib that belong to whoever asked for them: pyplot does not keep them, so that nobody has to close them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure_with_panels(rows: int, columns: int, *, figsize: tuple[float, float], **kwargs: Any) -> tuple[Figure, Any]:
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
    from matplotlib.figure import Figure

    figure = Figure(figsize=figsize, layout="constrained")
    return figure, figure.subplots(rows, columns, **kwargs)
