"""The unknowns in the order in which the interpreted engine works: windows of splines are slices there, not scattered numbers.

Terms with one basis (a run of the layout) stand together, coefficient by coefficient: number = start + coefficient · terms +
term. So the coefficients that the readings of a cell can reach are one slice of every run. A periodic spline is unrolled: its
first `degree` coefficients stand at its end again, and are folded back where results leave. So are the columns of further ends,
positions at which a reading sees the machine once more: every end has columns of its own for the same coefficients.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from volid.model.error_model import ROWS, Layout, Term
from volid.model.splines import Basis, Spline


class Run(NamedTuple):
    """Terms with one basis. `spline`: the one it has a window of; None where all its columns are taken. `width`: number of terms.
    `size`: coefficients of a term, unrolled. `start`: of its columns. `rows`, `signs` (terms,): error values the terms add to,
    and how."""

    terms: tuple[Term, ...]
    spline: Spline | None
    width: int
    size: int
    start: int
    rows: np.ndarray
    signs: np.ndarray


def window_of(run: list[Term]) -> Spline | None:
    """The spline of a run whose basis is 0 outside a few of its coefficients; None for constants and cross effects."""
    basis = run[0].basis
    local = len(basis.factors) == 1 and basis.linear is None and basis.directed < 0
    return basis.factors[0] if local else None


def _at_end(run: list[Term], end: int, layout: Layout) -> list[Term]:
    """The terms of a run at another end, whose rows of positions and error values stand behind those of the first."""
    axes, rows = end * layout.n_axes, end * ROWS * (layout.n_axes + 1)
    basis = run[0].basis
    moved = Basis(
        tuple(s._replace(axis=s.axis + axes) for s in basis.factors),
        None if basis.linear is None else (basis.linear[0] + axes, basis.linear[1]),
        basis.directed + axes if basis.directed >= 0 else -1,
    )
    return [term._replace(basis=moved, row=term.row + rows) for term in run]


class Columns:
    """All columns of a layout with some nuisance parameters behind them.

    `ends`: how many positions a reading sees at most. `runs`: those with a window first. `source` (n,): the number in z of every
    column.
    """

    def __init__(self, layout: Layout, n_nuisance: int, ends: int = 1) -> None:
        self.layout, self.n_nuisance, self.ends = layout, n_nuisance, ends
        self.runs: list[Run] = []
        source = []
        start = 0
        every = [_at_end(run, end, layout) for end in range(ends) for run in layout.runs]
        for run in sorted(every, key=lambda r: window_of(r) is None):
            spline, size = window_of(run), run[0].basis.size
            unrolled = np.arange(size + (spline.degree if spline is not None and spline.periodic else 0)) % size
            source.append((np.array([t.start for t in run]) + unrolled[:, None]).ravel())
            rows, signs = np.array([t.row for t in run]), np.array([[t.sign] for t in run])
            self.runs.append(Run(tuple(run), spline, len(run), len(unrolled), start, rows, signs))
            start += len(run) * len(unrolled)
        self.n_curves = start
        self.source = np.concatenate([*source, layout.n_coefficients + np.arange(n_nuisance)]).astype(np.int64)

    def seen_by(self, ends: int) -> Columns:
        """The same columns with those runs alone that readings with so many ends see."""
        if ends == self.ends:
            return self
        seen = copy(self)
        last = ends * ROWS * (self.layout.n_axes + 1)
        seen.runs = [run for run in self.runs if run.rows[0] < last]
        return seen

    @property
    def size(self) -> int:
        """Number of columns."""
        return len(self.source)

    @property
    def windows(self) -> list[Run]:
        """Runs with a window."""
        return [run for run in self.runs if run.spline is not None]

    @property
    def others(self) -> list[Run]:
        """Runs without one."""
        return [run for run in self.runs if run.spline is None]

    @cached_property
    def _first(self) -> np.ndarray:
        """The first column of every number in z."""
        return np.unique(self.source, return_index=True)[1]

    @cached_property
    def _again(self) -> tuple[np.ndarray, np.ndarray]:
        """Columns that stand for a number in z again, and the first ones of the same numbers."""
        again = np.setdiff1d(np.arange(self.size), self._first)
        return again, self._first[self.source[again]]

    def spread(self, z: np.ndarray) -> np.ndarray:
        """Values of all columns from z (size,), or columns of a matrix (r, size)."""
        return np.asarray(z)[..., self.source]

    def folded(self, vector: np.ndarray) -> np.ndarray:
        """A gradient in z from one in all columns."""
        return np.bincount(self.source, vector, minlength=self.layout.n_coefficients + self.n_nuisance)

    def folded_square(self, matrix: np.ndarray) -> np.ndarray:
        """JᵀJ in z from the upper triangle of one in all columns, which is overwritten."""
        below = np.tril_indices(self.size, -1)
        matrix[below] = matrix.T[below]
        again, first = self._again
        for lines in (matrix, matrix.T):
            np.add.at(lines, first, lines[again])
        return np.ascontiguousarray(matrix[np.ix_(self._first, self._first)])


@lru_cache(maxsize=16)
def columns_of(layout: Layout, n_nuisance: int, ends: int = 1) -> Columns:
    """The columns of a layout; the same ones serve all stages of a fit."""
    return Columns(layout, n_nuisance, ends)
