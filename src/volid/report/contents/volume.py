"""The working volume in numbers with their uncertainty: ISO 230-1 volumetric accuracy, largest and RMS deviation.

The RMS over P even points has the gradient Σ eᵀG/(P·RMS), G = ∂e/∂θ, and U = 2 u by propagation of the covariance (GUM
5.1.2); U of ranges and of the largest deviation is that of `volume_sizes`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.backend.rms import rms
from volid.compensation.residual.accuracy import K
from volid.fitting.prediction.deviations import gradient_matrix
from volid.fitting.prediction.largest import Places, values_at, with_largest
from volid.fitting.prediction.spread import linear_uncertainty
from volid.fitting.solution import Solution
from volid.model.iso230 import DIRECTIONS
from volid.report.contents.contents import Contents


class VolumeValue(NamedTuple):
    """A number of the working volume with U (k = 2): `key` "V_X" … "V_C", "largest", "rms"; [mm or rad].

    NaN where the data do not determine it, or where no function of the model acts on it: 0 ± 0 would be a claim. `place`: where
    the largest deviation stands, machine axis order [mm or degrees]; () for the others.
    """

    key: str
    value: float
    U: float
    unit: str
    place: tuple[float, ...] = ()


def volume_values(contents: Contents) -> list[VolumeValue]:
    """V_X … V_C, the largest and the RMS deviation before compensation in the stated datum, each with U.

    Source: ISO 230-1:2012 3.8 for the ranges.
    """
    solution, sizes = contents.solution, contents.sizes
    if sizes is None:
        return []
    found = [
        _unless_nothing(VolumeValue(f"V_{letter}", value, expanded, "mm" if k < 3 else "rad"))
        for k, (letter, value, expanded) in enumerate(
            zip(DIRECTIONS, *(v.tolist() for v in sizes.accuracy), strict=True)
        )
    ]
    return [*found, *_lengths(solution, np.asarray(contents.tool, dtype=float), *(float(v[0]) for v in sizes.largest))]


def _unless_nothing(found: VolumeValue) -> VolumeValue:
    nothing = found.value == 0.0 and found.U == 0.0
    return found._replace(value=np.nan, U=np.nan) if nothing else found


def _lengths(solution: Solution, tool: np.ndarray, largest: float, expanded: float) -> list[VolumeValue]:
    """The largest deviation with its place, and the RMS over the places that are spread evenly."""
    places = with_largest(solution, tool)
    vectors = values_at(solution, places, tool)[:, :3]
    if not np.isfinite(vectors).all():
        return [VolumeValue(key, np.nan, np.nan, "mm") for key in ("largest", "rms")]
    worst = int(np.argmax(np.linalg.norm(vectors, axis=1)))
    at = tuple(places.positions[worst].tolist())
    return [VolumeValue("largest", largest, expanded, "mm", at), _mean(solution, places, tool, vectors)]


def _mean(solution: Solution, places: Places, tool: np.ndarray, vectors: np.ndarray) -> VolumeValue:
    even, theta = places.even, np.asarray(solution.parameters)
    e, q, way = vectors[even], places.positions[even], places.directions[even]
    total = rms(np.linalg.norm(e, axis=1))
    gradient = gradient_matrix(solution.model, theta, q, np.broadcast_to(tool, (len(q), 3)), way)[:, :3]
    below = max(len(e) * total, 1e-300)
    u = linear_uncertainty(np.einsum("pk,pkn->n", e, gradient) / below, solution.parameter_covariance)
    scatter = np.linalg.norm(e * solution.scatter_u()[:3]) / below
    return VolumeValue("rms", float(total), K * float(np.hypot(u, scatter)), "mm")
