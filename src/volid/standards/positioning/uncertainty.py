"""Expanded uncertainty of the quantities of ISO 230-2: what instrument, set-up and surroundings may have added to the runs.

The measurand is the quantity of THESE runs: how well the machine repeats is part of it (R, A) and no contribution; how
another test of five runs would come out is not said. With x the deviations that an exact instrument would have shown, and n
what the contributions add, a test shows Q(x + n). Each contribution draws n for every approach at once, so that what is alike
in all runs (a scale) acts on E, A and M, and what changes from approach to approach also on R and B. U is the smallest number
that |Q(x^ + n) - Q(x^)| exceeds in 4.55 % of the draws, which is k = 2 of a normal distribution; it includes that noise only
ever raises a range (JCGM 101, propagation of distributions).

x^ are the measured deviations, shrunk where they are no larger than the contributions themselves explain: four parts (means
of both directions about their mean, half the mean reversal, half reversals about it, scatter about the means) are each
multiplied by 1 - variance of n / variance seen, the share of it that is the machine's, or by 0. Without it, a machine that
repeats better than its instrument would have an R that looks certain. Every Q but B_mean is a seminorm of the deviations, so
that |Q(x + n) - Q(x)| never exceeds Q(n), whatever x is: `largest` is U from n alone.

Source: JCGM 101:2008; the contributions are those that ISO/TR 230-9 and the annex of ISO 230-2 name (recalled), their
propagation is not that of the annex.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from volid.backend.consent import ask_memory
from volid.standards.positioning.runs import PositioningRuns, Statistics, statistics_of

TRIALS, FEWEST = 4000, 400  # of a test of many approaches fewer
NUMBERS, COPIES = 4_000_000, 6  # drawn at once; arrays of that size that are in memory together
PROBABILITY = 0.9545  # k = 2
SURE = 0.99  # that the contributions explain no more variance than is taken out
_LEAST = 0.05  # share of U² below which a contribution is not named

_FEWER = "Evaluate fewer targets at once"
Draw = Callable[[np.random.Generator, int], np.ndarray]
Quantities = Callable[[Statistics], Mapping[str, np.ndarray]]


class Contribution(NamedTuple):
    """One thing that makes a test uncertain.

    `name`: in words. `draw`: from a generator and a number of trials, what it adds to the deviations, an array that spreads to
    (trials, t, 2, n) [mm or degrees].
    """

    name: str
    draw: Draw


class Uncertainty(NamedTuple):
    """U (k = 2) by symbol; `alone`: by contribution, what it would be with it alone; `largest`: bound whatever the machine is;
    `remarks`: what there is to say of it."""

    U: Mapping[str, float]
    alone: Mapping[str, Mapping[str, float]]
    largest: Mapping[str, float]
    remarks: tuple[str, ...]


def expanded(
    runs: PositioningRuns,
    contributions: Sequence[Contribution],
    quantities: Quantities,
    seed: int = 0,
    probability: float = PROBABILITY,
) -> Uncertainty:
    """U of all quantities by the contributions together, and by each alone.

    `seed`: of the random numbers. `probability`: with which a change by the contributions stays within U, above that of k = 2
    where several tests have to do so together.
    """
    rng = np.random.default_rng(seed)
    trials = int(np.clip(NUMBERS // runs.deviations.size, FEWEST, TRIALS))
    shape = (trials, *runs.deviations.shape)
    ask_memory(
        f"{runs.deviations.size} approaches in {trials} trials", COPIES * 8.0 * trials * runs.deviations.size, _FEWER
    )
    alone, total = {}, np.zeros(shape)
    for contribution in contributions:
        drawn = np.broadcast_to(contribution.draw(rng, trials), shape)
        alone[contribution.name] = _changes(runs.deviations, drawn, quantities, probability)
        total = total + drawn
    start = shrunk(runs.deviations, total)
    U = _changes(start, total, quantities, probability)
    nothing = np.where(np.isfinite(runs.deviations), 0.0, np.nan)
    return Uncertainty(U, alone, _changes(nothing, total, quantities, probability), _remarks(U, alone))


def shrunk(deviations: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """Deviations (t, 2, n) with each of their parts reduced to the share that `drawn`, (…, t, 2, n), does not explain."""
    parts, added = _parts(deviations), _parts(np.where(np.isfinite(deviations), drawn, np.nan))
    result = np.zeros(deviations.shape)
    for part, noise in zip(parts, added, strict=True):
        seen, of_noise = np.nanmean(part**2), np.quantile(np.nanmean(noise**2, axis=(-3, -2, -1)), SURE)
        result = result + part * (max(0.0, 1.0 - of_noise / seen) if seen > 0.0 else 0.0)
    return result


def _parts(deviations: np.ndarray) -> tuple[np.ndarray, ...]:
    """Means of both directions about their mean, half the mean reversal, half reversals about it, scatter.

    Each spreads to (…, t, 2, n). Their sum is the deviations but for a constant. Where a target was approached in one direction
    only it has no reversal.
    """
    mean = statistics_of(deviations).mean
    both = np.where(np.isnan(mean), mean[..., ::-1], mean)
    middle = both.mean(axis=-1, keepdims=True)
    about, half = middle - middle.mean(axis=-2, keepdims=True), mean - middle
    there = np.isfinite(half)
    common = np.where(there, half, 0.0).sum(axis=-2, keepdims=True) / np.maximum(there.sum(axis=-2, keepdims=True), 1)
    return about[..., None], common[..., None], (half - common)[..., None], deviations - mean[..., None]


def _changes(start: np.ndarray, drawn: np.ndarray, quantities: Quantities, probability: float) -> dict[str, float]:
    """The size that each quantity's change by the draws keeps within, with `probability`."""
    before, after = quantities(statistics_of(start)), quantities(statistics_of(start + drawn))
    sizes = {name: np.abs(after[name] - value) for name, value in before.items() if np.isfinite(value)}
    return {name: float(np.quantile(size, probability)) for name, size in sizes.items()}


def _remarks(U: Mapping[str, float], alone: Mapping[str, Mapping[str, float]]) -> tuple[str, ...]:
    """By which contributions U of the main quantities comes about."""
    said = {symbol: _named(symbol, U[symbol], alone) for symbol in _shown(U) if U.get(symbol, 0.0) > 0.0}
    if not said:
        return ()
    alike = len(set(said.values())) == 1
    shown = next(iter(said.values())) if alike else "; ".join(f"{symbol}: {names}" for symbol, names in said.items())
    return (f"U comes from {shown}. The machine's own scatter is part of what is measured, and not of U",)


def _shown(U: Mapping[str, float]) -> tuple[str, ...]:
    """The quantities of both directions, or those of one where there is no other."""
    both = tuple(symbol for symbol in ("E", "A", "R", "M", "B") if symbol in U)
    return both or tuple(U)


def _named(symbol: str, U: float, alone: Mapping[str, Mapping[str, float]]) -> str:
    """The contributions to U of a quantity, largest first, without those that hardly count."""
    shares = {name: (found[symbol] / U) ** 2 for name, found in alone.items()}
    named = [name for name in sorted(shares, key=lambda n: -shares[n]) if shares[name] >= _LEAST]
    return ", ".join(named) or "many small contributions"
