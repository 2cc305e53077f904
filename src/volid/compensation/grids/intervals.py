"""Coverage intervals of grid values, from the Monte Carlo samples of a solution (types L-VOL and R-VOL)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from volid.compensation.grids.grid import AnyGrid
from volid.compensation.grids.parts import part_model
from volid.compensation.grids.places import place_of
from volid.compensation.grids.request import ENTIRE
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.uncertainty.coverage import PROBABILITY
from volid.uncertainty.intervals import deviation_intervals


def with_intervals(solution: Solution, grid: AnyGrid, probability: float = PROBABILITY) -> AnyGrid:
    """The grid with `bands` (4, n, 6): ends of the coverage intervals of its ERROR values, as of `Bands`, from the samples.

    Raises `InputError` when the solution has no samples, the type holds less than the entire error of its axes, or the values are
    known up to a rigid motion only.
    """
    if solution.samples is None:
        raise InputError("coverage intervals need Monte Carlo samples; run `volid.monte_carlo` first")
    if grid.type not in ENTIRE:
        raise InputError(
            f"coverage intervals are offered for {', '.join(ENTIRE)}, not for {grid.type}; u is in the grid"
        )
    if any("up to a rigid motion" in note for note in grid.notes):
        raise InputError("no coverage intervals: the values are known up to a rigid motion of the workpiece frame only")
    place = place_of(solution.machine, grid)
    found = deviation_intervals(
        solution,
        grid.values,
        place.full,
        np.array(place.tool),
        np.zeros_like(place.full),
        part=part_model(solution.model, place.letters),
        probability=probability,
    )
    return replace(grid, bands=np.stack(found))
