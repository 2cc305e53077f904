"""The verdict on a fit: accepted; accepted, u enlarged; or rejected. And the cause, by name.

Whether a misfit is significant depends on how many readings there are; what it does to the result does not. So the tests
(chi-square of all readings and of groups, hold-outs by block, alternatives) only say that there is one. The grade follows from
the outcome (`outcome`):

- factor² = κ² + variance by leaving out blocks + variance by displacements (`blocks`), or the mean square of what alternatives
  move where that is more, each only where it is significant, in units of u²; κ: unit weight where it is significantly above 1.
  Every u is multiplied by the factor.
- rejected where the misfit may move a result by more than U = 2 u: the factor exceeds √5, so that u_misfit = u √(factor² - 1)
  exceeds 2 u; or an alternative that explains the misfit moves a number of the outcome by more than its U; or another chain
  explains it.
- rejected where the misfit sits in one place: the unit weight of one group is above `CONCENTRATED` times that of the others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from volid.fitting.diagnosis.adequacy import ACCEPTED, ENLARGED, NOT_TESTABLE, REJECTED, Adequacy, Cause, GroupTest
from volid.fitting.diagnosis.alternatives.base import Judged, profile
from volid.fitting.diagnosis.alternatives.functions import PITCH
from volid.fitting.diagnosis.alternatives.ranking import CHAINS, TRIED, named
from volid.fitting.diagnosis.alternatives.readings import NONE, PART, WHOLE
from volid.fitting.diagnosis.around import Around, Fit
from volid.fitting.diagnosis.blocks import Excess, cells, displacement, influence, partitions
from volid.fitting.diagnosis.groups import SET
from volid.fitting.diagnosis.outcome import largest, typical
from volid.fitting.diagnosis.verdict_text import BARE_U, CERTAIN, concentrated, power, verdict_text
from volid.model.machine import Machine
from volid.observations import KINDS

SIGNIFICANT = 1e-3  # probability of a misfit by chance, per family of tests
BLOCKS = 1e-4  # the same for hold-outs by block, whose distribution is known only about
LARGEST = 5.0**0.5  # factor from which on the misfit alone exceeds U = 2 u
WORSE = 1.15  # unit weight from which on the smoothness is estimated anew with a larger u
TESTED = 0.5  # share of the readings below which the verdict says so


class Misfit(NamedTuple):
    """What is significant at some probability: κ² (1 where chi-square is not), what hold-outs by block show, unit weights of
    groups."""

    square: float
    influence: Excess
    displacement: Excess
    groups: tuple[GroupTest, ...]

    @property
    def is_structured(self) -> bool:
        """Whether a hold-out by block found anything."""
        return self.influence.variance > 0.0 or self.displacement.variance > 0.0

    @property
    def factor(self) -> float:
        """For u."""
        return self.factor_with([])

    def factor_with(self, alternatives: list[Judged]) -> float:
        """For u, where hold-outs may see less than what alternatives do to the outcome (root mean square)."""
        moved = sum(typical(j.change) ** 2 for j in alternatives if np.all(np.isfinite(j.change)))
        together = np.sqrt(self.square + max(self.influence.variance + self.displacement.variance, moved))
        return float(max([together, *(g.unit_weight for g in self.groups)]))


NOTHING = Excess("", 0.0, 1.0)


class _Blocks(NamedTuple):
    """What every hold-out by block shows."""

    influence: list[Excess]
    displacement: list[Excess]


def _blocks(around: Around, machine: Machine, tested: Adequacy) -> _Blocks:
    square = max(tested.unit_weight, 1.0) ** 2 if tested.probability < SIGNIFICANT else 1.0
    return _Blocks(
        [influence(around, b, square) for b in partitions(around, machine)],
        [displacement(around, b, square) for b in cells(around, machine)],
    )


def _misfit(tested: Adequacy, blocks: _Blocks, probability: float, of_blocks: float) -> Misfit:
    """What is significant at `probability`, hold-outs at `of_blocks`; each for its family of tests together."""
    square = max(tested.unit_weight, 1.0) ** 2 if tested.probability < probability else 1.0
    groups = [g for g in tested.groups if g.probability * len(tested.groups) < probability and g.unit_weight > 1.0]
    influences, displacements = (_largest(found, of_blocks) for found in blocks)
    return Misfit(square, influences, displacements, tuple(groups))


def _largest(found: list[Excess], probability: float) -> Excess:
    certain = [e for e in found if e.probability * len(found) < probability]
    return max(certain, key=lambda e: e.variance, default=NOTHING)


def judge(around: Around, fit: Fit, machine: Machine, tested: Adequacy, waves: Mapping[str, float]) -> Adequacy:
    """The adequacy of a fit with grade, factor, causes and verdict. `tested`: chi-square and group tests, without a verdict.

    `waves`: what the fit found to be independent from position to position, by direction [mm]; u of the readings holds it.
    """
    blocks = _blocks(around, machine, tested)
    found, certain = (_misfit(tested, blocks, *p) for p in ((SIGNIFICANT, BLOCKS), (CERTAIN, CERTAIN)))
    doubtful = tested.probability < SIGNIFICANT or bool(found.groups) or found.is_structured
    alternatives = named(around, fit, machine, doubtful, bool(waves))
    own = [j for j in alternatives if not j.alternative.is_rival]
    causes = [*map(_cause, alternatives), *_rest(around, tested, found, own)]
    unknown = _unknown(around, tested, own) if causes and causes[-1].cause == NONE else 0.0
    reasons = _reasons(certain, tested, _moving(own, waves), unknown)
    factor = float(np.hypot(found.factor_with(own), unknown)) if doubtful or alternatives else 1.0
    larger = factor > 1.0 or bool(waves) or bool(alternatives)
    grade = REJECTED if reasons else ENLARGED if larger else ACCEPTED
    adequacy = replace(tested, rejected=bool(reasons), grade=grade, factor=factor, causes=tuple(causes))
    return replace(adequacy, verdict=verdict_text(adequacy, reasons, waves) + _tested(around.share, bool(reasons)))


def _moving(own: list[Judged], waves: Mapping[str, float]) -> list[Judged]:
    """Alternatives that certainly explain the misfit and move some result by more than its U; waves are part of u where found."""
    explained = [j for j in own if j.log_probability < np.log(CERTAIN) and largest(j.change) > 1.0]
    return [j for j in explained if not (waves and j.alternative.cause == PITCH)]


def _tested(share: float, rejected: bool) -> str:
    """How little a part of the readings may show, where only that was tested one by one."""
    if share >= TESTED or rejected:
        return ""
    return (
        f"; {100.0 * share:.0f} % of the readings were tested one by one: a misfit that moves results by less than "
        f"{1.0 / np.sqrt(share):.1f} u may not show"
    )


def explained_otherwise(adequacy: Adequacy) -> bool:
    """Whether something else than waves explains best what a fit took as independent from position to position."""
    return bool(adequacy.causes) and adequacy.causes[0].cause not in (PITCH, WHOLE, NONE, PART)


def perhaps_u(adequacy: Adequacy) -> bool:
    """Whether the misfit may be a u that is too small as a whole, which the functions followed."""
    first = adequacy.causes[0].cause if adequacy.causes else WHOLE
    return adequacy.unit_weight > WORSE and adequacy.probability < SIGNIFICANT and first in (WHOLE, NONE, PART)


def untested(tested: Adequacy) -> Adequacy:
    """The verdict where nothing can be tested."""
    return replace(tested, grade=NOT_TESTABLE, verdict="not testable: there are no more readings than unknowns")


def _unknown(around: Around, tested: Adequacy, alternatives: list[Judged]) -> float:
    """What a misfit of unknown shape may bring to the outcome, in units of its u: all of it, as it is in the readings [mm]."""
    chi = around.share * tested.chi_square - sum(j.drop for j in alternatives)
    nu = max(int(around.share * tested.degrees_of_freedom) - sum(j.k for j in alternatives), 1)
    lengths, seen = around.outcome.u[around.outcome.is_length], np.linalg.norm(around.target, axis=0)
    if not len(lengths) or not np.any(seen > 0.0):
        return 0.0
    reading = 1.0 / float(np.median(seen[seen > 0.0]))  # u of a reading as a displacement of the target [mm]
    return float(np.sqrt(max(chi / nu - 1.0, 0.0))) * reading / typical(lengths)


def _reasons(certain: Misfit, tested: Adequacy, moving: list[Judged], unknown: float) -> list[str]:
    """Why a misfit may move a result by more than its U, in words; empty where it does not. `certain`: what surely is one."""
    reasons, groups = [], tested.groups
    if moving:
        size = largest(moving[0].change)
        by = f"moves results by up to {size:.1f} {BARE_U}" if np.isfinite(size) else "moves all results"
        chance = power(moving[0].log_probability / float(np.log(10.0)))
        reasons.append(f"{moving[0].alternative.what} (by chance with a probability {chance}), which {by}")
    worst_groups = concentrated(groups)
    if worst_groups:
        worst = worst_groups[0]
        reasons.append(f"the misfit sits in one place: {worst.what} (unit weight {worst.unit_weight:.2f})")
    factor = float(np.hypot(certain.factor, unknown if tested.probability < CERTAIN else 0.0))
    if factor > LARGEST:
        most = max(certain.displacement, certain.influence, key=lambda e: e.variance)
        seen = f", by hold-outs of {most.sort}" if most.variance > 0.5 * factor**2 else ""
        reasons.append(f"the misfit may move results by more than their U (u {factor:.1f} times as large{seen})")
    return reasons


def _cause(j: Judged) -> Cause:
    a, change = j.alternative, largest(j.change)
    cure = a.cure.replace("{size:.1e}", f"{2.0 * float(np.max(np.abs(j.values), initial=0.0)):.1e}")
    return Cause(a.cause, a.what, cure, j.drop, j.gain, j.k, j.log_probability / float(np.log(10.0)), change)


def _rest(around: Around, tested: Adequacy, found: Misfit, alternatives: list[Judged]) -> list[Cause]:
    """What is left of the misfit when all alternatives are taken out: u as a whole or of a part, or none of these."""
    on_another_machine = bool(alternatives) and alternatives[0].alternative.cause in CHAINS
    if on_another_machine or not (tested.probability < SIGNIFICANT or found.groups):
        return []
    chi = around.share * tested.chi_square - sum(j.drop for j in alternatives)
    nu = max(int(around.share * tested.degrees_of_freedom) - sum(j.k for j in alternatives), 1)
    probability = float(chdtrc(nu, max(chi, 0.0)))
    left = chi - profile(chi, nu)
    if alternatives and (probability > SIGNIFICANT or alternatives[0].gain > left):
        return []
    return [_leftover(tested, found, alternatives, _Left(chi, nu, probability, left))]


class _Left(NamedTuple):
    """Chi-square, degrees of freedom and probability of what alternatives leave, and what a larger u would gain."""

    chi_square: float
    freedom: int
    probability: float
    gain: float


def _leftover(tested: Adequacy, found: Misfit, alternatives: list[Judged], left: _Left) -> Cause:
    weight, log10 = (
        float(np.sqrt(max(left.chi_square, 0.0) / left.freedom)),
        float(np.log10(max(left.probability, 1e-300))),
    )
    worst = concentrated(tested.groups)
    parts = [g for g in worst if g.sort in _labels()]
    if parts and not alternatives:
        what = f"readings of {parts[0].what} are worse than stated by the factor {parts[0].unit_weight:.2f}"
        cure = f"campaign: column 'u' of these readings times {parts[0].unit_weight:.2f}, once it is known why"
        return Cause(PART, what, cure, 0.0, 0.0, 1, log10, 0.0)
    if found.is_structured or left.probability > SIGNIFICANT or worst:
        rest = "the rest of the misfit" if alternatives else "the misfit"
        what = f"none of these explains {rest}: {', '.join(TRIED)}"
        cure = "look at the residuals by station, place and time, and repeat what looks odd"
        return Cause(NONE, what, cure, 0.0, 0.0, 0, log10, 0.0)
    what = f"all u are too small by the factor {weight:.2f}: the instrument is worse than stated"
    drop = left.chi_square - left.freedom
    return Cause(WHOLE, what, f"campaign, [[set]]: u times {weight:.2f}", drop, left.gain, 1, log10, 0.0)


def _labels() -> set[str]:
    """Sorts of groups that share an instrument or what stands still, not a place or a time."""
    return {SET, *(label for kind in KINDS.values() for label in kind.tested_by)}
