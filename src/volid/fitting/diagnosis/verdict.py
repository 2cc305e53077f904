"""The verdict on a fit: accepted; accepted, u enlarged; or rejected. And the cause, by name.

Whether a misfit is significant depends on how many readings there are; what it does to the result does not. So the tests
(chi-square of all readings and of groups, hold-outs by block, alternatives) only say that there is one. The grade follows from
the outcome (`outcome`):

- factor² = κ² + variance by leaving out blocks + variance by displacements (`blocks`), each only where it is significant, in
  units of u²; κ: unit weight where it is significantly above 1. Every u is multiplied by the factor.
- rejected where the misfit may move a result by more than U = 2 u: the factor exceeds √5, so that u_misfit = u √(factor² - 1)
  exceeds 2 u; or an alternative that explains the misfit moves a number of the outcome by more than its U; or another chain
  explains it.
- rejected where the misfit sits in one place: the unit weight of one group is above `CONCENTRATED` times that of the others.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from volid.fitting.diagnosis.adequacy import ACCEPTED, ENLARGED, NOT_TESTABLE, REJECTED, Adequacy, Cause, GroupTest
from volid.fitting.diagnosis.alternatives.base import Judged, profile
from volid.fitting.diagnosis.alternatives.functions import PITCH
from volid.fitting.diagnosis.alternatives.ranking import TRIED, named
from volid.fitting.diagnosis.alternatives.readings import NONE, WHOLE
from volid.fitting.diagnosis.around import Around, Fit
from volid.fitting.diagnosis.blocks import Excess, cells, displacement, influence, partitions
from volid.fitting.diagnosis.outcome import largest
from volid.model.machine import Machine

SIGNIFICANT = 1e-3  # probability of a misfit by chance, per family of tests
BLOCKS = 1e-4  # the same for hold-outs by block, whose distribution is known only about
CERTAIN = 1e-6  # the same, for a verdict that rejects
LARGEST = 5.0**0.5  # factor from which on the misfit alone exceeds U = 2 u
WORSE = 1.15  # unit weight from which on the smoothness is estimated anew with a larger u
CONCENTRATED = 1.5  # unit weight of one group over that of all others
PESSIMISTIC = 0.8  # unit weight below which u is said to be too large
WORST = 4  # groups named in the verdict


class Misfit(NamedTuple):
    """What hold-outs by block show: the factor for u, and what it is made of."""

    factor: float
    kappa: float
    influence: Excess
    displacement: Excess

    @property
    def is_significant(self) -> bool:
        """Whether a block test found anything."""
        return self.influence.variance > 0.0 or self.displacement.variance > 0.0


NOTHING = Excess("", 0.0, 1.0)


def misfit(around: Around, machine: Machine, adequacy: Adequacy) -> Misfit:
    """The factor for u."""
    square = max(adequacy.unit_weight, 1.0) ** 2 if adequacy.probability < SIGNIFICANT else 1.0
    moved = _largest([influence(around, b, square) for b in partitions(around, machine)])
    shown = _largest([displacement(around, b, square) for b in cells(around, machine)])
    factor = float(np.sqrt(square + moved.variance + shown.variance))
    return Misfit(factor, float(np.sqrt(square)), moved, shown)


def _largest(found: list[Excess]) -> Excess:
    """The largest variance of those that are significant together."""
    certain = [e for e in found if e.probability * len(found) < BLOCKS]
    return max(certain, key=lambda e: e.variance, default=NOTHING)


def judge(around: Around, fit: Fit, machine: Machine, tested: Adequacy, scattered: bool) -> Adequacy:
    """The adequacy of a fit with grade, factor, causes and verdict. `tested`: chi-square and group tests, without a verdict.

    `scattered`: u of the readings holds a part that is independent from position to position.
    """
    found = misfit(around, machine, tested)
    local = _local(tested.groups)
    doubtful = tested.probability < SIGNIFICANT or bool(local) or found.is_significant
    alternatives = named(around, fit, machine, doubtful, scattered)
    explained = [j for j in alternatives if j.log_probability < np.log(CERTAIN)]
    factor = max([found.factor, *(g.unit_weight for g in local)])
    outside = [j for j in explained if not (scattered and j.alternative.cause == PITCH)]  # waves are part of u then
    reasons = _reasons(factor, found, tested.groups, outside)
    significant = doubtful or bool(alternatives)
    causes = [_cause(j) for j in alternatives]
    if tested.probability < SIGNIFICANT or local:
        causes += _rest(tested, found, alternatives)
    larger = scattered or (significant and factor > 1.0)
    grade = REJECTED if reasons else ENLARGED if larger else ACCEPTED
    factor = factor if significant else 1.0
    adequacy = replace(tested, rejected=bool(reasons), grade=grade, factor=factor, causes=tuple(causes))
    return replace(adequacy, verdict=verdict_text(adequacy, reasons))


def explained_otherwise(adequacy: Adequacy) -> bool:
    """Whether something else than waves explains best what a fit took as independent from position to position."""
    return bool(adequacy.causes) and adequacy.causes[0].cause not in (PITCH, WHOLE, NONE)


def perhaps_u(adequacy: Adequacy) -> bool:
    """Whether the misfit may be a u that is too small as a whole, which the functions followed."""
    first = adequacy.causes[0].cause if adequacy.causes else WHOLE
    return adequacy.unit_weight > WORSE and adequacy.probability < SIGNIFICANT and first in (WHOLE, NONE)


def untested(tested: Adequacy) -> Adequacy:
    """The verdict where nothing can be tested."""
    return replace(tested, grade=NOT_TESTABLE, verdict="not testable: there are no more readings than unknowns")


def _local(groups: tuple[GroupTest, ...]) -> list[GroupTest]:
    """Groups whose residuals are significantly larger than u."""
    return [g for g in groups if g.probability * len(groups) < SIGNIFICANT and g.unit_weight > 1.0]


def _concentrated(groups: tuple[GroupTest, ...]) -> list[GroupTest]:
    """Groups whose unit weight is far above that of the others of their sort."""
    found = []
    for g in groups:
        others = [o for o in groups if o.sort == g.sort and o is not g]
        n = sum(o.n for o in others)
        if not n or g.probability * len(groups) > CERTAIN:
            continue
        rest = float(np.sqrt(sum(o.n * o.unit_weight**2 for o in others) / n))
        if g.unit_weight > CONCENTRATED * max(rest, 1.0):
            found.append(g)
    return sorted(found, key=lambda g: -g.unit_weight)


def _reasons(factor: float, found: Misfit, groups: tuple[GroupTest, ...], explained: list[Judged]) -> list[str]:
    """Why a misfit may move a result by more than its U, in words; empty where it does not."""
    reasons = []
    moving = [j for j in explained if largest(j.change) > 1.0]
    if moving:
        size = largest(moving[0].change)
        by = f"changes results by up to {size:.1f} U" if np.isfinite(size) else "is another machine"
        reasons.append(f"{moving[0].alternative.what}, which {by}")
    concentrated = _concentrated(groups)
    if concentrated:
        reasons.append(
            f"the misfit sits in one place: {concentrated[0].what} (unit weight {concentrated[0].unit_weight:.2f})"
        )
    if factor > LARGEST:
        most = found.displacement if found.displacement.variance > found.influence.variance else found.influence
        seen = f", by hold-outs of {most.sort}" if most.variance > 0.5 * factor**2 else ""
        reasons.append(f"the misfit may move results by more than their U (u {factor:.1f} times as large{seen})")
    return reasons


def _cause(j: Judged) -> Cause:
    a, change = j.alternative, largest(j.change)
    return Cause(a.cause, a.what, a.cure, j.drop, j.gain, j.k, j.log_probability / float(np.log(10.0)), change)


def _rest(tested: Adequacy, found: Misfit, alternatives: list[Judged]) -> list[Cause]:
    """What is left of the misfit when the best alternative is taken out: u as a whole, or none of these."""
    best = alternatives[0] if alternatives else None
    chi = tested.chi_square - (best.drop if best else 0.0)
    nu = tested.degrees_of_freedom - (best.k if best else 0)
    probability = float(chdtrc(max(nu, 1), max(chi, 0.0)))
    if best is not None and (probability > SIGNIFICANT or best.gain > chi - profile(chi, nu)):
        return []
    weight, log10 = float(np.sqrt(chi / max(nu, 1))), float(np.log10(max(probability, 1e-300)))
    structured = found.is_significant or bool(_concentrated(tested.groups))
    if structured or probability > SIGNIFICANT:
        rest = "the rest of the misfit" if best else "the misfit"
        what = f"none of these explains {rest}: {', '.join(TRIED)}"
        cure = "look at the residuals by station, place and time, and repeat what looks odd"
        return [Cause(NONE, what, cure, 0.0, 0.0, 0, log10, weight - 1.0)]
    what = f"all u are too small by the factor {weight:.2f}: the instrument is worse than stated"
    cure = f"campaign, [[set]]: u times {weight:.2f}"
    return [Cause(WHOLE, what, cure, chi - nu, chi - profile(chi, nu), 1, log10, weight - 1.0)]


def verdict_text(adequacy: Adequacy, reasons: list[str]) -> str:
    """The verdict in words."""
    weight, freedom = adequacy.unit_weight, adequacy.degrees_of_freedom
    if adequacy.grade == ACCEPTED:
        if weight < PESSIMISTIC and freedom > 30:
            return f"model accepted by the data; unit weight {weight:.2f}: the stated uncertainties are pessimistic"
        return "model accepted by the data"
    p = adequacy.probability
    chance = f"probability {p:.1e}" if p > 0.0 else "probability below 1e-300"
    if adequacy.grade == ENLARGED:
        by = (
            f"by the factor {adequacy.factor:.2f}"
            if adequacy.factor > 1.0
            else "by what is independent from place to place"
        )
        return (
            f"model accepted by the data, with every u enlarged {by} (unit weight {weight:.2f}, {chance}): there is a misfit, "
            "too small to move a result by more than its U"
        )
    text = f"model rejected by the data (unit weight {weight:.2f}, {chance}): {'; '.join(reasons)}"
    where = "; ".join(f"{g.what} (unit weight {g.unit_weight:.2f})" for g in _worst(adequacy.groups))
    text += f"; worst: {where}" if where else ""
    if adequacy.suspects:
        text += f"; {len(adequacy.suspects)} reading(s) beyond the critical value, first {adequacy.suspects[0].where}"
    return text


def _worst(groups: tuple[GroupTest, ...]) -> list[GroupTest]:
    """Groups whose unit weight is far above that of the others, one of each sort."""
    found: dict[str, GroupTest] = {}
    for group in _concentrated(groups):
        found.setdefault(group.sort, group)
    return list(found.values())[:WORST]
