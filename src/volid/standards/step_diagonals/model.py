"""The nine functions beside what the full kinematic model finds in the same readings.

The model has rotations of all axes and a tilted mirror on every diagonal, and says of each deviation whether the readings
determine it; the separation of the nine takes both for zero. Compared are deviations of the functional point along the three
lines through the middle of the steps' box, from their first node on, and their shapes alone, the least-squares line of each
removed, because the slopes are what tilted mirrors leave open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from volid.fitting.prediction.deviations import gradient_matrix
from volid.fitting.prediction.spread import linear_uncertainty
from volid.fitting.solution import Solution
from volid.model.iso230 import LINEAR_AXES
from volid.standards.results import Section
from volid.standards.step_diagonals.separation import NAMES, NineFunctions
from volid.standards.step_diagonals.steps import middle_lines

COLUMNS = (
    "function",
    "range of the nine",
    *("difference", "u there", "determined"),
    *("shape: difference", "u there", "determined"),
)


class Curve(NamedTuple):
    """One function by the nine and by the model, and u of the latter; NaN where not determined, (n + 1,) each [mm]."""

    nine: np.ndarray
    model: np.ndarray
    u: np.ndarray

    def compared(self) -> tuple[float, float, str]:
        """The largest difference and u there [mm], NaN where nothing is determined; positions that are."""
        known = np.flatnonzero(np.isfinite(self.model))
        share = f"{len(known)} of {len(self.model)}"
        if not len(known):
            return np.nan, np.nan, share
        at = known[np.argmax(np.abs(self.nine - self.model)[known])]
        return float(abs(self.nine[at] - self.model[at])), float(self.u[at]), share


@dataclass(frozen=True, eq=False)
class ByModel:
    """Functions and their shapes by name, such as "Dx(x)", as the nine and a solution have them."""

    functions: dict[str, Curve]
    shapes: dict[str, Curve]

    def section(self) -> Section:
        """Range of each function by the nine, largest difference and u there [mm], at how many positions; then of shapes."""
        rows = tuple(
            (name, float(np.ptp(f.nine)), *f.compared(), *self.shapes[name].compared())
            for name, f in self.functions.items()
        )
        return Section("model", "beside the full model", COLUMNS, rows)


def by_model(nine: NineFunctions, solution: Solution) -> ByModel:
    """What a solution says of the lines of the nine functions.

    Args:
        nine: The nine functions.
        solution: A fit of the same readings, or of others of this machine.
    """
    tool, functions, shapes = nine.steps.observations.tool[:1], {}, {}
    for axis in range(len(LINEAR_AXES)):
        q, x = middle_lines(nine.steps, axis), nine.steps.nodes[axis]
        points = q, np.repeat(tool, len(q), axis=0), np.zeros_like(q)
        rows = gradient_matrix(solution.model, np.asarray(solution.parameters), *points)[:, :3]
        line = np.stack([np.ones_like(x), x - x.mean()], axis=1)
        without = np.eye(len(x)) - line @ np.linalg.pinv(line)
        for c in range(3):
            name, own = NAMES[3 * axis + c], nine.values[axis][:, c]
            functions[name] = _curve(own, rows[:, c] - rows[0, c], solution)
            shapes[name] = _curve(without @ own, without @ rows[:, c], solution)
    return ByModel(functions, shapes)


def _curve(own: np.ndarray, rows: np.ndarray, solution: Solution) -> Curve:
    unknown = solution.is_not_determined(rows) | ~rows.any(axis=1)
    values, u = rows @ np.asarray(solution.parameters), linear_uncertainty(rows, solution.parameter_covariance)
    return Curve(own, np.where(unknown, np.nan, values), np.where(unknown, np.nan, u))
