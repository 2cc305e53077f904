"""Distributions of input quantities, JCGM 101:2008 6.4, and the factor between half width and standard uncertainty."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

NORMAL, SAMPLES = "normal", "samples"
# half width over standard uncertainty (JCGM 101 6.4.2, 6.4.5, 6.4.6)
HALF_WIDTH = {"rectangular": np.sqrt(3.0), "triangular": np.sqrt(6.0), "U-shaped": np.sqrt(2.0)}
DISTRIBUTIONS = (NORMAL, *HALF_WIDTH, SAMPLES)


def standardised(distribution: str, rng: np.random.Generator, size: int, samples: Sequence[float] = ()) -> np.ndarray:
    """`size` independent draws with mean 0 and standard deviation 1, shape (size,).

    `samples`: the values that "samples" draws from, with replacement; their mean and spread are taken out. Raises `KeyError`
    for an unknown name.
    """
    if distribution == NORMAL:
        return rng.standard_normal(size)
    if distribution == SAMPLES:
        values = np.asarray(samples, dtype=float)
        return (rng.choice(values, size) - values.mean()) / values.std()
    half = HALF_WIDTH[distribution]
    if distribution == "rectangular":
        return rng.uniform(-half, half, size)
    if distribution == "triangular":
        return 0.5 * half * (rng.uniform(-1.0, 1.0, size) + rng.uniform(-1.0, 1.0, size))
    return half * np.sin(2.0 * np.pi * rng.uniform(0.0, 1.0, size))
