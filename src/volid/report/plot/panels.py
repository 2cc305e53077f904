"""Figures of matplotlib that belong to whoever asked for them: pyplot does not keep them, so that nobody has to close them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.exceptions import shown
from volid.report.language import Texts
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


SMALL_SIZE = (3.4, 1.8)  # inches of a small panel


def figure_with_places(size: tuple[float, float], places: Sequence[Sequence[float]]) -> tuple[Figure, list[Any]]:
    """A figure whose panels stand where they are told: drawn at once, and true to scale.

    Args:
        size: Width and height [inch].
        places: Of each panel, left and lower edge, width and height [inch].

    >>> figure, (panel,) = figure_with_places((4.0, 2.0), [(0.4, 0.5, 3.5, 1.25)])
    >>> [round(float(v), 3) for v in panel.get_position().extents]
    [0.1, 0.25, 0.975, 0.875]
    """
    figure = _figure_class()(figsize=size)
    width, height = size
    return figure, [figure.add_axes((x / width, y / height, w / width, h / height)) for x, y, w, h in places]


def small_panel(
    size: tuple[float, float] = SMALL_SIZE, edges: tuple[float, float, float, float] = (0.5, 0.4, 0.08, 0.26)
) -> tuple[Figure, Any]:
    """A small figure with one panel, for a page with many of them.

    Args:
        size: Width and height [inch].
        edges: Room at the left, below, at the right and above [inch].
    """
    left, below, right, above = edges
    figure, panels = figure_with_places(size, [(left, below, size[0] - left - right, size[1] - below - above)])
    return figure, panels[0]


def signs(text: str, texts: Texts) -> str:
    """A number as figures write it in a language: with a minus sign, and in German with a decimal comma.

    >>> signs("-12.5", Texts("de"))
    '−12,5'
    """
    found = text.replace("-", "\u2212")
    return found.replace(".", ",") if texts.language == "de" else found


def shown_vector(values: Sequence[float], texts: Texts) -> str:
    """A vector as figures write it in a language; no line breaks within it.

    >>> shown_vector((0.0, 0.5, -150.0), Texts("de")).replace("\\u00a0", " ")
    '(0; 0,5; −150)'
    """
    separator = ";\u00a0" if texts.language == "de" else ",\u00a0"
    return f"({separator.join(signs(f'{value:g}', texts) for value in values)})"


def in_language(axis: Any, texts: Texts) -> None:
    """The numbers of an axis of matplotlib, `panel.xaxis` or of a colour bar, in the signs of a language."""
    from matplotlib.ticker import ScalarFormatter

    if texts.language == "de" and isinstance(axis.get_major_formatter(), ScalarFormatter):
        axis.set_major_formatter(_comma_formatter()())


def figure_in_language(figure: Figure, texts: Texts) -> None:
    """The numbers of all axes of a figure, its colour bars too, in the signs of a language."""
    for panel in figure.axes:
        in_language(panel.xaxis, texts)
        in_language(panel.yaxis, texts)


@cache
def _comma_formatter() -> Any:
    from matplotlib.ticker import ScalarFormatter

    class CommaFormatter(ScalarFormatter):
        """Numbers with a decimal comma."""

        def __call__(self, x: float, pos: int | None = None) -> str:
            return super().__call__(x, pos).replace(".", ",")

    return CommaFormatter


NAME_LENGTH = 28  # characters of the name of a station, a sphere or a set within a figure
TITLE, SMALL = 11, 8  # points of a figure's title, and of its legend and notes


def heading(figure: Figure, title: str, handles: Sequence[Any] = (), labels: Sequence[str] = ()) -> None:
    """The title of a figure, and below it the one legend of all its panels, in as many rows as its width needs.

    Args:
        figure: A figure of `figure_with_panels`.
        title: The title; wrapped to the figure's width.
        handles, labels: Of the legend; none: there is none.
    """
    width, height = figure.get_size_inches()
    lines = wrap(title, int(11.5 * width))
    engine: Any = figure.get_layout_engine()
    place = (
        {} if engine is not None else {"y": 1.0 - 0.06 / height}
    )  # a place of its own takes a title out of the layout
    figure.suptitle("\n".join(lines), fontsize=TITLE, parse_math=False, **place)
    if not labels:
        return
    beside = sum(len(label) + 7 for label in labels) <= 13.0 * width
    in_a_row = len(labels) if beside else max(1, int(13.0 * width / (max(map(len, labels)) + 7)))
    rows = -(-len(labels) // in_a_row)
    below = 1.0 - (0.1 + len(lines) * 1.25 * TITLE / 72.0) / height
    legend = figure.legend(
        handles, labels, fontsize=SMALL, frameon=False, ncols=min(in_a_row, len(labels)), borderaxespad=0.0,
        borderpad=0.0, loc="upper center", bbox_to_anchor=(0.5, below),
    )  # fmt: skip
    as_written(legend.get_texts())
    if engine is not None:
        engine.set(rect=(0.0, 0.0, 1.0, 1.0 - rows * 1.8 * SMALL / 72.0 / height))


def as_written(texts: Iterable[Any]) -> None:
    """Texts of matplotlib that hold names from files: a dollar sign in them begins no formula."""
    for text in texts:
        text.set_parse_math(False)


def plain_texts(figure: Figure) -> None:
    """Every text of a figure as it is written, because it may hold names from files: a dollar sign begins no formula, control
    characters and marks of direction are shown, not obeyed."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_parse_math(False)
        written = text.get_text()
        if (harmless := shown(written)) != written:
            text.set_text(harmless)


def note_below(figure: Figure, lines: Sequence[str], width: int | None = None) -> None:
    """Sentences below the panels of a figure, wrapped to its width, in small type.

    Args:
        figure: A figure of `figure_with_panels`.
        lines: One for each sentence; none: nothing is written.
        width: Characters of a line; by default as many as fit.
    """
    characters = width or int(15 * figure.get_figwidth())
    text = "\n".join(part for line in lines for part in wrap(line, characters))
    if text:
        figure.supxlabel(text, fontsize=SMALL, color=NEUTRAL, ha="left", x=0.02, parse_math=False)


def round_levels(largest: float, signed: bool, most: int = 12) -> np.ndarray:
    """Levels at round numbers (1, 2, 2.5 or 5 times a power of ten apart) that hold sizes up to `largest`.

    >>> round_levels(51.0, signed=False).tolist()
    [0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0]
    """
    from matplotlib.ticker import MaxNLocator

    locator = MaxNLocator(nbins=most, steps=[1, 2, 2.5, 5, 10], symmetric=signed)
    return np.asarray(locator.tick_values(-largest if signed else 0.0, largest))


def level_lines(panel: Any, x: np.ndarray, y: np.ndarray, values: np.ndarray, largest: float, colours: str) -> Any:
    """A field as areas between round levels; of values of both signs with lines at them, dashed below zero, to be read in grey.

    Args:
        panel: Axes of matplotlib.
        x, y: Positions, shapes (n,) and (m,), or both (m, n).
        values: Shape (m, n); NaN stays blank.
        largest: End of the scale.
        colours: A map of the palette: `SIGNED` has levels of both signs, others begin at 0.

    Returns the areas, for a colour bar.
    """
    levels = round_levels(largest, colours == SIGNED, 16 if colours == SIGNED else 12)
    areas = panel.contourf(x, y, values, levels=levels, cmap=colours)
    if colours == SIGNED and np.nanmin(values) < levels[-2] and np.nanmax(values) > levels[1]:
        dashes = ["--" if level < 0.0 else "-" for level in levels]
        widths = [1.2 if abs(level) < 1e-12 else 0.5 for level in levels]
        panel.contour(x, y, values, levels=levels, colors=NEUTRAL, linestyles=dashes, linewidths=widths)
    return areas


@cache
def _figure_class() -> Any:
    from matplotlib.figure import Figure

    class ShownFigure(Figure):
        """A figure that a notebook shows as the last value of a cell; names from files are drawn as they are written."""

        def draw(self, renderer: Any) -> None:
            plain_texts(self)
            super().draw(renderer)

        def _repr_png_(self) -> bytes:
            from io import BytesIO

            stream = BytesIO()
            self.savefig(stream, format="png", dpi=110)
            return stream.getvalue()

    return ShownFigure
