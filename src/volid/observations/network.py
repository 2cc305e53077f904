"""The stations of all length readings: their start values from the lengths alone, and the frame that known stations share."""

from __future__ import annotations

from typing import Any

import numpy as np

from volid.campaign import Campaign, Station
from volid.exceptions import InputError
from volid.model.geometry import best_rigid_motion
from volid.multilateration.trilateration import StationEstimate, trilaterate
from volid.observations.base import NuisanceTable
from volid.observations.beams import Beam
from volid.observations.response import PlaceOf, Remainder, Response, TurnOf, as_rows
from volid.observations.stations import Seen

_FEW = 4  # readings: fewer locate no station with a dead path
PLACEMENT = ("X", "Y", "Z", "A", "B", "C")
PLACEMENT_SPREAD = {"mm": 5.0, "rad": 1e-3}  # how far a virtual network's frame lies from the machine's
_ONE_FRAME = (
    "known stations share one frame, but stand on {bodies}, which the new datum moves against each other. Give the stations of "
    "every body their own positions (known = false), or fit in that datum: [datum] of the machine file"
)


def placement_slots(campaign: Campaign, seen: Seen, table: NuisanceTable) -> list[int]:
    """Numbers of the six placement parameters of the stations' common frame."""
    units = ["mm"] * 3 + ["rad"] * 3
    return [
        table.index(
            ("placement", c),
            f"placement {c}",
            unit,
            spread=PLACEMENT_SPREAD[unit],
            response=_placement_response(campaign, i, seen),
        )
        for i, (c, unit) in enumerate(zip(PLACEMENT, units, strict=True))
    ]


def _placement_response(campaign: Campaign, i: int, seen: Seen) -> Response:
    """The stations' common frame moves with the body that they all stand on."""
    keys = tuple(("placement", c) for c in PLACEMENT)
    bodies, remainder = tuple(dict.fromkeys(s.body for s in campaign.stations if s.is_placed)), seen.not_followed
    if len(bodies) > 1:
        remainder = Remainder(as_rows(1e12 * np.eye(6, 9)), _ONE_FRAME.format(bodies=", ".join(bodies)))
    if i < 3:
        return PlaceOf(bodies[0], remainder, keys[:3], i, tool=seen.tool, u=seen.u)
    return TurnOf(bodies[0], remainder, keys[3:], i - 3, sense=1.0)


def find_stations(campaign: Campaign, beams: list[Beam]) -> dict[Any, float]:
    """Start values by nuisance key for all stations of a campaign that `beams` see.

    Approximate positions only decide between mirror images. Raises `InputError` when a station without an approximate
    position has too few readings.
    """
    starts: dict[Any, float] = {}
    known = []
    for station in campaign.stations:
        of_station = [beam for beam in beams if beam.station.name == station.name]
        if not of_station:
            continue
        estimate, paths = _locate(station, of_station)
        starts.update(paths)
        if estimate is None:
            continue
        if station.is_placed:
            known.append((station, np.asarray(estimate.position)))
        elif not station.known:
            starts.update({("station", station.name, c): float(estimate.position[i]) for i, c in enumerate("XYZ")})
    return {**starts, **_placement(known)}


def _locate(station: Station, beams: list[Beam]) -> tuple[StationEstimate | None, dict[Any, float]]:
    """Trilateration of one station: its estimate, and start values of its dead paths by nuisance key."""
    targets = np.concatenate([beam.targets for beam in beams])
    distances = np.concatenate([beam.distances for beam in beams])
    numbers, index = _numbered(beams)
    relative = any(beam.relative for beam in beams)
    estimate: StationEstimate | None = None
    try:
        approximate = None if station.is_placed else station.position
        found = trilaterate(targets, distances, index, relative, start=approximate)
    except InputError as problem:
        if station.position is None:
            few = f", or mend its name, that stands in {len(distances)} rows only" if len(distances) < _FEW else ""
            raise InputError(
                f"station {station.name}: no approximate position, and none can be found from its readings: {problem}{few}"
            ) from problem
        paths_of_readings = distances - np.linalg.norm(targets - np.asarray(station.position), axis=1)
        paths = {i: float(np.median(paths_of_readings[index == i])) for i in numbers.values()}
    else:
        estimate = found
        paths = dict(zip(np.asarray(found.segments).tolist(), found.dead_paths, strict=True)) if relative else {}
    starts = {
        ("dead path", station.name, segment): float(paths.get(number, 0.0))
        for (segment, number_of_set), number in numbers.items()
        if number_of_set is None
    }
    return estimate, starts


def _numbered(beams: list[Beam]) -> tuple[dict[tuple[str, int | None], int], np.ndarray]:
    """Numbers of the uninterrupted beams, and that of every reading, (n,).

    Sets share a dead path where the segment has the same name, (segment, None); an absolute length is one of its own.
    """
    numbers: dict[tuple[str, int | None], int] = {}
    index = []
    for i, beam in enumerate(beams):
        keys = [(name, None) if beam.relative else ("", i) for name in beam.names]
        by_name = np.array([numbers.setdefault(key, len(numbers)) for key in keys], dtype=np.int64)
        index.append(by_name[beam.segments])
    return numbers, np.concatenate(index)


def _placement(known: list[tuple[Station, np.ndarray]]) -> dict[Any, float]:
    """Known stations carried into the machine frame by the rigid motion that best fits their estimates."""
    if not known:
        return {}
    given = np.array([station.position for station, _ in known], dtype=float)
    found = np.array([position for _, position in known])
    if len(known) >= 3:
        placed = best_rigid_motion(given, found)(given)
    else:  # too few for a rotation
        placed = given - given.mean(axis=0) + found.mean(axis=0)
    return {
        ("placed", s.name, c): float(p[i]) for (s, _), p in zip(known, placed, strict=True) for i, c in enumerate("XYZ")
    }
