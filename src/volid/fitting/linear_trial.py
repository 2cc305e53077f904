"""A campaign fitted once more, linearised and with few coefficients: for questions about its readings that need no new fit.

The model has the solution's functions with a few intervals, the machine is nominal, the other unknowns stand where the
solution has them. Readings are thinned. One least-squares step from there is exact to second order of the errors, which is enough
to tell readings that fit from such that do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from volid.campaign import Campaign
from volid.fitting.equations.choice import INTERPRETED, engine_named
from volid.fitting.equations.engine import Equations
from volid.fitting.equations.problem import build_problem
from volid.fitting.solution import Solution
from volid.model.error_model import ErrorModel, build_model

SEGMENTS = 12  # a smooth function is followed to some tenths of a good sensor's u
ROWS = 4000  # of all sets together
RANK = 1e-9  # of the largest singular value, columns scaled to one


class Trial(NamedTuple):
    """Whitened readings and predictions (m,), the set of each (-1: prior knowledge), and a basis (m, r) of what unknowns move."""

    readings: np.ndarray
    predictions: np.ndarray
    number: np.ndarray
    basis: np.ndarray

    @property
    def degrees_of_freedom(self) -> int:
        """Readings less unknowns."""
        return len(self.readings) - self.basis.shape[1]

    def chi_square(self, negated: Sequence[int] = ()) -> float:
        """Of the best fit, with the readings of some sets negated."""
        sign = np.where(np.isin(self.number, list(negated)), -1.0, 1.0)
        left = sign * self.readings - self.predictions
        left = left - self.basis @ (self.basis.T @ left)
        return float(left @ left)


def few_coefficients(solution: Solution, most: int = SEGMENTS) -> ErrorModel:
    """The solution's model with at most so many intervals for every function and axis."""
    segments = {name: tuple(min(n, most) for n in numbers) for name, numbers in solution.model.segments.items()}
    return build_model(solution.machine, segments, datum=solution.datum)


def thin(solution: Solution) -> Campaign:
    """The campaign with at most `ROWS` rows, spread evenly over every set, without what was set aside as outliers."""
    step = int(np.ceil(sum(len(s) for s in solution.campaign.sets) / ROWS))
    sets = []
    for s, outliers in zip(solution.campaign.sets, solution.readings.outliers, strict=True):
        sets.append(s.rows_of(np.flatnonzero(~outliers.any(axis=1))[::step]))
    return replace(solution.campaign, sets=tuple(sets))


def found_starts(solution: Solution) -> dict[Any, float]:
    """The other unknowns by key, where the solution has them."""
    values = np.asarray(solution.nuisance).tolist()
    return {entry.key: v for entry, v in zip(solution.nuisance_table, values, strict=True)}


def trial_of(solution: Solution) -> Trial:
    """The thinned campaign of a solution as a linear problem."""
    problem = build_problem(
        thin(solution), few_coefficients(solution), found_starts(solution), engine=engine_named(INTERPRETED)
    )
    system, z = problem.system, problem.start
    root, value = np.asarray(system.prior_root), np.asarray(system.prior_value)
    parts = _whitened(problem.equations, z)
    numbers = [np.full(len(r), n) for (n, _), (r, _, _) in zip(problem.places, parts, strict=True)]
    design = np.concatenate([*(d for _, _, d in parts), root]) @ problem.free
    return Trial(
        np.concatenate([*(r for r, _, _ in parts), value]),
        np.concatenate([*(p for _, p, _ in parts), root @ z]),
        np.concatenate([*numbers, np.full(len(value), -1)]),
        _basis(design),
    )


def _whitened(equations: Equations, z: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Readings (m,), predictions (m,) and Jacobian (m, size) of every block, divided by u, those with a weight."""
    found = []
    for block, predicted, rows in zip(
        equations.system.blocks, equations.predictions(z), equations.jacobian(z), strict=True
    ):
        weight = np.asarray(block.weight).ravel()
        seen = weight > 0.0
        readings, expected = (weight * np.asarray(v).ravel() for v in (block.reading, predicted))
        design = np.asarray(rows).transpose(0, 2, 1).reshape(len(weight), -1)
        found.append((readings[seen], expected[seen], design[seen]))
    return found


def _basis(design: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the columns of a long matrix, those that are nearly dependent left out."""
    scale = np.linalg.norm(design, axis=0)
    q, r = np.linalg.qr(design[:, scale > 0.0] / scale[scale > 0.0])
    left, sizes, _ = np.linalg.svd(r)
    return np.asarray(q @ left[:, : len(sizes)][:, sizes > RANK * max(float(sizes.max(initial=0.0)), 1e-300)])
