"""Variance of deviations through the error values: |F g|² with the gradient g of the deviation and any root F of a covariance.

A deviation depends on the coefficients through the error values alone, e = Σ basis · c, and those of one axis on its position
alone. So F is carried to error values once per distinct position of every axis (T, below), not once per point, and

    |F g|² = Σ_ab p_a (T_a T_bᵀ) p_b,   p_a: partial derivatives of the deviation by the error values that depend on axis a.

On a grid the products T_a T_bᵀ are made once per pair of positions. Exact: the same number as with the gradient itself.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from volid.error_model import ROWS, Layout, Term
from volid.splines import Basis, evaluate

CHUNK = 1024
THREADS = 2
WORTH_A_TABLE = 4  # pairs of positions per point up to which their products are made beforehand


def linear_uncertainty(rows: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Standard uncertainty √(r C rᵀ) of linear outputs `rows` (q, n): shape (…, q) for `covariance` C (…, n, n)."""
    return np.asarray(np.sqrt(np.maximum(np.sum((rows @ covariance) * rows, axis=-1), 0.0)))


class Tables(NamedTuple):
    """What the error values of one group of axes spread: `rows` of the error values, `number` (m,) of the distinct position of
    every point, `table` (distinct positions, rows, r)."""

    rows: np.ndarray
    number: np.ndarray
    table: np.ndarray


def _axes_of(basis: Basis) -> tuple[int, ...]:
    """Axes that a basis depends on."""
    axes = {f.axis for f in basis.factors} | ({basis.linear[0]} if basis.linear else set())
    return tuple(sorted(axes | ({basis.directed} if basis.directed >= 0 else set())))


def tables_of(layout: Layout, factor: np.ndarray, positions: np.ndarray, direction: np.ndarray) -> list[Tables]:
    """Tables of every group of axes, for `factor` (r, n_coefficients) and points (m, n_axes)."""
    groups: dict[tuple[int, ...], list[Term]] = {}
    for term in layout.terms:
        groups.setdefault(_axes_of(term.basis), []).append(term)
    return [_table(axes, terms, factor, positions, direction) for axes, terms in groups.items()]


def _table(
    axes: tuple[int, ...], terms: list[Term], factor: np.ndarray, positions: np.ndarray, direction: np.ndarray
) -> Tables:
    columns = list(axes)
    where = np.hstack([positions[:, columns], direction[:, columns]])
    distinct, index = _distinct(where)
    q, way = np.zeros((positions.shape[1], len(distinct))), np.zeros((positions.shape[1], len(distinct)))
    q[columns], way[columns] = distinct[:, : len(columns)].T, distinct[:, len(columns) :].T
    rows = list(dict.fromkeys(t.row for t in terms))
    table = np.zeros((len(distinct), len(rows), len(factor)))
    values: dict[Basis, np.ndarray] = {}
    for term in terms:
        if term.basis not in values:
            values[term.basis] = evaluate(term.basis, q, way)
        own = factor[:, term.start : term.start + term.basis.size]
        table[:, rows.index(term.row)] += term.sign * (values[term.basis].T @ own.T)
    return Tables(np.array(rows), index, table)


def _distinct(where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct rows and the number of each row's own: column by column, since sorting whole rows is slow."""
    number = np.zeros(len(where), dtype=np.int64)
    for column in where.T:
        found, own = np.unique(column, return_inverse=True)
        _, number = np.unique(number * len(found) + own, return_inverse=True)
    _, first, index = np.unique(number, return_index=True, return_inverse=True)
    return where[first], np.asarray(index).ravel()


def squares(groups: list[Tables], partials: Iterator[tuple[slice, np.ndarray]], n_axes: int, m: int) -> np.ndarray:
    """|F g|² of every component, shape (k, m); `partials`: slices of points, each with (k, error values, points)."""
    n_rows = ROWS * (n_axes + 1)
    pairs = sum(len(a.table) * len(b.table) for i, a in enumerate(groups) for b in groups[i:])
    products = _products(groups) if pairs <= WORTH_A_TABLE * m else None

    def of(points: slice, p: np.ndarray) -> np.ndarray:
        weights = np.ascontiguousarray(p.transpose(2, 0, 1))
        if products is None:
            spread = np.zeros((len(weights), n_rows, groups[0].table.shape[2] if groups else 0))
            for g in groups:
                spread[:, g.rows] += g.table[g.number[points]]
            return np.asarray(np.sum((weights @ spread) ** 2, axis=2).T)
        covariance = _gather(groups, products, points, n_rows)
        return np.asarray(np.sum((weights @ covariance) * weights, axis=2).T)

    parts: list[np.ndarray] = []
    with ThreadPoolExecutor(THREADS) as pool:  # NumPy lets other threads work meanwhile
        waiting: deque[Future[np.ndarray]] = deque()
        for points, p in partials:
            waiting.append(pool.submit(of, points, p))
            if len(waiting) > 2 * THREADS:
                parts.append(waiting.popleft().result())
        parts += [f.result() for f in waiting]
    return np.concatenate(parts, axis=1)


def _products(groups: list[Tables]) -> dict[tuple[int, int], np.ndarray]:
    """T_a T_bᵀ for every pair of groups and positions: (positions of a, positions of b, rows of a, rows of b)."""
    result = {}
    for i, a in enumerate(groups):
        for j, b in enumerate(groups[i:], start=i):
            flat = a.table.reshape(-1, a.table.shape[2]) @ b.table.reshape(-1, b.table.shape[2]).T
            shape = (*a.table.shape[:2], *b.table.shape[:2])
            result[i, j] = np.ascontiguousarray(flat.reshape(shape).transpose(0, 2, 1, 3))
    return result


def _gather(
    groups: list[Tables], products: dict[tuple[int, int], np.ndarray], points: slice, n_rows: int
) -> np.ndarray:
    """Covariance of the error values at some points, (points, rows, rows), from the products; zero where nothing depends."""
    result = np.zeros((len(groups[0].number[points]) if groups else 0, n_rows, n_rows))
    for (i, j), product in products.items():
        a, b = groups[i], groups[j]
        own = product[a.number[points], b.number[points]]
        result[_block(a.rows, b.rows)] += own
        if i != j:
            result[_block(b.rows, a.rows)] += own.transpose(0, 2, 1)
    return result


def _block(rows: np.ndarray, columns: np.ndarray) -> tuple[Any, ...]:
    """Index of a block of matrices: by slices where both lie in sequence, which is much faster than by numbers."""
    if all(np.array_equal(n, np.arange(n[0], n[0] + len(n))) for n in (rows, columns)):
        return slice(None), slice(rows[0], rows[0] + len(rows)), slice(columns[0], columns[0] + len(columns))
    return slice(None), rows[:, None], columns
