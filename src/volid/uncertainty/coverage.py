"""Coverage intervals from samples, and when propagation would have been enough (JCGM 101:2008, 7.7, 7.9, 8)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from volid.exceptions import InputError

PROBABILITY = 0.95


class Intervals(NamedTuple):
    """End points of coverage intervals of q quantities, each (q,): probabilistically symmetric, and shortest."""

    low: np.ndarray
    high: np.ndarray
    shortest_low: np.ndarray
    shortest_high: np.ndarray


def coverage_intervals(samples: np.ndarray, probability: float = PROBABILITY) -> Intervals:
    """Coverage intervals of the columns of `samples`, shape (m, q), for one coverage `probability`. JCGM 101 7.7.

    With q = pM, rounded up to an integer, and r = (M - q)/2, the interval [y(r), y(r + q)] is symmetric in probability. The
    shortest interval is that of all [y(r), y(r + q)] with the least length. Raises `InputError` for less than 1/(1 - p) samples.
    """
    m = len(samples)
    if m < 1.0 / (1.0 - probability):
        least = 1.0 / (1.0 - probability)
        raise InputError(
            f"{m} samples; a {probability:.0%} interval needs at least {least:.0f}; take more `trials`, some may have failed"
        )
    ordered = np.array(samples.T, order="C")  # in one piece by quantity: several times faster to sort
    ordered.sort(axis=1)
    inside = min(int(np.floor(probability * m + 0.5)), m - 1)
    first = int(np.floor(0.5 * (m - inside) + 0.5)) - 1
    first = min(max(first, 0), m - 1 - inside)
    best = np.argmin(ordered[:, inside:] - ordered[:, : m - inside], axis=1)
    rows = np.arange(len(ordered))
    return Intervals(
        ordered[:, first].copy(), ordered[:, first + inside].copy(), ordered[rows, best], ordered[rows, best + inside]
    )


def numerical_tolerance(u: np.ndarray, digits: int) -> np.ndarray:
    """δ = 10^l / 2 with u = c · 10^l and c an integer of `digits` decimal digits; 0 where u is 0. JCGM 101 7.9.2."""
    u = np.asarray(u, dtype=float)
    safe = np.where(u > 0.0, u, 1.0)
    exponent = np.floor(np.log10(safe)) - (digits - 1)
    rounded = np.round(safe / 10.0**exponent)  # 9.96 with two digits is 10 · 10^0, not 99 · 10^-1
    exponent = np.where(rounded >= 10**digits, exponent + 1, exponent)
    return np.where(u > 0.0, 0.5 * 10.0**exponent, 0.0)


class Validity(NamedTuple):
    """Differences of the end points |y ± k u - end point|, each (q,), the tolerance δ, and the verdict.

    `valid`: both differences are within δ. `decided`: the end points of Monte Carlo are known well enough to say so: the larger
    difference is further from δ than twice their standard deviation from sampling.
    """

    low: np.ndarray
    high: np.ndarray
    tolerance: np.ndarray
    valid: np.ndarray
    decided: np.ndarray


def gum_validity(
    estimate: np.ndarray,
    u: np.ndarray,
    found: Intervals,
    trials: int,
    digits: int = 1,
    probability: float = PROBABILITY,
) -> Validity:
    """Compare propagation (estimate ± k u, normal) with the symmetric intervals of Monte Carlo. JCGM 101 8.1.

    `trials`: M, behind the intervals. `digits`: significant digits of u that matter, one or two. An end point at probability a
    has the standard deviation sqrt(a (1 - a)/M) over the density there, taken as normal.
    """
    k = float(ndtri(0.5 + 0.5 * probability))
    low, high = np.abs(estimate - k * u - found.low), np.abs(estimate + k * u - found.high)
    tolerance = numerical_tolerance(u, digits)
    tail = 0.5 - 0.5 * probability
    sampling = np.sqrt(tail * (1.0 - tail) / trials) / (np.exp(-0.5 * k**2) / np.sqrt(2.0 * np.pi)) * u
    larger = np.maximum(low, high)
    return Validity(low, high, tolerance, larger <= tolerance, np.abs(larger - tolerance) > 2.0 * sampling)
