"""Figures of matplotlib that belong to whoever asked for them: pyplot does not keep them, so that nobody has to close them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.report.plot.palette import NEUTRAL, SIGNED

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


TITLE, SMALL = 11, 8  # points of a figure's title, and of its legend and notes


def heading(figure: Figure, title: str, handles: Sequence[Any] = (), labels: Sequence[str] = ()) -> None:
    """The title of a figure, and below it the one legend of all its panels, in as many rows as its width needs.

    Args:
        figure: A figure of `figure_with_panels`.
        title: The title; wrapped to the figure's width.
        handles, labels: Of the legend; none: there is none.
    """
    width, height = figure.get_size_inches()
    lines = wrap(title, int(10.5 * width))
    figure.suptitle("\n".join(lines), fontsize=TITLE)
    if not labels:
        return
    beside = sum(len(label) + 7 for label in labels) <= 13.0 * width
    in_a_row = len(labels) if beside else max(1, int(13.0 * width / (max(map(len, labels)) + 7)))
    rows = -(-len(labels) // in_a_row)
    below = 1.0 - (0.06 + len(lines) * 1.25 * TITLE / 72.0) / height
    figure.legend(
        handles, labels, fontsize=SMALL, frameon=False, ncols=min(in_a_row, len(labels)), borderaxespad=0.0,
        borderpad=0.0, loc="upper center", bbox_to_anchor=(0.5, below),
    )  # fmt: skip
    engine: Any = figure.get_layout_engine()
    engine.set(rect=(0.0, 0.0, 1.0, 1.0 - rows * 1.8 * SMALL / 72.0 / height))


def note_below(figure: Figure, lines: Sequence[str], width: int | None = None) -> None:
    """Sentences below the panels of a figure, wrapped to its width, in small type.

    Args:
        figure: A figure of `figure_with_panels`.
        lines: One for each sentence; none: nothing is written.
        width: Characters of a line; by default as many as fit.
    """
    characters = width or int(13.5 * figure.get_figwidth())
    text = "\n".join(part for line in lines for part in wrap(line, characters))
    if text:
        figure.supxlabel(text, fontsize=SMALL, color=NEUTRAL, ha="left", x=0.02)


def round_levels(largest: float, signed: bool, most: int = 12) -> np.ndarray:
    """Levels at round numbers (1, 2, 2.5 or 5 times a power of ten apart) that hold sizes up to `largest`.

    >>> round_levels(51.0, signed=False).tolist()
    [0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0]
    """
    from matplotlib.ticker import MaxNLocator

    locator = MaxNLocator(nbins=most, steps=[1, 2, 2.5, 5, 10], symmetric=signed)
    return np.asarray(locator.tick_values(-largest if signed else 0.0, largest))


def level_lines(panel: Any, x: np.ndarray, y: np.ndarray, values: np.ndarray, largest: float, colours: str) -> Any:
    """A field as areas between round levels, with lines at them, dashed below zero, so that it can be read in grey too.

    Args:
        panel: Axes of matplotlib.
        x, y: Positions, shapes (n,) and (m,), or both (m, n).
        values: Shape (m, n); NaN stays blank.
        largest: End of the scale.
        colours: A map of the palette: `SIGNED` has levels of both signs, others begin at 0.

    Returns the areas, for a colour bar.
    """
    levels = round_levels(largest, colours == SIGNED)
    areas = panel.contourf(x, y, values, levels=levels, cmap=colours)
    if np.nanmin(values) < levels[-2] and np.nanmax(values) > levels[1]:
        dashes = ["--" if level < 0.0 else "-" for level in levels]
        widths = [1.2 if abs(level) < 1e-12 else 0.5 for level in levels]
        panel.contour(x, y, values, levels=levels, colors=NEUTRAL, linestyles=dashes, linewidths=widths)
    return areas


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
