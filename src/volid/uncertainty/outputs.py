"""The quantities that users ask for, as functions of the parameters: location errors, error motions, the working volume."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from volid.backend.even_points import evenly
from volid.backend.rms import rms
from volid.fitting.prediction.deviations import deviation_values, gradient_matrix
from volid.fitting.prediction.largest import values_at, with_largest
from volid.fitting.solution import Solution
from volid.model.axis_lines import LineRow, constant_rows
from volid.model.iso230 import parse

POSITIONS = 7  # of every error motion


@dataclass(frozen=True, eq=False)
class Outputs:
    """q outputs: linear ones, then those of the deviation field.

    `names`, `units` (mm or rad), `positions` (NaN for constants): one entry each. `rows`: (l, p) linear outputs. `field`:
    (3 P, p) gradient of the deviation at P points, `offset` (3 P,) with deviation = offset + field · x; empty without a field.
    The first `n_even` points are spread evenly, for the RMS; the others are where something is largest. `scatter`: (l,), standard
    deviation of what is independent from position to position, beside x; `directions` (3,): the same of the deviation [mm].
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    positions: np.ndarray
    rows: np.ndarray
    field: np.ndarray
    offset: np.ndarray
    scatter: np.ndarray
    directions: np.ndarray
    n_even: int

    def values(self, x: np.ndarray) -> np.ndarray:
        """Outputs of parameters x, (b, p) -> (b, q). The field's outputs: largest and RMS length, and three ranges."""
        return np.concatenate([x @ self.rows.T, self.field_values(x)], axis=1)

    def field_values(self, x: np.ndarray, rng: np.random.Generator | None = None) -> np.ndarray:
        """The field's outputs of parameters x, (b, p) -> (b, 5), or (b, 0) without a field; `rng` draws the scatter."""
        if not len(self.field):
            return np.zeros((len(x), 0))
        vectors = (self.offset + x @ self.field.T).reshape(len(x), -1, 3)
        if rng is not None and np.any(self.directions > 0.0):
            vectors = vectors + self.directions * rng.standard_normal(vectors.shape)
        size = np.linalg.norm(vectors, axis=2)
        return np.column_stack([size.max(axis=1), rms(size[:, : self.n_even], axis=1), np.ptp(vectors, axis=1)])


FIELD = ("largest deviation", "RMS deviation", "V_X", "V_Y", "V_Z")


def headline_outputs(solution: Solution, tool: np.ndarray | None = None) -> Outputs:
    """Constants, every error motion at `POSITIONS` places, and the deviation field for one tool vector.

    Location errors are those of the axis average lines; a carried axis has them relative to its carrier too, as EX(0A)C. What the
    data do not determine is left out. `tool`: (3,) [mm], the first set's first one by default.
    """
    if tool is not None:
        solution.ask(tool)
    names, units, positions, scatter, rows = [], [], [], [], []
    for name, symbol, at, values in _linear(solution):
        kept = ~solution.is_not_determined(values) & (name not in solution.held_tool_rotation)
        number = int(kept.sum())
        rows += list(values[kept])
        names += [symbol] * number
        units += [parse(name).unit] * number
        positions += at[kept].tolist()
        scatter += [solution.scatter_of(name)] * number
    n, k = solution.model.n_parameters, len(solution.nuisance_table)
    matrix = np.pad(np.array(rows).reshape(-1, n), ((0, 0), (0, k)))
    field, offset, n_even = _field(solution, tool)
    if len(field):
        names, units, positions = names + list(FIELD), units + ["mm"] * len(FIELD), positions + [np.nan] * len(FIELD)
    directions, sizes = solution.scatter_u()[:3], np.array(scatter, dtype=float)
    return Outputs(tuple(names), tuple(units), np.array(positions), matrix, field, offset, sizes, directions, n_even)


def _linear(solution: Solution) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Name, symbol, positions (m,) and rows (m, n) of every error motion and of every constant, in the order of the model."""
    constants: dict[str, list[LineRow]] = {}
    for line in constant_rows(solution.model):
        constants.setdefault(line.name, []).append(line)
    for name in solution.model.names:
        for line in constants.get(name, ()):
            yield name, line.symbol, np.array([np.nan]), line.row[None]
        if name not in constants:
            at = evenly(*solution.machine.axis(parse(name).axis).travel, POSITIONS)
            yield name, name, at, solution.motion_rows(name, at, 0)


def _field(solution: Solution, tool: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, int]:
    """Gradient (3 P, p), offset (3 P,) of the deviation in the working volume, and how many points are even; empty when it is not
    determined."""
    vector = solution.campaign.sets[0].tool[0] if tool is None else np.asarray(tool, dtype=float)
    places = with_largest(solution, vector)
    positions, still, count = places.positions, places.directions, len(places.positions)
    tools = np.broadcast_to(vector, (count, 3))
    if not np.isfinite(values_at(solution, places, vector)[:, :3]).all():
        p = len(solution.parameters) + len(solution.nuisance_table)
        return np.zeros((0, p)), np.zeros(0), 0
    theta = np.asarray(solution.parameters)
    values = deviation_values(solution.model, theta, positions, tools, still)[:, :3]
    gradient = gradient_matrix(solution.model, theta, positions, tools, still)[:, :3].reshape(3 * count, -1)
    offset = values.ravel() - gradient @ theta
    return np.pad(gradient, ((0, 0), (0, len(solution.nuisance_table)))), offset, len(positions[places.even])
