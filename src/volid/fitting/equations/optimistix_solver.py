"""Gauss-Newton with the structured normal matrix, as an optimistix solver, damped only when a step fails.

Solves min |r(z0 + P y)|² / 2. One assembly of JᵀJ per iteration; the step solves the Jacobi-scaled normal equations by
Cholesky factorisation (Levenberg-Marquardt damping λ is 0 until a step does not descend). Nocedal and Wright, Numerical
Optimization, 10.3. `solver.solve` reaches the same minimum with fewer assemblies; this one is compiled as a whole and can stand
inside other JAX programs.
"""

from __future__ import annotations

from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx

from volid.fitting.equations.compiled import CompiledEquations
from volid.fitting.equations.problem import Problem
from volid.fitting.equations.programs import assemble
from volid.fitting.equations.solver import Optimum, optimum_at
from volid.fitting.equations.system import Normal, System
from volid.fitting.equations.tiles import Tiles

BUCKET = 32


class _Arguments(eqx.Module):
    system: System
    tiles: tuple[Tiles | None, ...]
    origin: Any
    free: Any


def _normal(y: Any, args: _Arguments) -> Normal:
    full = assemble(args.system, args.tiles, args.origin + args.free @ y)
    matrix = args.free.T @ (full.matrix @ args.free)
    unused = jnp.diagonal(matrix) == 0.0
    return Normal(full.cost, args.free.T @ full.gradient, matrix + jnp.diag(jnp.where(unused, 1.0, 0.0)))


def _cost(y: Any, args: _Arguments) -> Any:
    """The function that optimistix is given; the solver itself never calls it."""
    return y


class _State(eqx.Module):
    normal: Normal
    damping: Any
    step: Any
    done: Any
    failed: Any


class StructuredGaussNewton(optx.AbstractLeastSquaresSolver):
    """optimistix solver that takes cost, gradient and JᵀJ from `assemble` instead of materialising J.

    `tolerance`: largest step at convergence, in units of each parameter's conditional standard uncertainty.
    """

    tolerance: float = 1e-6
    rtol: float = 1e-12
    atol: float = 1e-12
    norm: Any = eqx.field(static=True, default=optx.max_norm)

    def init(self, fn: Any, y: Any, args: Any, options: Any, f_struct: Any, aux_struct: Any, tags: Any) -> _State:
        """A state whose first step is zero and descends, so that the program holds one assembly only."""
        no, n = jnp.array(False), y.shape[0]
        normal = Normal(jnp.array(jnp.inf), jnp.zeros(n), jnp.eye(n))
        return _State(normal, jnp.array(0.0), jnp.array(jnp.inf), no, no)

    def step(self, fn: Any, y: Any, args: Any, options: Any, state: _State, tags: Any) -> tuple[Any, _State, Any]:
        """One trial step, kept when it descends."""
        scale = 1.0 / jnp.sqrt(jnp.diagonal(state.normal.matrix))
        matrix = state.normal.matrix * scale[:, None] * scale[None, :]
        operator = lx.MatrixLinearOperator(matrix + state.damping * jnp.eye(len(scale)), lx.positive_semidefinite_tag)
        scaled = lx.linear_solve(operator, scale * state.normal.gradient, lx.Cholesky(), throw=False).value
        size = jnp.max(jnp.abs(scaled))
        trial = y - scale * scaled
        new = _normal(trial, args)
        first = jnp.isinf(state.normal.cost)
        accept = jnp.isfinite(size) & (new.cost <= state.normal.cost * (1.0 + 1e-10) + 1e-10)
        damping = jnp.where(
            accept,
            jnp.where(state.damping < 1e-9, 0.0, 0.1 * state.damping),
            jnp.maximum(10.0 * state.damping, 1e-6),
        )
        kept = jax.tree.map(lambda a, b: jnp.where(accept, a, b), (trial, new), (y, state.normal))
        done = accept & (size < self.tolerance) & (state.damping <= 1e-6) & ~first
        failed = damping > 1e9
        return kept[0], _State(kept[1], damping, size, done, failed), None

    def terminate(self, fn: Any, y: Any, args: Any, options: Any, state: _State, tags: Any) -> tuple[Any, Any]:
        """Stop at a small undamped step, or when no damping helps."""
        result = optx.RESULTS.where(state.failed, optx.RESULTS.nonlinear_divergence, optx.RESULTS.successful)
        return state.done | state.failed, result

    def postprocess(
        self, fn: Any, y: Any, aux: Any, args: Any, options: Any, state: _State, tags: Any, result: Any
    ) -> tuple[Any, Any, dict[str, Any]]:
        """Nothing to do; the last normal equations are in the state."""
        return y, aux, {}


@eqx.filter_jit
def _solve(args: _Arguments, y: Any, solver: StructuredGaussNewton) -> tuple[Any, Any, Any, Any]:
    found: Any = optx.least_squares(_cost, solver, y, args, max_steps=60, throw=False, adjoint=optx.ImplicitAdjoint())
    z = args.origin + args.free @ found.value
    return z, found.state.normal, found.stats["num_steps"], found.result == optx.RESULTS.successful


def solve_by_optimistix(problem: Problem, start: np.ndarray | None = None, free: np.ndarray | None = None) -> Optimum:
    """Minimise over z = start + free · y from y = 0 with `optimistix.least_squares`; as `solver.solve` otherwise.

    The equations of `problem` are those of the compiled engine (`choice.engine_for_compiled_solver`).
    The columns of `free` are padded with zeros to a multiple of 32, so that models of similar size share one program.
    """
    start = problem.start if start is None else start
    free = problem.free if free is None else free
    width = -(-free.shape[1] // BUCKET) * BUCKET
    padded = jnp.asarray(np.pad(free, ((0, 0), (0, width - free.shape[1]))))
    equations = cast(CompiledEquations, problem.equations)
    system, tiles = jax.tree.map(jnp.asarray, (equations.system, equations.tiles))
    args = _Arguments(system, tiles, jnp.asarray(start), padded)
    z, normal, iterations, converged = _solve(args, jnp.zeros(width), StructuredGaussNewton())
    return optimum_at(problem, np.asarray(z), float(normal.cost), free, int(iterations), bool(converged))
