"""Reversal in spatial grids: they have one value per node, whatever the approach direction."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from volid.compensation.grids.grid import AnyGrid
from volid.compensation.grids.sides import part_letters
from volid.fitting.solution import Solution
from volid.model.iso230 import parse

NONE = "none: the model has no reversal"
DENSE = 201  # positions per axis at which the largest reversal is looked for


def left_reversal(solution: Solution, letters: Collection[str]) -> dict[str, float]:
    """Largest |B|/2 over the travel of every function of the axes `letters` that has reversal [mm or rad].

    E(q, ±) = E(q) ± B(q)/2 (CONVENTIONS 3): the mean of both directions leaves half the reversal, with either sign. Cross
    effects are evaluated with the other axis at its reference.
    """
    theta, found = np.asarray(solution.parameters), {}
    for name in dict.fromkeys(f.name for f in solution.model.functions if f.part == "reversal"):
        axis = solution.machine.axis(parse(name).axis)
        if axis.letter in letters:
            q = np.linspace(*axis.travel, DENSE)
            up, down = (solution.motion_rows(name, q, way) @ theta for way in (1, -1))
            found[name] = float(np.abs(up - down).max() / 2.0)
    return found


def reversal_text(solution: Solution, grid: AnyGrid) -> str:
    """How the grid treats reversal and what remains of it, in words; `NONE` when its axes have no reversal."""
    halves = left_reversal(solution, part_letters(solution.machine, grid.side))
    if not halves:
        return NONE
    each = ", ".join(
        f"{name} {1e6 * v:.2f} µrad" if parse(name).is_rotation else f"{name} {1e3 * v:.2f} µm"
        for name, v in halves.items()
    )
    return (
        f"mean of both approach directions; half the reversal is left in either direction, at most {each}; error tables hold "
        "both directions"
    )
