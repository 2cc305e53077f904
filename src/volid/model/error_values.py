"""Error values from coefficients, and the chain rule back: what the fit, predictions and grids evaluate over and over.

Error values are linear in the coefficients c of the spline bases: row by row, value = Σ sign · c · basis. The functions here take
bases that were evaluated already, so that each is evaluated once per position, and run on NumPy arrays and in JAX alike.

A reading may see the machine at several positions, its *ends*: positions `q` are then (ends · n_axes, m), one end after another,
and so are the bases and the rows of error values. The coefficients are the same at all ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from volid.backend.elementary import in_rows, space
from volid.model.error_model import ROWS, Layout, Term
from volid.model.splines import Basis, evaluate


def error_values(layout: Layout, coefficients: Any, bases: Any) -> Any:
    """Error values (ends·6·(n_axes + 1), m) from coefficients and the evaluated `bases` (one (size, m) array each)."""
    if not layout.terms:
        return np.zeros((ROWS * (layout.n_axes + 1), 0))
    m = bases[0].shape[1]
    return in_rows(error_rows(layout, coefficients, bases, m), (m,))


def error_rows(layout: Layout, coefficients: Any, bases: Any, m: int) -> list[Any]:
    """`error_values` as a list of rows (m,).

    In JAX the rows are not one array: XLA would split the product that puts curves into rows, and add up its parts again at every
    use of a row.
    """
    every: list[Any] = []
    for values in values_by_end(layout, bases):
        rows: list[Any] = [None] * (ROWS * (layout.n_axes + 1))
        for run in layout.runs:
            last = run[-1].start + run[-1].basis.size
            curves = coefficients[run[0].start : last].reshape(len(run), -1) @ values[run[0].basis]
            add_curves(rows, run, curves)
        every += rows
    zero = space(coefficients).zeros(m)
    return [zero if row is None else row for row in every]


def values_by_end(layout: Layout, bases: Sequence[Any]) -> list[dict[Basis, Any]]:
    """Values of every basis by the basis, end by end."""
    n = len(layout.bases)
    parts = [bases[i : i + n] for i in range(0, len(bases), n)] if n else [[]]
    return [dict(zip(layout.bases, part, strict=True)) for part in parts]


def add_curves(rows: list[Any], run: Sequence[Term], curves: Any) -> None:
    """Add the curves of a run's terms, (terms, m), to the rows of error values they belong to; None stands for 0."""
    for term, curve in zip(run, curves, strict=True):
        signed = curve if term.sign == 1.0 else term.sign * curve
        rows[term.row] = signed if rows[term.row] is None else rows[term.row] + signed


def evaluate_bases(layout: Layout, q: Any, direction: Any) -> list[Any]:
    """All distinct bases at positions `q` (ends·n_axes, m) and approach directions (ends·n_axes, m), end by end."""
    n = layout.n_axes
    ends = [slice(i, i + n) for i in range(0, len(q), n)]
    return [evaluate(basis, q[end], direction[end]) for end in ends for basis in layout.bases]


def coefficient_rows(layout: Layout, partials: Any, bases: Any) -> Any:
    """Chain rule from error values to coefficients: ∂r/∂c, shape (n_coefficients, m), from ∂r/∂(error values)."""
    if not layout.terms:
        return np.zeros((0, partials.shape[1]))
    total: Any = None
    for own, values in zip(by_end(layout, partials), values_by_end(layout, bases), strict=True):
        blocks = []
        for run in layout.runs:
            signed = signed_rows(run, own)
            blocks.append((signed[:, None, :] * values[run[0].basis][None, :, :]).reshape(-1, own.shape[1]))
        whole = space(blocks[0]).concatenate(blocks)
        total = whole if total is None else total + whole
    return total


def by_end(layout: Layout, rows: Any) -> list[Any]:
    """Rows of error values, or derivatives by them, (ends·6·(n_axes + 1), …), end by end."""
    n = ROWS * (layout.n_axes + 1)
    return [rows[i : i + n] for i in range(0, len(rows), n)]


def signed_rows(run: Sequence[Term], partials: Any) -> Any:
    """Partial derivatives with respect to the curves of a run's terms, (terms, m), from those to error values."""
    return partials[np.array([t.row for t in run])] * np.array([[t.sign] for t in run], dtype=partials.dtype)


def summed_rows(layout: Layout, partials: Any, bases: Any) -> Any:
    """`coefficient_rows` summed over the positions, shape (n_coefficients,), without the rows themselves."""
    if not layout.terms:
        return np.zeros(0)
    total: Any = None
    for own, values in zip(by_end(layout, partials), values_by_end(layout, bases), strict=True):
        blocks = [(signed_rows(run, own) @ values[run[0].basis].T).reshape(-1) for run in layout.runs]
        whole = space(blocks[0]).concatenate(blocks)
        total = whole if total is None else total + whole
    return total
