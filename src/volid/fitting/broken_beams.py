"""Broken beams: a robust fit finds the reading from which on a segment is longer by a constant, and begins a new segment there.

An interferometer that lost its beam and found it again counts on from another length. All later readings of the segment are off
by the same amount: they are no outliers, and setting them aside one by one would lose half of the segment.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from volid.campaign import Campaign
from volid.fitting.diagnosis.alternatives.base import Judged, judged
from volid.fitting.diagnosis.alternatives.time import breaks, drifts
from volid.fitting.diagnosis.around import Around, Fit, around
from volid.fitting.diagnosis.outcome import Outcome
from volid.fitting.diagnosis.robust import down_weight
from volid.fitting.smooth_fit import SmoothFit
from volid.observations import KINDS

STEP = 4.0  # u of a reading: smaller ones are left to the verdict
CHANCE = 1e-5  # that a sound campaign is cut anywhere
LARGEST = 120_000_000  # numbers of J L that are kept at once, 1 GB: some 270,000 readings
MOST = 12  # times that all segments are looked through


def with_new_segments(
    campaign: Campaign, fitter: SmoothFit, starts: Mapping[Any, float]
) -> tuple[Campaign, tuple[str, ...]]:
    """The campaign with a new segment after the most certain break, and what was found in words; () where there is none.

    `fitter`: at its optimum, gross readings included; they are weighted down here (Huber).
    """
    if not any(KINDS[s.kind].runs_by(s) for s in campaign.sets):
        return campaign, ()
    whole = fitter.factors
    fitter.solve(down_weight(fitter.residuals_only, whole))
    assert fitter.optimum is not None
    fit = Fit(
        fitter.problem, fitter.campaign, fitter.optimum.z, fitter.root(), fitter.factors, starts, fitter.smooth_rows
    )
    chi = 2.0 * float(fitter.optimum.cost)
    freedom = fitter.campaign.n_readings + fitter.n_smooth - fitter.free.shape[1]
    seen = around(fit, Outcome.nothing(fit.root.shape[1]), chi, max(freedom, 1), LARGEST)
    found = [j for j in judged(seen, breaks(seen)) if j.log_probability < np.log(CHANCE) and _is_step(j, seen)]
    slow = max((j.score for j in judged(seen, drifts(seen))), default=0.0)
    found = [j for j in found if j.score > slow]  # what drifts is no step, and would be cut again and again
    if not found:
        return campaign, ()
    best = max(found, key=lambda j: j.gain)  # the next one is looked for when this one is cured
    if seen.share < 1.0:
        return campaign, (f"{best.alternative.what}, or near it; too many readings to cut there",)
    cut = _cut(campaign, np.array(best.alternative.readings), seen.set_number, seen.row)
    return cut, (f"{best.alternative.what} (by {1e3 * float(best.values[0]):.1f} µm): a new segment begins there",)


def _is_step(found: Judged, seen: Around) -> bool:
    """Whether the step is large against the u of its readings."""
    own = np.array(found.alternative.readings)
    u = 1.0 / np.median(seen.weight[own][seen.weight[own] > 0.0])
    return bool(abs(float(found.values[0])) > STEP * u)


def _cut(campaign: Campaign, numbers: np.ndarray, sets: np.ndarray, rows: np.ndarray) -> Campaign:
    """The campaign in which readings `numbers` have a segment of their own."""
    i = int(sets[numbers[0]])
    s = campaign.sets[i]
    own = rows[numbers]
    label = KINDS[s.kind].runs_by(s)[-1]
    labels = s.labels[label].astype(object)
    labels[own] = f"{labels[own[0]]} from row {int(own[0]) + 1 if s.rows is None else int(s.rows[own[0]])}"
    cut = replace(s, labels={**s.labels, label: labels.astype(str)})
    return replace(campaign, sets=(*campaign.sets[:i], cut, *campaign.sets[i + 1 :]))
