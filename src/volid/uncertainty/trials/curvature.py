"""Gradient and Hessian of every reading at the solution, in tiles of near readings: what `second_order` takes.

Error values with the same splines are grouped, so that one product gives all of them; readings stand in the order of the splines'
cells, so that a tile needs few columns of the bases.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from volid.backend.lazy import jnp
from volid.backend.pytrees import STATIC, map_arrays, register_dataclass
from volid.fitting.equations.second_derivatives import second_derivatives
from volid.fitting.equations.system import Block, System
from volid.fitting.prediction.deviations import THREADS
from volid.model.error_model import ROWS as ROWS_PER_BODY
from volid.model.error_model import Layout, Term
from volid.model.error_values import evaluate_bases
from volid.model.splines import Basis, Spline, spline_interval

LARGEST = 512 * 2**20  # bytes of Hessians that are kept
SLICE = 4096  # rows whose second derivatives are formed at once
ROWS, TRIALS = 128, 128  # of one tile, and refitted at once: a tile's values stay in the processor's cache
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


def hessian_bytes(system: System) -> float:
    """Memory for the Hessians of all readings; infinite where some see the machine at two positions, which no tile holds."""
    if any(b.q.shape[1] > system.layout.n_axes for b in system.blocks):
        return float("inf")
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
    joined = map_arrays(_joined, block)
    order = _by_cells(groups, joined)
    joined, numbers = map_arrays(lambda a: a[:, :, order], joined), _joined(numbers)[0][:, order]
    bases = [np.empty((joined.q.shape[2], group.size), np.float32) for group in groups]
    second = np.zeros((len(joined.weight[0]), joined.q.shape[2], len(steps) + 1, len(steps) + 1), np.float32)

    def fill(start: int) -> None:
        own = slice(start, start + SLICE)
        chunk = map_arrays(lambda a: a[0, :, own], joined)
        values = dict(zip(system.layout.bases, evaluate_bases(system.layout, chunk.q, chunk.direction), strict=True))
        for group, columns in zip(groups, bases, strict=True):
            columns[own] = (np.concatenate([values[b] for b in group.bases]) * chunk.weight.any(axis=0)).T
        second[:, own, :, :-1] = second_derivatives(system, chunk, z, rows, np.array(steps))

    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(fill, range(0, joined.q.shape[2], SLICE)))
    length = block.q.shape[2]
    each = next(r for r in range(min(ROWS, length), 0, -1) if length % r == 0)
    used = (np.asarray(joined.weight[0]) > 0.0).astype(np.float32)
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
        slots=tiles(joined.slots[0].T, 0),
        used=tiles(used, 1),
        numbers=tiles(numbers, 1),
    )


def _by_cells(groups: tuple[Group, ...], joined: Block) -> np.ndarray:
    """Order of the rows in which neighbours lie in the same intervals of the splines; what is not used comes last.

    To and fro: every second line of cells backwards, so that a tile that ends one line and begins the next stays near.
    """
    keys, parity = [], np.zeros(joined.q.shape[2])
    for group in groups:
        if group.spline is not None:
            cell = spline_interval(group.spline, np.asarray(joined.q)[0, group.spline.axis])[0]
            keys.append(np.where(parity % 2, -cell, cell))
            parity = parity + cell
    used = (np.asarray(joined.weight[0]) > 0.0).any(axis=0)
    return np.asarray(np.lexsort([*reversed(keys), np.logical_not(used)]))


class _Windows(NamedTuple):
    """Bases (tiles, R, width) with the first columns cut to `span` of them from `starts` (tiles,) on."""

    span: int
    starts: np.ndarray
    bases: np.ndarray


def _windows(group: Group, bases: np.ndarray) -> _Windows:
    """The columns of a group's spline that are not 0 in some row of each tile; all of them where there is none to save."""
    size = 0 if group.spline is None else group.bases[0].size
    seen = np.any(bases[:, :, :size], axis=1)
    if not size or not seen.any():
        return _Windows(size, np.zeros(len(bases), int), bases)
    first = seen.argmax(axis=1)
    span = int((size - seen[:, ::-1].argmax(axis=1) - first).max())
    starts = np.minimum(first, size - span)
    columns = starts[:, None, None] + np.arange(span)
    return _Windows(span, starts, np.concatenate([np.take_along_axis(bases, columns, 2), bases[:, :, size:]], axis=2))


def _joined(values: Any) -> np.ndarray:
    """(chunks, width, rows) as one chunk."""
    values = np.asarray(values)
    chunks, width, rows = values.shape
    return values.transpose(1, 0, 2).reshape(1, width, chunks * rows)
