"""All alternatives tested on one fit, one after another as they explain what is left of the misfit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from volid.fitting.diagnosis.alternatives.axes import ORDER, other_orders
from volid.fitting.diagnosis.alternatives.base import Alternative, Judged, judged, with_unknowns
from volid.fitting.diagnosis.alternatives.functions import (
    CROSS,
    FINER,
    LEFT_OUT,
    PITCH,
    REVERSAL,
    cross_effects,
    finer,
    left_out,
    pitches,
    reversals,
)
from volid.fitting.diagnosis.alternatives.readings import (
    OUTLIERS,
    RANGE,
    SCALE,
    SCALE_OF_SET,
    TOOL,
    outliers,
    ranges,
    scales,
    tools,
)
from volid.fitting.diagnosis.alternatives.refits import judged_others, refitted, some_rows
from volid.fitting.diagnosis.alternatives.slips import EXPLAINS, GROSS, SLIPS, possible_slips
from volid.fitting.diagnosis.alternatives.time import BREAK, DRIFT, GROWTH, WARMTH, breaks, drifts, growths
from volid.fitting.diagnosis.around import Around, Fit
from volid.model.error_model import ErrorModel
from volid.model.machine import Machine

CHANCE = 1e-3  # that any alternative is named on a sound campaign, all of them together
LISTED = 4
RIVAL = 0.75  # of the best score, from which on another cause is as likely as that
COMMON = 0.7  # the same for growth against scales: machines grow in every campaign, instruments are calibrated
WORTH = 0.1  # of the first score: an alternative with less retells what the first one, of low order, leaves of itself
EQUAL = 1e-3  # of a score: as good as the same
LARGEST_SCALE = 0.01  # of a length
CHAINS = (ORDER, *SLIPS)
REFITTED, GROSS_ROWS = (
    4000,
    1200,
)  # readings that other chains are compared by, the second where all of them are off by much
TRIED = (
    DRIFT,
    GROWTH,
    WARMTH,
    BREAK,
    CROSS,
    LEFT_OUT,
    FINER,
    TOOL,
    SCALE,
    SCALE_OF_SET,
    RANGE,
    ORDER,
    *SLIPS,
    PITCH,
    REVERSAL,
    OUTLIERS,
)


def named(around: Around, fit: Fit, machine: Machine, doubtful: bool, scattered: bool) -> list[Judged]:
    """Alternatives that explain more than chance does: the best one, then what explains the rest once it is in the model.

    `doubtful`: the residuals are larger than u; `scattered`: they were, before u of the readings was enlarged by what is
    independent from position to position. Other chains and waves are looked for only then, since they take longer.
    """
    found: list[Judged] = []
    now, wide = around, doubtful or scattered
    for turn in range(LISTED):
        tested = list(judged(now, _linear(now, fit.problem.model, wide and turn < 2)))
        if wide and turn == 0:
            tested += _otherwise(around, fit, machine)
        best = _best(tested)
        if best is None or (found and best.score < WORTH * found[0].score):
            break
        found.append(best)
        if turn == 0:
            found += _rivals(best, tested)
        if best.alternative.cause in CHAINS:  # nothing else can be tested around a fit on the wrong machine
            break
        now = with_unknowns(now, best)
    return found


def _best(tested: list[Judged]) -> Judged | None:
    """The one with the best score; growth instead of scales of instruments, where it explains the misfit nearly as well."""
    certain = _certain(tested)
    best = _first_of_equals(certain)
    if best is None or best.alternative.cause not in (SCALE, SCALE_OF_SET, RANGE):
        return best
    growing = [j for j in certain if j.alternative.cause in (GROWTH, WARMTH) and j.score > COMMON * best.score]
    return max(growing, key=lambda j: j.score, default=best)


def _first_of_equals(certain: list[Judged]) -> Judged | None:
    """The best score; of others of its cause that explain the same (one tool vector: EXX, or EBX on its arm) the first."""
    best = max(certain, key=lambda j: j.score, default=None)
    same = (j for j in certain if best and j.alternative.cause == best.alternative.cause)
    return next((j for j in same if best and j.score > (1.0 - EQUAL) * best.score), best)


def _certain(tested: list[Judged]) -> list[Judged]:
    limit = float(np.log(CHANCE / max(len(tested), 1)))
    return [j for j in tested if j.log_probability < limit and j.score > 0.0 and _is_possible(j)]


def _is_possible(j: Judged) -> bool:
    """Whether such an error can be: no refraction changes lengths by a hundredth."""
    return (
        j.alternative.cause not in (SCALE, SCALE_OF_SET) or float(np.max(np.abs(j.values), initial=0.0)) < LARGEST_SCALE
    )


def _rivals(best: Judged, tested: list[Judged]) -> list[Judged]:
    """The best alternative of another cause, where it explains the misfit nearly as well: readings do not tell them apart."""
    others = [j for j in _certain(tested) if j.alternative.cause != best.alternative.cause]
    near = [j for j in others if j.score > RIVAL * best.score]
    if not near:
        return []
    rival = max(near, key=lambda j: j.score)
    what = f"or, nearly as likely: {rival.alternative.what}"
    return [rival._replace(alternative=replace(rival.alternative, what=what, is_rival=True))]


def _linear(around: Around, model: ErrorModel, doubtful: bool) -> Iterator[Alternative]:
    machine = model.machine
    yield from drifts(around)
    yield from growths(around, machine)
    yield from breaks(around)
    yield from tools(around)
    yield from scales(around)
    yield from ranges(around)
    yield from outliers(around)
    yield from reversals(around, model)
    yield from cross_effects(around, model)
    yield from left_out(around, model)
    yield from finer(around, model)
    if doubtful:
        yield from pitches(around, machine)


def _otherwise(around: Around, fit: Fit, machine: Machine) -> list[Judged]:
    """Other orders of the axes, and where the readings are off by much, slips. `machine`: travels cut to what was measured."""
    weight = float(np.sqrt(around.chi_square / max(around.freedom, 1)))
    gross = weight > GROSS
    campaign = replace(some_rows(fit.campaign, fit.factors, GROSS_ROWS if gross else REFITTED), machine=machine)
    base = refitted(fit, campaign, around, gross)
    if not np.isfinite(base.now):
        return []
    found = list(judged_others(fit, base, other_orders(campaign)))
    return found + list(judged_others(fit, base, possible_slips(campaign, weight), EXPLAINS))
