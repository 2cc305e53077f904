"""Where a campaign was measured: stations and what stands on the workpiece, beams, measured points and the volume, in one frame.

Everything is nominal (without the machine's errors), in the frame of one body, which is the machine frame when all axes are at 0:
that of the body on which most readings' stations stand, otherwise of the body that carries the rotary axes of the workpiece, and
the workpiece itself where there are none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from volid.campaign import Campaign, ObservationSet, Station
from volid.fitting.solution import Solution
from volid.model.geometry import Vector, rotate_small
from volid.model.kinematics import transform
from volid.model.machine import BED, TOOL, WORKPIECE, Machine
from volid.observations import KINDS
from volid.observations.network import PLACEMENT
from volid.observations.stations import station_keys

DIGITS = 3  # decimal places of a point [mm] by which measured points are one


@dataclass(frozen=True, eq=False)
class Stand:
    """A station or something that stands on the workpiece: its `name`, its `place` (3,) and the `targets` (m, 3) it saw [mm].

    `estimated`: whether the place is the fit's; else it is stated, or nominal.
    """

    name: str
    place: np.ndarray
    targets: np.ndarray
    estimated: bool


@dataclass(frozen=True, eq=False)
class MeasuringGeometry:
    """What a figure of the measuring geometry shows.

    Args:
        body: Body in whose frame everything is: "workpiece", "bed" or the letter of an axis.
        stations: Where instruments stand that see the targets by beams, or a ball bar's socket.
        spheres: What stands at places of its own and is seen without a beam; no targets.
        points: Distinct functional points that were measured, shape (m, 3) [mm].
        corners: Corners of the travels of the linear axes with the most used tool, shape (8, 3) [mm], rotary axes at 0.
        left_out: Names of stations on other bodies, whose places in this frame move.
    """

    body: str
    stations: tuple[Stand, ...]
    spheres: tuple[Stand, ...]
    points: np.ndarray
    corners: np.ndarray
    left_out: tuple[str, ...]


def geometry_of(solution: Solution) -> MeasuringGeometry:
    """The measuring geometry of a solution.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
    >>> found = geometry_of(solution)
    >>> found.body, [s.name for s in found.stations], found.corners.min(axis=0).tolist()
    ('workpiece', ['S1', 'S2', 'S3', 'S4', 'S5', 'S6'], [0.0, 90.0, -700.0])
    """
    campaign = solution.campaign
    body = frame_of(campaign)
    stations = _stations(solution, body)
    named = {s.name for s in stations}
    return MeasuringGeometry(
        body,
        stations,
        spheres_of(campaign),
        points_of(campaign, body),
        _corners(solution, body),
        tuple(s.name for s in campaign.stations if s.name not in named),
    )


def frame_of(campaign: Campaign) -> str:
    """The body in whose frame the geometry is drawn."""
    count: dict[str, int] = {}
    for s in campaign.sets:
        for beam in KINDS[s.kind].beams(s, campaign):
            count[beam.station.body] = count.get(beam.station.body, 0) + len(beam.distances)
    if count:
        return max(count, key=lambda body: count[body])
    return _under_rotary(campaign.machine)


def _under_rotary(machine: Machine) -> str:
    """The body under the last rotary axis that turns the workpiece: what the tool does there does not turn."""
    turning = [i for i, axis in enumerate(machine.axes) if axis.primed and not axis.is_linear]
    if not turning:
        return WORKPIECE
    carrier = machine.axes[turning[-1] + 1] if turning[-1] + 1 < len(machine.axes) else None
    return carrier.letter if carrier is not None and carrier.primed else BED


def _stations(solution: Solution, body: str) -> tuple[Stand, ...]:
    campaign = solution.campaign
    targets: dict[str, list[np.ndarray]] = {}
    for s in campaign.sets:
        for beam in KINDS[s.kind].beams(s, campaign):
            targets.setdefault(beam.station.name, []).append(beam.targets)
        for name in dict.fromkeys(KINDS[s.kind].stations_of(s).tolist()):
            targets.setdefault(name, [])
    found = []
    for station in (s for s in campaign.stations if s.body == body and s.name in targets):
        seen = np.concatenate([np.zeros((0, 3)), *targets[station.name]])
        place, estimated = station_place(solution, station)
        if place is not None:
            found.append(Stand(station.name, place, seen, estimated))
    return tuple(found)


def station_place(solution: Solution, station: Station) -> tuple[np.ndarray | None, bool]:
    """Place of a station in the frame of its body (3,) [mm], and whether the fit estimated it; None where nothing is known."""
    values = {entry.key: float(v) for entry, v in zip(solution.nuisance_table, solution.nuisance, strict=True)}
    own = [values[key] for key in station_keys(station.name) if key in values]
    if len(own) == 3:
        return np.array(own), True
    if station.is_placed:
        return _placed(solution.campaign, station, values), True
    return (None if station.position is None else np.array(station.position, dtype=float)), False


def _placed(campaign: Campaign, station: Station, values: Mapping[Any, float]) -> np.ndarray | None:
    """A station of a network that is known in itself: carried by the network's placement as the fit found it."""
    starts: dict[Any, float] = {}
    for kind in dict.fromkeys(s.kind for s in campaign.sets):
        starts |= KINDS[kind].starts(campaign)
    keys = [("placed", station.name, c) for c in "XYZ"], [("placement", c) for c in PLACEMENT]
    if not all(key in known for key, known in ((keys[0][0], starts), (keys[1][0], values))):
        return None
    x, y, z = (starts[key] for key in keys[0])
    moved = [values[key] for key in keys[1]]
    turned = rotate_small((moved[3], moved[4], moved[5]), (x, y, z))
    return np.asarray(turned, dtype=float) + moved[:3]


def spheres_of(campaign: Campaign) -> tuple[Stand, ...]:
    """What stands on the workpiece at a place of its own, where it is when all axes are at 0."""
    found: dict[str, np.ndarray] = {}
    for s in campaign.sets:
        for name, place in KINDS[s.kind].standing_at(s).items():
            found.setdefault(name, np.asarray(place, dtype=float))
    return tuple(Stand(name, place, np.zeros((0, 3)), False) for name, place in found.items())


def points_of(campaign: Campaign, body: str) -> np.ndarray:
    """Distinct measured functional points in the frame of a body."""
    parts = [_seen(campaign.machine, s, body) for s in campaign.sets if KINDS[s.kind].sees_tool(s)]
    points = np.concatenate([np.zeros((0, 3)), *parts])
    return np.unique(np.round(points, DIGITS), axis=0) if len(points) else points


def _seen(machine: Machine, readings: ObservationSet, body: str) -> np.ndarray:
    ends = readings.all_ends
    return _carried(machine, ends.positions, ends.tool, body)


def _carried(machine: Machine, positions: np.ndarray, tool: np.ndarray, body: str) -> np.ndarray:
    """Functional points (m, 3) nominally, in the frame of a body."""
    x, y, z = np.broadcast_to(tool, (len(positions), 3)).T
    vector: Vector = (x, y, z)
    found = transform(machine, positions.T, None, vector, start=machine.body_index(TOOL), stop=machine.body_index(body))
    return np.stack([np.broadcast_to(np.asarray(c), len(positions)) for c in found], axis=1)


def _corners(solution: Solution, body: str) -> np.ndarray:
    """Corners of the travels of the linear axes, rotary axes at 0 (at the middle of their travel where that is outside)."""
    axes = solution.campaign.machine.axes
    choices = [a.travel if a.is_linear else (min(max(0.0, a.travel[0]), a.travel[1]),) for a in axes]
    positions = np.stack([m.ravel() for m in np.meshgrid(*choices, indexing="ij")], axis=1).astype(float)
    return _carried(solution.campaign.machine, positions, np.asarray(solution.most_used_tool()), body)
