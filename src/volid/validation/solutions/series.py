"""Three solutions or more over time: which functions drift, and until when a compensation made from the first one holds.

The drift of a function is the slope of a weighted line through its values, θ'(t) = θ'₀ + (t - t₀) s: a combination Σ aᵢ θ'ᵢ with
aᵢ = wᵢ (tᵢ - t̄) / Σ w (t - t̄)², wᵢ the inverse of the mean variance of the deviation field of solution i. So it has the same
tests as a comparison of two, and what the solutions share counts once (`shared`). What a line leaves is tested likewise: a crash,
or a repair, is no drift. A survey that leaves something of a function undetermined takes no part in the line of that function,
as long as two others are left (`lines`). Not modelled: drift that depends on the season, or within one survey.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from volid.backend.threads import one_blas_thread
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.model.error_functions import describe_datum
from volid.model.machine import Datum
from volid.validation.solutions.comparison import doubts
from volid.validation.solutions.function_changes import LEVEL, FunctionChange, by_holm, function_change, values_of
from volid.validation.solutions.lines import Fields, Lines, fields_of
from volid.validation.solutions.outputs import Outputs, outputs_of
from volid.validation.solutions.shared import Said, what_is_shared
from volid.validation.solutions.states import in_one_model
from volid.validation.solutions.volume_change import VolumeChange

FEWEST = 3
K = 2.0  # coverage factor of limits and intervals


@dataclass(frozen=True, eq=False)
class FunctionDrift:
    """One function over time.

    `surveys`: numbers of those that its line goes through. `drift`: its change from the first to the last of these along it.
    `steady`: False where the line leaves a significant rest, with `probability` of one as large by chance (NaN of two surveys);
    `step`: number of the survey before which most of that rest happened, and `step_change`: the change there. `since_first`
    (k, m), `since_first_u`: its values less those of the first of `surveys`, NaN where one of the two leaves them undetermined.
    """

    surveys: tuple[int, ...]

    drift: FunctionChange
    steady: bool
    probability: float
    step: int
    step_change: FunctionChange
    since_first: np.ndarray
    since_first_u: np.ndarray

    @property
    def before_step(self) -> int:
        """Number of the survey from which `step_change` counts."""
        return self.surveys[self.surveys.index(self.step) - 1]


class Holding(NamedTuple):
    """Until when a compensation made from the first survey holds, by the change of the field since then.

    `limit`, `rate` with `u` [mm, mm per unit of time]. `exceeded`: number of the first survey that exceeds the limit, -1: none,
    or no function has changed significantly; `clearly`: by more than its U. `until`, `earliest`, `latest`: extrapolated along the
    drift, in units of time from the first survey; inf where none is seen, NaN where the surveys do not determine the field.
    `significant`: whether any function drifts. `before`: number of the last survey before `exceeded` of which the field is
    determined.
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
    before: int


@dataclass(frozen=True, eq=False)
class Series:
    """Solutions over time.

    Args:
        names: What messages call them, in the order of time.
        times: From the first survey, shape (k,), in days or another unit.
        functions: Every function and constant, as `FunctionDrift`.
        volume: Change of the field from the first to each other survey; NaN where one of the two leaves some of it open.
        drift: Change of the field along the line through the surveys that determine it, over the whole span.
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
    line = Lines.of(shared, when - when[0])
    functions = _functions(line)
    fields = fields_of(line)
    small = fields.limit(K) if limit is None else limit
    return Series(
        names=tuple(called),
        times=line.times,
        functions=functions,
        volume=fields.changes,
        drift=fields.drift,
        holding=_holding(fields, small, functions),
        datum=describe_datum(states.machine, states.model.datum),
        notes=(*states.notes, *shared.notes, *left_out(called, functions, fields)),
        attention=doubts(shared),
    )


def _functions(line: Lines) -> tuple[FunctionDrift, ...]:
    """Every function, with Holm's rule over drifts and rests together."""
    outputs = outputs_of(line.shared.of.model)
    level = LEVEL / (2 * max(len(outputs), 1))
    found = [_of_function(line, own, level) for own in outputs]
    both = np.array([f.drift.probability for f in found] + [f.probability for f in found])
    passed = by_holm(both)
    return tuple(
        replace(f, drift=replace(f.drift, significant=bool(d)), steady=not r)
        for f, d, r in zip(found, passed[: len(found)], passed[len(found) :], strict=True)
    )


def _of_function(line: Lines, outputs: Outputs, level: float) -> FunctionDrift:
    who = line.through(outputs.rows)
    drift = function_change(line.slope(who), outputs, level)
    left = [function_change(c, outputs).probability for c in line.rests(who)]
    steps = [function_change(line.between(i, j), outputs) for i, j in pairwise(who)]
    step = int(np.argmin([s.probability if np.isfinite(s.probability) else 1.0 for s in steps]))
    since = [values_of(line.between(who[0], i), outputs) if i != who[0] else None for i in range(len(line.times))]
    nothing = np.zeros(len(outputs.rows))
    return FunctionDrift(
        surveys=who,
        drift=drift,
        steady=True,
        probability=float(min(1.0, len(left) * np.nanmin(left))) if np.isfinite(left).any() else np.nan,
        step=who[step + 1],
        step_change=steps[step],
        since_first=np.stack([nothing if own is None else own[0] for own in since]),
        since_first_u=np.stack([nothing if own is None else own[1] for own in since]),
    )


def _holding(fields: Fields, limit: float, functions: Sequence[FunctionDrift]) -> Holding:
    """The date from which the change of the field exceeds the limit.

    The largest of many noisy lengths exceeds any limit near its own U, so it says nothing unless some function has changed.
    """
    times, changes, drift = fields.line.times, fields.changes, fields.drift
    significant = any(f.drift.significant for f in functions)
    has_changed = significant or any(not f.steady for f in functions)
    over = [i for i, c in enumerate(changes, start=1) if has_changed and c.largest > limit]
    exceeded = over[0] if over else -1
    clearly = bool(over) and changes[exceeded - 1].largest - K * changes[exceeded - 1].u > limit
    known = [0, *(i for i, c in enumerate(changes, start=1) if np.isfinite(c.largest) and i < exceeded)]
    span = float(times[-1])
    rate, u = drift.largest / span, drift.u / span

    def reached(speed: float) -> float:
        if not np.isfinite(speed + limit):
            return np.nan
        return limit / speed if speed > 0.0 else np.inf

    until = reached(rate) if significant or not np.isfinite(rate) else np.inf
    latest = reached(rate - K * u) if significant or not np.isfinite(rate) else np.inf
    return Holding(limit, rate, u, exceeded, clearly, until, reached(rate + K * u), latest, significant, known[-1])


def left_out(names: Sequence[str], functions: Sequence[FunctionDrift], fields: Fields) -> list[str]:
    """Notes on surveys that take no part in something, because they leave some of it undetermined."""
    notes = []
    for i, name in enumerate(names):
        whole = [f.drift.name for f in functions if i not in f.surveys]
        if whole:
            which = ", ".join(whole) if len(whole) < len(functions) else "any function"
            notes.append(f"{name} does not determine all of {which}: the drift goes by the other surveys")
        if i not in fields.surveys:
            notes.append(
                f"{name} does not determine the whole deviation field: how that changed, the other surveys tell"
            )
    return notes
