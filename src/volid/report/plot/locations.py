"""Location errors of the rotary axes as bars with U. Positions in µm, orientations in µrad."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.exceptions import cut
from volid.fitting.results import FunctionValue
from volid.fitting.solution import Solution
from volid.model.iso230 import ROTARY_AXES, parse
from volid.report.language import ENGLISH, Texts
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.curves import K, scale_of
from volid.report.plot.palette import BLACK, BLUE, NEUTRAL, SKY
from volid.report.plot.panels import figure_with_panels, heading, in_language, note_below, signs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PER_BAR = 0.95  # inches


def location_errors(solution: Solution, truth: Mapping[str, float] | None = None, *, texts: Texts = ENGLISH) -> Figure:
    """Location errors of the rotary axes with bars of ± U (k = 2), positions and orientations in separate panels.

    They are those of the axis average lines in the machine frame, as `Solution.location` has them. Those that the data do not
    determine are named below.

    Args:
        solution: The solution.
        truth: True values by symbol, likewise (`volid.model.axis_lines.line_values`) [mm or rad]. With it, panels below show the
            identified value minus `truth`, at a scale that shows the bars.
        texts: The language.

    Raises:
        NothingToDrawError: the model has no location errors of rotary axes.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> figure = volid.plot.location_errors(solution)
    >>> [label.get_text().split()[0] for label in figure.axes[0].get_xticklabels()]
    ['EX0C', 'EY0C', 'EY0A', 'EZ0A']
    """
    rows = [solution.location(n) for n in solution.model.names if parse(n).location and parse(n).axis in ROTARY_AXES]
    if not rows:
        raise NothingToDrawError("the model has no location errors of rotary axes")
    known = {
        turns: [r for r in rows if parse(r.name).is_rotation == turns and np.isfinite(r.value)] for turns in (0, 1)
    }
    wide = [max(2.2, PER_BAR * len(shown)) for shown in known.values()]
    size = (sum(wide) + 1.6, 5.8 if truth else 3.6)
    figure, panels = figure_with_panels(2 if truth else 1, 2, figsize=size, squeeze=False, width_ratios=wide)
    for column, shown, key in zip(panels.T, known.values(), ("positions", "orientations"), strict=True):
        _column(column, shown, truth, texts)
        column[0].set_title(texts(f"figures.{key}"), fontsize=9, loc="left", color=NEUTRAL)
    labels = panels[0][0].get_legend_handles_labels() if truth else ()
    heading(figure, texts("figures.locations_title", machine=cut(solution.machine.name)), *labels)
    unknown = ", ".join(r.name for r in rows if not np.isfinite(r.value))
    note_below(figure, [texts("functions.not_determined", names=unknown)] if unknown else [])
    return figure


def _column(panels: Sequence[Any], shown: list[FunctionValue], truth: Mapping[str, float] | None, texts: Texts) -> None:
    """Bars of location errors of one unit; with `truth`, below them identified minus true values."""
    if not shown:
        for panel in panels:
            panel.set_axis_off()
        return
    x, scale, unit = np.arange(len(shown)), scale_of(shown[0].name), parse(shown[0].name).report_unit
    value, u = (scale * np.array([getattr(r, key) for r in shown]) for key in ("value", "u"))
    bars = {"color": SKY, "edgecolor": BLUE, "ecolor": BLACK, "capsize": 4, "width": 0.5}
    panels[0].bar(x, value, yerr=K * u, label=texts("figures.identified"), **bars)
    panels[0].set_ylabel(unit)
    if truth:
        true = scale * np.array([truth.get(r.name, np.nan) for r in shown])
        panels[0].plot(x, true, "_", color=BLACK, ms=18, mew=1.6, label=texts("functions.truth"))
        panels[1].errorbar(x, value - true, yerr=K * u, fmt="o", color=BLUE, capsize=4)
        panels[1].set_ylabel(texts("figures.identified_less_truth", unit=unit))
    labels = [f"{r.name}\n{signs(_with_u(v, K * s), texts)}" for r, v, s in zip(shown, value, u, strict=True)]
    for panel in panels:
        panel.axhline(0.0, color=NEUTRAL, lw=0.8)
        panel.set_xticks(x, [r.name for r in shown], fontsize=8)
        panel.set_xlim(-0.6, len(shown) - 0.4)
        in_language(panel.yaxis, texts)
    panels[0].set_xticks(x, labels, fontsize=8)


def _with_u(value: float, expanded: float) -> str:
    """Value ± U, with two significant digits of U."""
    digits = max(0, 1 - int(np.floor(np.log10(expanded)))) if expanded > 0.0 else 1
    return f"{value:.{digits}f}\n± {expanded:.{digits}f}"


def draw(asked: Asked) -> Figure:
    """For the collection of figures."""
    if all(axis.is_linear for axis in asked.solution.machine.axes):
        raise NothingToDrawError("the machine has no rotary axes")
    return location_errors(asked.solution, texts=asked.texts)
