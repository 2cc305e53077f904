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
    readings, active = campaign.sets[number], np.any(rows != 0.0, axis=1) | (v != 0.0)
    groups = list(groupings(campaign, readings, readings))
    masks = np.array([_wide(group.rows, readings.readings.shape[1]) & active for group in groups], dtype=float)
    counts, totals = masks.sum(axis=1), masks @ v
    left = counts - np.sum((masks @ rows) ** 2, axis=1)
    tried = np.flatnonzero((counts > 0.0) & (left > LEAST * counts))
    if not len(tried):
        return NOTHING
    chances = erfc(np.abs(totals[tried]) / (scatter * np.sqrt(2.0 * left[tried])))
    best = int(tried[np.argmin(chances)])
    what = "all of it" if groups[best].sort == SET else groups[best].what
    return Pattern(what, float(totals[best] / counts[best]), min(1.0, len(tried) * float(chances.min())))


def _wide(rows: np.ndarray, columns: int) -> np.ndarray:
    """Which readings, row by row, from which rows (m,), or which rows and columns (m, k)."""
    return (rows if rows.ndim == 2 else np.repeat(rows[:, None], columns, axis=1)).ravel()
