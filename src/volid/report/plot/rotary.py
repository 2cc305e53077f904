"""Maps over the angles of two rotary axes: residuals, and rotary grids."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from volid.compensation.grids.grid import RotaryGrid
from volid.compensation.grids.rotary import rotary_grids
from volid.fitting.solution import Solution
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.panels import figure_with_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def angle_map(solution: Solution, number: int = 0, held_out: bool = True) -> Figure:
    """Residuals of a set over the angles of its two rotary axes: length of the residual vector, RMS over the readings there.

    `number`: of the set. `held_out`: predicted from all other rotary positions, else within the fit.
    """
    readings = solution.campaign.sets[number]
    source = solution.readings.held_out if held_out else solution.readings.residuals
    rotary = [i for i, axis in enumerate(solution.machine.axes) if not axis.is_linear][:2]
    angles, index = np.unique(np.round(readings.positions[:, rotary], 3), axis=0, return_inverse=True)
    square = np.sum(np.asarray(source[number]) ** 2, axis=1)
    count = np.bincount(index.ravel())
    size = 1e3 * np.sqrt(np.bincount(index.ravel(), weights=square) / count)
    figure, panel = figure_with_panels(1, 1, figsize=(9, 3.8))
    first, second = (solution.machine.axes[i] for i in rotary)
    spots = panel.scatter(*angles.T, c=size, s=90, marker="s", cmap="viridis", vmin=0.0)
    panel.set_xlabel(f"{first.letter} / °")
    panel.set_ylabel(f"{second.letter} / °")
    what = "residuals, each position predicted from the others" if held_out else "residuals of the fit"
    panel.set_title(f"set '{readings.name}': {what}", fontsize=9, loc="left")
    figure.colorbar(spots, ax=panel, label="RMS length / µm")
    return figure


def rotary_grid(grid: RotaryGrid) -> Figure:
    """The six components of a rotary spatial grid over its two axes, ERROR values, µm and µrad."""
    from matplotlib.ticker import MaxNLocator

    shape = tuple(len(n) for n in reversed(grid.nodes))
    figure, panels = figure_with_panels(2, 3, figsize=(13, 6.2), sharex=True, sharey=True)
    for k, panel in enumerate(panels.ravel()):
        scale, what, unit = (1e6, "rotation about", "µrad") if k >= 3 else (1e3, "translation in", "µm")
        values = scale * grid.values[:, k].reshape(shape)
        largest = float(np.nanmax(np.abs(values)))
        levels = MaxNLocator(nbins=20, symmetric=True).tick_values(-largest, largest)
        colours = panel.contourf(grid.nodes[1], grid.nodes[0], values.T, levels=levels, cmap="RdBu_r")
        figure.colorbar(colours, ax=panel, ticks=MaxNLocator(nbins=8, symmetric=True))
        panel.set_title(f"{what} {'XYZ'[k % 3]} / {unit}", fontsize=9, loc="left")
    for panel in panels[-1]:
        panel.set_xlabel(f"{grid.axes[1]} / °")
    for panel in panels[:, 0]:
        panel.set_ylabel(f"{grid.axes[0]} / °")
    point = ", ".join(f"{c:g}" for c in grid.reference_point)
    figure.suptitle(f"{grid.type}, {grid.side}: error of the point ({point}) mm in the {grid.frame} frame")
    return figure


def draw(asked: Asked) -> dict[str, Figure]:
    """For the collection of figures: the rotary grids of every side, and the residuals over the angles of each set."""
    if all(axis.is_linear for axis in asked.solution.machine.axes):
        raise NothingToDrawError("the machine has no rotary axes")
    grids = rotary_grids(asked.solution, points=37)
    return {grid.side: rotary_grid(grid) for grid in grids}
