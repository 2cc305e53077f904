"""What compensation types leave of the deviation, side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from volid.compensation.base import base_of
from volid.compensation.residual.fields import LENGTHS, QUANTITIES
from volid.compensation.residual.forecast import Forecast, forecast
from volid.report.plot.asked import Asked
from volid.report.plot.palette import SERIES
from volid.report.plot.panels import figure_with_panels
from volid.report.text.basics import vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_DRAWN = 3  # tool vectors in a figure


def forecast_figure(found: Forecast, machine_name: str) -> Figure:
    """Largest and RMS length and the orientation after each type, with 95 % intervals, for the first tool vector; lengths by tool
    vector when there are several. Needs matplotlib."""
    figure, (left, right) = figure_with_panels(1, 2, figsize=(11, 4.4), width_ratios=(3, 2))
    names = [c.name for c in found.columns]
    x = np.arange(len(names))
    _draw_lengths(left, found, x)
    _draw_orientations(right, found, x)
    for panel in (left, right):
        panel.set_xticks(x, [n.replace(" + ", "\n+ ") for n in names], fontsize=7, rotation=0 if len(names) < 7 else 60)
        panel.grid(axis="y", color="0.9")
    figure.suptitle(f"{machine_name}: what each compensation type leaves (95 % intervals)", fontsize=11)
    return figure


def _draw_lengths(panel: Any, found: Forecast, x: np.ndarray) -> None:
    """Largest and RMS length after each type, with intervals, for every tool vector."""
    for k, colour in ((0, SERIES[0]), (2, SERIES[2])):
        for i, tool in enumerate(found.tools[:MOST_DRAWN]):
            p = [c.predictions[i] for c in found.columns]
            value = 1e3 * np.array([v.value[k] for v in p])
            span = np.abs(1e3 * np.array([[v.low[k] for v in p], [v.high[k] for v in p]]) - value)
            style = {"fmt": "o" if i == 0 else "s", "color": colour, "alpha": 1 / (1 + 0.5 * i), "capsize": 3}
            shift = 0.12 * (i - 0.5 * (min(len(found.tools), MOST_DRAWN) - 1))
            label = f"{LENGTHS[k]}, tool {vector(tool.tolist())} mm"
            panel.errorbar(x + shift, value, yerr=span, label=label, **style)
    panel.set_yscale("log")
    panel.tick_params(axis="y", which="both", labelsize=8)
    panel.yaxis.set_major_formatter("{x:g}")
    panel.yaxis.set_minor_formatter("{x:g}")
    panel.set_ylabel("remaining deviation / µm")
    panel.legend(fontsize=8, frameon=False)


def _draw_orientations(panel: Any, found: Forecast, x: np.ndarray) -> None:
    """Largest orientation errors after each type, for the first tool vector."""
    for k, colour in zip(range(len(LENGTHS), len(QUANTITIES)), SERIES[:4], strict=True):
        value = 1e6 * np.array([c.predictions[0].value[k] for c in found.columns])
        panel.plot(x, value, "o", color=colour, label=QUANTITIES[k])
    panel.set_ylabel("largest orientation error / µrad")
    panel.legend(fontsize=8, frameon=False)


def draw(asked: Asked) -> Figure:
    """For the collection of figures: types that add up, for the tool vector alone."""
    solution = asked.solution
    base = base_of(solution, tool=asked.tool)
    types = [[name] for name in ("L-POS", "L-VOL")]
    found = forecast(solution, types, base, np.array([asked.tool]), every_tool=False)
    return forecast_figure(found, solution.machine.name)
