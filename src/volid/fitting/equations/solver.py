"""Gauss-Newton with few assemblies: chord steps with the exact gradient in between, damping only when a step fails.

Solves min |r(z0 + P y)|² / 2. JᵀJ costs six times a gradient and more, and near the minimum it hardly changes. So a factorisation
is kept as long as the steps it proposes shrink fast; every step takes the exact gradient, so the minimum is that of Gauss-Newton.
Steps solve the Jacobi-scaled normal equations by Cholesky factorisation, with Levenberg-Marquardt damping λ = 0 until a step
does not descend. Nocedal and Wright, Numerical Optimization, 10.3; Kelley, Iterative Methods, 5.4.1 (chord method).
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from volid.backend.threads import one_blas_thread
from volid.fitting.equations.engine import Equations
from volid.fitting.equations.free_directions import FreeDirections
from volid.fitting.equations.problem import Problem
from volid.fitting.equations.system import Normal, thinned

TOLERANCE = 1e-7  # estimated distance to the minimum, in units of each parameter's conditional standard uncertainty
SETTLED = 1e-7  # or that of every number that follows from the parameters, in units of its standard uncertainty
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
    """Cost, gradient and JᵀJ in the free directions of a problem."""

    def __init__(self, equations: Equations, free: np.ndarray) -> None:
        self.equations = equations
        self.free = FreeDirections(free)

    def full_normal(self, z: np.ndarray, rough: bool) -> Normal:
        """Cost, gradient and JᵀJ in z."""
        return self.equations.normal(z, rough)

    def full_slope(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """Cost and gradient in z."""
        return self.equations.slope(z)

    def normal(self, z: np.ndarray, rough: bool = False) -> Normal:
        """Cost, gradient (n,) and JᵀJ (n, n) in the free directions; 1 on the diagonal of what no reading sees."""
        cost, gradient, matrix = self.full_normal(z, rough)
        gradient, matrix = self.free.pull(gradient), self.free.project(matrix)
        unused = np.flatnonzero(np.diagonal(matrix) == 0.0)
        matrix[unused, unused] = 1.0
        return Normal(float(cost), gradient, matrix)

    def slope(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """Cost and gradient (n,)."""
        cost, gradient = self.full_slope(z)
        return float(cost), self.free.pull(gradient)


def _placed(equations: Equations, z: np.ndarray, free: np.ndarray) -> np.ndarray:
    """`z` with the nuisance parameters at their own minimum, or nearly: stations millimetres off make the first JᵀJ a poor one.

    Only those that `free` moves one by one, and by some of the readings. Where a step fails, `z` as it was before.
    """
    n = equations.system.layout.n_coefficients
    columns = free[:, ~free[:n].any(axis=0)][n:]
    if not columns.shape[1]:
        return z
    few = equations.engine.equations(thinned(equations.system, max(PLACING, 8 * columns.shape[1])))
    best, least = z, np.inf
    for _ in range(PLACING_STEPS):
        normal = few.nuisance(z)
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
    return Optimum(Objective(problem.equations, free), z, cost, iterations, converged)


class _Descent:
    """Where the iteration stands.

    `z`, `cost`, `gradient`: the best point so far. `steps`: the factorisation in use, `age` accepted steps old, of a JᵀJ in
    single precision when `rough`. `last`: size of the step before, inf when there is none to compare with.
    """

    def __init__(self, objective: Objective, z: np.ndarray) -> None:
        self.objective, self.z = objective, z
        self.rough, self.damping, self.last = True, 0.0, np.inf
        self._assemble()
        self.cost, self.gradient = float(self._normal.cost), self._normal.gradient

    def _assemble(self) -> None:
        self._normal, self.age = self.objective.normal(self.z, self.rough), 0
        self.steps = _factorise(self._normal.matrix, self.damping)

    @property
    def light(self) -> bool:
        """Whether the damping counts as none."""
        return self.damping <= LIGHT

    def propose(self) -> tuple[np.ndarray, float]:
        """The next step and its size; from a new JᵀJ where the steps of the old one do not shrink fast."""
        step, size = self.steps.propose(self.gradient)
        slow = self.age and size > SHRINK * self.last and size > TOLERANCE
        if slow or (self.rough and not np.isfinite(size)):
            self.rough = self.rough and not self.age
            self._assemble()
            step, size = self.steps.propose(self.gradient)
        return step, size

    def distance(self, size: float) -> float:
        """Estimated distance to the minimum after a step of this size: the step times the share by which it shrank."""
        return size * (min(1.0, size / self.last) if 0.0 < self.last < np.inf else 1.0)

    def settled(self, step: np.ndarray) -> bool:
        """Whether the step moves no linear combination of the parameters by more than `SETTLED` of its u: √(gᵀ H⁻¹ g).

        Parameters that are known only together may still move by more than their conditional u, which is rounding then. A
        JᵀJ in single precision that no step has proved cannot say so; one in double precision can, at a start that is the
        minimum already, where steps are rounding and never shrink.
        """
        decrement = float(self.gradient @ step)
        return (self.age > 0 or not self.rough) and 0.0 <= decrement <= SETTLED**2

    def descends(self, cost: float) -> bool:
        """Whether a trial's cost is no higher than the best, but for rounding."""
        return cost <= self.cost * (1.0 + SLACK) + SLACK

    def reject(self) -> bool:
        """Damp more; False when nothing helps."""
        self.damping = max(10.0 * self.damping, LIGHT)
        if self.damping > HEAVY or not np.isfinite(self.cost):
            return False
        if self.age or self.rough:
            self.rough = False
            self._assemble()
        else:
            self.steps = _factorise(self._normal.matrix, self.damping)
        return True

    def accept(self, trial: np.ndarray, cost: float, gradient: np.ndarray, size: float) -> None:
        """Go to the trial."""
        self.z, self.cost, self.gradient, self.last, self.age = trial, cost, gradient, size, self.age + 1

    def relax(self) -> None:
        """Damp less after a step that descended."""
        if not self.light:
            self.damping, self.last = 0.1 * self.damping, np.inf
            self._assemble()
        self.damping = 0.0 if self.damping < LIGHT else self.damping

    def optimum(self, count: int, converged: bool) -> Optimum:
        """The best point so far."""
        return Optimum(self.objective, self.z, self.cost, count, converged)


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
    objective = objective or Objective(problem.equations, problem.free if free is None else free)
    if start is None:
        z = _placed(problem.equations, z, objective.free.whole)
    at = _Descent(objective, z)
    for count in range(1, LARGEST_STEPS + 1):
        step, size = at.propose()
        close, settled, light = at.distance(size) <= TOLERANCE, at.settled(step), at.light
        trial = objective.free.move(at.z, step)
        if light and (settled or (at.age and close)):
            at.z, at.cost = trial, max(0.0, at.cost - 0.5 * float(at.gradient @ step))
            return at.optimum(count, True)
        cost, gradient = objective.slope(trial) if np.isfinite(size) else (np.inf, at.gradient)
        if not at.descends(cost):
            if not at.reject():
                return at.optimum(count, False)
            continue
        at.accept(trial, cost, gradient, size)
        if light and (close or settled):
            return at.optimum(count, True)
        at.relax()
    return at.optimum(LARGEST_STEPS, False)
