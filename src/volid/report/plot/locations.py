"""Location errors of the rotary axes as bars with U. Positions in µm, orientations in µrad."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.fitting.results import FunctionValue
from volid.fitting.solution import Solution
from volid.model.iso230 import ROTARY_AXES, parse
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.palette import SERIES
from volid.report.plot.panels import figure_with_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

K = 2.0


def location_errors(solution: Solution, truth: Mapping[str, float] | None = None) -> Figure:
    """Location errors of the rotary axes with bars of ± U (k = 2), positions and orientations in separate panels.

    They are those of the axis average lines in the machine frame, as `Solution.location` has them.

    `truth`: true values by symbol, likewise (`volid.model.axis_lines.line_values`). With it, panels below show the identified
    value minus `truth`, at a scale that shows the bars.
    """
    rows = [solution.location(n) for n in solution.model.names if parse(n).location and parse(n).axis in ROTARY_AXES]
    figure, panels = figure_with_panels(2 if truth else 1, 2, figsize=(10, 5.6 if truth else 3.2), squeeze=False)
    for column, rotation in zip(panels.T, (False, True), strict=True):
        shown = [r for r in rows if parse(r.name).is_rotation == rotation and np.isfinite(r.value)]
        _location_column(column, shown, truth, (1e6, "µrad") if rotation else (1e3, "µm"))
        column[0].set_title("orientations" if rotation else "positions", fontsize=9, loc="left", color="0.35")
    figure.suptitle(f"{solution.machine.name}: location errors with U (k = 2)")
    return figure


def _location_column(
    panels: Any, shown: list[FunctionValue], truth: Mapping[str, float] | None, unit: tuple[float, str]
) -> None:
    """Bars of location errors of one unit; with `truth`, below them identified minus true values."""
    x, (scale, name) = np.arange(len(shown)), unit
    value, u = (scale * np.array([getattr(r, key) for r in shown]) for key in ("value", "u"))
    panels[0].bar(x, value, yerr=K * u, color=SERIES[0], alpha=0.55, capsize=4, width=0.5, label="identified")
    panels[0].set_ylabel(name)
    if truth:
        true = scale * np.array([truth.get(r.name, np.nan) for r in shown])
        panels[0].plot(x, true, "_", color="black", ms=26, mew=1.6, label="truth")
        panels[0].legend(fontsize=8, frameon=False, markerscale=0.6)
        panels[1].errorbar(x, value - true, yerr=K * u, fmt="o", color=SERIES[0], capsize=4)
        panels[1].set_ylabel(f"identified − truth / {name}")
    for panel in panels:
        panel.axhline(0.0, color="0.6", lw=0.8)
        panel.set_xticks(x, [r.name for r in shown])
        panel.set_xlim(-0.6, len(shown) - 0.4)


def draw(asked: Asked) -> Figure:
    """For the collection of figures."""
    if all(axis.is_linear for axis in asked.solution.machine.axes):
        raise NothingToDrawError("the machine has no rotary axes")
    return location_errors(asked.solution)
