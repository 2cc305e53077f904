"""The programs that refits of many trials are made of: linear step, second-order correction, step with the exact gradient.

All of them work on x relative to the solution x₀, trials first, and on what the trials share (`Frozen`); see `refit`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import gcd
from typing import Any

import numpy as np

from volid.backend.lazy import jax, jit, jnp
from volid.backend.pytrees import map_arrays, register_dataclass
from volid.effects.prediction import predict_readings
from volid.fitting.equations.programs import residual_rows
from volid.fitting.equations.system import Block, System
from volid.model.error_model import ROWS as ROWS_PER_BODY
from volid.model.error_model import Layout
from volid.model.error_values import add_curves, by_end, evaluate_bases, values_by_end
from volid.uncertainty.trials.curvature import Curvature
from volid.uncertainty.trials.second_order import second_order

ROWS, TRIALS = 256, 64  # of one tile: its intermediate values stay in the processor's cache


@register_dataclass
@dataclass(frozen=True, eq=False)
class Frozen:
    """What all trials share: system, z at the solution, T with z = T x, C, prior rows in x, predictions, reading numbers.

    `weighted` (p, N): TᵀJᵀ in the order of the readings, None where that is too large to keep; `aside`: numbers of the readings
    that are set aside.
    """

    system: System
    z: Any
    basis: Any
    covariance: Any
    prior: Any
    predictions: list[Any]
    numbers: list[Any]
    weighted: Any
    aside: Any


def tiles_of(block: Block, numbers: np.ndarray) -> tuple[Block, np.ndarray]:
    """A block and its reading numbers cut into equal chunks of at most `ROWS` rows, those of padding alone left out."""
    each = gcd(block.q.shape[2], ROWS)

    def cut(a: np.ndarray) -> np.ndarray:
        n, width, rows = a.shape
        parts = a.reshape(n, width, rows // each, each).transpose(0, 2, 1, 3)
        return parts.reshape(n * (rows // each), width, each)

    used = cut(np.asarray(block.weight)).any(axis=(1, 2))
    return map_arrays(lambda a: cut(np.asarray(a))[used], block), cut(numbers)[used]


@jit
def linear_step(frozen: Frozen, noise: Any, prior_noise: Any) -> tuple[Any, Any]:
    """C g with g = TᵀJᵀε + Wᵀε_p, shape (b, p), and chi-square |ε|² + |ε_p|² - gᵀC g of a linear model, (b,).

    `noise` (b, N), `prior_noise` (b, r).
    """
    if frozen.weighted is not None:
        gradient = (frozen.weighted @ noise.T).T
    else:
        total = jnp.zeros((noise.shape[0], frozen.system.size))
        for block, numbers in zip(frozen.system.blocks, frozen.numbers, strict=True):

            def add(total: Any, parts: Any, block: Block = block) -> tuple[Any, None]:
                chunk, own = parts
                _, rows = residual_rows(frozen.system, block.form, chunk, frozen.z)
                return total + noise[:, own.reshape(-1)] @ rows.T, None

            total, _ = jax.lax.scan(add, total, (block, numbers))
        gradient = total @ frozen.basis
    gradient = gradient + prior_noise @ frozen.prior
    step = gradient @ frozen.covariance
    square = jnp.einsum("bn,bn->b", noise, noise) - jnp.sum(noise[:, frozen.aside] ** 2, axis=1)
    square = square + jnp.sum(prior_noise**2, axis=1)
    return step, square - jnp.sum(gradient * step, axis=1)


@jit
def turned(noise: Any) -> Any:
    """Noise (b, N) by readings, (N, b), in single precision: enough for the second-order part."""
    return noise.T.astype(jnp.float32)


@jit
def corrected(frozen: Frozen, curvature: list[Curvature] | None, first: Any, x: Any, noise: Any) -> Any:
    """first - C g(x), with g the second-order part of the gradient at x, (b, p); and that part of chi-square, (b,)."""
    assert curvature is not None
    gradient, square = second_order(frozen.system, curvature, x @ frozen.basis.T, noise)
    return first - (gradient @ frozen.basis) @ frozen.covariance, square


def _tile_gradient(system: System, chunk: Block, exact: Any, noise: Any, z: Any) -> tuple[Any, Any]:
    """Gradient (trials, size) and chi-square (trials,) of one tile; `noise` (trials, k, rows), `z` (trials, size).

    Error values and nuisance values stand as one (trials, rows) array each, not as one large array: the reverse pass of indexing
    into that would add up as many padded arrays as it has rows.
    """
    layout, form, n = system.layout, chunk.form, system.layout.n_coefficients
    shape = (len(z), chunk.q.shape[1])
    bases = jax.lax.optimization_barrier(evaluate_bases(layout, chunk.q, chunk.direction))
    errors = jax.lax.optimization_barrier(_error_rows(layout, z[:, :n], bases, shape))
    slots = tuple(z[:, n:][:, number] for number in chunk.slots)

    def over_trials(values: Any) -> tuple[Any, ...]:
        return tuple(jnp.broadcast_to(v[None], shape) for v in values)

    q, tool, constants = (over_trials(v) for v in (chunk.q, chunk.tool, chunk.constants))

    def prediction(e: Any, s: Any) -> Any:
        return predict_readings(system.machine, form, q, tool, e, s, constants)

    value, pull_back = jax.vjp(prediction, errors, slots)
    weight = chunk.weight[:, None]
    residual = (value - exact[:, None]) * weight - jnp.where(weight > 0.0, noise.transpose(1, 0, 2), 0.0)
    residual, pull_back = jax.lax.optimization_barrier((residual, pull_back))
    d_errors, d_slots = jax.lax.optimization_barrier(pull_back(residual * weight))
    chi_square = jnp.sum(residual**2, axis=(0, 2))
    curves = _pull_to_coefficients(layout, d_errors, bases, len(z))
    if not system.n_nuisance:
        return curves, chi_square
    hot = (chunk.slots.reshape(-1)[:, None] == jnp.arange(system.n_nuisance)).astype(float)
    return jnp.concatenate([curves, jnp.concatenate(d_slots, axis=1) @ hot], axis=1), chi_square


def _error_rows(layout: Layout, coefficients: Any, bases: Any, shape: tuple[int, int]) -> tuple[Any, ...]:
    """Error values of every row of the layout as (trials, rows) arrays, from coefficients (trials, n)."""
    every: list[Any] = []
    for values in values_by_end(layout, bases):
        rows: list[Any] = [None] * (ROWS_PER_BODY * (layout.n_axes + 1))
        for run in layout.runs:
            last = run[-1].start + run[-1].basis.size
            own = coefficients[:, run[0].start : last].reshape(shape[0], len(run), -1).transpose(1, 0, 2)
            curves = own.reshape(len(run) * shape[0], -1) @ values[run[0].basis]
            add_curves(rows, run, curves.reshape(len(run), *shape))
        every += rows
    return tuple(jnp.zeros(shape) if row is None else row for row in every)


def _pull_to_coefficients(layout: Layout, partials: Any, bases: Any, trials: int) -> Any:
    """Chain rule from error rows to coefficients, summed over the tile's rows: (trials, n_coefficients)."""
    total: Any = 0.0
    for own, values in zip(by_end(layout, partials), values_by_end(layout, bases), strict=True):
        blocks = [jnp.zeros((trials, 0))]
        for run in layout.runs:
            stacked = jnp.concatenate([term.sign * own[term.row] for term in run])
            pulled = (stacked @ values[run[0].basis].T).reshape(len(run), trials, -1)
            blocks.append(pulled.transpose(1, 0, 2).reshape(trials, -1))
        total = total + jnp.concatenate(blocks, axis=1)
    return total


@jit
def exact_step(frozen: Frozen, x: Any, noise: Any, prior_noise: Any) -> tuple[Any, Any]:
    """One exact-gradient step of every trial: (new x - x₀ (b, p), chi-square before the step (b,)); `x` relative to x₀."""
    system = frozen.system
    trials = min(TRIALS, x.shape[0])

    def of_trials(parts: Any) -> tuple[Any, Any]:
        own, eps = parts
        z = frozen.z + own @ frozen.basis.T
        gradient, chi = jnp.zeros_like(z), jnp.zeros(len(own))
        for block, exact, numbers in zip(system.blocks, frozen.predictions, frozen.numbers, strict=True):

            def add(total: Any, tile: Any) -> tuple[Any, None]:
                chunk, predictions, number = tile
                g, c = _tile_gradient(system, chunk, predictions, eps[:, number], z)
                return (total[0] + g, total[1] + c), None

            (gradient, chi), _ = jax.lax.scan(add, (gradient, chi), (block, exact, numbers))
        return gradient, chi

    shape = (x.shape[0] // trials, trials, -1)
    gradient, chi = jax.lax.map(of_trials, (x.reshape(shape), noise.reshape(shape)))
    offset = x @ frozen.prior.T - prior_noise
    gradient = gradient.reshape(x.shape[0], -1) @ frozen.basis + offset @ frozen.prior
    return x - gradient @ frozen.covariance, chi.reshape(-1) + jnp.sum(offset**2, axis=1)
