"""Unmodelled error: how much larger than stated u is where the model does not follow the machine. It is never applied silently.

There are two measures. Without any lack of fit, the probability that a measure enlarges u is below 5 %:
  unit weight s = sqrt(Σ(v/u)² / ν), residuals at the readings: instrument, drift, non-rigid behaviour (chi-square test);
  held-out weight h = sqrt(Q / E Q), Q the sum of squares of the prediction errors of readings that are held out (K-fold), E Q
  its expectation from noise and the parameters' uncertainty: only solutions of earlier versions, which chose segments by it,
  have one.

The larger of the two enlarges every u by one factor; the part due to it, u_lack = u sqrt(factor² - 1), is stated beside u. This
takes the lack of fit as random from reading to reading, and as large elsewhere as where there are readings. JCGM GUM-6:2020 11.7.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.fitting.solution import Solution

CHANCE = 0.05
QUANTILE = 1.645  # of the normal distribution, one-sided 5 %


class LackOfFit(NamedTuple):
    """`unit_weight`, `held_out`: the measures (NaN: not available). `factor`: multiplies every u; 1 without a lack of fit."""

    unit_weight: float
    held_out: float
    factor: float

    @property
    def share(self) -> float:
        """u_lack / u."""
        return float(np.sqrt(self.factor**2 - 1.0))

    def __str__(self) -> str:
        if not np.isfinite(self.unit_weight):
            return "not testable: there are no more readings than unknowns"
        seen = f"unit weight {self.unit_weight:.2f}"
        if np.isfinite(self.held_out):
            seen += f", held out {self.held_out:.2f}"
        if self.factor == 1.0:
            return f"none found ({seen})"
        return (
            f"found ({seen}); not part of the stated u: it adds {self.share:.2f} u in quadrature, with it every u is "
            f"{self.factor:.2f} times as large"
        )


def lack_of_fit(solution: Solution) -> LackOfFit:
    """The unmodelled error that the residuals show."""
    adequacy, statistics = solution.adequacy, solution.statistics
    factors = [1.0]
    if adequacy.unit_weight > 1.0 and adequacy.probability < CHANCE:
        factors.append(float(adequacy.unit_weight))
    held_out = float(statistics.held_out_weight)
    if held_out**2 > 1.0 + QUANTILE * np.sqrt(2.0 / max(statistics.n_readings, 1)):
        factors.append(held_out)
    return LackOfFit(float(adequacy.unit_weight), held_out, max(factors))
