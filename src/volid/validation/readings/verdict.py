"""The verdict of a validation in words, and what the campaign could not tell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import chdtr

from volid.fitting.diagnosis.adequacy import Cause
from volid.validation.readings.changes import function_columns
from volid.validation.readings.chi_squares import Smallest, Split, Test, smallest
from volid.validation.readings.groups import Group

COARSE = 0.010  # mm at the functional point: a change that is found only from there on is hardly tested
WORSE = 1.3  # times the ratio of all readings, from which a group is where a disagreement is
NO_TEST = "nothing is tested"
FAR_SMALLER, CHANCE = 0.7, 1e-3  # times u: residuals that are smaller, not by chance, have an u that is too large
LISTED, MEMBERS = 3, 10  # groups that are named, and readings that one needs for it


class Outcome(NamedTuple):
    """`level`: probability with which a right solution is confirmed; `seen`: whether the fit has seen the readings; `untested`:
    why nothing is tested, empty where something is."""

    level: float
    seen: bool = False
    untested: str = ""


def verdict_of(found: Sequence[Test], groups: Sequence[Group], causes: Sequence[Cause], outcome: Outcome) -> str:
    """One or two sentences: confirmed or not, by what, where, and what it looks like."""
    failed = [t for t in found if not t.passed]
    if not failed and outcome.untested:
        return f"confirmed, but {outcome.untested}"
    if not failed:
        agree = f"the readings agree with the solution's predictions (a right solution does so in {100 * outcome.level:g} %)"
        return f"no test: {agree}, but the fit has seen them already" if outcome.seen else f"confirmed: {agree}"
    parts = ", ".join(f"{t.what} (chi-square {t.chi_square:.1f}, limit {t.limit:.1f})" for t in failed)
    where = _where(groups)
    looks = (
        f"; it looks like this: {causes[0].what}"
        if causes
        else "; nothing that was tried explains it better than chance"
    )
    return f"not confirmed, by {parts}{where}{looks}"


def _where(groups: Sequence[Group]) -> str:
    """Groups that fit clearly worse than their set does."""
    whole = max((g.ratio for g in groups if g.sort == "set"), default=1.0)
    worse = [g for g in groups if g.sort != "set" and g.n >= MEMBERS and g.ratio > WORSE * whole][:LISTED]
    sets = [g for g in groups if g.sort == "set" and g.ratio > WORSE]
    named = worse or sets[:LISTED]
    if not named:
        return ""
    return "; worst in " + ", ".join(f"{g.what} (E_n > 1 in {100 * g.e_n_above_1:.0f} %)" for g in named)


def weak_points(smallest: Sequence[Smallest]) -> tuple[str, ...]:
    """What would not be found, and what only when it is large, one sentence each."""
    never = [s.name for s in smallest if s.value == float("inf")]
    coarse = [s for s in smallest if COARSE < s.at_point < float("inf")]
    found = []
    if never:
        found.append(
            f"this campaign cannot tell a change of {', '.join(never)}: its own unknowns take it up, or no reading sees it"
        )
    if coarse:
        sizes = ", ".join(f"{s.name} from {1e3 * s.at_point:.0f} µm at the functional point on" for s in coarse)
        found.append(f"this campaign would find with 90 % only large changes: {sizes}")
    return tuple(found)


def untested(split: Split, smallest_: Sequence[Smallest], parameters: np.ndarray, level: float) -> str:
    """Why the readings are no test of the solution; empty where they are one.

    They are none where they would not tell the solution from a machine without errors, nor find any change below `COARSE`.
    """
    if any(s.at_point <= COARSE for s in smallest_):
        return ""
    whole = np.sum([column for _, column in function_columns(split.whitened.linear, parameters)], axis=0)
    if smallest(split, np.asarray(whole), level) <= 1.0:
        return ""
    return (
        f"{NO_TEST}: these readings would hardly tell the machine of the solution from one without errors, and find no change "
        f"below {1e3 * COARSE:g} µm at the functional point; take more readings, or look whether their u is right"
    )


def far_smaller(split: Split) -> str:
    """A sentence where residuals are smaller than u says, beyond chance; empty else."""
    freedom, whole = split.whitened.freedom, float(np.sum(split.whitened.v**2))
    ratio = float(np.sqrt(whole / freedom))
    if ratio > FAR_SMALLER or chdtr(freedom, whole) > CHANCE:
        return ""
    return (
        f"residuals are {ratio:.2g} times what their u lets expect: u of readings or solution is too large, so that changes are "
        "found only when they are larger than need be"
    )
