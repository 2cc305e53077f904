"""`distance`: station to target, plus a dead path (tracking interferometer, laser tracker, double ball bar).

d = |target - station| + dead path, with one dead path per station and segment when `relative`, none or a calibrated
length's deviation (prior `calibrated_u`) when not. Stations known in their common frame share six placement parameters.
CONVENTIONS 6; ISO/TR 16907 8.3.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from volid.campaign import Campaign, ObservationSet, Station
from volid.elementary import in_rows
from volid.geometry import Vector, add, norm, rotate_small, subtract
from volid.kinematics import functional_point, transform
from volid.machine import Machine
from volid.observations.base import Group, Kind, NuisanceTable


class DistanceSettings(NamedTuple):
    """Static part: the body the station stands on, whether its network is placed, whether there is a length offset."""

    body: int
    placed: bool
    offset: bool


PLACEMENT = ("X", "Y", "Z", "A", "B", "C")
# What a virtual instrument draws: dead paths [mm], and how far the stations' common frame lies from the machine's
DEAD_PATH_SPREAD = 300.0
PLACEMENT_SPREAD = {"mm": 5.0, "rad": 1e-3}


def predict(
    machine: Machine, settings: DistanceSettings, q: Any, tool: Vector, errors: Any, slots: Any, constants: Any
) -> Any:
    """Predicted distances, shape (1, m) [mm]."""
    target = functional_point(machine, q, tool, errors)
    if settings.placed:
        # station = t + R(ω) s, with ω a correction to the placement that `s` already holds
        station = add(rotate_small((slots[3], slots[4], slots[5]), tuple(constants[:3])), tuple(slots[:3]))
    else:
        station = (slots[0], slots[1], slots[2])
    station = transform(machine, q, errors, station, start=settings.body)
    distance = norm(subtract(target, station))
    if settings.offset:
        distance = distance + slots[6 if settings.placed else 3]
    return in_rows([distance], np.shape(q[0]))


def _settings(observations: ObservationSet, station: Station, machine: Machine) -> DistanceSettings:
    offset = bool(observations.options.get("relative", True)) or observations.options.get("calibrated_u", 0.0) > 0.0
    placed = station.known and station.frame != "machine"
    return DistanceSettings(machine.body_index(station.body), placed, offset)


def _station_slots(station: Station, placed: bool, table: NuisanceTable) -> list[int]:
    if placed:
        units = ["mm"] * 3 + ["rad"] * 3
        return [
            table.index(("placement", c), f"placement {c}", u, spread=PLACEMENT_SPREAD[u])
            for c, u in zip(PLACEMENT, units, strict=True)
        ]
    start = station.position or (0.0, 0.0, 0.0)
    prior = 0.0 if station.known else np.inf
    return [
        table.index(("station", station.name, c), f"station {station.name} {c}", "mm", start[i], prior)
        for i, c in enumerate("XYZ")
    ]


def _offset_slot(observations: ObservationSet, station: Station, segment: str, table: NuisanceTable) -> int:
    if observations.options.get("relative", True):
        name = f"dead path {station.name} segment {segment}"
        return table.index(("dead path", station.name, segment), name, spread=DEAD_PATH_SPREAD)
    prior = float(observations.options["calibrated_u"])
    return table.index(("length", observations.name), f"length {observations.name}", prior_u=prior)


def groups(observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
    """Rows of a set by station body and placement, with their nuisance parameters."""
    found: dict[DistanceSettings, list[tuple[np.ndarray, list[int], list[float]]]] = {}
    names, segments = observations.labels["station"], observations.labels["segment"]
    for name in dict.fromkeys(names):
        station = campaign.station(name)
        settings = _settings(observations, station, campaign.machine)
        base = _station_slots(station, settings.placed, table)
        fixed = [
            table.starts.get(("placed", name, c), (station.position or (0.0,) * 3)[i]) for i, c in enumerate("XYZ")
        ]
        of_station = names == name
        for segment in dict.fromkeys(segments[of_station]) if settings.offset else [None]:
            rows = np.flatnonzero(of_station if segment is None else of_station & (segments == segment))
            slots = base if segment is None else [*base, _offset_slot(observations, station, segment, table)]
            found.setdefault(settings, []).append((rows, slots, fixed if settings.placed else []))
    return [_group(settings, parts) for settings, parts in found.items()]


def _group(settings: DistanceSettings, parts: list[tuple[np.ndarray, list[int], list[float]]]) -> Group:
    rows = np.concatenate([rows for rows, _, _ in parts])
    order = np.argsort(rows, kind="stable")
    slots = np.concatenate([np.tile(np.array(s)[:, None], len(r)) for r, s, _ in parts], axis=1)
    constants = np.concatenate([np.tile(np.array(c).reshape(-1, 1), len(r)) for r, _, c in parts], axis=1)
    return Group(rows[order], settings, slots[:, order], constants[:, order])


DISTANCE = Kind(
    name="distance",
    readings=("distance",),
    labels={"station": None, "segment": "1"},
    options={"relative": True, "calibrated_u": 0.0},
    predict=predict,
    groups=groups,
    doc="|target - station| + dead path [mm]",
)
