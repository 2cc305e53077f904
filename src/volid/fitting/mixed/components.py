"""Parts of a campaign's readings that have one factor of u each, and the campaign with these factors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign
from volid.exceptions import InputError, shown
from volid.fitting.mixed.records import VarianceComponent
from volid.observations import KINDS

ALL = "all"


class Component(NamedTuple):
    """Readings of set number `number` that share a factor of u: those of one unit. `rows` (m, k), bool."""

    number: int
    set: str
    part: str
    rows: np.ndarray


def components_of(campaign: Campaign, asked: bool | str | Sequence[str]) -> tuple[Component, ...]:
    """The parts whose u is to be estimated: of every set for True or "all", else of the sets named; () for False.

    Raises `InputError` for a set that the campaign does not have.
    """
    if isinstance(asked, bool) or asked == ALL:
        names = [s.name for s in campaign.sets] if asked else []
    else:
        names = [asked] if isinstance(asked, str) else list(asked)
        names = [s.name for s in campaign.sets] if names == [ALL] else names
    present = [s.name for s in campaign.sets]
    for name in names:
        if name not in present:
            raise InputError(
                f"`estimate_u`: the campaign has no set '{shown(name)}'; expected '{ALL}', or some of {shown(', '.join(present))}"
            )
    return tuple(c for i, s in enumerate(campaign.sets) if s.name in names for c in _parts(campaign, i))


def _parts(campaign: Campaign, number: int) -> list[Component]:
    """The parts of a set by unit: range and angles of a tracker, translations and rotations of a level and a laser."""
    observations = campaign.sets[number]
    found = []
    for words, _, rows, _ in KINDS[observations.kind].parts(observations):
        wide = rows if rows.ndim == 2 else np.repeat(rows[:, None], observations.readings.shape[1], axis=1)
        found.append(Component(number, observations.name, words, wide))
    return found


def scaled(campaign: Campaign, components: Sequence[Component], factors: np.ndarray) -> Campaign:
    """The campaign with the u of every part times its factor."""
    sets = list(campaign.sets)
    for component, factor in zip(components, factors.tolist(), strict=True):
        own = sets[component.number]
        sets[component.number] = replace(own, u=np.where(component.rows, factor * own.u, own.u))
    return replace(campaign, sets=tuple(sets))


def stated_u(campaign: Campaign, found: Sequence[VarianceComponent]) -> tuple[np.ndarray, ...]:
    """The u that were stated, (m, k) per set, of a campaign that holds the estimated ones."""
    factors = {(c.set, c.part): c.factor for c in found}
    parts = components_of(campaign, True)
    own = scaled(campaign, parts, np.array([1.0 / factors.get((c.set, c.part), 1.0) for c in parts]))
    return tuple(s.u for s in own.sets)
