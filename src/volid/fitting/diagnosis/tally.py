"""Chi-square of all readings and of groups, and the normalised residual test."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc

from volid.campaign import Campaign
from volid.fitting.diagnosis.adequacy import Adequacy, GroupTest, SuspectReading, suspect
from volid.fitting.diagnosis.groups import groupings
from volid.fitting.diagnosis.robust import critical_value


def assess(
    campaign: Campaign,
    residuals: list[np.ndarray],
    leverages: list[np.ndarray],
    active: list[np.ndarray],
    degrees_of_freedom: int,
    prior_chi_square: float = 0.0,
) -> Adequacy:
    """Test the whitened residuals (reading - predicted)/u, leverages h and active readings, each (m, k) per set."""
    tally = Tally(campaign, sum(int(a.sum()) for a in active))
    tally.add(campaign, residuals, leverages, active)
    return tally.adequacy(degrees_of_freedom, prior_chi_square)


class Tally:
    """Sums of squared residuals and redundancies by groups, over all readings or part by part.

    `like`: the campaign, or a sample of it, which decides what groups there are. `n`: number of all readings that take part.
    """

    def __init__(self, like: Campaign, n: int) -> None:
        self._like = {s.name: s for s in like.sets}
        self._limit = critical_value(n)
        self._total = self._redundancy = 0.0
        self._groups: dict[tuple[str, str], np.ndarray] = {}  # sum of squares, of redundancies, readings
        self._suspects: list[SuspectReading] = []

    def add(
        self, campaign: Campaign, residuals: list[np.ndarray], leverages: list[np.ndarray], active: list[np.ndarray]
    ) -> None:
        """Count the whitened residuals (reading - predicted)/u, leverages h and active readings, each (m, k) per set."""
        squares = [np.where(a, r**2, 0.0) for r, a in zip(residuals, active, strict=True)]
        redundancy = [np.where(a, 1.0 - h, 0.0) for h, a in zip(leverages, active, strict=True)]
        self._total += sum(float(s.sum()) for s in squares)
        self._redundancy += sum(float(f.sum()) for f in redundancy)
        for s, sq, re in zip(campaign.sets, squares, redundancy, strict=True):
            for group in groupings(campaign, s, self._like[s.name]):
                rows, key = group.rows, (group.sort, group.what)
                found = np.array([sq[rows].sum(), re[rows].sum(), re[rows].size])
                self._groups[key] = self._groups.get(key, 0.0) + found
        self._suspects += _suspects(campaign, residuals, redundancy, active, self._limit)

    def adequacy(self, dof: int, prior_chi_square: float = 0.0) -> Adequacy:
        """The tests of what was counted; their verdict is still to be given (`verdict.judge`)."""
        total = self._total + prior_chi_square
        probability = float(chdtrc(dof, total)) if dof > 0 else float("nan")
        tests = [_test(*key, *sums) for key, sums in self._groups.items()]
        groups = tuple(sorted((g for g in tests if g), key=lambda g: (g.probability, -g.unit_weight)))
        suspects = tuple(sorted(self._suspects, key=lambda x: -abs(x.normalised)))
        weight = float(np.sqrt(total / dof)) if dof > 0 else float("nan")
        checked = self._redundancy
        own = float(np.sqrt(self._total / checked)) if checked > 0.0 else math.nan
        found = Adequacy(total, dof, weight, probability, groups, suspects, False, "")
        return replace(found, redundancy=checked, reading_weight=own)


def _suspects(
    campaign: Campaign,
    residuals: list[np.ndarray],
    redundancy: list[np.ndarray],
    active: list[np.ndarray],
    limit: float,
) -> list[SuspectReading]:
    result = []
    for s, r, f, a in zip(campaign.sets, residuals, redundancy, active, strict=True):
        normalised = np.where(a & (f > 1e-6), r / np.sqrt(np.maximum(f, 1e-6)), 0.0)
        for i, k in zip(*np.nonzero(np.abs(normalised) > limit), strict=True):
            result.append(suspect(s, int(i), int(k), float(r[i, k]), float(normalised[i, k])))
    return result


def _test(sort: str, what: str, total: float, dof: float, n: float) -> GroupTest | None:
    if dof < 1.0:
        return None
    return GroupTest(what, int(n), float(np.sqrt(total / dof)), float(chdtrc(dof, total)), sort)
