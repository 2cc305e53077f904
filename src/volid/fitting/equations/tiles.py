"""Large sets by cells of the working volume: JᵀJ from the few coefficients that the readings of one cell can reach.

A reading depends on degree + 1 coefficients of every spline, so of the hundreds of columns of J most are zero in it. Readings
are sorted by cells, each some spline intervals wide on every axis, and cut into tiles of `rows` readings of one cell (padded
with weight 0). In a tile every spline is a window of `widths` coefficients that begins at `starts`; everything else (constants,
squareness, cross effects, nuisance parameters) is kept whole. The product of a tile is then a third of the dense one, or less.
Equal to the dense sum but for rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.backend.lazy import jax, jnp
from volid.backend.pytrees import STATIC, register_dataclass
from volid.fitting.equations.cells import cell_numbers, finest_segments, window_width
from volid.fitting.equations.system import Block, System, flat
from volid.model.error_model import ROWS, Layout, Term
from volid.model.error_values import add_curves, signed_rows
from volid.model.splines import Spline, evaluate, spline_interval, spline_values

LEAST = 8192  # rows of a block from which tiles pay
MOST_WHOLE = 192  # columns kept whole up to which tiles pay
LENGTHS = (128, 256, 512, 1024)


@register_dataclass
@dataclass(frozen=True, eq=False)
class Tiles:
    """Readings of one block by tiles: `chunk`, a block whose chunks are the tiles; `starts` (n_tiles, windows); `numbers`
    (n_tiles, rows), where each reading stands in the block, one past its end for padding; `widths` of the windows."""

    chunk: Any
    starts: Any
    numbers: Any
    widths: tuple[int, ...] = field(metadata=STATIC)


class _Split(NamedTuple):
    """Runs of a layout that have a window, and those that are kept whole."""

    windows: list[list[Term]]
    whole: list[list[Term]]


def _split(layout: Layout) -> _Split:
    windows: list[list[Term]] = []
    whole: list[list[Term]] = []
    for run in layout.runs:
        basis = run[0].basis
        simple = len(basis.factors) == 1 and basis.linear is None and basis.directed < 0
        (windows if simple and not basis.factors[0].periodic else whole).append(run)
    return _Split(windows, whole)


def _size(run: list[Term]) -> int:
    return len(run) * run[0].basis.size


class _Plan(NamedTuple):
    """Intervals per cell along every axis, and rows per tile."""

    share: int
    rows: int


def _choose(splines: list[Spline], counts: list[int], whole: int, m: int) -> _Plan:
    """The plan of least estimated work."""
    finest = finest_segments(splines)
    best, least = _Plan(1, LENGTHS[0]), np.inf
    for share, rows in product((1, 2, 3, 4, 6, 8, 12), LENGTHS):
        cells = int(np.prod([-(-n // share) for n in finest.values()]))
        wide = whole + sum(
            k * window_width(s, share, finest[s.axis], s.size) for s, k in zip(splines, counts, strict=True)
        )
        work = (m + 0.5 * rows * min(cells, m)) * wide * (wide + 150.0) * (1.0 + 60.0 / rows)
        if work < least:
            best, least = _Plan(share, rows), work
    return best


def tiles_of(layout: Layout, n_nuisance: int, block: Any, m: int) -> Tiles | None:
    """Tiles of a block of `m` readings' rows, or None where they do not pay, or readings see several positions at once."""
    split = _split(layout)
    whole = sum(_size(run) for run in split.whole) + n_nuisance
    several = block.q.shape[1] > layout.n_axes
    if several or m < LEAST or not split.windows or whole > MOST_WHOLE:
        return None
    splines = [run[0].basis.factors[0] for run in split.windows]
    plan = _choose(splines, [len(run) for run in split.windows], whole, m)
    arrays = {name: flat(getattr(block, name))[:, :m] for name in _ARRAYS}
    intervals = [np.asarray(spline_interval(s, arrays["q"][s.axis])[0], dtype=np.int64) for s in splines]
    numbers = _by_cell(cell_numbers(splines, intervals, plan.share), plan.rows)
    cut = {name: _cut(values, numbers, name == "weight") for name, values in arrays.items()}
    starts, widths = _windows(splines, intervals, numbers, m)
    return Tiles(type(block)(form=block.form, **cut), starts, numbers, widths)


_ARRAYS = ("q", "direction", "tool", "reading", "weight", "slots", "constants")


def _by_cell(cell: np.ndarray, rows: int) -> np.ndarray:
    """Row numbers by tiles, (n_tiles, rows), m for padding: every tile lies in one cell."""
    m = len(cell)
    order = np.argsort(cell, kind="stable")
    _, first, count = np.unique(cell[order], return_index=True, return_counts=True)
    tiles = -(-count // rows)
    n_tiles = _rounded(int(tiles.sum()))
    numbers = np.full((n_tiles, rows), m, dtype=np.int64)
    target = np.concatenate([[0], np.cumsum(tiles)[:-1]]) * rows
    place = np.repeat(target - first, count) + np.arange(m)
    numbers.ravel()[place] = order
    return numbers


def _rounded(n: int) -> int:
    """n rounded up to an eighth of a power of two, so that similar campaigns share a program."""
    step = max(1, int(2 ** np.floor(np.log2(max(n, 1)))) // 8)
    return -(-n // step) * step


def _cut(values: np.ndarray, numbers: np.ndarray, zero: bool) -> np.ndarray:
    """(width, m) -> (n_tiles, width, rows); padding repeats a tile's first reading, with weight 0."""
    m = values.shape[1]
    inside = np.where(numbers < m, numbers, np.where(numbers[:, :1] < m, numbers[:, :1], 0))
    result = np.ascontiguousarray(values[:, inside].transpose(1, 0, 2))
    return np.where((numbers < m)[:, None], result, 0.0) if zero else result


def _windows(
    splines: list[Spline], intervals: list[np.ndarray], numbers: np.ndarray, m: int
) -> tuple[np.ndarray, tuple[int, ...]]:
    """First coefficient of every window in every tile, (n_tiles, windows), and the windows' widths."""
    used = np.flatnonzero(numbers[:, 0] < m)
    starts, widths = np.zeros((len(numbers), len(splines)), dtype=np.int64), []
    for k, (s, i) in enumerate(zip(splines, intervals, strict=True)):
        own = np.append(i, 0)[numbers[used]]
        low = np.where(numbers[used] < m, own, s.segments).min(axis=1)
        high = np.where(numbers[used] < m, own, 0).max(axis=1)
        width = int((high - low).max()) + s.degree + 1
        starts[used, k] = np.minimum(low, s.size - width)
        widths.append(width)
    return starts, tuple(widths)


def reweighted(tiles: Tiles | None, block: Block) -> Tiles | None:
    """Tiles with the readings and weights of `block`; a weight of 0 stays 0."""
    if tiles is None:
        return None
    last = block.q.shape[0] * block.q.shape[2] - 1
    numbers = np.minimum(np.asarray(tiles.numbers), last)
    reading, weight = (
        np.ascontiguousarray(flat(a)[:, numbers].transpose(1, 0, 2)) for a in (block.reading, block.weight)
    )
    weight = np.where(np.any(tiles.chunk.weight, axis=1, keepdims=True), weight, 0.0)
    return replace(tiles, chunk=replace(tiles.chunk, reading=reading, weight=weight))


class _Local(NamedTuple):
    """Basis values in one tile: of every window, and of every run that is whole; in the order of the split."""

    windows: list[Any]
    whole: list[Any]


def _bases(split: _Split, chunk: Any, starts: Any, widths: tuple[int, ...]) -> _Local:
    windows = []
    for k, (run, width) in enumerate(zip(split.windows, widths, strict=True)):
        spline = run[0].basis.factors[0]
        windows.append(spline_values(spline, chunk.q[spline.axis], starts[k], width))
    return jax.lax.optimization_barrier(
        _Local(windows, [evaluate(run[0].basis, chunk.q, chunk.direction) for run in split.whole])
    )


def _errors(layout: Layout, split: _Split, local: _Local, z: Any, starts: Any, m: int) -> list[Any]:
    """Error values, one row (m,) each, from the windows of the coefficients."""
    rows: list[Any] = [None] * (ROWS * (layout.n_axes + 1))
    for k, (run, values) in enumerate(zip(split.windows, local.windows, strict=True)):
        own = z[run[0].start : run[0].start + _size(run)].reshape(len(run), -1)
        add_curves(rows, run, jax.lax.dynamic_slice_in_dim(own, starts[k], values.shape[0], axis=1) @ values)
    for run, values in zip(split.whole, local.whole, strict=True):
        add_curves(rows, run, z[run[0].start : run[0].start + _size(run)].reshape(len(run), -1) @ values)
    return [jnp.zeros(m) if row is None else row for row in rows]


class _TileLinear(NamedTuple):
    """Cost, gradient (columns,) and Jacobian (columns, k·rows) of one tile, in windows, whole columns and nuisance."""

    cost: Any
    gradient: Any
    rows: Any


class _Assembly(NamedTuple):
    """What all tiles of an assembly share: system and its runs, widths of the windows, z, the prediction (chunk, error values,
    slots) -> readings, and the type of the Jacobian's numbers."""

    system: System
    split: _Split
    widths: tuple[int, ...]
    z: Any
    predict: Any
    kind: Any


def _linearised(of: _Assembly, chunk: Any, starts: Any) -> _TileLinear:
    system, z, kind = of.system, of.z, of.kind
    n, m = system.layout.n_coefficients, chunk.q.shape[1]
    local = _bases(of.split, chunk, starts, of.widths)
    errors = _errors(system.layout, of.split, local, z, starts, m)
    values, pull_back = jax.vjp(lambda e, s: of.predict(chunk, e, s), errors, list(z[n + chunk.slots]))
    residual = (values - chunk.reading) * chunk.weight
    number = jnp.arange(system.n_nuisance, dtype=chunk.slots.dtype)[:, None]
    runs = list(zip((*of.split.windows, *of.split.whole), (*local.windows, *local.whole), strict=True))
    parts, gradient = [], jnp.zeros(())
    for k in range(values.shape[0]):
        one = jnp.where((jnp.arange(values.shape[0]) == k)[:, None], chunk.weight, 0.0)
        d_errors, d_slots = (in_rows(d, (m,)) for d in pull_back(one))
        slopes = [(signed_rows(run, d_errors * residual[k]) @ basis.T).reshape(-1) for run, basis in runs]
        sums = jnp.zeros(system.n_nuisance).at[chunk.slots.reshape(-1)].add((d_slots * residual[k]).reshape(-1))
        gradient = gradient + jnp.concatenate([*slopes, sums])
        d_errors, d_slots = d_errors.astype(kind), d_slots.astype(kind)
        rows = [
            (signed_rows(run, d_errors)[:, None] * basis.astype(kind)[None]).reshape(-1, basis.shape[1])
            for run, basis in runs
        ]
        extra = [jnp.where(number == slot, d, 0.0) for slot, d in zip(chunk.slots, d_slots, strict=True)]
        parts.append(jnp.concatenate([*rows, sum(extra)] if extra else rows))
    whole = jax.lax.optimization_barrier(jnp.concatenate(parts, axis=1))
    return _TileLinear(0.5 * jnp.sum(residual**2), gradient, whole)


def assemble_tiles(system: System, tiles: Tiles, z: Any, predict: Any, rough: bool = False) -> tuple[Any, Any, Any]:
    """Cost, gradient and JᵀJ in z of one block, summed tile by tile in windows; JᵀJ of a tile in single precision if `rough`."""
    split, kind = _split(system.layout), jnp.float32 if rough else jnp.float64
    shared = _Assembly(system, split, tiles.widths, z, predict, kind)
    spaces = [(len(run), run[0].basis.size) for run in split.windows]
    whole = sum(_size(run) for run in split.whole) + system.n_nuisance
    shapes = [(len(run), w) for run, w in zip(split.windows, tiles.widths, strict=True)]
    pairs = list(_pairs(len(spaces)))
    squares = [jnp.zeros((*spaces[p], *spaces[q])) for p, q in pairs]
    crossed = [jnp.zeros((*s, whole)) for s in spaces]
    total = (0.0, [jnp.zeros(s) for s in spaces], jnp.zeros(whole), squares, crossed, jnp.zeros((whole, whole)))

    def add(total: Any, tile: Any) -> tuple[Any, None]:
        chunk, starts = tile
        found = _linearised(shared, chunk, starts)
        gradient, matrix = found.gradient, (found.rows @ found.rows.T).astype(jnp.float64)
        ends = np.cumsum([0, *(t * w for t, w in shapes)])
        cost, slopes, rest, squares, crossed, corner = total
        own = [slice(a, b) for a, b in pairwise(ends)]
        slopes = [
            _add(s, gradient[o].reshape(t, w), (0, starts[k])) for k, (s, o, (t, w)) in _with(slopes, own, shapes)
        ]
        crossed = [
            _add(c, matrix[o, ends[-1] :].reshape(t, w, whole), (0, starts[k], 0))
            for k, (c, o, (t, w)) in _with(crossed, own, shapes)
        ]
        squares = [
            _add(s, matrix[own[p], own[q]].reshape(*shapes[p], *shapes[q]), (0, starts[p], 0, starts[q]))
            for s, (p, q) in zip(squares, pairs, strict=True)
        ]
        last = ends[-1]
        rest, corner = rest + gradient[last:], corner + matrix[last:, last:]
        return (cost + found.cost, slopes, rest, squares, crossed, corner), None

    total, _ = jax.lax.scan(add, total, (tiles.chunk, tiles.starts))
    return _in_order(system, split, pairs, total)


def _with(*lists: Any) -> Iterator[Any]:
    return enumerate(zip(*lists, strict=True))


def _pairs(n: int) -> Iterator[tuple[int, int]]:
    return ((p, q) for p in range(n) for q in range(p, n))


def _add(total: Any, part: Any, where: tuple[Any, ...]) -> Any:
    """`total` with `part` added at `where`."""
    at = tuple(jnp.asarray(w, dtype=jnp.int64) for w in where)
    old = jax.lax.dynamic_slice(total, at, part.shape)
    return jax.lax.dynamic_update_slice(total, old + part, at)


def _in_order(system: Any, split: _Split, pairs: list[tuple[int, int]], total: Any) -> tuple[Any, Any, Any]:
    """Window, whole and nuisance parts in the order of z."""
    cost, slopes, rest, squares, crossed, corner = total
    n = system.layout.n_coefficients
    places = [np.arange(run[0].start, run[0].start + _size(run)) for run in split.windows]
    others = np.concatenate(
        [*(np.arange(run[0].start, run[0].start + _size(run)) for run in split.whole), n + np.arange(system.n_nuisance)]
    ).astype(np.int64)
    order = np.argsort(np.concatenate([*places, others]))
    gradient = jnp.concatenate([*(s.reshape(-1) for s in slopes), rest])[order]
    found = dict(zip(pairs, squares, strict=True))
    lines = []
    for p, place in enumerate(places):
        line = [
            found[p, q].reshape(len(place), -1) if p <= q else found[q, p].reshape(-1, len(place)).T
            for q in range(len(places))
        ]
        lines.append(jnp.concatenate([*line, crossed[p].reshape(len(place), -1)], axis=1))
    lines.append(jnp.concatenate([*(c.reshape(-1, len(others)).T for c in crossed), corner], axis=1))
    return cost, gradient, jnp.concatenate(lines)[order][:, order]
