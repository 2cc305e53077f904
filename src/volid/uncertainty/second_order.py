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

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import register_dataclass

from volid.error_model import ROWS as ROWS_PER_BODY
from volid.error_model import Layout, add_curves, evaluate_bases
from volid.fitting import interpreted
from volid.fitting.system import Block, System
from volid.trees import STATIC

LARGEST = 512 * 2**20  # bytes of Hessians that are kept
SLICE = 4096  # rows whose second derivatives are formed at once
ROWS, TRIALS = 128, 128  # of one tile: its values stay in the processor's cache
SINGLE = jnp.float32
STEP = {"mm": 1.0, "rad": 1e-3}  # of the differences; everything else is as small as an angle


@register_dataclass
@dataclass(frozen=True, eq=False)
class Curvature:
    """Readings of one block by tiles of rows; every array begins with the number of tiles.

    `bases`: of every run (R, size). `second` (k, R, d + 1, d): whitened Hessian and, as its last row, gradient in the d values
    that the block's readings depend on, first those of `rows` of the error values, then the slots. `slots` (s, R). `used`
    (k, R): 0 for padding and what is set aside. `numbers` (k, R), of readings.
    """

    rows: tuple[int, ...] = field(metadata=STATIC)
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


def curvatures(system: System, z: np.ndarray, numbers: list[Any], units: list[str]) -> list[Curvature]:
    """Curvature of every block at z; `numbers` (chunks, k, rows) of the readings, `units` of the nuisance parameters."""
    z = np.asarray(z)
    return [_curvature(system, block, z, np.asarray(n), units) for block, n in zip(system.blocks, numbers, strict=True)]


def _curvature(system: System, block: Block, z: np.ndarray, numbers: np.ndarray, units: list[str]) -> Curvature:
    rows = _rows(system.layout)
    steps = [STEP["mm"] if row % ROWS_PER_BODY < 3 else STEP["rad"] for row in rows]
    steps += [STEP.get(units[number], STEP["rad"]) for number in np.asarray(block.slots)[0, :, 0].tolist()]
    whole = jax.tree.map(_joined, block)
    bases, second = [], []
    for start in range(0, whole.q.shape[2], SLICE):
        part = jax.tree.map(lambda a, start=start: a[:, :, start : start + SLICE], whole)
        (chunk,) = interpreted.chunks_of(part)
        bases.append([b.T.astype(np.float32) for b in evaluate_bases(system.layout, chunk.q, chunk.direction)])
        second.append(interpreted.second_derivatives(system, block.form, chunk, z, rows, np.array(steps)))
    length = block.q.shape[2]
    each = next(r for r in range(min(ROWS, length), 0, -1) if length % r == 0)
    used = (np.asarray(whole.weight[0]) > 0.0).astype(np.float32)
    kept = used.reshape(len(used), -1, each).any(axis=(0, 2))

    def tiles(values: np.ndarray, axis: int) -> Any:
        """Tiles of `each` rows, which stand along `axis`; those of padding alone left out."""
        cut = values.reshape(*values.shape[:axis], -1, each, *values.shape[axis + 1 :])
        return jnp.asarray(np.moveaxis(cut, axis, 0)[kept])

    return Curvature(
        rows,
        [tiles(np.concatenate([b[i] for b in bases]), 0) for i in range(len(bases[0]))],
        second=tiles(np.concatenate(second, axis=1), 1),
        slots=tiles(whole.slots[0], 1),
        used=tiles(used, 1),
        numbers=tiles(_joined(numbers)[0], 1),
    )


def _joined(values: Any) -> np.ndarray:
    """(chunks, width, rows) as one chunk."""
    values = np.asarray(values)
    chunks, width, rows = values.shape
    return values.transpose(1, 0, 2).reshape(1, width, chunks * rows)


def _values(layout: Layout, tile: Curvature, dz: Any, n: int) -> Any:
    """δw (R, d, T) from δz (size, T), single precision."""
    trials, m = dz.shape[1], tile.slots.shape[1]
    found: list[Any] = [None] * (ROWS_PER_BODY * (layout.n_axes + 1))
    bases = dict(zip(layout.bases, tile.bases, strict=True))
    for run in layout.runs:
        size = run[0].basis.size
        own = dz[run[0].start : run[0].start + len(run) * size].reshape(len(run), size, trials)
        curves = bases[run[0].basis] @ own.transpose(1, 0, 2).reshape(size, -1)  # (R, terms * T)
        add_curves(found, run, [curves[:, i * trials : (i + 1) * trials] for i in range(len(run))])
    rows = [*(found[r] for r in tile.rows), *(dz[n + slot] for slot in tile.slots)]
    return jnp.stack(rows, axis=1) if rows else jnp.zeros((m, 0, trials), SINGLE)


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


def second_order(system: System, blocks: list[Curvature], dz: Any, noise: Any) -> tuple[Any, Any]:
    """Second-order part of Jᵀr, (b, size), and of |r|², (b,).

    `dz` (b, size): step of every trial from z; `noise` (N, b), single precision. Values of b trials must fit into the cache.
    """
    n, b = system.layout.n_coefficients, dz.shape[0]
    own = dz.T.astype(SINGLE)
    total = jnp.zeros((system.size, b)), jnp.zeros(b)
    for block in blocks:

        def add(total: Any, tile: Curvature) -> tuple[Any, None]:
            w = _values(system.layout, tile, own, n)
            slopes, square = jnp.zeros_like(w), jnp.zeros(b)
            for k in range(tile.used.shape[0]):
                found = tile.second[k] @ w  # Hessian and, as its last row, gradient
                bent, along = found[:, :-1], found[:, -1]
                quadratic = 0.5 * jnp.sum(bent * w, axis=1)
                linear = (along - noise[tile.numbers[k]]) * tile.used[k][:, None]
                residual = linear + quadratic
                slopes = slopes + tile.second[k][:, -1, :, None] * quadratic[:, None] + bent * residual[:, None]
                square = square + jnp.sum((linear + residual) * quadratic, axis=0)
            return (total[0] + _pulled(system, tile, slopes), total[1] + square), None

        total, _ = jax.lax.scan(add, total, block)
    return total[0].T, total[1]
