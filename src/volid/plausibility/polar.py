"""Slips of readings as range, azimuth and elevation: angles in radians or gon, zenith angles, ranges in metres.

The nominal targets of a station and its readings as points differ by a rigid motion and the machine's errors. Where they do not,
the readings are tried in other units; what fits ten times better is named.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import best_rigid_motion
from volid.model.kinematics import nominal_point
from volid.observations.point import cartesian

_GON = 0.9  # degrees
_FITS = 5e-3  # of the targets' extent: more than a machine's errors
_BETTER = 0.1


def _scaled(*factors: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda readings: readings * np.array(factors)


TRIALS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "azimuth and elevation seem to be in radians; expected degrees": _scaled(1.0, 180.0 / np.pi, 180.0 / np.pi),
    "azimuth and elevation seem to be in gon; expected degrees": _scaled(1.0, _GON, _GON),
    "range seems to be in metres; expected mm": _scaled(1e3, 1.0, 1.0),
    "elevation seems to be the zenith angle, counted from the z axis; expected the angle above the x, y plane, 90° minus it": (
        lambda readings: np.array([0.0, 0.0, 90.0]) + readings * np.array([1.0, 1.0, -1.0])
    ),
    "azimuth seems to count the other way; expected from x towards y": _scaled(1.0, -1.0, 1.0),
}


def check_polar(readings: ObservationSet, campaign: Campaign) -> None:
    """Raises `InputError` for ranges that are not positive, elevations beyond a right angle, and readings in other units."""
    ranges, elevation = readings.readings[:, 0], readings.readings[:, 2]
    if (ranges <= 0.0).any():
        i = int(np.argmax(ranges <= 0.0))
        raise InputError(f"{readings.where(i)}: range is {ranges[i]:g} mm; expected a distance > 0")
    before = _misfit(readings, campaign, readings.readings)
    if before > _FITS:
        after = {said: _misfit(readings, campaign, change(readings.readings)) for said, change in TRIALS.items()}
        said = min(after, key=lambda k: after[k])
        if after[said] < _BETTER * before:
            raise InputError(f"{readings.source or readings.name}, set '{readings.name}': {said}")
    if (np.abs(elevation) > 90.0).any():
        i = int(np.argmax(np.abs(elevation) > 90.0))
        raise InputError(
            f"{readings.where(i)}: elevation is {elevation[i]:g}°; expected -90 … 90, above the x, y plane"
        )


def _misfit(readings: ObservationSet, campaign: Campaign, values: np.ndarray) -> float:
    """Largest, over stations, RMS distance of readings from nominal targets after the best rigid motion, over their extent."""
    changed = ObservationSet(**{**readings.__dict__, "readings": values})
    points, worst = cartesian(changed), 0.0
    for name in np.unique(readings.labels["station"]):
        rows = np.flatnonzero(readings.labels["station"] == name)
        body = campaign.machine.body_index(campaign.station(str(name)).body)
        target = nominal_point(campaign.machine, readings.positions[rows], readings.tool[rows], body)
        left = best_rigid_motion(target, points[rows])(target) - points[rows]
        extent = target - target.mean(axis=0)
        worst = max(worst, float(np.sqrt(np.sum(left**2) / max(float(np.sum(extent**2)), 1e-300))))
    return worst
