"""Coverage intervals of grid values, from the Monte Carlo samples of a solution (types L-VOL and R-VOL)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from volid.compensation.grids.linear import Grid
from volid.compensation.grids.parts import full_positions, part_letters, part_model, tool_reaching
from volid.compensation.grids.rotary import RotaryGrid
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.uncertainty.coverage import PROBABILITY
from volid.uncertainty.intervals import deviation_intervals

TYPES = ("L-VOL", "L-VOL+", "R-VOL", "R-VOL+")


def with_intervals(solution: Solution, grid: Grid | RotaryGrid, probability: float = PROBABILITY) -> Grid | RotaryGrid:
    """The grid with `bands` (4, n, 6): ends of the coverage intervals of its ERROR values, as of `Bands`, from the samples.

    Raises `InputError` when the solution has no samples, the type holds less than the whole error of its axes, or the values are
    known up to a rigid motion only.
    """
    if solution.samples is None:
        raise InputError(
            "coverage intervals need Monte Carlo samples; run volid uncertainty with -o first, and take its output"
        )
    if grid.type not in TYPES:
        raise InputError(
            f"coverage intervals are offered for {', '.join(TYPES)}, not for {grid.type}; u is in the grid"
        )
    if any("up to a rigid motion" in note for note in grid.notes):
        raise InputError("no coverage intervals: the values are known up to a rigid motion of the workpiece frame only")
    machine = solution.machine
    full = full_positions(machine, grid.axes, grid.positions)
    if isinstance(grid, RotaryGrid):
        letters = part_letters(machine, grid.side)
        tool = tool_reaching(machine, grid.side, full, np.array(grid.reference_point))
    else:
        letters = part_letters(machine, None)
        tool = np.tile(np.asarray(grid.tool, dtype=float), (len(full), 1))
    part = part_model(solution.model, letters)
    found = deviation_intervals(
        solution, grid.values, full, tool, np.zeros_like(full), part=part, probability=probability
    )
    return replace(grid, bands=np.stack(found))
