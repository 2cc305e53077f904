"""The uncertainty budget: what every source contributes to U, in µm and µrad."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.exceptions import InputError, cut
from volid.report.contents.contributions import Contributions, contributions, headline_contributions, with_main_sources
from volid.report.language import ENGLISH, Texts
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.dots import finished, quiet
from volid.report.plot.palette import BLACK, FAINT, NEUTRAL, SERIES
from volid.report.plot.panels import figure_with_panels, heading, shown_vector
from volid.report.symbols import shown_symbol
from volid.uncertainty.budget import Line

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARKERS = ("o", "s", "^", "D", "v", "P", "X")
ROW = 0.2  # inch, of an output
LEAST = 0.01  # of U: contributions below are not drawn


def draw(asked: Asked) -> Figure:
    """The figure of a solution. Raises `NothingToDrawError` for one that cannot be refitted."""
    try:
        found = headline_contributions(asked.solution, asked.tool, asked.texts)
    except InputError as reason:
        raise NothingToDrawError(str(reason)) from None
    return _figure(found, asked.texts, f"{cut(asked.solution.machine.name)}: {said_of_tool(asked.tool, asked.texts)}")


def said_of_tool(tool: Sequence[float], texts: Texts) -> str:
    """For which tool vector the numbers of the volume hold."""
    return texts("budget.tool", tool=shown_vector(tool, texts))


def budget_bars(lines: Iterable[Line], texts: Texts = ENGLISH, words: Mapping[str, str] | None = None) -> Figure:
    """What every source contributes to the expanded uncertainty U (k = 2) of every output, and U itself.

    Contributions are absolute: their root sum of squares is U. Shares would show a source that matters as large wherever U is
    small. Functions are shown as RMS over their travel. The sources that matter most have their own mark, all others share one.

    Args:
        lines: The lines of a budget, as `budget_lines` gives them.
        texts: The language.
        words: Of sources; those that share their words are taken together.

    Source: GUM 5.1.2.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> from volid.uncertainty.budget import budget, budget_lines, headline_rows
    >>> from volid.uncertainty.outputs import headline_outputs
    >>> figure = volid.plot.budget_bars(budget_lines(budget(solution), headline_rows(solution, headline_outputs(solution))))
    >>> figure.axes[0].get_xlabel()
    'contribution to U (k = 2) / µm'
    """
    return _figure(with_main_sources(contributions(lines, words), texts), texts, "")


def parts_of(found: Iterable[Contributions]) -> list[list[Contributions]]:
    """The outputs by panel: numbers of the volume, other lengths, rotations. What the datum fixes has no U and is left out."""
    known = [output for output in found if output.expanded > 0.0]
    volume = [o for o in known if o.is_of_volume]
    lengths = [o for o in known if not o.is_of_volume and o.unit == "mm"]
    rotations = [o for o in known if not o.is_of_volume and o.unit != "mm"]
    return [part for part in (volume, lengths, rotations) if part]


def _figure(found: Sequence[Contributions], texts: Texts, title: str) -> Figure:
    parts = parts_of(found)
    heights = [ROW * len(part) + 0.75 for part in parts] or [1.0]
    figure, panels = figure_with_panels(
        len(heights), 1, figsize=(7.5, sum(heights) + 1.2), squeeze=False, height_ratios=heights
    )
    for panel, part in zip(panels[:, 0], parts, strict=False):
        budget_panel(panel, part, texts)
    handles, labels = panels[0][0].get_legend_handles_labels()
    heading(figure, title, handles, labels)
    figure.supxlabel(fill(texts("budget.how"), 110), fontsize=7, x=0.01, ha="left", color=NEUTRAL)
    finished(figure, texts)
    return figure


def budget_panel(panel: Any, part: Sequence[Contributions], texts: Texts) -> None:
    """A row for every output of one unit: a dot for what every source contributes to U, a line that ends at U."""
    scale, unit = (1e3, "µm") if part[0].unit == "mm" else (1e6, "µrad")
    rows = range(len(part))
    panel.hlines(rows, 0.0, [scale * o.expanded for o in part], color=FAINT, lw=3.0, zorder=1)
    style = {"ls": "none", "zorder": 3, "clip_on": False}
    ends = [scale * o.expanded for o in part]
    panel.plot(ends, rows, "|", color=BLACK, ms=10, mew=1.6, label=texts("budget.total"), gid="total", **style)
    for i, source in enumerate(part[0].parts):
        values = [scale * o.parts[source] if o.parts[source] >= LEAST * o.expanded else np.nan for o in part]
        look = {"color": SERIES[i % len(SERIES)], "mec": BLACK, "mew": 0.4, "alpha": 0.95}
        panel.plot(values, rows, MARKERS[i % len(MARKERS)], ms=5.5, label=source, gid=f"source {i}", **look, **style)
    panel.set_yticks(rows, [output_words(o.output, texts) for o in part])
    panel.set_ylim(len(part) - 0.5, -0.5)
    panel.set_xlim(0.0, 1.05 * max(ends))
    panel.set_xlabel(texts("budget.axis", unit=unit), fontsize=8)
    panel.set_title(texts(f"budget.{_sort(part[0])}"), fontsize=8, loc="left")
    panel.grid(axis="x", color=FAINT, lw=0.5)
    panel.set_axisbelow(True)
    quiet(panel)
    panel.tick_params(axis="y", length=0, labelcolor=NEUTRAL)


def _sort(output: Contributions) -> str:
    return "of_volume" if output.is_of_volume else "of_lengths" if output.unit == "mm" else "of_rotations"


def output_words(name: str, texts: Texts) -> str:
    """An output in words: the numbers of the volume, V_X as V X; other symbols stay as they are."""
    keys = {"largest deviation": "largest", "RMS deviation": "rms"}
    return texts(f"budget.{keys[name]}") if name in keys else shown_symbol(name)
