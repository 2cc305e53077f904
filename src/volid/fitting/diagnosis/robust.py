"""Gross outliers: Huber's loss by reweighting finds them, normalised residuals name them, the other readings are fitted again.

The first step is iteratively reweighted least squares with Huber weights (Huber and Ronchetti, Robust Statistics, 7.8). Then the
readings whose normalised residual w = r / (u sqrt(1 - h)) exceeds the critical value are set aside in rounds, and may be taken
back in a later one (Baarda 1968, data snooping; Teunissen, Testing Theory, 4).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

HUBER = 1.5
REWEIGHTINGS = 6
GENERATIONS = 6
SIGNIFICANCE = 0.05


class Weighted(NamedTuple):
    """A weighted fit, as the robust loop sees it: whitened residuals r/u and leverages h, (m, k) per set."""

    residuals: list[np.ndarray]
    leverages: list[np.ndarray]


def critical_value(n_readings: int) -> float:
    """Two-sided 5 % critical value of the largest of n normalised residuals (Bonferroni)."""
    return -float(ndtri(0.5 * SIGNIFICANCE / max(n_readings, 1)))


def spread(residuals: list[np.ndarray]) -> float:
    """Robust standard deviation of the whitened residuals (normalised median absolute deviation), at least 1."""
    values = np.concatenate([r.ravel() for r in residuals])
    return max(1.0, 1.4826 * float(np.median(np.abs(values))))


def huber_factors(residuals: list[np.ndarray]) -> list[np.ndarray]:
    """Square roots of Huber weights, min(1, k s / |r|)."""
    limit = HUBER * spread(residuals)
    return [np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(r), 1e-300))) for r in residuals]


def set_aside(fit: Weighted) -> list[np.ndarray]:
    """Which readings are outliers of a fit: |r| / (s sqrt(1 - h)) beyond the critical value."""
    n = sum(r.size for r in fit.residuals)
    limit = critical_value(n) * spread(fit.residuals)
    return [
        np.abs(r) > limit * np.sqrt(np.maximum(1.0 - h, 1e-6))
        for r, h in zip(fit.residuals, fit.leverages, strict=True)
    ]


def down_weight(fit: Callable[[list[np.ndarray]], list[np.ndarray]], factors: list[np.ndarray]) -> list[np.ndarray]:
    """Huber factors at convergence; `fit` maps square-root weights to whitened residuals."""
    for _ in range(REWEIGHTINGS):
        new = huber_factors(fit(factors))
        change = max(float(np.max(np.abs(a - b), initial=0.0)) for a, b in zip(new, factors, strict=True))
        factors = new
        if change < 0.02:
            break
    return factors


def name_outliers(fit: Callable[[list[np.ndarray]], Weighted], outliers: list[np.ndarray]) -> list[np.ndarray]:
    """Outliers when the remaining readings are fitted without them, iterated until the set repeats."""
    for _ in range(GENERATIONS):
        found = set_aside(fit([np.where(o, 0.0, 1.0) for o in outliers]))
        same = all(np.array_equal(a, b) for a, b in zip(found, outliers, strict=True))
        outliers = found
        if same:
            break
    return outliers
