"""What a fit says of each set of readings among the others, as records that a solution holds."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

OTHERS = "the other sets"
ESTIMATED = "estimated"
UNFINISHED = "estimated, but the rounds stopped before they converged"
NAN = math.nan  # always this one, so that equal records compare equal


def with_one_nan(record: Any) -> None:
    """Put `NAN` in place of every NaN of a record."""
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, float) and math.isnan(value):
            object.__setattr__(record, field.name, NAN)


@dataclass(frozen=True)
class VarianceComponent:
    """By which factor the stated u of a part of a set was changed, because the fit estimated it from the residuals.

    Args:
        set: The set.
        part: The readings of the set that share a unit, in words, such as "polar, range".
        n: Readings that took part.
        redundancy: How many of them check others: the sum of 1 - h at the end.
        factor: u of the readings in the solution = factor · stated u; 1 where it was not estimated.
        u: Standard uncertainty of the factor; NaN where it was not estimated.
        state: "estimated" (and what is wrong with that), or why the stated u was kept.

    >>> VarianceComponent("bar", "distance", 120, 88.0, 1.9, 0.14, "estimated").is_estimated
    True
    """

    set: str
    part: str
    n: int
    redundancy: float
    factor: float
    u: float
    state: str

    def __post_init__(self) -> None:
        with_one_nan(self)

    @property
    def is_estimated(self) -> bool:
        """Whether the factor was estimated."""
        return self.state in (ESTIMATED, UNFINISHED)


@dataclass(frozen=True)
class SetTest:
    """What a fit says of one set among the others. Chi-squares are over the u that the fit used.

    Of a campaign of very many readings, those that were tested one by one stand for all.

    Args:
        set: The set.
        n: Readings that took part.
        redundancy: How many of them check others, the sum of 1 - h.
        unit_weight: Root of the set's chi-square over its redundancy; NaN without any.
        probability: Of a chi-square at least as large by chance.
        own_weight: The same of its scatter alone: what is left when functions as smooth as those of the fit follow its residuals.
            It shows u, whatever the other sets say. NaN where nothing is left.
        own_freedom: Degrees of freedom of that.
        own_probability: Of a scatter at least as large by chance.
        disagreement: What the residuals have in common with an error of the machine, over what chance leaves of it, as a unit
            weight: above 1 where the set sees another machine than the other sets do. NaN without other sets.
        disagreement_probability: Of a disagreement at least as large by chance, with the scatter that the sets show.
        prediction_weight: Root of chi-square over degrees of freedom of the set's readings predicted by all other sets, its own
            unknowns fitted to it.
        prediction_freedom: Degrees of freedom of that: readings less what the set alone determines.
        prediction_probability: Of predictions at least as bad by chance.
        largest_en: Largest |E_n| = |reading - predicted|/√(U² + U_predicted²), k = 2; NaN where no reading is predicted.
        beyond: Share of the predicted readings with |E_n| > 1.
        alone: Combinations of unknowns, its own ones among them, that no other set determines.
        rest_weight: Unit weight of the fit without the set.
        pattern: Readings of the set whose mean residual deviates most, in words; "" where it is nothing.
        pattern_mean: Their mean residual over u.
        pattern_probability: Of a mean at least as far off by chance, all groups counted.
        contradicts: What it certainly contradicts: "the other sets", or the name of one set, where nothing tells whether that or
            this one is wrong; "" for nothing.
        verdict: All of that in words.
    """

    set: str
    n: int
    redundancy: float
    unit_weight: float
    probability: float
    own_weight: float
    own_freedom: float
    own_probability: float
    disagreement: float
    disagreement_probability: float
    prediction_weight: float
    prediction_freedom: float
    prediction_probability: float
    largest_en: float
    beyond: float
    alone: int
    rest_weight: float
    pattern: str
    pattern_mean: float
    pattern_probability: float
    contradicts: str
    verdict: str

    def __post_init__(self) -> None:
        with_one_nan(self)
