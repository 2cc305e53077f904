"""Observation kinds: one file each; this table is the only place that knows them all."""

from volid.observations.base import Kind
from volid.observations.component import COMPONENT
from volid.observations.displacement import DISPLACEMENT
from volid.observations.distance import DISTANCE
from volid.observations.point import POINT, POLAR

KINDS: dict[str, Kind] = {kind.name: kind for kind in (DISTANCE, POINT, POLAR, DISPLACEMENT, COMPONENT)}

__all__ = ["KINDS", "Kind"]
