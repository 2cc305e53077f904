"""Monte Carlo beside propagation: coverage bands of functions, and distributions of what is not linear."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.fitting.results import FunctionValue
from volid.fitting.solution import Solution
from volid.model.iso230 import parse
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.palette import SERIES
from volid.report.plot.panels import figure_with_panels
from volid.uncertainty.coverage import coverage_intervals
from volid.uncertainty.intervals import function_intervals
from volid.uncertainty.outputs import FIELD, headline_outputs

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def coverage_bands(
    solution: Solution,
    names: Sequence[str],
    truth: Mapping[str, Callable[[np.ndarray], np.ndarray]] | None = None,
    points: int = 61,
) -> Figure:
    """Error motions minus their estimate: shortest 95 % intervals by Monte Carlo, ± 1.96 u by propagation, and the truth.

    Raises `ValueError` when the solution has no samples.
    """
    columns = min(3, len(names))
    figure, panels = figure_with_panels(
        -(-len(names) // columns), columns, figsize=(4.4 * columns, 2.6 * -(-len(names) // columns)), squeeze=False
    )
    for panel in panels.ravel()[len(names) :]:
        panel.set_visible(False)
    for panel, name in zip(panels.ravel(), names, strict=False):
        axis = solution.machine.axis(parse(name).axis)
        x = np.linspace(*axis.travel, points)
        rows = [r for r in solution.motion(name, x) if r.direction >= 0]
        _band(panel, solution, rows, x, (truth or {}).get(name))
        panel.set_xlabel(f"{axis.letter} / {axis.unit}")
        panel.set_title(name, fontsize=9, loc="left")
        panel.set_ylabel(f"deviation from estimate / {parse(name).report_unit}", fontsize=8)
    figure.legend(
        *panels[0][0].get_legend_handles_labels(), fontsize=8, frameon=False, loc="outside upper center", ncols=3
    )
    return figure


def _band(panel: Any, solution: Solution, rows: list[FunctionValue], x: np.ndarray, truth: Any) -> None:
    scale = 1e6 if parse(rows[0].name).is_rotation else 1e3
    value, u = (np.array([getattr(r, key) for r in rows]) for key in ("value", "u"))
    found = function_intervals(solution, rows)
    low, high = scale * (found.shortest_low - value), scale * (found.shortest_high - value)
    panel.fill_between(x, low, high, color=SERIES[0], alpha=0.3, lw=0, label="Monte Carlo, shortest 95 %")
    for sign in (-1.96, 1.96):
        label = "propagation, ± 1.96 u" if sign < 0 else None
        panel.plot(x, sign * scale * u, color=SERIES[1], lw=1.0, label=label)
    if truth is not None:
        panel.plot(x, scale * (truth(x) - value), color="black", lw=1.0, ls="--", label="truth")
    panel.axhline(0.0, color="0.7", lw=0.8)


def volume_distribution(solution: Solution, tool: Sequence[float]) -> Figure:
    """Histograms of the deviation field's numbers from the samples, with 95 % intervals: largest, RMS, ranges.

    Raises `ValueError` when the solution has no samples, or the field is not determined for `tool` [mm].
    """
    outputs = headline_outputs(solution, np.asarray(tool, dtype=float))
    if solution.samples is None or not len(outputs.field):
        raise ValueError("no samples, or a deviation field that is not determined for this tool vector")
    values = 1e3 * solution.samples.outputs(outputs.field_values)
    centre = np.concatenate([np.asarray(solution.parameters), np.asarray(solution.nuisance)])
    estimate = 1e3 * outputs.field_values(centre[None])[0]
    found = coverage_intervals(values)
    figure, panels = figure_with_panels(1, len(FIELD), figsize=(15, 2.9))
    for k, (panel, name) in enumerate(zip(panels, FIELD, strict=True)):
        panel.hist(values[:, k], bins=60, color=SERIES[0], alpha=0.45, density=True)
        panel.axvline(estimate[k], color="black", lw=1.2, label="estimate")
        for end, label in ((found.shortest_low[k], "shortest 95 %"), (found.shortest_high[k], None)):
            panel.axvline(end, color=SERIES[1], lw=1.0, ls="--", label=label)
        panel.set_title(f"{name} / µm", fontsize=9, loc="left")
        panel.set_yticks([])
    panels[0].legend(fontsize=7, frameon=False)
    return figure


def draw(asked: Asked) -> Figure:
    """For the collection of figures."""
    if asked.solution.samples is None:
        raise NothingToDrawError("the solution has no samples of Monte Carlo refits (`volid.monte_carlo` makes them)")
    return volume_distribution(asked.solution, asked.tool)
