"""`point`: coordinates of the target in the frame of a station (laser tracker, photogrammetry, measuring arm).

(x, y, z) = R(ω) · R0 · (target - station), everything in the frame of the body that the station stands on. R0 comes from the
readings themselves, by the rigid motion that best carries the nominal points onto them (Kabsch, Acta Cryst. A32 (1976) 922); ω
and the station's position are unknown. CONVENTIONS 6.

The coordinates may also be given as range r [mm], azimuth az and elevation el [degrees], each with its own u. This is the kind
`polar`; in files it is a `point` set with these columns. x = r cos el cos az, y = r cos el sin az, z = r sin el. The predicted
azimuth is the one within half a turn of the reading. Not modelled: errors of the instrument's own axes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import arctan2, in_rows, nearest_integer, sqrt
from volid.campaign import Campaign, ObservationSet, Station
from volid.exceptions import InputError
from volid.model.geometry import Vector, rotate_small, subtract
from volid.model.kinematics import functional_point, nominal_point, transform
from volid.model.machine import TOOL, Machine
from volid.observations.base import DEGREES, Group, Kind, NuisanceTable
from volid.observations.pose import best_pose, check_units
from volid.observations.response import TurnOf, as_rows
from volid.observations.stations import Seen, station_slots

SPREAD = 1e-3  # rad: a virtual station's orientation is drawn within
IN_DEGREES = 180.0 / np.pi
_GON = 0.9  # degrees
_INCH = 25.4  # mm


def _scaled(*factors: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda readings: readings * np.array(factors)


_UNITS = {  # of coordinates
    "coordinates seem to be in metres; expected mm": _scaled(1e3),
    "coordinates seem to be in micrometres; expected mm": _scaled(1e-3),
    "coordinates seem to be in inches; expected mm": _scaled(_INCH),
}
_POLAR_UNITS = {
    "azimuth and elevation seem to be in radians; expected degrees": _scaled(1.0, 180.0 / np.pi, 180.0 / np.pi),
    "azimuth and elevation seem to be in gon; expected degrees": _scaled(1.0, _GON, _GON),
    "range seems to be in metres; expected mm": _scaled(1e3, 1.0, 1.0),
    "range seems to be in micrometres; expected mm": _scaled(1e-3, 1.0, 1.0),
    "elevation seems to be the zenith angle, counted from the z axis; expected the angle above the x, y plane, 90° minus it": (
        lambda readings: np.array([0.0, 0.0, 90.0]) + readings * np.array([1.0, 1.0, -1.0])
    ),
    "azimuth seems to count the other way; expected from x towards y": _scaled(1.0, -1.0, 1.0),
}


class PointSettings(NamedTuple):
    """Static part: the body the station stands on, and the rotation R0 into its frame, row by row."""

    body: int
    rotation: tuple[float, ...]


class Point(Kind):
    """Cartesian coordinates in the station's frame."""

    name = "point"
    readings = ("x", "y", "z")
    doc = "target in the station's frame [mm]"
    labels: Mapping[str, str | None] = {"station": None}
    scopes: Mapping[str, tuple[str, ...]] = {"station": ("station",)}
    tested_by = ("station",)
    named_by = ("station",)

    @staticmethod
    def predict(
        machine: Machine, settings: PointSettings, q: Any, tool: Vector, errors: Any, slots: Any, constants: Any
    ) -> Any:
        """Predicted coordinates in the station's frame, shape (3, m) [mm]."""
        return in_rows(_coordinates(machine, settings, q, tool, errors, slots), np.shape(q[0]))

    def groups(self, observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
        """Rows of a set by station: its position, shared with other kinds, and its orientation."""
        return _groups(observations, campaign, table)

    def points_read(self, observations: ObservationSet) -> tuple[np.ndarray, np.ndarray]:
        """The readings themselves."""
        return observations.readings, np.eye(3) * observations.u[:, :, None] ** 2

    def check_values(self, observations: ObservationSet, campaign: Campaign) -> None:
        """Raises `InputError` for coordinates in metres, micrometres or inches."""
        check_units(observations, _nominal(observations, campaign), coordinates, _UNITS)


class Polar(Kind):
    """Range, azimuth and elevation."""

    name = "polar"
    readings = ("range", "azimuth", "elevation")
    doc = "target in the station's frame: range [mm], azimuth and elevation [degrees]"
    units = ("mm", DEGREES, DEGREES)
    file_kind = "point"
    labels: Mapping[str, str | None] = {"station": None}
    scopes: Mapping[str, tuple[str, ...]] = {"station": ("station",)}
    tested_by = ("station",)
    named_by = ("station",)

    @staticmethod
    def predict(
        machine: Machine, settings: PointSettings, q: Any, tool: Vector, errors: Any, slots: Any, constants: Any
    ) -> Any:
        """Predicted range [mm], azimuth and elevation [degrees], shape (3, m); `constants`: the azimuth read (0 in a plan)."""
        x, y, z = _coordinates(machine, settings, q, tool, errors, slots)
        flat = x * x + y * y
        azimuth = IN_DEGREES * arctan2(y, x)
        azimuth = azimuth - 360.0 * nearest_integer((azimuth - constants[0]) * (1.0 / 360.0))
        return in_rows([sqrt(flat + z * z), azimuth, IN_DEGREES * arctan2(z, sqrt(flat))], np.shape(q[0]))

    def groups(self, observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
        """As `Point.groups`, with the azimuths read as constants."""
        azimuth = np.nan_to_num(observations.readings[:, 1])
        return [group._replace(constants=azimuth[None, group.rows]) for group in _groups(observations, campaign, table)]

    def points_read(self, observations: ObservationSet) -> tuple[np.ndarray, np.ndarray]:
        """The readings as coordinates, to first order in their u."""
        r, azimuth, elevation = observations.readings.T * np.array([[1.0], [1.0 / IN_DEGREES], [1.0 / IN_DEGREES]])
        along = coordinates(observations) / r[:, None]
        zero = np.zeros_like(r)
        across = np.stack([-np.sin(azimuth), np.cos(azimuth), zero], axis=1) * (r * np.cos(elevation))[:, None]
        up = np.stack([-along[:, 2] * np.cos(azimuth), -along[:, 2] * np.sin(azimuth), np.cos(elevation)], axis=1)
        turned = (
            np.stack([along, across / IN_DEGREES, up * (r / IN_DEGREES)[:, None]], axis=2) * observations.u[:, None]
        )
        return coordinates(observations), turned @ turned.transpose(0, 2, 1)

    def check_values(self, observations: ObservationSet, campaign: Campaign) -> None:
        """Raises `InputError` for ranges that are not positive, elevations beyond a right angle, and readings in other units."""
        ranges, elevation = observations.readings[:, 0], observations.readings[:, 2]
        if (ranges <= 0.0).any():
            i = int(np.argmax(ranges <= 0.0))
            raise InputError(f"{observations.where(i)}: range is {ranges[i]:g} mm; expected a distance > 0")
        check_units(observations, _nominal(observations, campaign), coordinates, _POLAR_UNITS)
        if (np.abs(elevation) > 90.0).any():
            i = int(np.argmax(np.abs(elevation) > 90.0))
            raise InputError(
                f"{observations.where(i)}: elevation is {elevation[i]:g}°; expected -90 … 90, above the x, y plane"
            )


def _coordinates(
    machine: Machine, settings: PointSettings, q: Any, tool: Vector, errors: Any, slots: Any
) -> tuple[Any, Any, Any]:
    target = transform(machine, q, errors, functional_point(machine, q, tool, errors), start=0, stop=settings.body)
    arm = subtract(target, (slots[0], slots[1], slots[2]))
    r = settings.rotation
    turned = [r[3 * i] * arm[0] + r[3 * i + 1] * arm[1] + r[3 * i + 2] * arm[2] for i in range(3)]
    return rotate_small((slots[3], slots[4], slots[5]), (turned[0], turned[1], turned[2]))


def coordinates(observations: ObservationSet, readings: np.ndarray | None = None) -> np.ndarray:
    """Readings of either form (or others in their place) as coordinates in the station's frame, (m, 3) [mm]."""
    readings = observations.readings if readings is None else readings
    if observations.kind == Point.name:
        return readings
    r, azimuth, elevation = readings.T
    azimuth, elevation = np.deg2rad(azimuth), np.deg2rad(elevation)
    flat = r * np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), r * np.sin(elevation)], axis=1)


def _nominal(observations: ObservationSet, campaign: Campaign) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rows of every station of a set, and their nominal targets in the frame of its body."""
    result = []
    for name in np.unique(observations.labels["station"]):
        rows = np.flatnonzero(observations.labels["station"] == name)
        body = campaign.station(str(name)).body
        given = observations.positions[rows], observations.tool[rows]
        result.append((rows, nominal_point(campaign.machine, *given, campaign.machine.body_index(body))))
    return result


def _pose(campaign: Campaign, station: Station) -> tuple[np.ndarray, np.ndarray]:
    """R0 (3, 3) and the station's position (3,) from all its readings; without readings (a plan) as the campaign states them.

    Raises `InputError` for fewer than three points that do not lie on one line.
    """
    given, seen = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for observations in campaign.sets:
        if observations.kind in (Point.name, Polar.name):
            rows = np.flatnonzero(observations.labels["station"] == station.name)
            place = observations.positions[rows], observations.tool[rows]
            given.append(nominal_point(campaign.machine, *place, campaign.machine.body_index(station.body)))
            seen.append(coordinates(observations)[rows])
    nominal, read = np.concatenate(given), np.concatenate(seen)
    nominal, read = nominal[np.isfinite(read).all(axis=1)], read[np.isfinite(read).all(axis=1)]
    if not len(read):
        return np.eye(3), np.array(station.position or (0.0, 0.0, 0.0))
    return best_pose(nominal, read, f"station '{station.name}'")


def _groups(observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
    result = []
    for name in dict.fromkeys(observations.labels["station"]):
        station, rows = campaign.station(name), np.flatnonzero(observations.labels["station"] == name)
        rotation, place = _pose(campaign, station)
        known = station.known and station.frame == "machine"
        start = np.array(station.position) if known else place
        seen = Seen(observations, campaign, rows, station.body, TOOL)
        slots = station_slots(station, seen, table, tuple(start.tolist()), 0.0 if known else np.inf)
        slots += _orientation_slots(station, rotation, table)
        settings = PointSettings(campaign.machine.body_index(station.body), tuple(rotation.ravel().tolist()))
        columns = np.tile(np.array(slots)[:, None], len(rows))
        result.append(Group(rows, settings, columns, np.zeros((0, len(rows)))))
    return result


def _orientation_slots(station: Station, rotation: np.ndarray, table: NuisanceTable) -> list[int]:
    """Small rotation of a station besides R0: it turns with the body that the station stands on."""
    keys = tuple(("pose", station.name, c) for c in "ABC")
    frame = as_rows(rotation)
    return [
        table.index(
            keys[i],
            f"orientation {station.name} {c}",
            "rad",
            spread=SPREAD,
            response=TurnOf(station.body, of=keys, component=i, frame=frame),
        )
        for i, c in enumerate("ABC")
    ]


POINT = Point()
POLAR = Polar()
