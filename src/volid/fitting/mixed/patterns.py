"""Systematic residuals within one set: groups of its readings whose mean lies farther from 0 than chance explains."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import erfc

from volid.campaign import Campaign
from volid.fitting.diagnosis.groups import SET, groupings

LEAST = 1e-3  # of the number of readings: a mean that the fit holds at 0 tells nothing


class Pattern(NamedTuple):
    """`what`: readings in words, their `mean` residual over u, `probability` of one at least as large by chance."""

    what: str
    mean: float
    probability: float


NOTHING = Pattern("", 0.0, 1.0)


def pattern_of(campaign: Campaign, number: int, v: np.ndarray, rows: np.ndarray, scatter: float) -> Pattern:
    """The group of readings of set `number` with the most significant mean, all groups of the set counted.

    `v` (n,): whitened residuals of the set, row by row; `rows` (n, r): J L, so that v has the covariance 1 - J L LᵀJᵀ; `scatter`:
    by which factor the set scatters more than u says, at least 1.
    """
    readings = campaign.sets[number]
    found, tried = NOTHING, 0
    active = np.any(rows != 0.0, axis=1) | (v != 0.0)
    for group in groupings(campaign, readings, readings):
        mask = (
            group.rows if group.rows.ndim == 2 else np.repeat(group.rows[:, None], readings.readings.shape[1], axis=1)
        ).ravel()
        mask = mask & active
        n = int(np.count_nonzero(mask))
        left = n - float(np.sum(rows[mask].sum(axis=0) ** 2))
        if not n or left < LEAST * n:
            continue
        tried += 1
        total = float(v[mask].sum())
        probability = float(erfc(abs(total) / (scatter * np.sqrt(2.0 * left))))
        if probability < found.probability:
            what = "all of it" if group.sort == SET else group.what
            found = Pattern(what, total / n, probability)
    return found._replace(probability=min(1.0, tried * found.probability))
