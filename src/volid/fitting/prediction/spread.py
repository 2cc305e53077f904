"""Variance of deviations through the error values: |F g|² with the gradient g of the deviation and any root F of a covariance.

A deviation depends on the coefficients through the error values alone, e = Σ basis · c, and those of one axis on its position
alone. So F is carried to error values once per distinct position of every axis (T, below), not once per point, and

    |F g|² = Σ_ab p_a (T_a T_bᵀ) p_b,   p_a: partial derivatives of the deviation by the error values that depend on axis a.

On a grid the products T_a T_bᵀ are made once per pair of positions. Exact: the same number as with the gradient itself.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from volid.model.error_model import Layout, Term
from volid.model.splines import Basis, evaluate

CHUNK = 512  # points at once
WORTH_A_TABLE = 4  # pairs of positions per point up to which their products are made beforehand


def linear_uncertainty(rows: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Standard uncertainty √(r C rᵀ) of linear outputs `rows` (q, n): shape (…, q) for `covariance` C (…, n, n)."""
    return np.asarray(np.sqrt(np.maximum(np.sum((rows @ covariance) * rows, axis=-1), 0.0)))


def covariance_root(covariance: np.ndarray) -> np.ndarray:
    """A root R, R Rᵀ = C, of a covariance C (n, n), whose smallest eigenvalues may be below 0 by rounding; shape (n, n)."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


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


@lru_cache(maxsize=64)
def groups_of(layout: Layout) -> dict[tuple[int, ...], list[Term]]:
    """Terms by the axes that they depend on."""
    groups: dict[tuple[int, ...], list[Term]] = {}
    for term in layout.terms:
        groups.setdefault(_axes_of(term.basis), []).append(term)
    return groups


def rows_of(terms: list[Term]) -> list[int]:
    """Rows of the error values that terms add to."""
    return list(dict.fromkeys(t.row for t in terms))


def tables_of(layout: Layout, factor: np.ndarray, positions: np.ndarray, direction: np.ndarray) -> list[Tables]:
    """Tables of every group of axes, for `factor` (r, n_coefficients) and points (m, n_axes)."""
    return [_table(axes, terms, factor, positions, direction) for axes, terms in groups_of(layout).items()]


def _table(
    axes: tuple[int, ...], terms: list[Term], factor: np.ndarray, positions: np.ndarray, direction: np.ndarray
) -> Tables:
    columns = list(axes)
    directed = sorted({t.basis.directed for t in terms} - {-1})
    distinct, index = _distinct([*positions[:, columns].T, *direction[:, directed].T], len(positions))
    q, way = (np.zeros((positions.shape[1], len(distinct))) for _ in range(2))
    q[columns], way[directed] = distinct[:, : len(columns)].T, distinct[:, len(columns) :].T
    rows = rows_of(terms)
    table = np.zeros((len(distinct), len(rows), len(factor)))
    values: dict[Basis, np.ndarray] = {}
    for term in terms:
        if term.basis not in values:
            values[term.basis] = evaluate(term.basis, q, way)
        own = factor[:, term.start : term.start + term.basis.size]
        table[:, rows.index(term.row)] += term.sign * (values[term.basis].T @ own.T)
    return Tables(np.array(rows), index, table)


def _distinct(columns: list[np.ndarray], m: int) -> tuple[np.ndarray, np.ndarray]:
    """Distinct rows of some columns (m,), and the number of each row's own; column by column: sorting whole rows is slow."""
    number = np.zeros(m, dtype=np.int64)
    found = np.zeros((min(m, 1), 0))
    for column in columns:
        values, own = _ranked(column)
        numbers, number = _ranked(number * len(values) + own)
        found = np.column_stack([found[numbers // len(values)], values[numbers % len(values)]])
    return found, number


def _ranked(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct values in order and the number of each value's own: as `np.unique`, of runs of equal values at once."""
    begins = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]])) if len(values) else np.zeros(0, int)
    distinct, own = np.unique(values[begins], return_inverse=True)
    return distinct, np.repeat(own, np.diff(begins, append=len(values)))


def squares(groups: list[Tables], points: slice, partials: np.ndarray) -> np.ndarray:
    """|F g|² of every component, (k, m), of some points whose pairs of positions are too many for `products`.

    `partials` (k, error values, m).
    """
    found = np.empty((len(partials), partials.shape[2]))
    for start in range(0, found.shape[1], CHUNK):
        part = slice(start, min(start + CHUNK, found.shape[1]))
        weights = np.ascontiguousarray(partials[:, :, part].transpose(2, 0, 1))
        spread = np.zeros((len(weights), partials.shape[1], groups[0].table.shape[2]))
        for g in groups:
            spread[:, g.rows] += g.table[g.number[points][part]]
        found[:, part] = np.sum((weights @ spread) ** 2, axis=2).T
    return found


def worth_products(groups: list[Tables], m: int) -> bool:
    """Whether m points lie on so few pairs of positions that their products are made beforehand."""
    pairs = sum(len(a.table) * len(b.table) for i, a in enumerate(groups) for b in groups[i:])
    return pairs <= WORTH_A_TABLE * m


def products(groups: list[Tables]) -> list[np.ndarray]:
    """T_a T_bᵀ for every pair of groups a ≤ b and of positions: (positions of a, positions of b, rows of a, rows of b)."""
    result = []
    for i, a in enumerate(groups):
        for b in groups[i:]:
            flat = a.table.reshape(-1, a.table.shape[2]) @ b.table.reshape(-1, b.table.shape[2]).T
            shape = (*a.table.shape[:2], *b.table.shape[:2])
            result.append(np.ascontiguousarray(flat.reshape(shape).transpose(0, 2, 1, 3)))
    return result


def quadratic_forms(partials: list[Any], tables: list[Any], number: Any) -> Any:
    """Σ_ab p_a (T_a T_bᵀ) p_b of every component, (k, m), in NumPy or JAX.

    `partials`: of every group (k, rows, m). `tables`: `products`. `number` (groups, m): distinct position of every point.
    """
    total: Any = 0.0
    remaining = iter(tables)
    for i, a in enumerate(partials):
        for j, b in enumerate(partials[i:], start=i):
            table = next(remaining)
            first, second, rows, columns = table.shape
            gathered = table.reshape(first * second, rows * columns)[number[i] * second + number[j]]
            covariance = gathered.T.reshape(rows, columns, -1)
            carried = sum(a[:, r, None] * covariance[r] for r in range(rows))  # (k, columns, m)
            total = total + (1.0 if i == j else 2.0) * (carried * b).sum(axis=1)
    return total
