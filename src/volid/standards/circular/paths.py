"""Mean paths of both senses, and what lies between them: the circular hysteresis."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.standards.circular.readings import CircularReadings

_K = 2.0


class MeanPath(NamedTuple):
    """Mean of all runs of a sense: `angle` (k,) [degrees], growing, from the middle of the arc; `deviation` (k,) [mm];
    `u` (k,) [mm] of it, NaN where none is known."""

    angle: np.ndarray
    deviation: np.ndarray
    u: np.ndarray


def mean_path(test: CircularReadings, of_all: np.ndarray, sense: int) -> MeanPath:
    """The mean path of a sense."""
    rows = np.flatnonzero(test.sense == sense)
    angle = np.round(relative_angle(test)[rows], 4)
    angles, number, count = np.unique(angle, return_inverse=True, return_counts=True)
    number = number.ravel()
    mean = np.bincount(number, weights=of_all[rows]) / count
    u = np.full(len(test), np.nan) if test.u is None else test.u
    u = np.sqrt(np.bincount(number, weights=u[rows] ** 2)) / count
    return MeanPath(angles, mean, u)


def relative_angle(test: CircularReadings) -> np.ndarray:
    """Angles from the middle of the arc, (m,), between -180 and 180 degrees."""
    middle = 0.0
    if not test.is_full:
        places = np.unique(np.round(test.angle % 360.0, 9))
        gaps = np.diff(places, append=places[0] + 360.0)
        widest = int(np.argmax(gaps))
        middle = places[widest] + 0.5 * gaps[widest] + 180.0
    return np.asarray((test.angle - middle + 180.0) % 360.0 - 180.0)


def hysteresis(test: CircularReadings, deviation: np.ndarray) -> tuple[float, str, float | None] | None:
    """Value, unit and U of the largest difference; None where the senses have no angle in common."""
    there, back = (mean_path(test, deviation, sense) for sense in (1, -1))
    period = 360.0 if test.is_full else None
    both = np.ones(len(there.angle), dtype=bool)
    if period is None:
        both = (there.angle >= back.angle[0]) & (there.angle <= back.angle[-1])
    if not both.any():
        return None
    other = np.interp(there.angle, back.angle, back.deviation, period=period)
    difference = np.where(both, np.abs(there.deviation - other), -1.0)
    i = int(np.argmax(difference))
    if test.u is None:
        return float(difference[i]), "mm", None
    u = np.hypot(there.u[i], np.interp(there.angle[i], back.angle, back.u, period=period))
    return float(difference[i]), "mm", float(_K * u)
