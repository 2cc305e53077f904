"""`point`: coordinates of the target in the frame of a station (laser tracker, photogrammetry, measuring arm).

(x, y, z) = R(ω) · R0 · (target - station), everything in the frame of the body that the station stands on. R0 comes from the
readings themselves, by the rigid motion that best carries the nominal points onto them (Kabsch, Acta Cryst. A32 (1976) 922); ω
and the station's position are unknown. CONVENTIONS 6.

The same as range r [mm], azimuth az and elevation el [degrees], each with a u of its own (kind `polar`, in files a `point` set
with these columns): x = r cos el cos az, y = r cos el sin az, z = r sin el. The predicted azimuth is the one within half a turn
of the reading. Not modelled: errors of the instrument's own axes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import arctan2, in_rows, nearest_integer, sqrt
from volid.campaign import Campaign, ObservationSet, Station
from volid.exceptions import InputError
from volid.model.geometry import Vector, best_rigid_motion, rotate_small, subtract
from volid.model.kinematics import functional_point, nominal_point, transform
from volid.model.machine import Machine
from volid.observations.base import Group, Kind, NuisanceTable

SPREAD = 1e-3  # rad: a virtual station's orientation is drawn within
IN_DEGREES = 180.0 / np.pi
_FLAT = 1e-3  # second singular value of the points over the first: below, they lie on a line


class PointSettings(NamedTuple):
    """Static part: the body the station stands on, and the rotation R0 into its frame, row by row."""

    body: int
    rotation: tuple[float, ...]


def predict(
    machine: Machine, settings: PointSettings, q: Any, tool: Vector, errors: Any, slots: Any, constants: Any
) -> Any:
    """Predicted coordinates in the station's frame, shape (3, m) [mm]."""
    target = transform(machine, q, errors, functional_point(machine, q, tool, errors), start=0, stop=settings.body)
    arm = subtract(target, (slots[0], slots[1], slots[2]))
    r = settings.rotation
    turned = [r[3 * i] * arm[0] + r[3 * i + 1] * arm[1] + r[3 * i + 2] * arm[2] for i in range(3)]
    point = rotate_small((slots[3], slots[4], slots[5]), (turned[0], turned[1], turned[2]))
    return in_rows(point, np.shape(q[0]))


def predict_polar(
    machine: Machine, settings: PointSettings, q: Any, tool: Vector, errors: Any, slots: Any, constants: Any
) -> Any:
    """Predicted range [mm], azimuth and elevation [degrees], shape (3, m); `constants`: the azimuth read (0 in a plan)."""
    x, y, z = predict(machine, settings, q, tool, errors, slots, constants)
    flat = x * x + y * y
    azimuth = IN_DEGREES * arctan2(y, x)
    azimuth = azimuth - 360.0 * nearest_integer((azimuth - constants[0]) * (1.0 / 360.0))
    return in_rows([sqrt(flat + z * z), azimuth, IN_DEGREES * arctan2(z, sqrt(flat))], np.shape(q[0]))


def cartesian(observations: ObservationSet) -> np.ndarray:
    """Readings as coordinates in the station's frame, (m, 3) [mm]."""
    if observations.kind == POINT.name:
        return observations.readings
    r, azimuth, elevation = observations.readings.T
    azimuth, elevation = np.deg2rad(azimuth), np.deg2rad(elevation)
    flat = r * np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), r * np.sin(elevation)], axis=1)


def _pose(campaign: Campaign, station: Station) -> tuple[np.ndarray, np.ndarray]:
    """R0 (3, 3) and the station's position (3,) from all its readings; without readings (a plan) as the campaign says.

    Raises `InputError` for fewer than three points that do not lie on one line.
    """
    body = campaign.machine.body_index(station.body)
    given, seen = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for observations in campaign.sets:
        if observations.kind in (POINT.name, POLAR.name):
            rows = np.flatnonzero(observations.labels["station"] == station.name)
            given.append(nominal_point(campaign.machine, observations.positions[rows], observations.tool[rows], body))
            seen.append(cartesian(observations)[rows])
    nominal, read = np.concatenate(given), np.concatenate(seen)
    nominal, read = nominal[np.isfinite(read).all(axis=1)], read[np.isfinite(read).all(axis=1)]
    if not len(read):
        return np.eye(3), np.array(station.position or (0.0, 0.0, 0.0))
    spread = np.linalg.svd(nominal - nominal.mean(axis=0), compute_uv=False)
    if len(read) < 3 or spread[1] < _FLAT * max(spread[0], 1e-300):
        raise InputError(
            f"station '{station.name}': its {len(read)} points lie on one line; its orientation needs three that do not"
        )
    motion = best_rigid_motion(nominal, read)
    return motion.rotation, -motion.rotation.T @ motion.translation


def groups(observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
    """Rows of a set by station: its position, shared with other kinds, and its orientation."""
    result = []
    for name in dict.fromkeys(observations.labels["station"]):
        station = campaign.station(name)
        rotation, place = _pose(campaign, station)
        known = station.known and station.frame == "machine"
        start = np.array(station.position) if known else place
        slots = [
            table.index(("station", name, c), f"station {name} {c}", "mm", start[i], 0.0 if known else np.inf)
            for i, c in enumerate("XYZ")
        ]
        slots += [table.index(("pose", name, c), f"orientation {name} {c}", "rad", spread=SPREAD) for c in "ABC"]
        rows = np.flatnonzero(observations.labels["station"] == name)
        settings = PointSettings(campaign.machine.body_index(station.body), tuple(rotation.ravel().tolist()))
        constants = np.zeros((0, len(rows)))
        if observations.kind == POLAR.name:
            constants = np.nan_to_num(observations.readings[rows, 1])[None]
        result.append(Group(rows, settings, np.tile(np.array(slots)[:, None], len(rows)), constants))
    return result


POINT = Kind(
    name="point",
    readings=("x", "y", "z"),
    labels={"station": None},
    predict=predict,
    groups=groups,
    doc="target in the station's frame [mm]",
)

POLAR = Kind(
    name="polar",
    readings=("range", "azimuth", "elevation"),
    labels={"station": None},
    predict=predict_polar,
    groups=groups,
    doc="target in the station's frame: range [mm], azimuth and elevation [degrees]",
    units=("mm", "degrees", "degrees"),
    file_kind="point",
)
