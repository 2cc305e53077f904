"""Points spread evenly: on a line by a step, over the unit cube by the Halton sequence, shifted at random.

Only NumPy is used, because SciPy's sequences take longer to import than most fits last.
"""

from __future__ import annotations

import numpy as np

PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29)


DIGITS = 6  # decimal places of positions [mm or degrees]: a nanometre, less than any scale resolves


def round_position(positions: np.ndarray) -> np.ndarray:
    """Positions without the noise of binary numbers: 76.2, not 76.19999999999999."""
    return np.round(positions, DIGITS) + 0.0


def every_step(low: float, high: float, step: float) -> np.ndarray:
    """Positions every `step` > 0 from the lower end on, and the upper end; those between are rounded to 1e-6.

    >>> every_step(0.0, 1.0, 0.4).tolist(), every_step(0.0, 100.0, 25.4).tolist()
    ([0.0, 0.4, 0.8, 1.0], [0.0, 25.4, 50.8, 76.2, 100.0])
    """
    inner = low + step * np.arange(int(np.floor((high - low) / step + 1e-9)) + 1)
    return _between(low, high, inner if high - inner[-1] < 1e-6 * step else np.append(inner, high))


def evenly(low: float, high: float, n: int) -> np.ndarray:
    """`n` equally spaced positions, the ends among them; those between are rounded to 1e-6.

    >>> evenly(0.0, 0.9, 4).tolist()
    [0.0, 0.3, 0.6, 0.9]
    """
    return _between(low, high, np.linspace(low, high, n))


def _between(low: float, high: float, positions: np.ndarray) -> np.ndarray:
    """Rounded positions, but the ends as they are: a table must not end before them."""
    rounded = round_position(positions)
    rounded[np.abs(positions - low) < 10.0**-DIGITS] = low
    rounded[np.abs(positions - high) < 10.0**-DIGITS] = high
    return rounded


def number_of_steps(low: float, high: float, step: float) -> float:
    """How many positions `every_step` gives, before there are any; infinite where a float cannot hold the number.

    >>> number_of_steps(0.0, 1.0, 0.4)
    4.0
    """
    with np.errstate(over="ignore"):
        full = float(np.floor(np.divide(high - low, step) + 1e-9))
    return full + 1.0 + (high - (low + step * full) >= 1e-6 * step)


def even_points(n: int, dimension: int, seed: int = 0) -> np.ndarray:
    """`n` points in [0, 1)^dimension, shape (n, dimension); `dimension` up to 10. Cranley and Patterson 1976.

    >>> even_points(4, 2, seed=0).round(3).shape
    (4, 2)
    """
    shift = np.random.default_rng(seed).random(dimension)
    columns = [radical_inverse(np.arange(1, n + 1), prime) for prime in PRIMES[:dimension]]
    return (np.stack(columns, axis=1) + shift) % 1.0


def radical_inverse(numbers: np.ndarray, base: int) -> np.ndarray:
    """Digits of whole numbers in `base`, mirrored at the point: 6 = 110 in base 2 becomes 0.011. Halton 1960."""
    result, share, remaining = np.zeros(len(numbers)), 1.0 / base, np.asarray(numbers).copy()
    while remaining.any():
        result += share * (remaining % base)
        remaining //= base
        share /= base
    return result
