"""Functions of low order along an axis, for alternatives that need no more than to be recognised."""

from __future__ import annotations

import numpy as np

from volid.model.machine import Axis


def low_order(axis: Axis, positions: np.ndarray, order: int) -> np.ndarray:
    """Functions of 1 … `order`, (k, n): Legendre polynomials over the travel; harmonics of an axis that turns round."""
    if axis.is_full_turn:
        angle = np.deg2rad(positions)
        return np.stack([f(h * angle) for h in range(1, max(order, 2)) for f in (np.cos, np.sin)])
    x = 2.0 * (positions - axis.travel[0]) / max(axis.length, 1e-300) - 1.0
    return np.stack([np.polynomial.Legendre.basis(i + 1)(x) for i in range(order)])


def span(values: np.ndarray) -> np.ndarray:
    """Values moved and scaled to -1 … 1; none stay none, as of places where a result is determined."""
    if not len(values):
        return values
    low, high = float(values.min()), float(values.max())
    return np.asarray((2.0 * values - low - high) / max(high - low, 1e-300))


def products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products of all pairs of functions (k, n) and (l, n), (k · l, n)."""
    return np.asarray((a[:, None, :] * b[None, :, :]).reshape(len(a) * len(b), a.shape[1]))
