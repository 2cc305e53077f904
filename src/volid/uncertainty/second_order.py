"""Refits to second order: the correction of a linear refit by the curvature of every reading, in single precision.

A whitened reading depends on few error and nuisance values w. Around the solution, with δw of one trial and noise ε,

    r = -ε + aᵀδw + δwᵀH δw / 2,   ∂r/∂w = a + H δw   (a: gradient, H: Hessian of the whitened prediction in w),

so the gradient Jᵀr of that trial differs from the linear one, which is 0 after the linear step, by the sum over readings of

    a (δwᵀH δw / 2) + H δw (-ε + aᵀδw + δwᵀH δw / 2).

H is the same in all trials: the sums are products of small matrices for many trials at once, without the chain itself. The
correction is some 1e-4 of the linear step; single precision gives it to 1e-7 of that, and what is left out is of third order.
Griewank and Walther, Evaluating Derivatives, chapter 13 (derivatives of higher order); the method of refits is ours.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from volid.elementary import in_rows
from volid.error_model import Layout, error_rows, evaluate_bases
from volid.fitting.system import Block, System
from volid.observations.effects import predict_readings

LARGEST = 512 * 2**20  # bytes of Hessians that are kept
ROWS, TRIALS = 64, 256  # of one tile: its values stay in the processor's cache
SINGLE = jnp.float32


class Curvature(eqx.Module):
    """Readings of one block by tiles of rows; every array begins with the number of tiles.

    `bases`: of every run (R, size). `second` (k, R, d + 1, d): whitened Hessian and, as its last row, gradient in the d values
    that the block's readings depend on, first those of `rows` of the error values, then the slots. `slots` (s, R). `used`
    (k, R): 0 for padding and what is set aside. `numbers` (k, R), of readings.
    """

    rows: tuple[int, ...] = eqx.field(static=True)
    bases: list[Any]
    second: Any
    slots: Any
    used: Any
    numbers: Any


def hessian_bytes(system: System) -> int:
    """Memory for the Hessians of all readings."""
    d = [len(_rows(system.layout)) + b.slots.shape[1] for b in system.blocks]
    return sum(4 * n * (n + 1) * int(b.reading.size) for n, b in zip(d, system.blocks, strict=True))


def _rows(layout: Layout) -> tuple[int, ...]:
    return tuple(sorted({t.row for t in layout.terms}))


def curvatures(system: System, z: Any, numbers: list[Any]) -> list[Curvature]:
    """Curvature of every block at z; `numbers` (chunks, k, rows) of the readings."""
    return [_cut(_curvature(system, block, z), own) for block, own in zip(system.blocks, numbers, strict=True)]


@eqx.filter_jit
def _curvature(system: System, block: Block, z: Any) -> Curvature:
    layout, n, m = system.layout, system.layout.n_coefficients, block.q.shape[2]
    rows = _rows(layout)

    def of_chunk(chunk: Block) -> Any:
        bases = evaluate_bases(layout, chunk.q, chunk.direction)
        errors = error_rows(layout, z[:n], bases, m)
        start = (*(errors[r] for r in rows), *z[n + chunk.slots])
        split, d = len(rows), len(rows) + chunk.slots.shape[0]

        def whitened(w: tuple[Any, ...], k: int) -> Any:
            whole = list(errors)
            for r, value in zip(rows, w, strict=False):
                whole[r] = value
            parts = predict_readings(
                system.machine, block.form, chunk.q, tuple(chunk.tool), whole, w[split:], chunk.constants
            )
            return parts[k] * chunk.weight[k]

        def slope(w: tuple[Any, ...], k: int) -> Any:
            value, pull_back = jax.vjp(lambda w: whitened(w, k), w)
            return in_rows(pull_back(jnp.ones_like(value))[0], (m,))

        def column(j: Any, k: int) -> Any:
            direction = tuple(jnp.full(m, i == j, dtype=start[0].dtype) for i in range(d))
            return jax.jvp(lambda w: slope(w, k), (start,), (direction,))[1].astype(SINGLE)

        second = []
        for k in range(block.form.n_readings):
            hessian = jax.lax.map(lambda j, k=k: column(j, k), jnp.arange(d)).transpose(2, 0, 1)
            second.append(jnp.concatenate([hessian, slope(start, k).T.astype(SINGLE)[:, None]], axis=1))
        return [b.T.astype(SINGLE) for b in bases], jnp.stack(second)

    bases, second = jax.lax.map(of_chunk, block)
    used = (block.weight > 0.0).astype(SINGLE)
    return Curvature(rows, bases, second, block.slots, used, jnp.zeros(0))


def _cut(whole: Curvature, numbers: Any) -> Curvature:
    """Tiles of at most `ROWS` rows; those of padding alone left out."""
    rows = whole.slots.shape[2]
    each = next(r for r in range(min(ROWS, rows), 0, -1) if rows % r == 0)

    def tiles(a: Any, axis: int) -> np.ndarray:
        a = np.asarray(a)
        cut = a.reshape(*a.shape[:axis], rows // each, each, *a.shape[axis + 1 :])
        cut = np.moveaxis(cut, axis, 1)
        return cut.reshape(-1, *cut.shape[2:])

    used = tiles(whole.used, 2)
    kept = used.any(axis=(1, 2))
    arrays = {name: jnp.asarray(tiles(getattr(whole, name), 2)[kept]) for name in ("second", "slots")}
    bases = [jnp.asarray(tiles(b, 1)[kept]) for b in whole.bases]
    return Curvature(
        whole.rows, bases, used=jnp.asarray(used[kept]), numbers=jnp.asarray(tiles(numbers, 2)[kept]), **arrays
    )


def _values(layout: Layout, tile: Curvature, dz: Any, n: int) -> Any:
    """δw (R, d, T) from δz (size, T), single precision."""
    trials, shape = dz.shape[1], tile.slots.shape[1]
    found = dict.fromkeys(tile.rows)
    bases = dict(zip(layout.bases, tile.bases, strict=True))
    for run in layout.runs:
        size = run[0].basis.size
        own = dz[run[0].start : run[0].start + len(run) * size].reshape(len(run), size, trials)
        curves = bases[run[0].basis] @ own.transpose(1, 0, 2).reshape(size, -1)  # (R, terms * T)
        for i, term in enumerate(run):
            curve = term.sign * curves[:, i * trials : (i + 1) * trials]
            found[term.row] = curve if found[term.row] is None else found[term.row] + curve
    rows = [*(found[r] for r in tile.rows), *(dz[n + slot] for slot in tile.slots)]
    return jnp.stack(rows, axis=1) if rows else jnp.zeros((shape, 0, trials), SINGLE)


def _pulled(system: System, tile: Curvature, slopes: Any) -> Any:
    """Σ over the tile's rows of the chain rule from (R, d, T) to z: (size, T)."""
    layout, trials = system.layout, slopes.shape[2]
    bases = dict(zip(layout.bases, tile.bases, strict=True))
    place = {row: i for i, row in enumerate(tile.rows)}
    blocks = [jnp.zeros((0, trials), SINGLE)]
    for run in layout.runs:
        own = jnp.concatenate([term.sign * slopes[:, place[term.row]] for term in run], axis=1)  # (R, terms * T)
        whole = (bases[run[0].basis].T @ own).reshape(-1, len(run), trials)
        blocks.append(whole.transpose(1, 0, 2).reshape(-1, trials))
    extra = jnp.zeros((system.n_nuisance, trials), SINGLE)
    number = jnp.arange(system.n_nuisance)[:, None]
    for i, slot in enumerate(tile.slots):
        extra = extra + (number == slot).astype(SINGLE) @ slopes[:, len(tile.rows) + i]
    return jnp.concatenate([*blocks, extra])


@eqx.filter_jit
def second_order(system: System, blocks: list[Curvature], dz: Any, noise: Any) -> tuple[Any, Any]:
    """Second-order part of Jᵀr, (b, size), and |r|² of the readings, (b,).

    `dz` (b, size): linear step of every trial, b a multiple of the trials of a tile or less; `noise` (N, b), single precision.
    """
    n, b = system.layout.n_coefficients, dz.shape[0]
    trials = min(TRIALS, b)
    parts = dz.T.astype(SINGLE).reshape(system.size, -1, trials).transpose(1, 0, 2)

    def of_trials(part: Any) -> tuple[Any, Any]:
        own, number = part
        total = jnp.zeros((system.size, trials)), jnp.zeros(trials)
        eps = jax.lax.dynamic_slice_in_dim(noise, number * trials, trials, axis=1)
        for block in blocks:

            def add(total: Any, tile: Curvature) -> tuple[Any, None]:
                w = _values(system.layout, tile, own, n)
                slopes, square = jnp.zeros_like(w), jnp.zeros(trials)
                for k in range(tile.used.shape[0]):
                    found = tile.second[k] @ w  # Hessian and, as its last row, gradient
                    bent, along = found[:, :-1], found[:, -1]
                    quadratic = 0.5 * jnp.sum(bent * w, axis=1)
                    residual = (along - eps[tile.numbers[k]]) * tile.used[k][:, None] + quadratic
                    slopes = slopes + tile.second[k][:, -1, :, None] * quadratic[:, None] + bent * residual[:, None]
                    square = square + jnp.sum(residual**2, axis=0)
                return (total[0] + _pulled(system, tile, slopes), total[1] + square), None

            total, _ = jax.lax.scan(add, total, block)
        return total

    gradient, square = jax.lax.map(of_trials, (parts, jnp.arange(b // trials)))
    return gradient.transpose(0, 2, 1).reshape(b, -1), square.reshape(-1)
