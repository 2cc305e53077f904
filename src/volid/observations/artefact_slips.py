"""What is wrong where calibrated points do not fit the places at which they were found: units, hands, names, placements."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations

import numpy as np

from volid.campaign import ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import best_rigid_motion
from volid.observations.artefact_places import Place, Rows

FITS = 5e-3  # of the points' extent: more than a machine's errors
BETTER = 0.1  # of the misfit: what is left where a mistake is mended
ENOUGH = 4  # rows that show by themselves whether they fit
MANY = 40  # rows up to which every pair is tried; beyond, those that fit worst
UNITS = {1e3: "metres", 1e-3: "micrometres", 25.4: "inches"}


def misfit(points: np.ndarray, found: np.ndarray) -> float:
    """RMS distance of points (m, 3), moved rigidly as well as can be, from where they were found, over their extent."""
    residual = best_rigid_motion(points, found)(points) - found
    extent = float(np.sum((found - found.mean(axis=0)) ** 2))
    return float(np.sqrt(np.sum(residual**2) / max(extent, 1e-300)))


def check_placement(place: Place, observations: ObservationSet) -> None:
    """Raises `InputError` where the points of a placement lie otherwise than calibrated, naming what would explain it."""
    points = np.concatenate([part.arms for part in place.parts])
    found = np.concatenate([part.nominal(True) for part in place.parts])
    if len(points) < 2 or (before := misfit(points, found)) <= FITS:
        return
    where = f"{observations.file_and_set}, placement '{place.placement}' of artefact '{place.parts[0].calibration.artefact}'"
    for said, after in _explanations(place.parts, points, found):
        if after < max(BETTER * before, 1e-9) and after < 4.0 * FITS:
            raise InputError(f"{where}: {said}")
    size = before * float(np.sqrt(np.mean(np.sum((found - found.mean(axis=0)) ** 2, axis=1))))
    raise InputError(
        f"{where}: the points lie {size:.3g} mm (root mean square) off the calibrated ones; expected at most {FITS:g} of their "
        "extent. Check the names of the points, the placements, the signs of the axes and the tool vector, or state "
        "large_errors = true"
    )


def _explanations(parts: list[Rows], points: np.ndarray, found: np.ndarray) -> Iterator[tuple[str, float]]:
    """What may be wrong, in words, with the misfit that would remain."""
    for factor, unit in UNITS.items():
        said = f"the calibrated coordinates seem to be in {unit}; expected mm"
        yield said, misfit(points * factor, found)
        read = np.concatenate([_found(part, factor) for part in parts])
        yield f"the readings x, y, z seem to be in {unit}; expected mm", misfit(points, read)
    mirrored = points * np.array([-1.0, 1.0, 1.0])
    if np.linalg.matrix_rank(points - points.mean(axis=0), tol=1e-2 * np.abs(points).max()) == 3:
        yield "the calibrated coordinates are left-handed; negate one of the columns x, y, z", misfit(mirrored, found)
    yield from _exchanged(parts, points, found)
    yield from _two_places(parts, points, found)


def _found(part: Rows, factor: float) -> np.ndarray:
    """Places found, if the readings were in another unit."""
    commanded = part.nominal(False)
    return np.asarray(commanded + factor * (part.nominal(True) - commanded))


def _exchanged(parts: list[Rows], points: np.ndarray, found: np.ndarray) -> Iterator[tuple[str, float]]:
    """One row with another point's name, and two rows whose names are exchanged."""
    said = _row_names(parts)
    residual = np.linalg.norm(best_rigid_motion(points, found)(points) - found, axis=1)
    tried = np.sort(np.argsort(-residual)[:MANY])
    for i, j in combinations(tried.tolist(), 2):
        changed = points.copy()
        changed[[i, j]] = points[[j, i]]
        yield f"{said(i)} and {said(j)}: the points seem to be exchanged", misfit(changed, found)
    for i in tried.tolist():
        others = np.arange(len(points)) != i
        if others.sum() > 3:
            yield (
                f"{said(i)}: this is not the place of that point; is the name right?",
                misfit(points[others], found[others]),
            )


def _two_places(parts: list[Rows], points: np.ndarray, found: np.ndarray) -> Iterator[tuple[str, float]]:
    """Rows before and after which the artefact stood elsewhere."""
    said = _row_names(parts)
    for i in range(ENOUGH, len(points) - ENOUGH + 1):
        after = max(misfit(points[:i], found[:i]), misfit(points[i:], found[i:]))
        yield f"the artefact stands elsewhere from {said(i)} on; give that placement another name", after


def _row_names(parts: list[Rows]) -> Callable[[int], str]:
    rows = [(part.observations, int(row)) for part in parts for row in part.rows]

    def said(i: int) -> str:
        observations, row = rows[i]
        return f"{observations.where(row)} (point '{observations.labels['point'][row]}')"

    return said
