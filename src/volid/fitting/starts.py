"""Start values of stations and dead paths from the data alone: every station trilaterated against nominal points."""

from __future__ import annotations

from typing import Any

import numpy as np

from volid.campaign import Campaign, ObservationSet, Station
from volid.exceptions import InputError
from volid.model.geometry import best_rigid_motion
from volid.model.kinematics import carry, nominal_point
from volid.model.machine import Machine
from volid.multilateration.trilateration import StationEstimate, trilaterate
from volid.observations.distance import sees_tool, target_body, target_place


def nominal_reflector(machine: Machine, observations: ObservationSet, rows: np.ndarray, body: str) -> np.ndarray:
    """Nominal places, in the frame of `body`, of a reflector that stands on another body than the tool, (m, 3) [mm]."""
    start, stop = machine.body_index(target_body(observations)), machine.body_index(body)
    return carry(machine, observations.positions[rows], np.asarray(target_place(observations)), start, stop)


def _readings_of(campaign: Campaign, station: Station) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Targets, distances, beam labels and whether any set is relative, over all distance sets of a station."""
    machine, targets, distances, beams, relative = campaign.machine, [], [], [], False
    for number, observations in enumerate(campaign.sets):
        if observations.kind != "distance":
            continue
        rows = observations.labels["station"] == station.name
        is_relative = bool(observations.options.get("relative", True))
        relative = relative or is_relative
        targets.append(
            nominal_point(
                machine, observations.positions[rows], observations.tool[rows], machine.body_index(station.body)
            )
            if sees_tool(observations)
            else nominal_reflector(machine, observations, rows, station.body)
        )
        distances.append(observations.readings[rows, 0])
        segments = observations.labels["segment"][rows]
        beams.append(
            np.array([f"dead path {s}" if is_relative else f"length {number}" for s in segments], dtype=object)
        )
    if not targets:
        return np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=object), False
    return np.concatenate(targets), np.concatenate(distances), np.concatenate(beams), relative


def _locate(campaign: Campaign, station: Station) -> tuple[StationEstimate | None, dict[Any, float]]:
    """Trilateration of one station: its estimate, and start values of its dead paths by nuisance key."""
    targets, distances, beams, relative = _readings_of(campaign, station)
    if not len(targets):
        return None, {}
    labels, index = np.unique(beams.astype(str), return_inverse=True)
    estimate: StationEstimate | None = None
    try:
        approximate = None if station.known and station.frame != "machine" else station.position
        found = trilaterate(targets, distances, index, relative, start=approximate)
    except InputError as problem:
        if station.position is None:
            raise InputError(
                f"station {station.name}: no approximate position, and none can be found from its readings: {problem}"
            ) from problem
        ranges = np.linalg.norm(targets - np.asarray(station.position), axis=1)
        paths = [float(np.median((distances - ranges)[index == i])) for i in range(len(labels))]
    else:
        estimate = found
        by_label = dict(zip(np.asarray(found.segments).tolist(), found.dead_paths, strict=True)) if relative else {}
        paths = [float(by_label.get(i, 0.0)) for i in range(len(labels))]
    prefix = "dead path "
    starts = {
        ("dead path", station.name, label.removeprefix(prefix)): path
        for label, path in zip(labels.tolist(), paths, strict=True)
        if label.startswith(prefix)
    }
    return estimate, starts


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


def find_starts(campaign: Campaign) -> dict[Any, float]:
    """Start values by nuisance key for all stations of a campaign.

    Approximate positions only decide between mirror images. Raises `InputError` when a station without an approximate
    position has too few readings.
    """
    starts: dict[Any, float] = {}
    known = []
    for station in campaign.stations:
        estimate, paths = _locate(campaign, station)
        starts.update(paths)
        if estimate is None:
            continue
        if station.known and station.frame != "machine":
            known.append((station, np.asarray(estimate.position)))
        elif not station.known:
            starts.update({("station", station.name, c): float(estimate.position[i]) for i, c in enumerate("XYZ")})
    return {**starts, **_placement(known)}
