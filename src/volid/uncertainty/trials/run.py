"""The trials of one Monte Carlo run by their numbers: what makes them, and the batches in which they are carried out and kept.

A trial follows from the seed and its number alone, so it does not matter which process makes it, and in which order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from volid.effects.prediction import effect_samples
from volid.fitting.equations.problem import random_effects
from volid.fitting.solution import Solution
from volid.uncertainty.trials.draws import Pseudo, point_scatter, pseudo_of, room_for, trial_noise
from volid.uncertainty.trials.refit import AT_ONCE, Refitter, joined
from volid.uncertainty.trials.samples import TrialFolder

BATCH = 1024  # trials
Progress = Callable[[str], None]
CarryOut = Callable[[TrialFolder, int, int, Progress], None]
"""Carries out trials first … last - 1, as far as they are not in the folder yet."""


class Run(NamedTuple):
    """What makes the trials, and how they are carried out."""

    refitter: Refitter
    seed: int
    pseudo: Pseudo


def run_of(solution: Solution, seed: int) -> Run:
    """Everything the trials of a seed need."""
    refitter = Refitter(solution)
    refitter.prepare()
    entries = tuple(solution.nuisance_table[j] for j in refitter.known)
    points = point_scatter(refitter.campaign, random_effects(solution.campaign, refitter.starts))
    pseudo = pseudo_of(entries, effect_samples(solution.campaign), points)
    return Run(refitter, seed, pseudo._replace(smooth=None if solution.smooth is None else solution.smooth.noise))


def run_trials(
    run: Run, first: int, count: int, tell: Callable[[int], None] = lambda number: None
) -> dict[str, np.ndarray]:
    """Trials first … first + count - 1, as arrays by name; `tell` is called with the number of every few trials done."""
    refitter, found = run.refitter, []
    # one room for all: fresh memory would cost as much as the numbers
    room = room_for(min(AT_ONCE, count), refitter.n_readings)
    for start in range(first, first + count, AT_ONCE):  # noise of so few trials stays in the cache
        number = min(AT_ONCE, first + count - start)
        noise = trial_noise(run.seed, start, number, refitter.n_readings, refitter.n_prior, run.pseudo, room)
        found.append(refitter.refit(*noise))
        tell(number)
    refits = joined(found)
    # what enlarges u enlarges the spread of the trials about the solution
    enlarged = refitter.centre + refitter.solution.factor * (refits.x - refitter.centre)
    return refits._replace(x=enlarged)._asdict()


def batches_to_do(store: TrialFolder, first: int, last: int) -> list[int]:
    """Numbers of the batches that trials first … last - 1 need and that are not there yet; batches are always whole."""
    return [b for b in range(first // BATCH, -(-last // BATCH)) if not store.done(b)]
