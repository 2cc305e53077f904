"""Start values from the data: what every observation kind says of its own unknowns."""

from __future__ import annotations

from typing import Any

from volid.campaign import Campaign
from volid.observations import sets_by_kind


def find_starts(campaign: Campaign) -> dict[Any, float]:
    """Start values by the unknown's key, from all readings of every kind in the campaign.

    Raises `InputError` when a kind finds none, such as for a station that is neither stated nor seen often enough.
    """
    starts: dict[Any, float] = {}
    for kind in sets_by_kind(campaign):
        starts.update(kind.starts(campaign))
    return starts
