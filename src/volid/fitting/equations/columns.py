"""The unknowns in the order in which the interpreted engine works: windows of splines are slices there, not scattered numbers.

Terms with one basis (a run of the layout) stand together, coefficient by coefficient: number = start + coefficient · terms +
term. So the coefficients that the readings of a cell can reach are one slice of every run. A periodic spline is unrolled: its
first `degree` coefficients stand at its end again, and are folded back where results leave.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from volid.model.error_model import Layout, Term
from volid.model.splines import Spline


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


class Columns:
    """All columns of a layout with some nuisance parameters behind them.

    `runs`: those with a window first. `source` (n,): the number in z of every column.
    """

    def __init__(self, layout: Layout, n_nuisance: int) -> None:
        self.layout, self.n_nuisance = layout, n_nuisance
        self.runs: list[Run] = []
        source = []
        start = 0
        for run in sorted(layout.runs, key=lambda r: window_of(r) is None):
            spline, size = window_of(run), run[0].basis.size
            unrolled = np.arange(size + (spline.degree if spline is not None and spline.periodic else 0)) % size
            source.append((np.array([t.start for t in run]) + unrolled[:, None]).ravel())
            rows, signs = np.array([t.row for t in run]), np.array([[t.sign] for t in run])
            self.runs.append(Run(tuple(run), spline, len(run), len(unrolled), start, rows, signs))
            start += len(run) * len(unrolled)
        self.n_curves = start
        self.source = np.concatenate([*source, layout.n_coefficients + np.arange(n_nuisance)]).astype(np.int64)

    @property
    def size(self) -> int:
        """Number of columns."""
        return len(self.source)

    @cached_property
    def windows(self) -> list[Run]:
        """Runs with a window."""
        return [run for run in self.runs if run.spline is not None]

    @cached_property
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
def columns_of(layout: Layout, n_nuisance: int) -> Columns:
    """The columns of a layout; the same ones serve all stages of a fit."""
    return Columns(layout, n_nuisance)
