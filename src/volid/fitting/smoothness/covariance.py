"""Prior covariance of smooth functions: a Matérn process of order 13/2 around a free line, on the line or on the circle.

A function with this prior has six continuous derivatives. Its `length` l (in units of the range) says over which distance
values stay alike, its `size` s how far they go: cov(f(x), f(x')) = s² k(|x - x'|), with p = 6 and r = √(2p + 1) d / l

    k(d) = exp(-r) p!/(2p)! Σ_i (p + i)!/(i! (p - i)!) (2r)^(p - i).

Constant and line are free (an improper prior: nothing is assumed of them); on a full turn, the constant alone. Orders from 9/2
to 17/2 gave the same fits where readings are many; between few positions a lower one gives u up to twice as large, a higher one
relies on more smoothness than a machine can be known to have.

The prior stands as pseudo-readings W c with unit variance on the spline's coefficients c: values at the spline's Greville
points g, whitened by the covariance there, and without what is free: W = Nᵀ L⁻¹ B(g), L Lᵀ = K(g, g), N orthogonal to L⁻¹ X, X
the free functions at g. Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, 2.7 (free functions), 4.2.1
(Matérn). Not modelled: a function that is smoother in one part of its range than in another; waves shorter than the knots'
spacing.
"""

from __future__ import annotations

from functools import lru_cache
from math import factorial

import numpy as np
from scipy.linalg import solve_triangular

from volid.model.splines import Spline, design_matrix

NUGGET = 1e-10  # of the variance, added to the diagonal: covariances of long lengths are nearly singular
ORDER = 6  # p of the order p + 1/2
COEFFICIENTS = [
    factorial(ORDER) / factorial(2 * ORDER) * factorial(ORDER + i) / (factorial(i) * factorial(ORDER - i))
    for i in range(ORDER + 1)
]
HARMONICS = 200  # of a process on the circle


def matern(distance: np.ndarray, length: float) -> np.ndarray:
    """Correlation of a Matérn process of order 13/2 at `distance`, both in one unit, any shape.

    >>> float(matern(np.array(0.0), 0.3))
    1.0
    """
    r = np.sqrt(2.0 * ORDER + 1.0) * np.abs(distance) / length
    value = np.zeros_like(r)
    for c in COEFFICIENTS:  # Horner's scheme, the highest power first
        value = value * (2.0 * r) + c
    return np.asarray(np.exp(-r) * value)


def greville_points(spline: Spline) -> np.ndarray:
    """One point per coefficient, shape (size,): where the coefficient acts most. In units of the range, 0 … 1 and a little
    beyond.
    """
    steps = np.arange(spline.size) + 0.5 * (1 - spline.degree)
    return np.asarray((steps % spline.segments if spline.periodic else steps) / spline.segments)


def correlation(spline: Spline, length: float) -> np.ndarray:
    """Correlation of a function's values at its Greville points, shape (size, size), nugget included.

    `length`: in units of the range. On a full turn the process is wrapped around the circle, without its constant part, and
    scaled to variance 1.
    """
    x = greville_points(spline)
    distance = x[:, None] - x[None, :]
    values = _on_the_circle(distance, length) if spline.periodic else matern(distance, length)
    return np.asarray(values + NUGGET * np.eye(len(x)))


def _on_the_circle(distance: np.ndarray, length: float) -> np.ndarray:
    """Σ S(n) cos(2π n d) / Σ S(n), n = 1, 2, …, with the spectral density S(n) = (1 + (2π n l / 3)²)⁻⁵ of the process on the
    line.
    """
    n = np.arange(1, HARMONICS + 1)
    weight = (1.0 + (2.0 * np.pi * n * length) ** 2 / (2.0 * ORDER + 1.0)) ** -(ORDER + 1.0)
    turns, number = np.unique(np.round(np.mod(distance, 1.0), 12), return_inverse=True)
    values = np.cos(2.0 * np.pi * turns[:, None] * n) @ weight / np.sum(weight)
    return np.asarray(values[number].reshape(distance.shape))


def free_functions(spline: Spline) -> np.ndarray:
    """Values at the Greville points of what the prior leaves free, shape (size, 2): constant and line; on a turn (size, 1)."""
    x = greville_points(spline)
    return np.stack([np.ones_like(x)] if spline.periodic else [np.ones_like(x), x - 0.5], axis=1)


@lru_cache(maxsize=256)
def values_at_greville(spline: Spline) -> np.ndarray:
    """Values of the basis functions at the Greville points, shape (size, size)."""
    low, high = spline.low, spline.high
    return design_matrix(spline, low + (high - low) * greville_points(spline))


def pseudo_readings(covariance: np.ndarray, free: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """W (n - free columns, coefficients): values `basis` · c, whitened by `covariance` (n, n), without the span of `free`."""
    lower = np.linalg.cholesky(covariance)
    whitened = solve_triangular(lower, np.hstack([free, basis]), lower=True)
    span, rest = whitened[:, : free.shape[1]], whitened[:, free.shape[1] :]
    across = np.linalg.qr(span, mode="complete")[0][:, free.shape[1] :]
    return np.asarray(across.T @ rest)


TABLE_STEP = 0.025  # of log length; cubic interpolation of the precision is good to 1e-4
SHORTEST, TABLE = np.log(0.02), 228  # log length of the first step, and number of steps: up to 6 ranges


def unit_rows(spline: Spline, length: float) -> np.ndarray:
    """Pseudo-readings on the coefficients of one spline for a process of size 1, shape (size - free functions, size)."""
    return pseudo_readings(correlation(spline, length), free_functions(spline), values_at_greville(spline))


@lru_cache(maxsize=4096)
def _tabulated(segments: int, degree: int, periodic: bool, number: int) -> np.ndarray:
    """Precision of the coefficients at one of equal steps of log length, (size, size): the same for every range."""
    rows = unit_rows(Spline(0, 0.0, 1.0, segments, degree, periodic), float(np.exp(SHORTEST + TABLE_STEP * number)))
    return np.asarray(rows.T @ rows)


def unit_precision(spline: Spline, log_length: float) -> tuple[np.ndarray, np.ndarray]:
    """Precision WᵀW of the coefficients for a process of size 1, and its derivative by log length, (size, size) each.

    Cubic interpolation between tabulated lengths (Catmull-Rom): exact in what is free.
    """
    x = (log_length - SHORTEST) / TABLE_STEP
    if not np.isfinite(x):
        raise np.linalg.LinAlgError("the length of a process is no number")
    i = int(np.clip(np.floor(x), 1, TABLE - 3))
    t = float(np.clip(x - i, -1.0, 2.0))
    value = 0.5 * np.array([-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, t**3 - t**2])
    slope = 0.5 * np.array([-1 + 4 * t - 3 * t**2, -10 * t + 9 * t**2, 1 + 8 * t - 9 * t**2, 3 * t**2 - 2 * t])
    near = np.stack([_tabulated(spline.segments, spline.degree, spline.periodic, i + k) for k in range(-1, 3)])
    return np.tensordot(value, near, axes=1), np.tensordot(slope / TABLE_STEP, near, axes=1)
