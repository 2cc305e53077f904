"""Calibrated points of an artefact: their coordinates, and what is open of them as independent unknowns with a stated u.

The deviations δ of all coordinates from the certificate have the covariance Σ [mm²]. δ = V ξ with independent ξ: for a coordinate
that is correlated with no other, ξ is its own deviation and its u that of the certificate; for coordinates that are correlated
with each other, V and the variances of ξ are eigenvectors and eigenvalues of their part of Σ (principal components; eigenvalues
that are 0 to rounding have no unknown). Not modelled: a calibration at another temperature than that of the measurement.
JCGM 102:2011, 6.2; CONVENTIONS 6.

In the options of a set, `points` is {artefact: {point: [x, y, z, u]}}, or [x, y, z] for coordinates that are exact, or
[x, y, z, u_x, u_y, u_z]; `covariance` is {"names": ["P1 x", …], "values": [[…], …]} in mm², with names "P1 x", or "plate P1 x"
in a set with several artefacts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from volid.campaign import ObservationSet
from volid.exceptions import InputError

LETTERS = "xyz"
POINTS, COVARIANCE = "points", "covariance"
AGREES = 0.01  # of u: stated beside a covariance, rounded as certificates round it
SYMMETRIC = 1e-6  # of the standard uncertainties: more than the digits of a file leave
NOTHING = 1e-10  # of the largest eigenvalue: below, it is rounding
DEFINITE = 1e-6  # of the largest eigenvalue: what a certificate's digits may leave below 0


class Factor(NamedTuple):
    """One unknown ξ of a calibration: what it is called, its u [mm], and what it does to all coordinates, (n, 3)."""

    name: str
    u: float
    effect: np.ndarray


class Calibration(NamedTuple):
    """The calibrated points of one artefact: their names (n), coordinates (n, 3) [mm], and what is open of them."""

    artefact: str
    points: tuple[str, ...]
    coordinates: np.ndarray
    factors: tuple[Factor, ...]

    def numbers(self, points: np.ndarray) -> np.ndarray:
        """Which of its points each name (m,) is."""
        order = {name: i for i, name in enumerate(self.points)}
        return np.array([order[name] for name in points.tolist()], dtype=np.int64)


def artefacts_of(observations: ObservationSet) -> list[str]:
    """Names of the artefacts of a set, in the order of its rows."""
    return [str(name) for name in dict.fromkeys(observations.labels["artefact"].tolist())]


def calibration_of(observations: ObservationSet, artefact: str) -> Calibration:
    """The calibration of one artefact of a set. Raises `InputError` for points or a covariance that are none."""
    table = _numbers(observations, artefact)
    coordinates = np.stack([row[:3] for row in table.values()])
    u = np.stack([row[3:] for row in table.values()])
    covariance = _covariance(observations, artefact, tuple(table), u)
    return Calibration(artefact, tuple(table), coordinates, tuple(_factors(artefact, tuple(table), covariance)))


def check_points(observations: ObservationSet) -> None:
    """Raises `InputError` for a row whose artefact or point is not among the calibrated ones, or a calibration that is none."""
    given = observations.options.get(POINTS)
    if not isinstance(given, Mapping) or not given or not all(isinstance(own, Mapping) for own in given.values()):
        raise InputError(
            f"set '{observations.name}': there are no calibrated points; expected points = \"plate.csv\" with the columns "
            "artefact, point, x, y, z, u"
        )
    for artefact in artefacts_of(observations):
        rows = np.flatnonzero(observations.labels["artefact"] == artefact)
        if artefact not in given:
            raise InputError(
                f"{observations.where(int(rows[0]))}: artefact '{artefact}' has no calibrated points; they are those of "
                f"{', '.join(map(str, given))}; mend the name, or add its points"
            )
        strange = ~np.isin(observations.labels["point"][rows], list(given[artefact]))
        if strange.any():
            row = int(rows[np.argmax(strange)])
            raise InputError(
                f"{observations.where(row)}: point '{observations.labels['point'][row]}' is not among the {len(given[artefact])} "
                f"calibrated points of artefact '{artefact}'; mend the name, or add the point to `points`"
            )
        calibration_of(observations, artefact)


def _numbers(observations: ObservationSet, artefact: str) -> dict[str, np.ndarray]:
    """(x, y, z, u_x, u_y, u_z) of every point of an artefact [mm]."""
    found = {}
    for point, row in observations.options[POINTS][artefact].items():
        try:
            values = np.array(row, dtype=float)
        except (TypeError, ValueError):
            values = np.zeros(0)
        if values.shape not in ((3,), (4,), (6,)) or not np.isfinite(values).all() or (values[3:] < 0.0).any():
            raise InputError(
                f"set '{observations.name}': point '{point}' of artefact '{artefact}' is {row}; expected [x, y, z], "
                "[x, y, z, u] or [x, y, z, u_x, u_y, u_z] in mm, u not negative"
            )
        u = values[3:] if len(values) == 6 else np.repeat(values[3:] if len(values) == 4 else 0.0, 3)
        found[str(point)] = np.concatenate([values[:3], u])
    return found


def _covariance(observations: ObservationSet, artefact: str, points: Sequence[str], u: np.ndarray) -> np.ndarray:
    """Σ of all coordinates of an artefact, (3n, 3n) [mm²]: that of the option where it names them, else u²."""
    result = np.diag(u.ravel() ** 2)
    given = observations.options.get(COVARIANCE) or {}
    if not given:
        return result
    names, values = _matrix(observations, given)
    own = [n for n in (f"{point} {c}" for point in points for c in LETTERS)]
    several = len(observations.options[POINTS]) > 1
    places = {(f"{artefact} {n}" if several else n): i for i, n in enumerate(own)}
    places |= {f"{artefact} {n}": i for i, n in enumerate(own)}
    kept = [k for k, name in enumerate(names) if name in places]
    at = [places[names[k]] for k in kept]
    part = values[np.ix_(kept, kept)]
    stated, found = u.ravel()[at], np.sqrt(np.maximum(np.diag(part), 0.0))
    other = (stated > 0.0) & (np.abs(stated - found) > AGREES * found)
    if other.any():
        i = int(np.argmax(other))
        raise InputError(
            f"set '{observations.name}', covariance: the standard uncertainty of {names[kept[i]]} is {found[i]:g} mm there and "
            f"{stated[i]:g} mm in `points`; leave u out of `points`, or mend one of them"
        )
    result[np.ix_(at, at)] = part
    return result


def _matrix(observations: ObservationSet, given: Any) -> tuple[list[str], np.ndarray]:
    """Names and values of a covariance matrix. Raises `InputError` for one that is none."""
    where = f"set '{observations.name}', covariance"
    try:
        names, values = [str(n) for n in given["names"]], np.array(given["values"], dtype=float)
    except (TypeError, ValueError, KeyError):
        names, values = [], np.zeros(0)
    if not names or values.shape != (len(names),) * 2 or not np.isfinite(values).all() or len(set(names)) < len(names):
        raise InputError(f"{where}: expected a name of every row, each once, and a square of numbers in mm²")
    known = _known_names(observations)
    if strange := [n for n in names if n not in known]:
        raise InputError(
            f"{where}: '{strange[0]}' is no coordinate of a calibrated point; expected names such as '{next(iter(known))}'"
        )
    u = np.sqrt(np.maximum(np.diag(values), 0.0))
    uneven = np.abs(values - values.T) > SYMMETRIC * np.outer(u, u)
    if uneven.any():
        i, j = np.argwhere(uneven)[0]
        raise InputError(
            f"{where}: {names[i]}, {names[j]} is {values[i, j]:g} and {names[j]}, {names[i]} is {values[j, i]:g}; expected a "
            "symmetric matrix"
        )
    least, largest = np.linalg.eigvalsh(values)[[0, -1]]
    if least < -DEFINITE * largest or largest <= 0.0:
        raise InputError(
            f"{where}: its smallest eigenvalue is {least:g} mm² and its largest {largest:g} mm²; expected none below 0, which "
            "would be a negative variance. Are these covariances in mm², with all their digits?"
        )
    return names, 0.5 * (values + values.T)


def _known_names(observations: ObservationSet) -> dict[str, None]:
    """Names of all coordinates, without the artefact's name first where there is one artefact."""
    table = observations.options[POINTS]
    long = [f"{a} {p} {c}" for a, own in table.items() for p in own for c in LETTERS]
    short = [f"{p} {c}" for own in table.values() for p in own for c in LETTERS] if len(table) == 1 else []
    return dict.fromkeys([*short, *long])


def _factors(artefact: str, points: Sequence[str], covariance: np.ndarray) -> list[Factor]:
    """ξ of a covariance (3n, 3n): one per uncorrelated coordinate, the principal components of every correlated part."""
    result: list[Factor] = []
    count, part_of = connected_components(csr_array(covariance != 0.0), directed=False)
    for part in range(count):
        at = np.flatnonzero(part_of == part)
        variances, vectors = np.linalg.eigh(covariance[np.ix_(at, at)])
        for k in np.flatnonzero(variances > NOTHING * max(float(variances[-1]), 0.0))[::-1]:
            point, letter = points[at[0] // 3], LETTERS[at[0] % 3].upper()
            which = f"{point} {letter}" if len(at) == 1 else f"{point} {letter} component {len(at) - k}"
            effect = np.zeros(covariance.shape[0])
            effect[at] = vectors[:, k] if len(at) > 1 else 1.0
            result.append(
                Factor(f"calibration {artefact} {which}", float(np.sqrt(variances[k])), effect.reshape(-1, 3))
            )
    return result
