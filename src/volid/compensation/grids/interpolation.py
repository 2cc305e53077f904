"""Linear interpolation between the nodes of a regular grid, as a control does it."""

from __future__ import annotations

from itertools import product

import numpy as np

from volid.model.machine import Axis


def period_of(axis: Axis, nodes: np.ndarray) -> float:
    """360 [°] where a full turn's nodes close the circle, so that a control may count turns; else 0."""
    return 360.0 if axis.is_full_turn and nodes[-1] - nodes[0] >= 360.0 - 1e-6 else 0.0


def grid_positions(nodes: tuple[np.ndarray, ...]) -> np.ndarray:
    """All nodes of a regular grid, shape (n, k), the first axis varying fastest."""
    mesh = np.meshgrid(*reversed(nodes), indexing="ij")
    return np.stack([m.ravel() for m in reversed(mesh)], axis=1)


def into_period(x: np.ndarray, low: float, high: float, period: float) -> np.ndarray:
    """Positions beyond low … high counted back by whole periods; as they are with `period` 0."""
    if not period:
        return x
    return np.where((x < low) | (x > high), low + np.mod(x - low, period), x)


def interpolate(nodes: tuple[np.ndarray, ...], table: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Values at `positions` (m, k) of a `table` (n_1, …, n_k, c) over increasing `nodes` (n_i,); shape (m, c).

    Multilinear between the 2^k nodes around a position. Raises `ValueError` for a position outside the nodes.
    """
    cells, shares = [], []
    for line, x in zip(nodes, np.asarray(positions, dtype=float).T, strict=True):
        if np.any((x < line[0]) | (x > line[-1])):
            raise ValueError(f"a position is out of bounds of the grid, {line[0]:g} … {line[-1]:g}")
        cell = np.clip(np.searchsorted(line, x, side="right") - 1, 0, max(len(line) - 2, 0))
        width = line[np.minimum(cell + 1, len(line) - 1)] - line[cell]
        cells.append(cell)
        shares.append((x - line[cell]) / np.where(width > 0.0, width, 1.0))
    result = np.zeros((len(positions), table.shape[-1]))
    for corner in product((0, 1), repeat=len(nodes)):
        at = tuple(np.minimum(c + i, len(n) - 1) for c, i, n in zip(cells, corner, nodes, strict=True))
        weight = np.prod([s if i else 1.0 - s for s, i in zip(shares, corner, strict=True)], axis=0)
        result += weight[:, None] * table[at]
    return result
