"""Random numbers of one trial: they follow from seed and trial number alone, whatever the batch or the worker."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from volid.observations.base import Nuisance
from volid.observations.distributions import NORMAL, standardised


class Pseudo(NamedTuple):
    """How the pseudo-readings of prior knowledge scatter: distribution and samples of each; normal for the rest."""

    distributions: tuple[str, ...]
    samples: tuple[tuple[float, ...], ...]


def pseudo_of(entries: tuple[Nuisance, ...], samples: dict[str, tuple[float, ...]]) -> Pseudo:
    """The distributions of nuisance parameters known beforehand."""
    return Pseudo(tuple(e.distribution for e in entries), tuple(samples.get(e.effect, ()) for e in entries))


def trial_noise(
    seed: int, first: int, count: int, n_readings: int, n_prior: int, pseudo: Pseudo, threads: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Whitened noise of trials first … first + count - 1: (count, n_readings) and (count, n_prior)."""
    noise, prior = np.empty((count, n_readings)), np.empty((count, n_prior))

    def draw(i: int) -> None:
        rng = np.random.Generator(np.random.Philox(key=[seed, first + i]))
        rng.standard_normal(out=noise[i])
        prior[i] = rng.standard_normal(n_prior)
        for j, name in enumerate(pseudo.distributions):
            if name != NORMAL:  # the pseudo-reading stays, the true value scatters: opposite sign
                prior[i, j] = -standardised(name, rng, 1, pseudo.samples[j])[0]

    if threads > 1:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(draw, range(count), chunksize=max(1, count // (4 * threads))))
    else:
        for i in range(count):
            draw(i)
    return noise, prior
