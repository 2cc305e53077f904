"""Random numbers of one trial: they follow from seed and trial number alone, whatever the batch or the worker."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign, Effect
from volid.effects.distributions import NORMAL, standardised
from volid.effects.random import Scatter, split_normal
from volid.observations.base import Nuisance

GENERATOR = "SFC64"
ALIGNMENT = 64  # bytes, of arrays that JAX takes without a copy


class Pseudo(NamedTuple):
    """How trials scatter where they are not normal.

    `distributions`, `samples`: of the pseudo-readings of prior knowledge; normal for the rest. `points`: what effects drawn anew
    for every reading bring, as shares (N,) of the standard deviation of the whitened noise, which is 1. `smooth` (s, h): what the
    uncertainty of the smoothness adds to its pseudo-readings, the last s, times h standard normal numbers.
    """

    distributions: tuple[str, ...]
    samples: tuple[tuple[float, ...], ...]
    points: tuple[Scatter, ...] = ()
    smooth: np.ndarray | None = None


def pseudo_of(
    entries: tuple[Nuisance, ...], samples: dict[str, tuple[float, ...]], points: tuple[Scatter, ...] = ()
) -> Pseudo:
    """The distributions of nuisance parameters known beforehand, and of effects drawn anew for every reading."""
    return Pseudo(tuple(e.distribution for e in entries), tuple(samples.get(e.effect, ()) for e in entries), points)


def point_scatter(campaign: Campaign, random: list[list[tuple[Effect, np.ndarray]]]) -> tuple[Scatter, ...]:
    """Shares of the effects `random` (per set, with their variances) in the whitened noise of a campaign with enlarged u."""
    u = np.concatenate([s.u.ravel() for s in campaign.sets])
    first = np.cumsum([0, *(s.u.size for s in campaign.sets)])
    found = []
    for i, parts in enumerate(random):
        for part in split_normal(parts)[1]:
            share = np.zeros(len(u))
            share[first[i] : first[i + 1]] = part.deviation.ravel()
            found.append(part._replace(deviation=share / u))
    return tuple(found)


def trial_generator(seed: int, trial: int) -> np.random.Generator:
    """Random numbers of one trial: SFC64, the fastest of NumPy's, seeded by a hash of both numbers."""
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=(trial,))))


def room_for(count: int, n_readings: int) -> np.ndarray:
    """Memory for the noise of `count` trials, (count, n_readings), that JAX reads where it stands.

    Whoever writes to it again waits until everything computed from it is there.
    """
    padded = np.empty(count * n_readings + ALIGNMENT // 8)
    first = -(padded.ctypes.data // 8) % (ALIGNMENT // 8)
    return padded[first : first + count * n_readings].reshape(count, n_readings)


def trial_noise(
    seed: int,
    first: int,
    count: int,
    n_readings: int,
    n_prior: int,
    pseudo: Pseudo,
    room: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Whitened noise of trials first … first + count - 1: (count, n_readings) and (count, n_prior).

    `room`: where the first of them stands until the next call with the same room.
    """
    noise = room_for(count, n_readings) if room is None else room[:count]
    prior = np.empty((count, n_prior))
    rest = np.sqrt(np.maximum(1.0 - sum(p.deviation**2 for p in pseudo.points), 0.0))

    for i in range(count):
        rng = trial_generator(seed, first + i)
        rng.standard_normal(out=noise[i])
        if pseudo.points:
            noise[i] *= rest
            for part in pseudo.points:
                noise[i] += part.deviation * standardised(part.distribution, rng, n_readings, part.samples)
        prior[i] = rng.standard_normal(n_prior)
        for j, name in enumerate(pseudo.distributions):
            if name != NORMAL:  # the pseudo-reading stays, the true value scatters: opposite sign
                prior[i, j] = -standardised(name, rng, 1, pseudo.samples[j])[0]
        if pseudo.smooth is not None and pseudo.smooth.size:
            prior[i, n_prior - len(pseudo.smooth) :] += pseudo.smooth @ rng.standard_normal(pseudo.smooth.shape[1])
    return noise, prior
