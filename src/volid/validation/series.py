"""Three solutions or more over time: which functions drift, and until when a compensation made from the first one holds.

The drift of a function is the slope of a weighted line through its values, θ'(t) = θ'₀ + (t - t₀) s: a combination Σ aᵢ θ'ᵢ with
aᵢ = wᵢ (tᵢ - t̄) / Σ w (t - t̄)², wᵢ the inverse of the mean variance of the deviation field of solution i. So it has the same
tests as a comparison of two, and what the solutions share counts once (`shared`). What a line leaves is tested likewise: a crash,
or a repair, is no drift. Not modelled: drift that depends on the season, or within one survey.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from volid.backend.threads import one_blas_thread
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.model.error_functions import describe_datum
from volid.model.machine import Datum
from volid.validation.comparison import doubts
from volid.validation.function_changes import (
    LEVEL,
    Combination,
    FunctionChange,
    Outputs,
    by_holm,
    function_change,
    outputs_of,
    values_of,
)
from volid.validation.shared import Said, Shared, what_is_shared
from volid.validation.states import in_one_model
from volid.validation.volume_change import Volume, VolumeChange, change_in, largest_u, volume_of

FEWEST = 3
K = 2.0  # coverage factor of limits and intervals


@dataclass(frozen=True, eq=False)
class FunctionDrift:
    """One function over time.

    `drift`: its change from the first survey to the last along the line. `steady`: False where the line leaves a significant
    rest, with `probability` of one as large by chance; `step`: number of the survey before which most of that rest happened, and
    `step_change`: the change there. `since_first` (k, m), `since_first_u`: its values less those of the first survey.
    """

    drift: FunctionChange
    steady: bool
    probability: float
    step: int
    step_change: FunctionChange
    since_first: np.ndarray
    since_first_u: np.ndarray


class Holding(NamedTuple):
    """Until when a compensation made from the first survey holds, by the change of the field since then.

    `limit`, `rate` with `u` [mm, mm per unit of time]. `exceeded`: number of the first survey that exceeds the limit, -1: none;
    `clearly`: by more than its U. `until`, `earliest`, `latest`: extrapolated along the drift, in units of time from the first
    survey; inf where none is seen. `significant`: whether any function drifts.
    """

    limit: float
    rate: float
    u: float
    exceeded: int
    clearly: bool
    until: float
    earliest: float
    latest: float
    significant: bool


@dataclass(frozen=True, eq=False)
class Series:
    """Solutions over time.

    Args:
        names: What messages call them, in the order of time.
        times: From the first survey, shape (k,), in days or another unit.
        functions: Every function and constant, as `FunctionDrift`.
        volume: Change of the field from the first to each other survey.
        drift: Change of the field along the line, over the span.
        holding: Until when a compensation made from the first survey holds.
        datum: What functions refer to, in words.
        notes: What was assumed.
        attention: Why u may be too small.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> volid.compare_series([solution] * 3, [0.0, 30.0, 75.0]).times.tolist()
    [0.0, 30.0, 75.0]
    """

    names: tuple[str, ...]
    times: np.ndarray
    functions: tuple[FunctionDrift, ...] = field(repr=False)
    volume: tuple[VolumeChange, ...]
    drift: VolumeChange
    holding: Holding
    datum: str
    notes: tuple[str, ...]
    attention: tuple[str, ...]

    @property
    def significant(self) -> tuple[FunctionDrift, ...]:
        """The functions that drift, or changed in another way."""
        return tuple(f for f in self.functions if f.drift.significant or not f.steady)


@one_blas_thread()
def series(
    solutions: Sequence[Solution],
    times: Sequence[float],
    *,
    datum: Datum | None = None,
    common: Sequence[str] = (),
    independent: Sequence[str] = (),
    limit: float | None = None,
    names: Sequence[str] = (),
) -> Series:
    """Drift of every function over three solutions or more, and until when a compensation made from the first one holds.

    Args:
        solutions: In any order of time, of one machine with the same error functions.
        times: When each was measured, in days or another unit.
        datum: In which functions are compared; None: that of the earliest.
        common: Names of systematic effects and artefacts that were the same ones in all campaigns, as in `compare`.
        independent: Names of effects that were not, although all campaigns name them alike.
        limit: Largest change of the field that is accepted [mm]; None: the largest U (k = 2) of the field of the first survey,
            which a compensation made from it has anyway.
        names: What messages call the solutions.

    Raises:
        InputError: fewer than three, equal times, and what `compare` raises.

    Source: ISO/TR 16907 4 b.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> found = series([solution] * 3, [0.0, 30.0, 75.0], limit=0.001)
    >>> found.significant, found.holding.until
    ((), inf)
    """
    if len(solutions) < FEWEST or len(times) != len(solutions):
        raise InputError(
            f"a series needs {FEWEST} solutions or more, each with its time; got {len(solutions)}, {len(times)}"
        )
    order = np.argsort(times, kind="stable")
    when = np.asarray(times, dtype=float)[order]
    if not np.all(np.diff(when) > 0.0):
        raise InputError("two solutions of the series have the same time; expected different dates")
    called = [names[i] if names else f"survey {n + 1}" for n, i in enumerate(order)]
    states = in_one_model([solutions[i] for i in order], called, datum)
    shared = what_is_shared(states, Said(tuple(common), tuple(independent)))
    volume, line = volume_of(states), _Line(shared, when - when[0])
    weights = np.array([1.0 / max(_mean_variance(volume, s.covariance), 1e-300) for s in states.states])
    slope = line.slope(weights)
    functions = _functions(line, slope)
    changes = tuple(change_in(volume, line.between(0, i)) for i in range(1, len(when)))
    drift = change_in(volume, slope)
    small = K * largest_u(volume, states.states[0].covariance) if limit is None else limit
    return Series(
        names=tuple(called),
        times=line.times,
        functions=functions,
        volume=changes,
        drift=drift,
        holding=_holding(line.times, changes, drift, small, any(f.drift.significant for f in functions)),
        datum=describe_datum(states.machine, states.model.datum),
        notes=(*states.notes, *shared.notes),
        attention=doubts(shared),
    )


class _Line(NamedTuple):
    """What the combinations of a series are made of. `times` (k,), from the first."""

    shared: Shared
    times: np.ndarray

    def slope(self, w: np.ndarray) -> Combination:
        """The change over the whole span along a line with weights w (k,)."""
        span = self.times[-1]
        away = self.times - np.sum(w * self.times) / np.sum(w)
        return Combination(self.shared, span * w * away / np.sum(w * away**2), self.times / span)

    def between(self, i: int, j: int) -> Combination:
        """The change from survey i to survey j."""
        weights = np.zeros(len(self.times))
        weights[i], weights[j] = -1.0, 1.0
        return Combination(self.shared, weights, (np.arange(len(weights)) >= j).astype(float))

    def rests(self) -> list[Combination]:
        """Combinations (k - 2) that are 0 for every line."""
        lines = np.stack([np.ones_like(self.times), self.times / self.times[-1]])
        return [Combination(self.shared, a, np.abs(a)) for a in null_space(lines).T]


def _mean_variance(volume: Volume, covariance: np.ndarray) -> float:
    flat = volume.rows.reshape(-1, volume.rows.shape[2])
    return float(np.mean(np.sum((flat @ covariance) * flat, axis=1)))


def _functions(line: _Line, slope: Combination) -> tuple[FunctionDrift, ...]:
    """Every function, with Holm's rule over drifts and rests together."""
    outputs = outputs_of(line.shared.of.model)
    level, last = LEVEL / (2 * max(len(outputs), 1)), range(1, len(line.times))
    others = _Others(line.rests(), [line.between(i - 1, i) for i in last], [line.between(0, i) for i in last])
    found = [_of_function(function_change(slope, own, level), own, others) for own in outputs]
    both = np.array([f.drift.probability for f in found] + [f.probability for f in found])
    passed = by_holm(both)
    return tuple(
        replace(f, drift=replace(f.drift, significant=bool(d)), steady=not r)
        for f, d, r in zip(found, passed[: len(found)], passed[len(found) :], strict=True)
    )


class _Others(NamedTuple):
    """Combinations beside the slope: what a line leaves, changes from survey to survey, and from the first to each other."""

    rests: list[Combination]
    steps: list[Combination]
    since: list[Combination]


def _of_function(drift: FunctionChange, outputs: Outputs, others: _Others) -> FunctionDrift:
    left = [function_change(c, outputs).probability for c in others.rests]
    steps = [function_change(c, outputs) for c in others.steps]
    step = int(np.argmin([s.probability if np.isfinite(s.probability) else 1.0 for s in steps]))
    since = [values_of(c, outputs) for c in others.since]
    nothing = np.zeros(len(outputs.rows))
    return FunctionDrift(
        drift=drift,
        steady=True,
        probability=float(min(1.0, len(left) * np.min(left))),
        step=step + 1,
        step_change=steps[step],
        since_first=np.stack([nothing, *(values for values, _ in since)]),
        since_first_u=np.stack([nothing, *(u for _, u in since)]),
    )


def _holding(
    times: np.ndarray, changes: Sequence[VolumeChange], drift: VolumeChange, limit: float, significant: bool
) -> Holding:
    """The date from which the change of the field exceeds the limit."""
    over = [i for i, c in enumerate(changes, start=1) if c.largest > limit]
    exceeded = over[0] if over else -1
    clearly = bool(over) and changes[exceeded - 1].largest - K * changes[exceeded - 1].u > limit
    span = float(times[-1])
    rate, u = drift.largest / span, drift.u / span

    def reached(speed: float) -> float:
        return limit / speed if speed > 0.0 else np.inf

    until = reached(rate) if significant else np.inf
    latest = reached(rate - K * u) if significant else np.inf
    return Holding(limit, rate, u, exceeded, clearly, until, reached(rate + K * u), latest, significant)
