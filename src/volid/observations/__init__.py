"""Observation kinds: one file each; this table is the only place that knows them all."""

from volid.campaign import Campaign, ObservationSet
from volid.observations.artefact import ARTEFACT
from volid.observations.base import Kind
from volid.observations.component import COMPONENT
from volid.observations.displacement import DISPLACEMENT
from volid.observations.distance import DISTANCE
from volid.observations.length import LENGTH
from volid.observations.level import LEVEL
from volid.observations.point import POINT, POLAR
from volid.observations.projection import PROJECTION

KINDS: dict[str, Kind] = {
    kind.name: kind for kind in (DISTANCE, POINT, POLAR, DISPLACEMENT, COMPONENT, LEVEL, LENGTH, PROJECTION, ARTEFACT)
}


def sets_by_kind(campaign: Campaign) -> dict[Kind, list[ObservationSet]]:
    """The sets of a campaign by their kind, in the order of the table."""
    found = {kind: [s for s in campaign.sets if KINDS[s.kind] is kind] for kind in KINDS.values()}
    return {kind: sets for kind, sets in found.items() if sets}


__all__ = ["KINDS", "Kind", "sets_by_kind"]
