"""All alternatives tested on one fit, the best of every cause, in the order of their evidence."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from volid.fitting.diagnosis.alternatives.axes import COLUMNS, ORDER, SENSE, judged_chains
from volid.fitting.diagnosis.alternatives.base import Alternative, Judged, judged
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
from volid.fitting.diagnosis.alternatives.readings import OUTLIERS, SCALE, TOOL, outliers, scales, tools
from volid.fitting.diagnosis.alternatives.time import BREAK, DRIFT, GROWTH, WARMTH, breaks, drifts, growths
from volid.fitting.diagnosis.around import Around, Fit
from volid.model.error_model import ErrorModel
from volid.model.machine import Machine

CHANCE = 1e-3  # that any alternative is named on a sound campaign, all of them together
LISTED = 5
WORTH = 0.03  # of the best score: an alternative with less only retells a little of what the best one explains
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
    ORDER,
    SENSE,
    COLUMNS,
    PITCH,
    REVERSAL,
    OUTLIERS,
)


def named(around: Around, fit: Fit, machine: Machine, doubtful: bool, scattered: bool) -> list[Judged]:
    """Alternatives that explain more than chance does, best first, at most one of a kind of name.

    `doubtful`: the residuals are larger than u; `scattered`: they were, before u of the readings was enlarged by what is
    independent from position to position. Other chains and waves are looked for only then, since they take longer.
    """
    found = list(judged(around, _linear(around, machine, fit.problem.model, doubtful or scattered)))
    found += judged_chains(fit, machine, around.chi_square, around.freedom) if doubtful or scattered else []
    limit = float(np.log(CHANCE / max(len(found), 1)))
    kept = [j for j in found if j.log_probability < limit and j.score > 0.0]
    kept.sort(key=lambda j: -j.score)
    best: dict[str, Judged] = {}
    for j in (j for j in kept if j.score > WORTH * kept[0].score):
        best.setdefault(j.alternative.cause, j)
    return list(best.values())[:LISTED]


def _linear(around: Around, machine: Machine, model: ErrorModel, doubtful: bool) -> Iterator[Alternative]:
    yield from drifts(around)
    yield from growths(around, machine)
    yield from breaks(around)
    yield from tools(around)
    yield from scales(around)
    yield from outliers(around)
    yield from reversals(around, machine)
    yield from cross_effects(around, machine)
    yield from left_out(around, model)
    yield from finer(around, model)
    if doubtful:
        yield from pitches(around, machine)
