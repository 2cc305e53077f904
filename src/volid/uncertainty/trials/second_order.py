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

import numpy as np

from volid.backend.lazy import jax, jnp
from volid.fitting.equations.system import System
from volid.uncertainty.trials.curvature import Curvature, Group

SINGLE = np.float32


def _by_groups(groups: tuple[Group, ...], dz: Any) -> list[Any]:
    """Coefficients (size, rows · T) of every group, from (n_coefficients or more, T)."""
    found = []
    for group in groups:
        steps_of_group = jnp.zeros((group.size, len(group.rows), dz.shape[1]), dz.dtype)
        for term, first, row in group.places:
            n = term.basis.size
            steps_of_group = steps_of_group.at[first : first + n, row].add(term.sign * dz[term.start : term.start + n])
        found.append(steps_of_group.reshape(group.size, -1))
    return found


def _from_groups(groups: tuple[Group, ...], parts: list[Any], total: Any) -> Any:
    """Adds the transpose of `_by_groups`, from (rows, size, T), to `total` (n_coefficients or more, T)."""
    for group, part in zip(groups, parts, strict=True):
        for term, first, row in group.places:
            n = term.basis.size
            total = total.at[term.start : term.start + n].add(term.sign * part[row, first : first + n])
    return total


def second_order(system: System, blocks: list[Curvature], dz: Any, noise: Any) -> tuple[Any, Any]:
    """Second-order part of Jᵀr, (b, size), and of |r|², (b,).

    `dz` (b, size): step of every trial from z; `noise` (N, b), single precision. Values of b trials must fit into the cache.
    """
    n, b = system.layout.n_coefficients, dz.shape[0]
    own = dz.T.astype(SINGLE)
    dz_nuisance = own[n:]
    total, square = jnp.zeros((system.size, b)), jnp.zeros(b)
    for block in blocks:
        coefficients = _by_groups(block.groups, own)

        def add(sums: Any, tile: Curvature, coefficients: list[Any] = coefficients) -> tuple[Any, None]:
            near = [_cut(*own) for own in zip(tile.groups, tile.spans, tile.starts, coefficients, strict=True)]
            pulled, extra, squares = _tile(tile, near, dz_nuisance, noise)
            parts = [_added(*own) for own in zip(tile.groups, tile.spans, tile.starts, sums[0], pulled, strict=True)]
            return (parts, sums[1] + extra, sums[2] + squares), None

        zero = [jnp.zeros((len(g.rows), g.size, b)) for g in block.groups]
        (parts, extra, square), _ = jax.lax.scan(add, (zero, jnp.zeros((system.n_nuisance, b)), square), block)
        total = _from_groups(block.groups, parts, total).at[n:].add(extra)
    return total.T, square


def _cut(group: Group, span: int, start: Any, values: Any) -> Any:
    """What of the group's coefficients (size, …) belongs to a tile's columns."""
    if group.spline is None or span == group.bases[0].size:
        return values
    window = jax.lax.dynamic_slice_in_dim(values, start, span)
    return jnp.concatenate([window, values[group.bases[0].size :]])


def _added(group: Group, span: int, start: Any, total: Any, part: Any) -> Any:
    """`total` (rows, size, T) with a tile's columns added to their places."""
    if group.spline is None or span == group.bases[0].size:
        return total + part
    near = jax.lax.dynamic_slice_in_dim(total, start, span, 1) + part[:, :span]
    total = jax.lax.dynamic_update_slice_in_dim(total, near, start, 1)
    return total.at[:, group.bases[0].size :].add(part[:, span:])


def _tile(tile: Curvature, coefficients: list[Any], nuisance: Any, noise: Any) -> tuple[list[Any], Any, Any]:
    """Sums over one tile: of every group (rows, size, T), of the nuisance parameters, and of |r|² (T,).

    Written for XLA on a CPU: the row of zeros below δw keeps Hessian and gradient in one array that needs no cutting, and slopes
    are made row by row where they are used.
    """
    count, trials = tile.used.shape[1], noise.shape[1]
    curves = [
        (values @ c).reshape(count, len(group.rows), trials)
        for group, values, c in zip(tile.groups, tile.bases, coefficients, strict=True)
    ]
    w = jnp.concatenate([*curves, nuisance[tile.slots], jnp.zeros((count, 1, trials), SINGLE)], axis=1)  # (R, d + 1, T)
    readings, squares = [], jnp.zeros(trials)
    for second, number, used in zip(tile.second, tile.numbers, tile.used, strict=True):
        curved = second @ w  # H δw and, as its last row, aᵀδw
        quadratic = 0.5 * jnp.sum(curved * w, axis=1)
        linear = (curved[:, -1] - noise[number]) * used[:, None]
        residual = linear + quadratic
        squares = squares + jnp.sum((linear + residual) * quadratic, axis=0)
        readings.append((second[:, -1], quadratic, curved, residual))

    def slopes(i: int) -> Any:
        return sum(a[:, i, None] * quadratic + curved[:, i] * residual for a, quadratic, curved, residual in readings)

    pulled, first = [], 0
    for group, values in zip(tile.groups, tile.bases, strict=True):
        own = jnp.stack([slopes(first + i) for i in range(len(group.rows))])
        back = jnp.broadcast_to(values.T[None], (len(group.rows), values.shape[1], count))
        pulled.append(back @ own)
        first += len(group.rows)
    if not tile.slots.shape[1]:
        return pulled, jnp.zeros((nuisance.shape[0], trials)), squares
    hot = tile.slots.T.reshape(-1)[None, :] == jnp.arange(nuisance.shape[0])[:, None]
    extra = jnp.concatenate([slopes(first + i) for i in range(tile.slots.shape[1])])
    return pulled, hot.astype(SINGLE) @ extra, squares
