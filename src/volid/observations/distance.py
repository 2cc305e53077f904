"""`distance`: station to target, plus a dead path (tracking interferometer, laser tracker, double ball bar).

d = |target - station| + dead path, with one dead path per station and segment when `relative`, none or a calibrated
length's deviation (prior `calibrated_u`) when not. Stations known in their common frame share six placement parameters.

The target is the functional point, or with `target_body` a reflector on any other body of the machine. `target` [mm] is then its
place in that body's frame, which is the machine frame when all axes are at 0. The place is approximate when `target_u` is inf
(default) and exact when it is 0; sets that describe a target alike share it. Such distances depend on the errors between the two
bodies only. CONVENTIONS 6; ISO/TR 16907 8.3.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, ObservationSet, Station
from volid.exceptions import InputError
from volid.model.geometry import Vector, add, norm, rotate_small, subtract, three_numbers
from volid.model.kinematics import functional_point, transform
from volid.model.machine import TOOL, Machine
from volid.observations.base import ARTEFACT, EITHER, LIGHT, Group, Kind, NuisanceTable, Place
from volid.observations.beams import Beam
from volid.observations.network import find_stations, placement_slots
from volid.observations.response import PlaceOf
from volid.observations.stations import Seen, station_slots


class DistanceSettings(NamedTuple):
    """Static part: the body the station stands on, whether its network is placed, whether there is a length offset, and the
    body of the target; None for the functional point."""

    body: int
    placed: bool
    offset: bool
    target: int | None = None


DEAD_PATH_SPREAD = 300.0  # mm, of what a virtual instrument draws


class Distance(Kind):
    """Lengths from a station, as the docstring of the module describes them."""

    name = "distance"
    readings = ("distance",)
    doc = "|target - station| + dead path [mm]"
    labels: Mapping[str, str | None] = {"station": None, "segment": "1"}
    options: Mapping[str, Any] = {"relative": True, "calibrated_u": 0.0}
    optional: Mapping[str, Any] = {"target_body": TOOL, "target": [], "target_u": np.inf}
    scopes: Mapping[str, tuple[str, ...]] = {"station": ("station",), "segment": ("station", "segment")}
    tested_by = ("station",)
    named_by = ("station",)

    @staticmethod
    def predict(
        machine: Machine,
        settings: DistanceSettings,
        q: Any,
        tool: Vector,
        errors: Any,
        slots: Any,
        constants: Any,
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

    def groups(self, observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
        """Rows of a set by station body and placement, with their nuisance parameters."""
        found: dict[DistanceSettings, list[_Rows]] = {}
        names, segments = observations.labels["station"], observations.labels["segment"]
        for name in dict.fromkeys(names):
            station = campaign.station(name)
            settings = _settings(observations, station, campaign.machine)
            of_station = names == name
            base = _place_slots(observations, campaign, station, np.flatnonzero(of_station), table)
            base += _target_slots(observations, table)
            given = station.position or (0.0,) * 3
            fixed = [table.starts.get(("placed", name, c), given[i]) for i, c in enumerate("XYZ")]
            for segment in dict.fromkeys(segments[of_station]) if settings.offset else [None]:
                rows = np.flatnonzero(of_station if segment is None else of_station & (segments == segment))
                slots = base if segment is None else [*base, _offset_slot(observations, station, segment, table)]
                found.setdefault(settings, []).append(_Rows(rows, slots, fixed if settings.placed else []))
        return [_group(settings, parts) for settings, parts in found.items()]

    def starts(self, campaign: Campaign) -> dict[Any, float]:
        """Stations and dead paths, each station trilaterated against the nominal targets of all its sets."""
        sets = [s for s in campaign.sets if s.kind == self.name]
        beams = [beam for s in sets for beam in self.beams(s, campaign)]
        return find_stations(campaign, beams)

    def target_body(self, options: Mapping[str, Any]) -> str:
        """The functional point unless the set says otherwise."""
        return str(options.get("target_body", TOOL))

    def beams(
        self, observations: ObservationSet, campaign: Campaign, positions: np.ndarray | None = None
    ) -> Iterator[Beam]:
        """Readings station by station, with the nominal targets."""
        machine, body = campaign.machine, self.target_body(observations.options)
        positions = observations.positions if positions is None else positions
        relative = bool(observations.options.get("relative", True))
        for name in np.unique(observations.labels["station"]).tolist():
            rows = np.flatnonzero(observations.labels["station"] == name)
            station = campaign.station(name)
            tool = observations.tool[rows].T
            place = (tool[0], tool[1], tool[2]) if body == TOOL else target_place(observations)
            ends = machine.body_index(body), machine.body_index(station.body)
            target = transform(machine, positions[rows].T, None, place, start=ends[0], stop=ends[1])
            points = np.stack([np.broadcast_to(np.asarray(c), len(rows)) for c in target], axis=1)
            names, segments = np.unique(observations.labels["segment"][rows], return_inverse=True)
            lengths = observations.readings[rows, 0]
            yield Beam(points, lengths, np.ravel(segments), relative, station, tuple(names.tolist()), rows)

    def check(self, observations: ObservationSet) -> None:
        """Raises `InputError` for a target without place, or a place of the target where it is the functional point."""
        if self.target_body(observations.options) != TOOL:
            target_place(observations)
        elif observations.options.get("target"):
            raise InputError(
                f"set '{observations.name}': target is for a reflector on another body; add target_body (bed, workpiece or an "
                "axis letter), or state the functional point by tool = [x, y, z]"
            )

    def lengths_of(self, observations: ObservationSet) -> str:
        """Paths in light where an interferometer counts, a bar where the length is calibrated; absolute ones may be either."""
        if observations.options.get("relative", True):
            return LIGHT
        return ARTEFACT if observations.options.get("calibrated_u", 0.0) > 0.0 else EITHER

    def dead_paths(self, observations: ObservationSet, starts: Mapping[Any, float]) -> np.ndarray:
        """Start values of the dead paths of relative distances, (m, 1) [mm]."""
        if not observations.options.get("relative", True):
            return super().dead_paths(observations, starts)
        beams = zip(observations.labels["station"], observations.labels["segment"], strict=True)
        return np.array([[starts.get(("dead path", str(s), str(g)), 0.0)] for s, g in beams])

    def runs_by(self, observations: ObservationSet) -> tuple[str, ...]:
        """A segment of a station has one dead path, unless distances are absolute."""
        return ("station", "segment") if observations.options.get("relative", True) else ()

    def advice(self, sets: Sequence[ObservationSet], campaign: Campaign) -> list[str]:
        """How many stations there are, and on what line the tool vectors lie."""
        sets = [s for s in sets if self.sees_tool(s)]
        if not sets:
            return []
        reasons = []
        stations = {name for s in sets for name in s.labels["station"]}
        if len(stations) < 3:
            named = "one station" if len(stations) == 1 else "two stations"
            reasons.append(f"distances from {named} only; at least three are needed")
        return reasons + _tool_advice(np.unique(np.round(np.concatenate([s.tool for s in sets]), 3), axis=0))


def _tool_advice(tools: np.ndarray) -> list[str]:
    if len(tools) == 1:
        single = ", ".join(f"{x:g}" for x in tools[0])
        return [f"a single tool vector ({single}) mm was used; use three that do not lie on one line"]
    if np.linalg.matrix_rank(tools - tools[0], tol=1.0) != 1:
        return []
    if np.ptp(tools[:, :2], axis=0).max() < 1.0:
        return ["every tool vector lies on the spindle axis; add one with a lateral offset"]
    said = "both" if len(tools) == 2 else f"all {len(tools)}"
    return [f"{said} tool vectors lie on one line; add one that does not lie on it"]


def _settings(observations: ObservationSet, station: Station, machine: Machine) -> DistanceSettings:
    offset = bool(observations.options.get("relative", True)) or observations.options.get("calibrated_u", 0.0) > 0.0
    body = DISTANCE.target_body(observations.options)
    target = None if body == TOOL else machine.body_index(body)
    return DistanceSettings(machine.body_index(station.body), station.is_placed, offset, target)


def target_place(observations: ObservationSet) -> Place:
    """Place of a target that is not the functional point, in its body's frame [mm]. Raises `InputError` when there is none."""
    place = three_numbers(observations.options.get("target") or ())
    if place is None:
        raise InputError(
            f"set '{observations.name}': target_body = '{DISTANCE.target_body(observations.options)}', but target is "
            f"{observations.options.get('target') or 'missing'}; expected target = [x, y, z] in mm, in that body's frame"
        )
    return place


def _target_slots(observations: ObservationSet, table: NuisanceTable) -> list[int]:
    """Place of a target that is not the functional point: it moves with its body."""
    body = DISTANCE.target_body(observations.options)
    if body == TOOL:
        return []
    place, prior = target_place(observations), float(observations.options.get("target_u", np.inf))
    name = f"target on {body} ({', '.join(f'{c:.12g}' for c in place)})"
    keys = tuple(("target", body, *(repr(c) for c in place), axis) for axis in "XYZ")
    return [
        table.index(keys[i], f"{name} {c}", start=place[i], prior_u=prior, response=PlaceOf(body, of=keys, component=i))
        for i, c in enumerate("XYZ")
    ]


def _place_slots(
    observations: ObservationSet, campaign: Campaign, station: Station, rows: np.ndarray, table: NuisanceTable
) -> list[int]:
    """Where a station stands: three coordinates, or the six of the frame that all known stations share."""
    seen = Seen(observations, campaign, rows, station.body, DISTANCE.target_body(observations.options))
    if not station.is_placed:
        prior = 0.0 if station.known else np.inf
        return station_slots(station, seen, table, station.position or (0.0, 0.0, 0.0), prior)
    return placement_slots(campaign, seen, table)


def _offset_slot(observations: ObservationSet, station: Station, segment: str, table: NuisanceTable) -> int:
    if observations.options.get("relative", True):
        name = f"dead path {station.name} segment {segment}"
        return table.index(("dead path", str(station.name), str(segment)), name, spread=DEAD_PATH_SPREAD)
    prior = float(observations.options["calibrated_u"])
    return table.index(("length", observations.name), f"length {observations.name}", prior_u=prior)


class _Rows(NamedTuple):
    """Row numbers, the slots of all of them, and the constants of all of them."""

    rows: np.ndarray
    slots: list[int]
    constants: list[float]


def _group(settings: DistanceSettings, parts: list[_Rows]) -> Group:
    rows = np.concatenate([p.rows for p in parts])
    order = np.argsort(rows, kind="stable")
    slots = np.concatenate([np.tile(np.array(p.slots)[:, None], len(p.rows)) for p in parts], axis=1)
    constants = np.concatenate([np.tile(np.array(p.constants).reshape(-1, 1), len(p.rows)) for p in parts], axis=1)
    return Group(rows[order], settings, slots[:, order], constants[:, order])


DISTANCE = Distance()
