"""`distance`: station to target, plus a dead path (tracking interferometer, laser tracker, double ball bar).

d = |target - station| + dead path, with one dead path per station and segment when `relative`, none or a calibrated
length's deviation (prior `calibrated_u`) when not. Stations known in their common frame share six placement parameters.

The target is the functional point, or with `target_body` a reflector on any other body of the machine: `target` [mm], its place
in that body's frame (all axes at 0: the machine frame), approximate when `target_u` is inf (default), exact when 0; sets that
say the same of a target share it. Such distances see what lies between the two bodies. CONVENTIONS 6; ISO/TR 16907 8.3.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, ObservationSet, Station
from volid.exceptions import InputError
from volid.model.geometry import Vector, add, norm, rotate_small, subtract
from volid.model.kinematics import functional_point, transform
from volid.model.machine import TOOL, Machine
from volid.observations.base import Group, Kind, NuisanceTable


class DistanceSettings(NamedTuple):
    """Static part: the body the station stands on, whether its network is placed, whether there is a length offset, and the
    body of the target; None for the functional point."""

    body: int
    placed: bool
    offset: bool
    target: int | None = None


PLACEMENT = ("X", "Y", "Z", "A", "B", "C")
# What a virtual instrument draws: dead paths [mm], and how far the stations' common frame lies from the machine's
DEAD_PATH_SPREAD = 300.0
PLACEMENT_SPREAD = {"mm": 5.0, "rad": 1e-3}


def predict(
    machine: Machine, settings: DistanceSettings, q: Any, tool: Vector, errors: Any, slots: Any, constants: Any
) -> Any:
    """Predicted distances, shape (1, m) [mm]."""
    used = 6 if settings.placed else 3
    if settings.placed:
        # station = t + R(ω) s, with ω a correction to the placement that `s` already holds
        station = add(rotate_small((slots[3], slots[4], slots[5]), tuple(constants[:3])), tuple(slots[:3]))
    else:
        station = (slots[0], slots[1], slots[2])
    if settings.target is None:
        station = transform(machine, q, errors, station, start=settings.body)
        distance = norm(subtract(functional_point(machine, q, tool, errors), station))
    else:  # in the frame of the target's body, through the axes between the two alone
        station = transform(machine, q, errors, station, start=settings.body, stop=settings.target)
        distance = norm(subtract((slots[used], slots[used + 1], slots[used + 2]), station))
        used += 3
    if settings.offset:
        distance = distance + slots[used]
    return in_rows([distance], np.shape(q[0]))


def _settings(observations: ObservationSet, station: Station, machine: Machine) -> DistanceSettings:
    offset = bool(observations.options.get("relative", True)) or observations.options.get("calibrated_u", 0.0) > 0.0
    placed = station.known and station.frame != "machine"
    body = target_body(observations)
    target = None if body == TOOL else machine.body_index(body)
    return DistanceSettings(machine.body_index(station.body), placed, offset, target)


def target_body(observations: ObservationSet) -> str:
    """The body that carries the target of a set: "tool" (the functional point) unless the set says otherwise."""
    return str(observations.options.get("target_body", TOOL))


def sees_tool(observations: ObservationSet) -> bool:
    """True unless a set measures to a reflector on another body than the tool."""
    return observations.sees_tool


def target_place(observations: ObservationSet) -> tuple[float, float, float]:
    """Place of a target that is not the functional point, in its body's frame [mm]. Raises `InputError` when there is none."""
    try:
        x, y, z = (float(c) for c in observations.options.get("target") or ())
    except (TypeError, ValueError):
        x = y = z = np.nan
    if not np.all(np.isfinite([x, y, z])):
        raise InputError(
            f"set '{observations.name}': target_body = '{target_body(observations)}', but target is "
            f"{observations.options.get('target') or 'missing'}; expected target = [x, y, z] in mm, in that body's frame"
        )
    return x, y, z


def check(observations: ObservationSet) -> None:
    """Raises `InputError` for a target without place, or a place of the target where it is the functional point."""
    if target_body(observations) != TOOL:
        target_place(observations)
    elif observations.options.get("target"):
        raise InputError(
            f"set '{observations.name}': target is for a reflector on another body; add target_body (bed, workpiece or an axis "
            "letter), or state the functional point by tool = [x, y, z]"
        )


def _target_slots(observations: ObservationSet, table: NuisanceTable) -> list[int]:
    body = target_body(observations)
    if body == TOOL:
        return []
    place, prior = target_place(observations), float(observations.options.get("target_u", np.inf))
    name = f"target on {body} ({', '.join(f'{c:g}' for c in place)})"
    return [table.index((name, c), f"{name} {c}", "mm", place[i], prior) for i, c in enumerate("XYZ")]


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
        base = _station_slots(station, settings.placed, table) + _target_slots(observations, table)
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
    optional={"target_body": TOOL, "target": [], "target_u": np.inf},
    predict=predict,
    groups=groups,
    check=check,
    doc="|target - station| + dead path [mm]",
)
