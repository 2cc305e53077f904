"""Poses from points: the rigid motion that carries nominal points onto coordinates read, and what is left of them.

Kabsch, Acta Cryst. A32 (1976) 922. Not modelled: a scale. Where more is left than a machine's errors, readings are tried in other
units; what fits ten times better is named.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from volid.campaign import ObservationSet
from volid.exceptions import InputError

_FLAT = 1e-3  # second singular value of the points over the first: below, they lie on a line
_FITS = 5e-3  # of the targets' extent: more than a machine's errors
_BETTER = 0.1


def best_pose(nominal: np.ndarray, read: np.ndarray, what: str) -> tuple[np.ndarray, np.ndarray]:
    """R (3, 3) and position s (3,) with read ≈ R (nominal - s), both (m, 3) [mm]; `what` has that pose, in messages.

    Raises `InputError` for fewer than three points that do not lie on one line.
    """
    centre, middle = nominal.mean(axis=0), read.mean(axis=0)
    spread = np.linalg.svd(nominal - centre, compute_uv=False)
    if len(read) < 3 or spread[1] < _FLAT * max(spread[0], 1e-300):
        raise InputError(f"{what}: its {len(read)} points lie on one line; its orientation needs three that do not")
    u, _, vt = np.linalg.svd((nominal - centre).T @ (read - middle))
    rotation = vt.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))]) @ u.T
    return rotation, centre - rotation.T @ middle


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
        return max(_left(targets, points[rows]) for rows, targets in nominal)

    before = misfit(observations.readings)
    if before <= _FITS:
        return
    after = {said: misfit(change(observations.readings)) for said, change in units.items()}
    said = min(after, key=lambda k: after[k])
    if after[said] < _BETTER * before:
        raise InputError(f"{observations.source or observations.name}, set '{observations.name}': {said}")


def _left(targets: np.ndarray, points: np.ndarray) -> float:
    """RMS distance of points from targets after the best rigid motion, over the targets' extent."""
    a, b = targets - targets.mean(axis=0), points - points.mean(axis=0)
    u, s, vt = np.linalg.svd(a.T @ b)
    handed = np.array([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    left = max(float(np.sum(a**2) + np.sum(b**2) - 2.0 * np.sum(s * handed)), 0.0)
    return float(np.sqrt(left / max(float(np.sum(a**2)), 1e-300)))
