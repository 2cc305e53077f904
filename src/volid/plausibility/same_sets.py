"""Sets that hold the same readings: one file given twice, or a copy of it under another name, counts its readings twice."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError

FEWEST = 6  # different readings from which on agreement in all digits is no chance
SHARE = 0.9  # of the rows of the smaller set


def check_same_sets(campaign: Campaign) -> None:
    """Raises `InputError` for two sets, one of which repeats the rows of the other: commanded positions, directions, tool,
    readings, and times where both have them. Names, labels and u may differ."""
    for one, other in combinations(campaign.sets, 2):
        again = _again(one, other)
        if again < FEWEST or again < SHARE * min(len(one), len(other)):
            continue
        raise InputError(
            f"{other.file_and_set}: {again} of its {len(other)} rows are those of {one.file_and_set}, which has {len(one)}, with "
            "the same positions and readings; remove one of the two, as they would count twice, or, if they were really measured "
            "twice, add a column time to both"
        )


def _again(one: ObservationSet, other: ObservationSet) -> int:
    """How many different rows of the two sets are equal; rows whose readings are all 0 do not count."""
    few, many = sorted((one.readings[:, 0], other.readings[:, 0]), key=len)
    if len(few) < FEWEST or np.isin(few, many).mean() < SHARE:  # quick, and nearly always so
        return 0
    timed = one.time is not None and other.time is not None
    rows, others = _rows(one, timed), _rows(other, timed)
    return len(rows & others) if rows and others else 0


def _rows(readings: ObservationSet, timed: bool) -> set[bytes]:
    columns = [np.hstack(readings.side_by_side), readings.readings]
    if timed and readings.time is not None:
        columns.append(readings.time[:, None])
    table = np.ascontiguousarray(np.hstack(columns)[(readings.readings != 0.0).any(axis=1)]) + 0.0  # no -0.0
    return {row.tobytes() for row in table}
