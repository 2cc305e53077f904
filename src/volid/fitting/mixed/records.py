"""What a fit says of each set of readings among the others, as records that a solution holds."""

from __future__ import annotations

from dataclasses import dataclass

ESTIMATED = "estimated"


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
        state: "estimated", or why the stated u was kept.

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

    @property
    def is_estimated(self) -> bool:
        """Whether the factor was estimated."""
        return self.state == ESTIMATED
