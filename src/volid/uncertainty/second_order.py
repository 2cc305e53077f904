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

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from volid.error_model import ROWS as ROWS_PER_BODY
from volid.error_model import Layout, Term, evaluate_bases
from volid.fitting import interpreted
from volid.fitting.system import Block, System
from volid.lazy import jax, jnp
from volid.splines import Basis, Spline, spline_interval
from volid.trees import STATIC, map_arrays, register_dataclass

LARGEST = 512 * 2**20  # bytes of Hessians that are kept
SLICE = 4096  # rows whose second derivatives are formed at once
THREADS = 2
ROWS, TRIALS = 128, 128  # of one tile: its values stay in the processor's cache
SINGLE = np.float32
STEP = {"mm": 1e-4, "rad": 1e-7}  # of the differences; everything else is as small as an angle


class Group(NamedTuple):
    """Error values with the same splines: all of them come from one product, bases (R, size) times coefficients (size, rows · T).

    `bases`: all that any of the rows has. `places`: every term with its first column and its row.
    """

    rows: tuple[int, ...]
    bases: tuple[Basis, ...]
    places: tuple[tuple[Term, int, int], ...]

    @property
    def size(self) -> int:
        """Columns of the bases."""
        return sum(b.size for b in self.bases)

    @property
    def spline(self) -> Spline | None:
        """The spline that the first columns hold, where it is 0 outside a few of them; None without one."""
        first = self.bases[0]
        local = (
            len(first.factors) == 1 and first.linear is None and first.directed < 0 and not first.factors[0].periodic
        )
        return first.factors[0] if local else None


@lru_cache(maxsize=64)
def groups_of(layout: Layout) -> tuple[Group, ...]:
    """Groups of all rows of the error values that a layout has."""
    terms: dict[int, list[Term]] = {}
    for term in layout.terms:
        terms.setdefault(term.row, []).append(term)
    alike: dict[frozenset[Basis], list[int]] = {}
    for row, own in sorted(terms.items()):
        alike.setdefault(frozenset(t.basis for t in own if t.basis.size > 1), []).append(row)
    groups = []
    for rows in alike.values():
        bases = tuple(dict.fromkeys(t.basis for row in rows for t in terms[row]))
        first = dict(zip(bases, np.cumsum([0, *(b.size for b in bases)]).tolist(), strict=False))
        places = tuple((t, first[t.basis], i) for i, row in enumerate(rows) for t in terms[row])
        groups.append(Group(tuple(rows), bases, places))
    return tuple(groups)


@register_dataclass
@dataclass(frozen=True, eq=False)
class Curvature:
    """Readings of one block by tiles of rows; every array begins with the number of tiles.

    `groups` of error values, `bases`: of every group (R, width): its columns from `starts` (groups,) on, as many as `spans` says,
    of the spline that comes first, then the others. `second` (k, R, d + 1, d + 1): whitened Hessian and, as its last
    row, gradient in the d values that the block's readings depend on, first those of the groups, then the slots; its last column
    is 0. `slots` (R, s). `used` (k, R): 0 for padding and what is set aside. `numbers` (k, R), of readings.
    """

    groups: tuple[Group, ...] = field(metadata=STATIC)
    spans: tuple[int, ...] = field(metadata=STATIC)
    bases: list[Any]
    starts: Any
    second: Any
    slots: Any
    used: Any
    numbers: Any


def hessian_bytes(system: System) -> int:
    """Memory for the Hessians of all readings."""
    d = [len(_rows(system.layout)) + b.slots.shape[1] for b in system.blocks]
    return sum(4 * (n + 1) ** 2 * int(b.reading.size) for n, b in zip(d, system.blocks, strict=True))


def _rows(layout: Layout) -> tuple[int, ...]:
    return tuple(row for group in groups_of(layout) for row in group.rows)


def curvatures(system: System, z: np.ndarray, numbers: list[Any], units: list[str]) -> list[Curvature]:
    """Curvature of every block at z; `numbers` (chunks, k, rows) of the readings, `units` of the nuisance parameters."""
    z = np.asarray(z)
    used = [(block, np.asarray(n)) for block, n in zip(system.blocks, numbers, strict=True) if block.q.shape[0]]
    return [_curvature(system, block, z, n, units) for block, n in used]


def _curvature(system: System, block: Block, z: np.ndarray, numbers: np.ndarray, units: list[str]) -> Curvature:
    groups, rows = groups_of(system.layout), _rows(system.layout)
    steps = [STEP["mm"] if row % ROWS_PER_BODY < 3 else STEP["rad"] for row in rows]
    steps += [STEP.get(units[number], STEP["rad"]) for number in np.asarray(block.slots)[0, :, 0].tolist()]
    whole = map_arrays(_joined, block)
    order = _by_cells(groups, whole)
    whole, numbers = map_arrays(lambda a: a[:, :, order], whole), _joined(numbers)[0][:, order]
    bases = [np.empty((whole.q.shape[2], group.size), np.float32) for group in groups]
    second = np.zeros((len(whole.weight[0]), whole.q.shape[2], len(steps) + 1, len(steps) + 1), np.float32)

    def fill(start: int) -> None:
        own = slice(start, start + SLICE)
        (chunk,) = interpreted.chunks_of(map_arrays(lambda a: a[:, :, own], whole))
        values = dict(zip(system.layout.bases, evaluate_bases(system.layout, chunk.q, chunk.direction), strict=True))
        for group, columns in zip(groups, bases, strict=True):
            columns[own] = (np.concatenate([values[b] for b in group.bases]) * chunk.weight.any(axis=0)).T
        second[:, own, :, :-1] = interpreted.second_derivatives(system, block.form, chunk, z, rows, np.array(steps))

    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(fill, range(0, whole.q.shape[2], SLICE)))
    length = block.q.shape[2]
    each = next(r for r in range(min(ROWS, length), 0, -1) if length % r == 0)
    used = (np.asarray(whole.weight[0]) > 0.0).astype(np.float32)
    kept = used.reshape(len(used), -1, each).any(axis=(0, 2))

    def tiles(values: np.ndarray, axis: int) -> Any:
        """Tiles of `each` rows, which stand along `axis`; those of padding alone left out."""
        cut = values.reshape(*values.shape[:axis], -1, each, *values.shape[axis + 1 :])
        return jnp.asarray(np.moveaxis(cut, axis, 0)[kept])

    cut = [_windows(group, np.asarray(tiles(b, 0))) for group, b in zip(groups, bases, strict=True)]
    return Curvature(
        groups,
        tuple(window.span for window in cut),
        [jnp.asarray(window.bases) for window in cut],
        jnp.asarray(np.stack([window.starts for window in cut], axis=1))
        if cut
        else jnp.zeros((int(kept.sum()), 0), int),
        second=tiles(second, 1),
        slots=tiles(whole.slots[0].T, 0),
        used=tiles(used, 1),
        numbers=tiles(numbers, 1),
    )


def _by_cells(groups: tuple[Group, ...], whole: Block) -> np.ndarray:
    """Order of the rows in which neighbours lie in the same intervals of the splines; what is not used comes last.

    To and fro: every second line of cells backwards, so that a tile that ends one line and begins the next stays near.
    """
    keys, parity = [], np.zeros(whole.q.shape[2])
    for group in groups:
        if group.spline is not None:
            cell = spline_interval(group.spline, np.asarray(whole.q)[0, group.spline.axis])[0]
            keys.append(np.where(parity % 2, -cell, cell))
            parity = parity + cell
    used = (np.asarray(whole.weight[0]) > 0.0).any(axis=0)
    return np.asarray(np.lexsort([*reversed(keys), np.logical_not(used)]))


class _Windows(NamedTuple):
    """Bases (tiles, R, width) with the first columns cut to `span` of them from `starts` (tiles,) on."""

    span: int
    starts: np.ndarray
    bases: np.ndarray


def _windows(group: Group, bases: np.ndarray) -> _Windows:
    """The columns of a group's spline that are not 0 in some row of each tile; all of them where there is none to save."""
    whole = 0 if group.spline is None else group.bases[0].size
    seen = np.any(bases[:, :, :whole], axis=1)
    if not whole or not seen.any():
        return _Windows(whole, np.zeros(len(bases), int), bases)
    first = seen.argmax(axis=1)
    span = int((whole - seen[:, ::-1].argmax(axis=1) - first).max())
    starts = np.minimum(first, whole - span)
    columns = starts[:, None, None] + np.arange(span)
    return _Windows(span, starts, np.concatenate([np.take_along_axis(bases, columns, 2), bases[:, :, whole:]], axis=2))


def _joined(values: Any) -> np.ndarray:
    """(chunks, width, rows) as one chunk."""
    values = np.asarray(values)
    chunks, width, rows = values.shape
    return values.transpose(1, 0, 2).reshape(1, width, chunks * rows)


def _by_groups(groups: tuple[Group, ...], dz: Any) -> list[Any]:
    """Coefficients (size, rows · T) of every group, from (n_coefficients or more, T)."""
    found = []
    for group in groups:
        whole = jnp.zeros((group.size, len(group.rows), dz.shape[1]), dz.dtype)
        for term, first, row in group.places:
            n = term.basis.size
            whole = whole.at[first : first + n, row].add(term.sign * dz[term.start : term.start + n])
        found.append(whole.reshape(group.size, -1))
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
            near = [_cut(*own, axis=0) for own in zip(tile.groups, tile.spans, tile.starts, coefficients, strict=True)]
            pulled, extra, squares = _tile(tile, near, dz_nuisance, noise)
            parts = [_added(*own) for own in zip(tile.groups, tile.spans, tile.starts, sums[0], pulled, strict=True)]
            return (parts, sums[1] + extra, sums[2] + squares), None

        zero = [jnp.zeros((len(g.rows), g.size, b)) for g in block.groups]
        (parts, extra, square), _ = jax.lax.scan(add, (zero, jnp.zeros((system.n_nuisance, b)), square), block)
        total = _from_groups(block.groups, parts, total).at[n:].add(extra)
    return total.T, square


def _cut(group: Group, span: int, start: Any, values: Any, axis: int) -> Any:
    """What stands in a tile's columns, along `axis`."""
    if group.spline is None or span == group.bases[0].size:
        return values
    window = jax.lax.dynamic_slice_in_dim(values, start, span, axis)
    rest = jax.lax.slice_in_dim(values, group.bases[0].size, group.size, axis=axis)
    return jnp.concatenate([window, rest], axis=axis)


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
        bent = second @ w  # H δw and, as its last row, aᵀδw
        quadratic = 0.5 * jnp.sum(bent * w, axis=1)
        linear = (bent[:, -1] - noise[number]) * used[:, None]
        residual = linear + quadratic
        squares = squares + jnp.sum((linear + residual) * quadratic, axis=0)
        readings.append((second[:, -1], quadratic, bent, residual))

    def slopes(i: int) -> Any:
        return sum(a[:, i, None] * quadratic + bent[:, i] * residual for a, quadratic, bent, residual in readings)

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
