"""The verdict on each set of readings among the others, from one fit, without another one.

A set can be at odds with a joint fit in two ways: its readings scatter more (or less) than its u says, or it sees another machine
than the other sets do. The first is tested by what its residuals keep when they are smoothed by the set's own functions, the
second by what is smoothed away (`sums.OneSet`). Where one set contradicts the others, they disagree with it too; so the set
whose absence leaves the others in best agreement is named, and the others are tested again without it. Of two sets nothing tells
which.

Exact for a model that is linear in its unknowns, and to second order of the errors here; with the smoothness of functions as it
was estimated from all sets.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign
from volid.fitting.diagnosis.adequacy import Adequacy
from volid.fitting.diagnosis.around import Around
from volid.fitting.mixed.patterns import NOTHING, Pattern, pattern_of
from volid.fitting.mixed.records import OTHERS, SetTest
from volid.fitting.mixed.sums import OneSet, Quadratic, Sums, prediction, sums_of

SIGNIFICANT = 1e-3  # probability of a finding by chance, all sets together
WORSE, BETTER = 1.15, 0.85  # scatter over u from which on u is said to be too small, or too large
PAIR = 2
UNDECIDED = "and nothing tells which is right"
OWN = 1e-6  # of a reading's variance, below which it is all that determines one of the set's own unknowns


class _Findings(NamedTuple):
    """Of one set: its tests in the joint fit."""

    one: OneSet
    whole: Quadratic
    scatter: Quadratic
    disagreement: Quadratic
    predicted: Quadratic


def set_tests(around: Around) -> tuple[SetTest, ...]:
    """The verdict on every set, in the order of the campaign; () for a single one, which the verdict on the fit is about.

    `around`: the linear fit, at its minimum.
    """
    if len(around.campaign.sets) == 1:
        return ()
    sums = sums_of(around.rows, around.v, around.set_number, around.active)
    findings = _findings(sums)
    found = dict(zip(sums.numbers, findings, strict=True))
    accused = _contradicting(sums, findings)
    total = Quadratic(around.share * around.chi_square, around.share * around.freedom, 1.0)
    return tuple(
        _record(around, g, number, found[number], sums, accused, total) for g, number in enumerate(sums.numbers)
    )


def _findings(sums: Sums) -> list[_Findings]:
    ones = [OneSet(sums, g) for g in range(len(sums.numbers))]
    scatters = [one.scatter() for one in ones]
    squares = [max(s.value / s.mean, 1.0) if s.exists else 1.0 for s in scatters]
    means = np.array([max(s.mean, 0.0) for s in scatters])
    result = []
    for g, (one, scatter) in enumerate(zip(ones, scatters, strict=True)):
        others = np.arange(len(ones)) != g
        weight = float(means[others].sum())
        rest = float(means[others] @ np.array(squares)[others]) / weight if weight > 0.0 else 1.0
        result.append(_Findings(one, one.whole(), scatter, one.disagreement(squares[g], rest), prediction(sums, g)))
    return result


def _disagree(findings: list[_Findings]) -> bool:
    """Whether some set certainly disagrees with the others; not a single one."""
    limit = SIGNIFICANT / len(findings)
    found = [f.disagreement for f in findings]
    return len(found) >= PAIR and any(q.probability() < limit and q.weight > 1.0 for q in found)


def _contradicting(sums: Sums, findings: list[_Findings]) -> dict[int, bool]:
    """Numbers of sets that contradict others, and whether it is certain that it is they: not of the last two."""
    accused: dict[int, bool] = {}
    while _disagree(findings):
        if len(sums.numbers) == PAIR:
            return accused | dict.fromkeys(sums.numbers, False)
        left = {g: sums.without(g) for g in range(len(sums.numbers))}  # one that dominates does not show it itself
        tested = {g: _findings(rest) for g, rest in left.items()}
        culprit = min(left, key=lambda g: _worst(tested[g]))
        accused[sums.numbers[culprit]] = True
        sums, findings = left[culprit], tested[culprit]
    return accused


def _worst(findings: list[_Findings]) -> float:
    """How far the sets disagree, in standard deviations of the one that does most."""
    found = [f.disagreement for f in findings]
    return max(((q.value - q.mean) / np.sqrt(q.variance) for q in found if q.exists), default=0.0)


class _Prediction(NamedTuple):
    """Of single readings by the other sets: largest |E_n|, share beyond 1, combinations that the set alone determines."""

    largest: float
    beyond: float
    alone: int


def _predicted(sums: Sums, g: int, rows: np.ndarray, v: np.ndarray) -> _Prediction:
    seen = sums.split(g)
    along, left = rows @ seen.directions, 1.0 - seen.values
    mine, theirs = along[:, ~seen.others], along[:, seen.others]
    shift = theirs @ (seen.along[seen.others] / left[seen.others])
    own = 1.0 - np.sum(mine**2, axis=1)  # what the set's own unknowns leave of a reading
    variance = own + theirs**2 @ (1.0 / left[seen.others])
    alone = int(np.count_nonzero(~seen.others))
    known = np.any(rows != 0.0, axis=1) & (own > OWN)
    if not known.any() or alone == len(seen.values):
        return _Prediction(float("nan"), float("nan"), alone)
    en = np.abs((v + shift)[known]) / (2.0 * np.sqrt(variance[known]))
    return _Prediction(float(en.max()), float(np.mean(en > 1.0)), alone)


def _record(
    around: Around, g: int, number: int, found: _Findings, sums: Sums, accused: dict[int, bool], total: Quadratic
) -> SetTest:
    own = around.set_number == number
    rows, v, readings = around.rows[own], around.v[own], around.campaign.sets[number]
    scatter, disagreement, predicted = found.scatter, found.disagreement, found.predicted
    pattern = pattern_of(around.campaign, number, v, rows, max(scatter.weight, 1.0) if scatter.exists else 1.0)
    pattern = pattern if pattern.probability * len(sums.numbers) < SIGNIFICANT else NOTHING
    outside, against = _predicted(sums, g, rows, v), _against(around.campaign, number, accused)
    rest = Quadratic(total.value - predicted.value, total.mean - predicted.mean, 1.0)
    return SetTest(
        set=readings.name,
        n=found.one.n,
        redundancy=found.one.redundancy,
        unit_weight=found.whole.weight,
        probability=found.whole.probability(),
        own_weight=scatter.weight,
        own_freedom=scatter.freedom,
        own_probability=scatter.probability(),
        disagreement=disagreement.weight,
        disagreement_probability=disagreement.probability(),
        prediction_weight=predicted.weight,
        prediction_freedom=predicted.mean,
        prediction_probability=predicted.probability(),
        largest_en=outside.largest,
        beyond=outside.beyond,
        alone=outside.alone,
        rest_weight=rest.weight,
        pattern=pattern.what,
        pattern_mean=pattern.mean,
        pattern_probability=pattern.probability,
        contradicts=against,
        verdict=_words(found, against, pattern, len(sums.numbers)),
    )


def _against(campaign: Campaign, number: int, accused: dict[int, bool]) -> str:
    """What a set contradicts, as `SetTest` has it."""
    if number not in accused or accused[number]:
        return OTHERS if number in accused else ""
    return next(campaign.sets[n].name for n, certain in accused.items() if n != number and not certain)


def _words(found: _Findings, against: str, pattern: Pattern, count: int) -> str:
    """What is found of a set, in words."""
    said, scatter, limit = [], found.scatter, SIGNIFICANT / count
    if not scatter.exists and not found.whole.exists:
        return "nothing of it is checked by other readings"
    if against:
        said.append(f"contradicts {against}" if against == OTHERS else f"contradicts set '{against}', {UNDECIDED}")
    if scatter.weight > WORSE and scatter.probability() < limit:
        said.append(f"its u seems too small by the factor {scatter.weight:.2f}")
    if scatter.weight < BETTER and scatter.probability(larger=False) < limit:
        said.append(f"its u seems too large by the factor {1.0 / max(scatter.weight, 1e-3):.2f}")
    if pattern.what:
        said.append(f"systematic residuals, most in {pattern.what} (mean {pattern.mean:+.2f} u)")
    doubt = "" if scatter.exists else ", as far as anything checks it"
    return "; ".join(said) or f"agrees with its u and with the other sets{doubt}"


def with_sets(judged: Adequacy, tests: tuple[SetTest, ...]) -> Adequacy:
    """The verdict on a fit with those on its sets, and with what contradicts what in its words."""
    certain = [t for t in tests if t.contradicts == OTHERS]
    pair = [t for t in tests if t.contradicts not in ("", OTHERS)]
    said = [
        f"set '{t.set}' contradicts the other sets, which have unit weight {t.rest_weight:.2f} without it"
        for t in certain
    ]
    if pair:
        names = " and ".join(f"'{t.set}'" for t in pair)
        said.append(f"sets {names} contradict each other, {UNDECIDED}")
    return replace(judged, sets=tests, verdict="; ".join([judged.verdict, *said]))
