"""The readings of one block as the interpreted engine takes them: sorted by cells of the working volume, cut into tiles.

A reading depends on degree + 1 coefficients of every spline. Readings of one cell, some spline intervals wide on every axis, make
a tile, in which every spline is a window of few coefficients; constants, squareness, cross effects are taken in full, and of
nuisance parameters those that occur. Small sets are one cell.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from volid.effects.prediction import Form
from volid.fitting.equations.cells import cell_numbers, count_cells, finest_segments, window_width
from volid.fitting.equations.columns import Columns
from volid.fitting.equations.system import Block, flat
from volid.model.splines import evaluate, local_values, spline_interval

SHARES = (1, 2, 3, 4, 6, 8, 12, 24)  # intervals of the finest spline of an axis in a cell, from which the best is taken
TILE = 2**18  # numbers of a tile's Jacobian: it stays in the processor's cache
PIECE = 4096  # readings whose chain is computed at once: NumPy needs long arrays, the cache short ones
KEPT = 512 * 2**20  # bytes of basis values that are kept
# Seconds of the parts of a product JᵀJ, on a core of 40 GFLOP/s: for the choice of cells, where a factor of two matters little
PER_FLOP, PER_NUMBER, PER_TILE, PER_SUM = 2.5e-11, 6e-10, 3e-4, 2.5e-9


class Tile(NamedTuple):
    """Rows `first` to `last`, first coefficient and width of every window, and the nuisance parameters that occur.

    `columns`: numbers of all columns, ascending; `parts`: runs of consecutive ones, where they stand and which they are.
    """

    first: int
    last: int
    starts: tuple[int, ...]
    widths: tuple[int, ...]
    nuisance: np.ndarray
    columns: np.ndarray
    parts: list[tuple[slice, slice]]


@dataclass(frozen=True, eq=False)
class Arranged:
    """Rows of a block, (width, m) each, in the order of the tiles.

    `numbers` (m,): places in the block, chunks one after another. `intervals` (windows, m): interval of every window's spline.
    `bounds` (tiles + 1,): first row of every tile. `bases`: by run, what `Arranged.basis` gives; None where that is not kept.
    """

    form: Form
    columns: Columns
    numbers: np.ndarray
    q: np.ndarray
    direction: np.ndarray
    tool: np.ndarray
    reading: np.ndarray
    weight: np.ndarray
    slots: np.ndarray
    constants: np.ndarray
    intervals: np.ndarray
    starts: np.ndarray
    bounds: np.ndarray
    bases: list[np.ndarray] | None
    tiles: tuple[Tile, ...]

    @property
    def m(self) -> int:
        """Number of rows."""
        return len(self.numbers)

    def pieces(self) -> Iterator[list[Tile]]:
        """Tiles one after another, so many at a time that their rows make a long array."""
        waiting: list[Tile] = []
        for tile in self.tiles:
            waiting.append(tile)
            if tile.last - waiting[0].first >= PIECE:
                yield waiting
                waiting = []
        if waiting:
            yield waiting

    def basis(self, k: int, rows: slice) -> np.ndarray:
        """Basis values of run k, (size, rows); for a window (its greatest width, rows), from each row's first coefficient on."""
        if self.bases is not None:
            return self.bases[k][:, rows]
        return self._basis(k, rows)

    def _basis(self, k: int, rows: slice) -> np.ndarray:
        run = self.columns.runs[k]
        if run.spline is None:
            return np.asarray(evaluate(run.terms[0].basis, self.q[:, rows], self.direction[:, rows]))
        _, u = spline_interval(run.spline, self.q[run.spline.axis, rows])
        place = self.intervals[k, rows] - self.starts[k, rows]
        values = np.zeros((max(t.widths[k] for t in self.tiles), len(u)))
        for r, local in enumerate(local_values(run.spline, u)):
            values[place + r, np.arange(len(u))] = local
        return values

    def changed(self, block: Block) -> Arranged:
        """The rows with the readings and weights of `block`, without those that have no weight."""
        weight, reading = (flat(a)[:, self.numbers] for a in (block.weight, block.reading))
        kept = weight.any(axis=0)
        if kept.all():
            return replace(self, weight=weight, reading=reading)
        rows = np.flatnonzero(kept)
        columns = {name: getattr(self, name)[..., rows] for name in _BY_ROW}
        bases = None if self.bases is None else [b[:, rows] for b in self.bases]
        bounds = np.searchsorted(rows, self.bounds)
        used = np.append(np.flatnonzero(np.diff(bounds)), len(bounds) - 1)
        found = replace(
            self, **columns, weight=weight[:, rows], reading=reading[:, rows], bounds=bounds[used], bases=bases
        )
        return replace(found, tiles=_tiles(found))

    @property
    def bytes_of_bases(self) -> int:
        """Memory that all basis values take."""
        wide = [max(t.widths[k] for t in self.tiles) for k in range(len(self.columns.windows))]
        return 8 * self.m * (sum(wide) + sum(run.size for run in self.columns.others))


_BY_ROW = ("numbers", "q", "direction", "tool", "slots", "constants", "intervals", "starts")
_ARRAYS = ("q", "direction", "tool", "reading", "weight", "slots", "constants")


def arranged(columns: Columns, block: Block) -> Arranged | None:
    """The rows of a block that have a weight; None where there are none."""
    columns = columns.seen_by(block.q.shape[1] // columns.layout.n_axes)
    arrays = {name: flat(getattr(block, name)) for name in _ARRAYS}
    used = np.flatnonzero(arrays["weight"].any(axis=0))
    if not used.size:
        return None
    arrays = {name: a[:, used] for name, a in arrays.items()}
    splines = [run.spline for run in columns.windows if run.spline is not None]
    intervals = np.zeros((len(splines), len(used)), dtype=np.int64)
    for k, spline in enumerate(splines):
        intervals[k] = spline_interval(spline, arrays["q"][spline.axis])[0]
    keys, most = _cells(columns, intervals, len(used), block.form.n_readings)
    order = np.argsort(keys, kind="stable")
    cut = np.flatnonzero(np.diff(keys[order])) + 1
    bounds = np.concatenate([[0], cut, [len(used)]])
    bounds = np.unique(np.concatenate([bounds, *_pieces(bounds, most)]))
    whole = Arranged(
        form=block.form,
        columns=columns,
        numbers=used[order],
        intervals=intervals[:, order],
        starts=np.zeros_like(intervals),
        bounds=bounds,
        bases=None,
        tiles=(),
        **{name: np.ascontiguousarray(a[:, order]) for name, a in arrays.items()},
    )
    starts = [np.repeat(np.minimum.reduceat(i, bounds[:-1]), np.diff(bounds)) for i in whole.intervals]
    whole = replace(whole, starts=np.array(starts, dtype=np.int64).reshape(len(splines), whole.m))
    whole = replace(whole, tiles=_tiles(whole))
    if whole.bytes_of_bases > KEPT:
        return whole
    return replace(whole, bases=[whole._basis(k, slice(None)) for k in range(len(columns.runs))])


def _pieces(bounds: np.ndarray, most: int) -> list[np.ndarray]:
    """Cuts of cells with more than `most` rows."""
    large = np.flatnonzero(np.diff(bounds) > most)
    return [np.arange(bounds[i], bounds[i + 1], most) for i in large]


def _tiles(rows: Arranged) -> tuple[Tile, ...]:
    if not rows.m:
        return ()
    first = rows.bounds[:-1]
    starts = rows.starts[:, first].T
    last = np.maximum.reduceat(rows.intervals, first, axis=1).T if len(rows.intervals) else starts
    degree = np.array([run.spline.degree for run in rows.columns.windows if run.spline], dtype=np.int64)
    widths = last - starts + degree + 1
    n, found = rows.columns.n_nuisance, []
    ends = zip(first.tolist(), rows.bounds[1:].tolist(), strict=True)
    for (a, b), start, width in zip(ends, starts.tolist(), widths.tolist(), strict=True):
        nuisance = np.flatnonzero(np.bincount(rows.slots[:, a:b].ravel(), minlength=n))
        columns = _columns(rows.columns, start, width, nuisance)
        found.append(Tile(a, b, tuple(start), tuple(width), nuisance, columns, _parts(columns)))
    return tuple(found)


def _columns(columns: Columns, starts: list[int], widths: list[int], nuisance: np.ndarray) -> np.ndarray:
    """Numbers of the columns of a tile, ascending."""
    windows = zip(columns.windows, starts, widths, strict=True)
    ends = [(run.start + start * run.width, size * run.width) for run, start, size in windows]
    ends += [(run.start, run.size * run.width) for run in columns.others]
    return np.concatenate([*(np.arange(a, a + n) for a, n in ends), columns.n_curves + nuisance])


def _parts(columns: np.ndarray) -> list[tuple[slice, slice]]:
    """Runs of consecutive numbers: where they stand in `columns`, and the numbers themselves."""
    ends = [0, *(np.flatnonzero(np.diff(columns) != 1) + 1).tolist(), len(columns)]
    runs = ((a, b, int(columns[a])) for a, b in pairwise(ends) if b > a)
    return [(slice(a, b), slice(first, first + b - a)) for a, b, first in runs]


def _cells(columns: Columns, intervals: np.ndarray, m: int, k: int) -> tuple[np.ndarray, int]:
    """Number of the cell of every row, (m,), and the most rows of a tile, for the least estimated work."""
    windows = columns.windows
    splines = [run.spline for run in windows if run.spline is not None]
    finest, best, least = finest_segments(splines), np.zeros(m, dtype=np.int64), np.inf
    whole = wide = sum(run.width * run.size for run in columns.others) + columns.n_nuisance
    for share in SHARES if splines else ():
        width = whole + sum(
            run.width * window_width(s, share, finest[s.axis], run.size)
            for run, s in zip(windows, splines, strict=True)
        )
        numbers = cell_numbers(splines, list(intervals), share)
        tiles = max(count_cells(numbers), m * k * width / TILE)
        work = m * k * width * (width * PER_FLOP + PER_NUMBER) + tiles * (PER_TILE + width * width * PER_SUM)
        if work < least:
            best, least, wide = numbers, work, width
    return best, max(64, TILE // max(1, k * wide))
