"""Points of the functional point as they were measured, without any model of the machine's errors (ISO/TR 16907 9.3.1).

Coordinates in a station's frame are carried into the workpiece frame by the rigid motion that best carries all of the station's
points onto the nominal ones. Distances from at least four stations to the same places give points by multilateration: a free
network, whose frame is placed in the same way. The deviation is actual less nominal, in the machine frame. What such a placement
takes out is no error that these readings can show; `frame_columns` says what remains unknown of it, station by station.

Not modelled: errors that all readings of an instrument share (scale, refraction); approach directions, of which the mean is
taken.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from volid.campaign import SAME_TOOL, Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import best_rigid_motion
from volid.model.jacobian import rigid_motion_rows
from volid.model.kinematics import nominal_point, side_rotation
from volid.model.machine import WORKPIECE, Machine
from volid.multilateration import adjust_network
from volid.observations import KINDS
from volid.observations.beams import Beam
from volid.observations.pose import best_pose
from volid.plausibility.repeats import SAME_POSITION, combine

if TYPE_CHECKING:
    from jaxtyping import Float, Int

STATIONS = 4  # that locate a place by distances, with unknown dead paths
MOST = 1500  # places, of which 3 coordinates each are one system of equations
_NETWORK = "the network of distances"


@dataclass(frozen=True, eq=False)
class MeasuredPoints:
    """Deviations of the functional point at m measured places, machine frame, nothing assumed of where they come from.

    Args:
        machine: The machine, whose nominal chain the deviations refer to.
        positions: Commanded positions, shape (m, n_axes) [mm or degrees].
        tool: Tool vectors, shape (m, 3) [mm].
        deviation: Actual less nominal after the best rigid placement of every station, shape (m, 3) [mm].
        covariance: Of what was read, X of all places first, then Y, then Z, shape (3m, 3m) [mm²].
        station: Number of the station that saw a place, shape (m,).
        stations: Names of the stations.
    """

    machine: Machine
    positions: Float[np.ndarray, "m axes"]
    tool: Float[np.ndarray, "m 3"]
    deviation: Float[np.ndarray, "m 3"]
    covariance: Float[np.ndarray, "m3 m3"]
    station: Int[np.ndarray, " m"]
    stations: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def values(self) -> np.ndarray:
        """Deviations, X of all places first, (3m,) [mm]."""
        return self.deviation.T.ravel()

    @property
    def tools(self) -> np.ndarray:
        """The distinct tool vectors, (t, 3) [mm], that of most places first."""
        found, counts = np.unique(np.round(self.tool, SAME_TOOL), axis=0, return_counts=True)
        return found[np.argsort(-counts, kind="stable")]

    def with_tool(self, tool: np.ndarray) -> np.ndarray:
        """Numbers of the places measured with a tool vector (3,) [mm]."""
        return np.flatnonzero(np.abs(self.tool - tool).max(axis=1) < 10.0**-SAME_TOOL)

    def motion_rows(self) -> np.ndarray:
        """What a rigid motion (t, ω) of the workpiece frame does to the deviations, X first, (3m, 6)."""
        rows = rigid_motion_rows(self.machine, self.positions, self.tool)[:, :3]
        return np.asarray(rows.transpose(1, 0, 2).reshape(-1, 6))

    def frame_columns(self, stations: range) -> np.ndarray:
        """Rigid motions of some stations as columns of size 1 mm at the farthest place, (3m, 6 · stations)."""
        rows = self.motion_rows()
        rows = rows / np.maximum(np.abs(rows).max(axis=0), 1e-9)
        own = np.tile(self.station, 3)
        return np.hstack([np.zeros((len(rows), 0)), *(rows * (own == s)[:, None] for s in stations)])

    def of(self, numbers: np.ndarray) -> MeasuredPoints:
        """Some of the places."""
        three = np.concatenate([numbers + k * len(self) for k in range(3)])
        return MeasuredPoints(
            self.machine, self.positions[numbers], self.tool[numbers], self.deviation[numbers],
            self.covariance[np.ix_(three, three)], self.station[numbers], self.stations,
        )  # fmt: skip


class _Read(NamedTuple):
    """Places that one station read: positions, tool, coordinates in its frame (m, 3), and their covariance, X first (3m, 3m)."""

    station: str
    positions: np.ndarray
    tool: np.ndarray
    coordinates: np.ndarray
    covariance: np.ndarray


def measured_points(campaign: Campaign) -> MeasuredPoints:
    """The places of a campaign whose coordinates were measured: by a tracker, or by distances from four stations and more.

    Args:
        campaign: A campaign with sets of kind `point` (also polar), or `distance`.

    Raises:
        InputError: nothing gives coordinates; rotary axes move; a station does not stand on the workpiece; there are fewer than
            three places that do not lie on one line; more places than one system of equations holds.

    Source: ISO/TR 16907:2015 9.3.1.
    """
    found = [*_stations_read(campaign), *_multilaterated(campaign)]
    if not found:
        raise InputError(
            f"{campaign.source or 'campaign'}: nothing gives coordinates without a model of the machine; expected sets of kind "
            f"'point', or 'distance' from at least {STATIONS} stations to the same places with the same tool vectors"
        )
    _check_rotary(campaign, found)
    if sum(len(r.tool) for r in found) > MOST:
        raise InputError(
            f"{campaign.source or 'campaign'}: {sum(len(r.tool) for r in found)} measured places; a field takes at most {MOST}. "
            "Leave out sets or rows"
        )
    placed = [_placed(campaign.machine, r) for r in found]
    counts = [len(r.tool) for r in found]
    return MeasuredPoints(
        campaign.machine,
        np.concatenate([r.positions for r in found]),
        np.concatenate([r.tool for r in found]),
        np.concatenate([deviation for deviation, _ in placed]),
        _joined([covariance for _, covariance in placed], counts),
        np.repeat(np.arange(len(found)), counts),
        tuple(r.station for r in found),
    )


def _joined(parts: list[np.ndarray], counts: list[int]) -> np.ndarray:
    """Covariances of several stations as one, X of all places first."""
    together = block_diag(*parts)
    starts = np.concatenate([[0], np.cumsum([3 * n for n in counts])])
    order = [starts[i] + k * n + np.arange(n) for k in range(3) for i, n in enumerate(counts)]
    numbers = np.concatenate(order)
    return np.asarray(together[np.ix_(numbers, numbers)])


def _check_rotary(campaign: Campaign, found: list[_Read]) -> None:
    positions = np.concatenate([r.positions for r in found])
    for i, axis in enumerate(campaign.machine.axes):
        if not axis.is_linear and np.ptp(positions[:, i]) > SAME_POSITION[False]:
            raise InputError(
                f"{campaign.source or 'campaign'}: {axis.letter} moves between the measured places; a field is over the linear "
                "axes, with the rotary ones at rest: leave the other rows out"
            )


def _check_body(campaign: Campaign, name: str) -> None:
    """Raises `InputError` where a station does not see the tool from the workpiece."""
    body = campaign.station(name).body
    if body != WORKPIECE and not (body == "bed" and not any(a.primed for a in campaign.machine.axes)):
        raise InputError(
            f"station '{name}' stands on {body}; a field needs points as the workpiece sees them, body = \"{WORKPIECE}\""
        )


# ---------------------------------------------------------------------------------------------------- coordinates as read


def _stations_read(campaign: Campaign) -> Iterator[_Read]:
    """Places by station, readings at one place averaged."""
    for station in campaign.stations:
        parts = []
        for s in campaign.sets:
            read = KINDS[s.kind].points_read(s)
            if read is not None:
                rows = np.flatnonzero((s.labels["station"] == station.name) & np.isfinite(read[0]).all(axis=1))
                parts.append((s.positions[rows], s.tool[rows], read[0][rows], read[1][rows]))
        if parts and sum(len(p[0]) for p in parts):
            _check_body(campaign, station.name)
            yield _averaged(campaign.machine, station.name, *map(np.concatenate, zip(*parts, strict=True)))


def _averaged(
    machine: Machine, station: str, positions: np.ndarray, tool: np.ndarray, read: np.ndarray, covariance: np.ndarray
) -> _Read:
    number = _places(machine, positions, tool)
    first = np.unique(number, return_index=True)[1]
    counts = np.bincount(number)
    mean = np.stack([np.bincount(number, c) for c in read.T], axis=1) / counts[:, None]
    spread = np.zeros((len(counts), 3, 3))
    np.add.at(spread, number, covariance)
    spread /= (counts**2)[:, None, None]
    full = np.block([[np.diag(spread[:, i, j]) for j in range(3)] for i in range(3)])
    return _Read(station, positions[first], tool[first], mean, full)


def _places(machine: Machine, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Number of the place of every row, whatever the approach, (m,)."""
    steps = np.array([SAME_POSITION[a.is_linear] for a in machine.axes])
    return combine([*np.round(positions / steps).T, *np.round(tool, SAME_TOOL).T])


# -------------------------------------------------------------------------------------------------------- multilateration


def _multilaterated(campaign: Campaign) -> Iterator[_Read]:
    """Places that at least four stations measured a distance to, all in the frame of one network."""
    beams = [(s, b) for s in campaign.sets if KINDS[s.kind].sees_tool(s) for b in KINDS[s.kind].beams(s, campaign)]
    if not beams:
        return
    rows = [b.rows if b.rows is not None else np.arange(len(b.distances)) for _, b in beams]
    positions, tool = (
        np.concatenate([getattr(s, n)[r] for (s, _), r in zip(beams, rows, strict=True)]) for n in ("positions", "tool")
    )
    place = _places(campaign.machine, positions, tool)
    name = np.concatenate([[b.station.name] * len(r) for (_, b), r in zip(beams, rows, strict=True)])
    pairs = np.unique(np.stack([place, np.unique(name, return_inverse=True)[1]]), axis=1)
    enough = np.bincount(pairs[0]) >= STATIONS
    kept = np.flatnonzero(enough[place])
    if not len(kept) or int(enough.sum()) < STATIONS:
        return
    for station in np.unique(name[kept]):
        _check_body(campaign, str(station))
    nominal = nominal_point(campaign.machine, positions, tool)
    yield _network(_Ranges.of(beams, rows, nominal), place, kept, positions, tool)


class _Ranges(NamedTuple):
    """Distances (m,), their u, the station's name, the name of the beam or None, and the nominal places (m, 3)."""

    distance: np.ndarray
    u: np.ndarray
    station: list[str]
    beam: list[tuple[str, str, str] | None]
    nominal: np.ndarray
    start: dict[str, tuple[float, float, float]]

    @classmethod
    def of(cls, beams: list[tuple[ObservationSet, Beam]], rows: list[np.ndarray], nominal: np.ndarray) -> _Ranges:
        names = [b.station.name for (_, b), r in zip(beams, rows, strict=True) for _ in r]
        segments = [
            ("segment", b.station.name, str(b.names[i])) if b.relative else None
            for (_, b) in beams
            for i in b.segments.tolist()
        ]
        distance = np.concatenate([b.distances for _, b in beams])
        u = np.concatenate([s.u[r, 0] for (s, _), r in zip(beams, rows, strict=True)])
        given = {b.station.name: b.station.position for _, b in beams if b.station.position is not None}
        return cls(distance, u, names, segments, nominal, given)


def _network(ranges: _Ranges, place: np.ndarray, kept: np.ndarray, positions: np.ndarray, tool: np.ndarray) -> _Read:
    from volid.multilateration.trilateration import trilaterate

    stations = list(dict.fromkeys(ranges.station[i] for i in kept))
    approximate: dict[str, np.ndarray] = {}
    for name in stations:
        own = np.array([i for i in kept if ranges.station[i] == name])
        codes = {b: k for k, b in enumerate(dict.fromkeys(ranges.beam[i] for i in own))}
        segments = np.array([codes[ranges.beam[i]] for i in own])
        found = trilaterate(
            ranges.nominal[own], ranges.distance[own], segments, ranges.beam[own[0]] is not None,
            start=ranges.start.get(name),
        )  # fmt: skip
        approximate[f"station {name}"] = np.asarray(found.position)
    numbers, first = np.unique(place[kept], return_index=True)
    targets = {n: f"place {n}" for n in numbers.tolist()}
    approximate |= {targets[n]: ranges.nominal[kept[f]] for n, f in zip(numbers.tolist(), first.tolist(), strict=True)}
    observations = [(f"station {ranges.station[i]}", targets[int(place[i])], float(ranges.distance[i])) for i in kept]
    points = [*(f"station {s}" for s in stations), *targets.values()]
    solution = adjust_network(
        points, (), observations, ranges.u[kept], approximate, groups=[ranges.beam[i] for i in kept]
    )  # fmt: skip
    lost = sorted(set(solution.undetermined) & set(targets.values()))
    if lost:
        raise InputError(
            f"the distances leave {len(lost)} places undetermined, because their stations lie in one plane with them, or too few "
            "see them; measure from further stations, or leave these rows out"
        )
    k, m = 3 * len(stations), len(numbers)
    order = k + np.concatenate([3 * np.arange(m) + c for c in range(3)])
    covariance = solution.covariance[np.ix_(order, order)]
    at = kept[first]
    return _Read(_NETWORK, positions[at], tool[at], solution.coordinates[len(stations) :], covariance)


# ------------------------------------------------------------------------------------------------------------- placement


def _placed(machine: Machine, read: _Read) -> tuple[np.ndarray, np.ndarray]:
    """Deviations (m, 3) in the machine frame after the best rigid placement, and their covariance, X first (3m, 3m)."""
    nominal = nominal_point(machine, read.positions, read.tool)
    best_pose(nominal, read.coordinates, f"the {len(nominal)} places of {read.station}")  # refuses a line
    motion = best_rigid_motion(read.coordinates, nominal)
    back = side_rotation(machine, read.positions[:1], True)[0].T
    deviation = (motion(read.coordinates) - nominal) @ back.T
    turn = np.kron(back @ motion.rotation, np.eye(len(nominal)))
    return deviation, turn @ read.covariance @ turn.T
