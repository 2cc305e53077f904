"""Unmodelled error: how much larger than stated every u is because the model does not follow the machine, in words.

The factor is found by `fitting.diagnosis.verdict`, and is part of every u of a solution, Monte Carlo samples included; the part
due to it, u_lack = u sqrt(1 - 1/factor²), stands as a source of its own in a budget. JCGM GUM-6:2020 11.7.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.fitting.diagnosis.adequacy import ENLARGED, NOT_TESTABLE, REJECTED
from volid.fitting.solution import Solution


class LackOfFit(NamedTuple):
    """`unit_weight`: sqrt(chi²/dof), NaN where not testable. `factor`: multiplies every u; 1 without a lack of fit. `grade`: of
    the verdict."""

    unit_weight: float
    factor: float
    grade: str

    @property
    def share(self) -> float:
        """u_lack / u, u without it."""
        return float(np.sqrt(self.factor**2 - 1.0))

    def __str__(self) -> str:
        if self.grade == NOT_TESTABLE:
            return "not testable: there are no more readings than unknowns"
        seen = f"unit weight {self.unit_weight:.2f}"
        if (
            self.factor == 1.0 and self.grade == REJECTED
        ):  # a file of an earlier version, or a cause that chi-square does not see
            return f"found ({seen}); not part of the stated u, which do not hold"
        if self.factor == 1.0:
            return f"none found ({seen})"
        text = f"found ({seen}); part of every u, which is {self.factor:.2f} times as large with it"
        return f"{text}, and may still be too small" if self.grade == REJECTED else text


def lack_of_fit(solution: Solution) -> LackOfFit:
    """The unmodelled error that the residuals show."""
    adequacy = solution.adequacy
    return LackOfFit(float(adequacy.unit_weight), adequacy.factor, adequacy.grade)


def verdict_words(solution: Solution) -> str:
    """The grade in one line, for the head of every output: "accepted, u enlarged by the factor 1.10"."""
    adequacy = solution.adequacy
    if adequacy.grade == REJECTED:
        return "MODEL REJECTED BY THE DATA; the uncertainties do not hold"
    if adequacy.grade == ENLARGED and adequacy.factor > 1.0:
        return f"{adequacy.grade} by the factor {adequacy.factor:.2f}"
    return adequacy.grade
