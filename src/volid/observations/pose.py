"""Poses from points: the rigid motion that carries nominal points onto the coordinates read, and the misfit that remains.

Kabsch, Acta Cryst. A32 (1976) 922. Not modelled: a scale. Where the misfit is larger than a machine's errors, the readings are
tried in other units, and a unit that fits ten times better is named.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from volid.campaign import ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import best_rigid_motion
from volid.observations.base import takes_large_errors

_FLAT = 1e-3  # second singular value of the points over the first: below, they lie on a line
_FITS = 5e-3  # of the targets' extent: more than a machine's errors
_BETTER = 0.1
_ALIKE = 0.05  # of the targets' extent: what the right unit may leave where something small is wrong besides


def best_pose(nominal: np.ndarray, read: np.ndarray, what: str) -> tuple[np.ndarray, np.ndarray]:
    """R (3, 3) and position s (3,) with read ≈ R (nominal - s), both (m, 3) [mm]; `what` has that pose, in messages.

    Raises `InputError` for fewer than three points that do not lie on one line.
    """
    spread = np.linalg.svd(nominal - nominal.mean(axis=0), compute_uv=False)
    if len(read) < 3 or spread[1] < _FLAT * max(spread[0], 1e-300):
        raise InputError(f"{what}: its {len(read)} points lie on one line; its orientation needs three that do not")
    motion = best_rigid_motion(nominal, read)
    return motion.rotation, -motion.rotation.T @ motion.translation


def check_units(
    observations: ObservationSet,
    nominal: list[tuple[np.ndarray, np.ndarray]],
    coordinates: Callable[[ObservationSet, np.ndarray], np.ndarray],
    units: Mapping[str, Callable[[np.ndarray], np.ndarray]],
) -> None:
    """Raises `InputError` when readings fit the nominal targets ten times better in another of the `units`.

    `nominal`: rows and their targets (m, 3), station by station. `coordinates` (set, readings): as points in the station's frame.
    """

    def misfit(readings: np.ndarray) -> float:
        points = coordinates(observations, readings)
        return max(_misfit_of(targets, points[rows]) for rows, targets in nominal)

    before = misfit(observations.readings)
    if before <= _FITS or takes_large_errors(observations):
        return
    after = {said: misfit(change(observations.readings)) for said, change in units.items()}
    said = min(after, key=lambda k: after[k])
    if after[said] < min(_BETTER * before, _ALIKE):  # readings that are much too small fit nothing, but miss by less
        raise InputError(f"{observations.file_and_set}: {said}")


def _misfit_of(targets: np.ndarray, points: np.ndarray) -> float:
    """RMS distance of points from targets after the best rigid motion, over the targets' extent."""
    residual = best_rigid_motion(targets, points)(targets) - points
    extent = float(np.sum((targets - targets.mean(axis=0)) ** 2))
    return float(np.sqrt(np.sum(residual**2) / max(extent, 1e-300)))
