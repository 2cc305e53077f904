"""Gauss-Newton with few assemblies: chord steps with the exact gradient in between, damping only when a step fails.

Solves min |r(z0 + P y)|² / 2. JᵀJ costs six times a gradient and more, and near the minimum it hardly changes. So a factorisation
is kept as long as the steps it proposes shrink fast; every step takes the exact gradient, so the minimum is that of Gauss-Newton.
Steps solve the Jacobi-scaled normal equations by Cholesky factorisation, with Levenberg-Marquardt damping λ = 0 until a step
does not descend. Nocedal and Wright, Numerical Optimization, 10.3; Kelley, Iterative Methods, 5.4.1 (chord method).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from volid.backend.lazy import jax, jnp
from volid.backend.threads import one_blas_thread
from volid.fitting.equations.compiled import normal_equations, nuisance_equations, slope
from volid.fitting.equations.free_directions import FreeDirections
from volid.fitting.equations.interpreted import interpreting
from volid.fitting.equations.problem import Problem
from volid.fitting.equations.system import Normal, System, halves, thinned

TOLERANCE = 1e-7  # estimated distance to the minimum, in units of each parameter's conditional standard uncertainty
SHRINK = (
    0.03  # a chord step is taken when it is at most this share of the step before; slower ones cost more than they save
)
LARGEST_STEPS = 60
PLACING = 512  # readings of a block that place the nuisance parameters before all others move, or 8 for each of these
PLACING_STEPS = 6
LIGHT, HEAVY = 1e-6, 1e9  # damping that counts as none; damping at which nothing helps
SLACK = 1e-10  # relative and absolute rise of the cost that is rounding


class Optimum:
    """The minimum: `z`, `cost` = |r|²/2 there, number of steps `iterations`, and whether it `converged`.

    `normal`: the normal equations at z in y, assembled when they are first asked for: many fits need the minimum alone.
    """

    def __init__(self, objective: Objective, z: np.ndarray, cost: float, iterations: int, converged: bool) -> None:
        self._objective, self.z, self.cost = objective, z, cost
        self.iterations, self.converged = iterations, converged

    @cached_property
    def normal(self) -> Normal:
        """cost, gradient (n,) and JᵀJ (n, n) in the free directions."""
        return self._objective.normal(self.z)


class Objective:
    """Cost, gradient and JᵀJ in the free directions of a problem; large arrays are put where JAX computes, once."""

    def __init__(self, system: System, free: np.ndarray) -> None:
        self.system = system
        self.free = FreeDirections(free)
        self._parts = [system] if interpreting() else [jax.tree.map(jnp.asarray, s) for s in _shared_out(system)]

    def _sums(self, function: Callable[..., Any], *arguments: Any) -> list[np.ndarray]:
        """The parts of what `function` gives for the system, summed over its halves, each on a thread of its own."""

        def of(part: System) -> list[np.ndarray]:
            return [np.asarray(a) for a in function(part, *arguments)]

        if len(self._parts) == 1:
            return of(self._parts[0])
        first, second = _THREADS.map(of, self._parts)
        return [a + b for a, b in zip(first, second, strict=True)]

    def normal(self, z: np.ndarray, rough: bool = False) -> Normal:
        cost, gradient, matrix = self._sums(normal_equations, z, rough)
        gradient, matrix = self.free.pull(gradient), self.free.project(matrix)
        unused = np.flatnonzero(np.diagonal(matrix) == 0.0)
        matrix[unused, unused] = 1.0
        return Normal(float(cost), gradient, matrix)

    def slope(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        cost, gradient = self._sums(slope, z)
        return float(cost), self.free.pull(gradient)


_THREADS = ThreadPoolExecutor(2, thread_name_prefix="volid-solver")


def _shared_out(system: System) -> list[System]:
    """Halves of a system where two processors share the work and no accelerator does it."""
    alone = (os.cpu_count() or 1) < 2 or jax.default_backend() != "cpu"
    return [system] if alone else halves(system)


def _placed(system: System, z: np.ndarray, free: np.ndarray) -> np.ndarray:
    """`z` with the nuisance parameters at their own minimum, or nearly: stations millimetres off make the first JᵀJ a poor one.

    Only those that `free` moves one by one, and by some of the readings. Where a step fails, `z` as it was before.
    """
    n = system.layout.n_coefficients
    columns = free[:, ~free[:n].any(axis=0)][n:]
    if not columns.shape[1]:
        return z
    best, least, system = z, np.inf, thinned(system, max(PLACING, 8 * columns.shape[1]))
    for _ in range(PLACING_STEPS):
        normal = nuisance_equations(system, z)
        matrix = columns.T @ np.asarray(normal.matrix) @ columns
        step, size = _factorise(matrix, 0.0).propose(columns.T @ np.asarray(normal.gradient))
        if not float(normal.cost) <= least or not np.isfinite(size):
            break
        best, least = z, float(normal.cost)
        z = z.copy()
        z[n:] -= columns @ step
        if size <= 1.0:
            return z
    return best


class _Steps(NamedTuple):
    """Factorised, Jacobi-scaled JᵀJ + λ I; `factor` None when it is not positive definite."""

    scale: np.ndarray
    factor: Any

    def propose(self, gradient: np.ndarray) -> tuple[np.ndarray, float]:
        """Step in y, and its largest component in conditional standard uncertainties (inf when there is none)."""
        if self.factor is None or not np.all(np.isfinite(gradient)):
            return np.zeros_like(gradient), np.inf
        scaled = cho_solve(self.factor, self.scale * gradient, check_finite=False)
        return self.scale * scaled, float(np.max(np.abs(scaled), initial=0.0))


def _factorise(matrix: np.ndarray, damping: float) -> _Steps:
    diagonal = np.diagonal(matrix)
    if not np.all(np.isfinite(matrix)) or np.any(diagonal <= 0.0):
        return _Steps(np.ones(len(matrix)), None)
    scale = 1.0 / np.sqrt(diagonal)
    scaled = matrix * scale[:, None] * scale
    scaled[np.diag_indices_from(scaled)] += damping
    try:
        return _Steps(scale, cho_factor(scaled, lower=True, overwrite_a=True, check_finite=False))
    except np.linalg.LinAlgError:
        return _Steps(scale, None)


def optimum_at(
    problem: Problem, z: np.ndarray, cost: float, free: np.ndarray, iterations: int, converged: bool
) -> Optimum:
    """The optimum that another solver found, with its normal equations on demand."""
    return Optimum(Objective(problem.system, free), z, cost, iterations, converged)


@one_blas_thread()
def solve(
    problem: Problem,
    start: np.ndarray | None = None,
    free: np.ndarray | None = None,
    objective: Objective | None = None,
) -> Optimum:
    """Minimise over z = start + free · y from y = 0; `free` (size, n) defaults to all free directions of the problem.

    `objective`: what gives cost, gradient and JᵀJ, where that is not the problem's own readings.

    Without a `start`, nuisance parameters (stations, dead paths) first go to their own minimum. The first JᵀJ is formed in single
    precision; where its steps do not shrink fast, the next ones in double. `converged` is claimed when the estimated distance
    to the minimum is below `TOLERANCE` without damping: the last step times the share by which it shrank. Then the last step is
    taken without a look at where it ends; the cost there follows from the quadratic model.
    """
    z = np.array(problem.start if start is None else start, dtype=float)
    objective = objective or Objective(problem.system, problem.free if free is None else free)
    if start is None:
        z = _placed(objective.system, z, objective.free.whole)
    rough = True
    normal, age, damping, last = objective.normal(z, rough), 0, 0.0, np.inf
    cost, gradient = float(normal.cost), normal.gradient
    steps = _factorise(normal.matrix, damping)
    for count in range(1, LARGEST_STEPS + 1):
        step, size = steps.propose(gradient)
        if (age and size > SHRINK * last and size > TOLERANCE) or (rough and not np.isfinite(size)):
            rough = rough and not age
            normal, age = objective.normal(z, rough), 0
            steps = _factorise(normal.matrix, damping)
            step, size = steps.propose(gradient)
        shrunk = min(1.0, size / last) if 0.0 < last < np.inf else 1.0
        light = damping <= LIGHT
        if light and age and size * shrunk <= TOLERANCE:
            cost = max(0.0, cost - 0.5 * float(gradient @ step))
            return Optimum(objective, objective.free.move(z, step), cost, count, True)
        trial = objective.free.move(z, step)
        new_cost, new_gradient = objective.slope(trial) if np.isfinite(size) else (np.inf, gradient)
        if not new_cost <= cost * (1.0 + SLACK) + SLACK:
            damping = max(10.0 * damping, LIGHT)
            if damping > HEAVY or not np.isfinite(cost):
                return Optimum(objective, z, cost, count, False)
            if age or rough:
                rough = False
                normal, age = objective.normal(z), 0
            steps = _factorise(normal.matrix, damping)
            continue
        z, cost, gradient, last, age = trial, new_cost, new_gradient, size, age + 1
        if light and size * shrunk <= TOLERANCE:
            return Optimum(objective, z, cost, count, True)
        if not light:
            damping, last = 0.1 * damping, np.inf
            normal, age = objective.normal(z, rough), 0
            steps = _factorise(normal.matrix, damping)
        damping = 0.0 if damping < LIGHT else damping
    return Optimum(objective, z, cost, LARGEST_STEPS, False)
