"""The working volume in numbers with their uncertainty: ISO 230-1 volumetric accuracy, largest and RMS deviation.

The largest length |e| at its place has the gradient eᵀG/|e|, the RMS over P even points Σ eᵀG/(P·RMS), a range G_max - G_min, with
G = ∂e/∂θ there: u follows by propagation of the covariance (GUM 5.1.2). That the place itself may be another one is not modelled.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.backend.rms import rms
from volid.fitting.prediction.deviations import gradient_matrix
from volid.fitting.prediction.largest import Places, values_at, with_largest
from volid.fitting.prediction.spread import linear_uncertainty
from volid.fitting.solution import Solution
from volid.model.iso230 import DIRECTIONS


class VolumeValue(NamedTuple):
    """A number of the working volume: `key` "V_X" … "V_C", "largest", "rms"; NaN where the data do not determine it, or
    where no function of the model acts on it.

    `place`: where the largest deviation stands, machine axis order [mm or degrees]; () for the others.
    """

    key: str
    value: float
    u: float
    unit: str
    place: tuple[float, ...] = ()


def volume_values(solution: Solution, tool: tuple[float, float, float]) -> list[VolumeValue]:
    """V_X … V_C, the largest and the RMS deviation before compensation in the stated datum, each with u.

    Args:
        solution: A solution, as `volid.fit` makes it.
        tool: Tool vector, (3,) [mm].

    Source: ISO 230-1:2012 3.8 for the ranges.
    """
    vector = np.asarray(tool, dtype=float)
    places = with_largest(solution, vector)
    values = values_at(solution, places, vector)
    return [*_ranges(solution, places, vector, values), *_lengths(solution, places, vector, values)]


def _ranges(solution: Solution, places: Places, tool: np.ndarray, values: np.ndarray) -> list[VolumeValue]:
    scatter, found = solution.scatter_u(), []
    for k, letter in enumerate(DIRECTIONS):
        unit = "mm" if k < 3 else "rad"
        if not np.isfinite(values[:, k]).all():
            found.append(VolumeValue(f"V_{letter}", np.nan, np.nan, unit))
            continue
        ends = [int(np.argmax(values[:, k])), int(np.argmin(values[:, k]))]
        high, low = _gradient(solution, places, tool, ends)[:, k]
        if not (values[:, k].any() or high.any() or low.any()):  # no function of the model acts: 0 ± 0 would be a claim
            found.append(VolumeValue(f"V_{letter}", np.nan, np.nan, unit))
            continue
        u = float(np.hypot(linear_uncertainty(high - low, solution.parameter_covariance), np.sqrt(2.0) * scatter[k]))
        found.append(VolumeValue(f"V_{letter}", float(np.ptp(values[:, k])), u, unit))
    return found


def _lengths(solution: Solution, places: Places, tool: np.ndarray, values: np.ndarray) -> list[VolumeValue]:
    vectors = values[:, :3]
    if not np.isfinite(vectors).all():
        return [VolumeValue(key, np.nan, np.nan, "mm") for key in ("largest", "rms")]
    size = np.linalg.norm(vectors, axis=1)
    worst, even = int(np.argmax(size)), np.arange(len(size))[places.even]
    along = vectors[worst] / max(float(size[worst]), 1e-300)
    own = along * solution.scatter_u()[:3]
    u = np.hypot(_u(solution, along @ _gradient(solution, places, tool, [worst])[0, :3]), np.linalg.norm(own))
    total = rms(size[even])
    gradient = _gradient(solution, places, tool, even.tolist())[:, :3]
    mean = np.einsum("pk,pkn->n", vectors[even], gradient) / max(len(even) * total, 1e-300)
    spread = np.linalg.norm(vectors[even] * solution.scatter_u()[:3]) / max(len(even) * total, 1e-300)
    place = tuple(places.positions[worst].tolist())
    return [
        VolumeValue("largest", float(size[worst]), float(u), "mm", place),
        VolumeValue("rms", float(total), float(np.hypot(_u(solution, mean), spread)), "mm"),
    ]


def _u(solution: Solution, row: np.ndarray) -> float:
    return float(linear_uncertainty(row, solution.parameter_covariance))


def _gradient(solution: Solution, places: Places, tool: np.ndarray, numbers: list[int]) -> np.ndarray:
    """∂e/∂θ at some of the places, (m, 6, n)."""
    q, way = places.positions[numbers], places.directions[numbers]
    tools = np.broadcast_to(tool, (len(numbers), 3))
    return gradient_matrix(solution.model, np.asarray(solution.parameters), q, tools, way)
