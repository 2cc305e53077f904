"""Error motions over their travels, with bands of U. Lengths in µm, rotations in µrad, positions in mm or degrees."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.fitting.solution import Solution
from volid.model.iso230 import DIRECTIONS, describe, motion, parse
from volid.report.plot.asked import Asked
from volid.report.plot.palette import ATTENTION, SERIES
from volid.report.plot.panels import figure_with_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

K = 2.0


def error_functions(
    solution: Solution, truth: Mapping[str, Callable[[np.ndarray], np.ndarray]] | None = None, axes: str = "XYZ"
) -> Figure:
    """All error motions of `axes` over their positions with bands of ± U (k = 2).

    `truth` adds known functions, position [mm or degrees] -> mm or rad. `axes`: letters; those the machine lacks do not count.
    """
    shown = sorted((a for a in solution.machine.axes if a.letter in axes), key=lambda a: DIRECTIONS.index(a.letter))
    figure, panels = figure_with_panels(
        len(DIRECTIONS), len(shown), figsize=(4.2 * len(shown), 11), squeeze=False, sharex="col"
    )
    for column, axis in enumerate(shown):
        for row, direction in enumerate(DIRECTIONS):
            _function_panel(panels[row][column], solution, motion(direction, axis.letter), truth or {})
        panels[-1][column].set_xlabel(f"{axis.letter} position / {axis.unit}")
    figure.suptitle(f"{solution.machine.name}: error motions with U (k = 2)")
    return figure


def _function_panel(panel: Any, solution: Solution, name: str, truth: Mapping[str, Any]) -> None:
    panel.axhline(0.0, color="0.8", lw=0.8)
    error = parse(name)
    panel.set_ylabel(f"{name} / {error.report_unit}")
    panel.set_title(describe(name), fontsize=8, loc="left", color="0.35")
    if (name, "mean") not in solution.model.by_name:
        panel.text(0.5, 0.5, "not in the model", transform=panel.transAxes, ha="center", color="0.5", fontsize=8)
        return
    x = np.linspace(*solution.machine.axis(error.axis).travel, 201)
    rows, scale = solution.motion(name, x), 1e6 if error.is_rotation else 1e3
    for direction, colour in zip((0, 1, -1), SERIES, strict=False):
        in_direction = [r for r in rows if r.direction == direction]
        if in_direction:
            value, u = (scale * np.array([getattr(r, key) for r in in_direction]) for key in ("value", "u"))
            label = {0: None, 1: "approached in +", -1: "approached in -"}[direction]
            panel.fill_between(x, value - K * u, value + K * u, color=colour, alpha=0.25, lw=0)
            panel.plot(x, value, color=colour, lw=1.4, label=label)
    if not np.isfinite([r.value for r in rows]).any():
        panel.text(0.5, 0.5, "not determined", transform=panel.transAxes, ha="center", color=ATTENTION, fontsize=8)
    if name in truth:
        panel.plot(x, scale * truth[name](x), color="black", lw=0.9, ls="--", label="truth")
    if panel.get_legend_handles_labels()[0]:
        panel.legend(fontsize=7, frameon=False)


def draw(asked: Asked) -> Figure:
    """For the collection of figures."""
    return error_functions(asked.solution, axes="".join(DIRECTIONS))
