"""When surveys of a series were made: dates of the record of conditions, or stated ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime, timedelta
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.fitting.solution import Solution

KEY = "date"  # of [conditions]
LATEST = 365.25 * 100.0  # days: beyond, a date says nothing
MINUTES = 24 * 60  # of a day


class Times(NamedTuple):
    """`values` (k,): days, or what the user counts in. `dated`: whether they are days since 1 January of the year 1."""

    values: tuple[float, ...]
    dated: bool

    def words(self, since_first: float) -> str:
        """A time from the first survey as date or number.

        >>> Times((738000.0, 738030.0), True).words(30.0)
        '2021-08-28'
        """
        if not isfinite(since_first):
            return "never"
        first = min(self.values)
        if not self.dated:
            return f"{first + since_first:.4g}"
        if since_first > LATEST:
            return "more than 100 years after the first"
        if all(v == int(v) for v in self.values):
            return (date.fromordinal(1) + timedelta(days=first - 1.0 + since_first)).isoformat()
        minutes = timedelta(minutes=round(MINUTES * (first - 1.0 + since_first)))
        return (datetime(1, 1, 1) + minutes).isoformat(" ", "minutes")


def stated_times(text: str, count: int) -> Times:
    """Times from "2026-01-10,2026-03-01,…" or "0,30,65": all dates, or all numbers.

    Raises `InputError` for another number of them than `count`, or a mixture.
    """
    parts = [p.strip() for p in text.split(",")]
    if len(parts) != count:
        raise InputError(
            f"`dates={text}`: {len(parts)} dates for {count} solutions; expected one for each, in their order"
        )
    days = [d for d in map(_day, parts) if d is not None]
    if len(days) == len(parts):
        return Times(tuple(days), True)
    try:
        numbers = tuple(float(p) for p in parts)
    except ValueError:
        numbers = (np.nan,)
    if not all(map(isfinite, numbers)):
        raise InputError(f"`dates={text}`: expected dates such as 2026-03-01, or numbers throughout")
    return Times(numbers, False)


def recorded_times(solutions: Sequence[Solution], names: Sequence[str]) -> Times:
    """Dates of the campaigns' records of conditions. Raises `InputError` naming a solution without one."""
    found = []
    for solution, name in zip(solutions, names, strict=True):
        texts = list(_texts(solution.campaign.conditions))
        days = [_day(t) for t in texts]
        if not texts or days[0] is None:
            what = f"is '{texts[0]}'" if texts else "is missing"
            raise InputError(
                f"{name}: [conditions] {KEY} {what}; expected the day of the survey, such as {KEY} = 2026-03-01 in the "
                "campaign's manifest, or give the days of all solutions by `dates`"
            )
        found.append(min(d for d in days if d is not None))
    return Times(tuple(found), True)


def _texts(conditions: Mapping[str, Any]) -> list[str]:
    """Entries `date` of a record, those of single files included."""
    nested = [t for v in conditions.values() if isinstance(v, Mapping) for t in _texts(v)]
    return [*([str(conditions[KEY])] if KEY in conditions else []), *nested]


def _day(text: str) -> float | None:
    """Ordinal of the day of an ISO date, with the part of the day where it says a time (UTC, where it says a zone); None for
    another text.

    >>> _day("2026-07-13T12:00") - _day("2026-07-13")
    0.5
    """
    for words in (text, text[:10]):
        try:
            at = datetime.fromisoformat(words)
            break
        except ValueError:
            continue
    else:
        return None
    at = at if at.tzinfo is None else at.astimezone(UTC).replace(tzinfo=None)
    return at.toordinal() + (at.hour * 60 + at.minute + at.second / 60) / MINUTES
