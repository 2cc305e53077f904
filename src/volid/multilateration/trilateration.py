"""Where a station stands: its position from readings to known targets alone, without a machine model.

The position is the start value of every identification with tracking interferometers: it needs no approximate
coordinates, accepts beam breaks and gross outliers, and reports when the data allow two answers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from volid.backend.rms import rms
from volid.exceptions import InputError
from volid.multilateration.one_station import (
    BIWEIGHT,
    Readings,
    as_readings,
    centred,
    closed_form,
    first_residuals,
    misfits,
    refine,
    robust_costs,
    robust_scale,
    robust_weights,
    subsample,
)

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

_COARSE, _MEDIUM = 250, 2000  # readings used while the right basin, then the right mirror image, is looked for
_RADII = (0.4, 1.5, 5.0, 15.0)  # of the spread start positions, in units of the targets' extent
_DISTANT = 100.0  # extents: farther off, wave fronts are so flat that such a position only stands in for "at infinity"
_INDISTINCT = 9.0  # twice the log-likelihood ratio (three standard deviations) below which two positions are possible


@dataclass(frozen=True)
class StationEstimate:
    """A station position, and what the readings say about it.

    `residuals` are reading - predicted, in the order given. `segments` are the labels that `dead_paths` belong to.
    `scale` is the robust standard deviation of the residuals, `outliers` marks readings beyond 4.685 of it.
    `alternative` is a second position that the readings cannot distinguish from the first (for coplanar targets its
    mirror image), or None.
    """

    position: Float[np.ndarray, " d"]
    segments: Int[np.ndarray, " s"]
    dead_paths: Float[np.ndarray, " s"]
    residuals: Float[np.ndarray, " n"]
    scale: float
    outliers: Bool[np.ndarray, " n"]
    alternative: Float[np.ndarray, " d"] | None


def trilaterate(
    targets: ArrayLike,
    distances: ArrayLike,
    segments: ArrayLike | None,
    relative: bool,
    start: ArrayLike | None = None,
    u: ArrayLike | None = None,
) -> StationEstimate:
    """Position of one station from distances to known targets.

    The reading is d = |p - s| + δ_j: station s, target p, one dead path δ_j per segment j (0 when not `relative`).
    The start position follows from |p|² - d² = 2 p·s - 2 d δ_j - k_j, which is linear in s, δ_j and k_j = |s|² - δ_j².
    From there, from its mirror images in the targets' best-fit plane and from positions spread around, damped Gauss-Newton
    follows, with the dead paths eliminated, with Huber weights and finally Tukey's biweight. The position with the lowest
    robust cost is taken, or, among positions that the readings cannot distinguish, the one nearest `start`. Errors of the
    targets are not modelled: they appear in the residuals.

    Args:
        targets: Array, shape (n, 3), or (n, 2) in the plane. Any one unit, that of the distances.
        distances: Array, shape (n,). Readings.
        segments: Array of int, shape (n,), the uninterrupted beam each reading belongs to; None: one segment.
        relative: True for an interferometer: one unknown dead path per segment.
        start: Approximate position, shape (3,); only a help, never needed.
        u: Standard uncertainty of a reading, number or shape (n,); None: unknown and equal.

    Raises:
        InputError: shapes differ, numbers are not finite, there are too few targets, or they lie on one line.

    References:
        Coope, Reliable computation of the points of intersection of n spheres in R^n, ANZIAM J. 42 (2000) C461;
        Huber, Robust Statistics, 1981, ch. 7; Golub and Pereyra, variable projection, Inverse Problems 19 (2003) R1.

    Example:
        >>> targets = np.array([[0, 0, 0], [500, 0, 0], [0, 500, 0], [0, 0, 400], [500, 500, 400.0]])
        >>> distances = np.linalg.norm(targets - [900, -700, 300], axis=1) - 120.0
        >>> estimate = trilaterate(targets, distances, None, relative=True)
        >>> estimate.position.round(6), estimate.dead_paths.round(6)
        (array([ 900., -700.,  300.]), array([-120.]))
    """
    points, readings_in, labels, index, sigma = _checked(targets, distances, segments, relative, u)
    order = np.argsort(index, kind="stable")
    centre, extent = points.mean(axis=0), rms(np.linalg.norm(points - points.mean(axis=0), axis=1))
    readings = as_readings(
        (points - centre)[order] / extent,
        readings_in[order] / extent,
        np.bincount(index),
        relative,
        None if sigma is None else sigma[order] / extent,
    )
    guess = None if start is None else (np.asarray(start, float) - centre) / extent
    best, other = _search(readings, guess)
    position, residuals, dead_paths, scale = _finish(readings, best)
    unsorted, in_order = np.empty_like(order), np.arange(order.size)
    unsorted[order] = in_order
    return StationEstimate(
        position=centre + extent * position,
        segments=labels,
        dead_paths=extent * dead_paths,
        residuals=extent * residuals[unsorted],
        scale=float(extent * scale * np.median(readings.u)),
        outliers=(np.abs(residuals) > BIWEIGHT * scale * readings.u)[unsorted],
        alternative=None if other is None else centre + extent * other,
    )


def _checked(targets, distances, segments, relative, u):
    """Arrays of the right shape, segment labels and index, and u, or InputError."""
    points, values = np.asarray(targets, float), np.asarray(distances, float)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or values.shape != points.shape[:1]:
        raise InputError(
            f"targets have shape {points.shape} and distances {values.shape}; expected (n, 3) or (n, 2), and (n,)"
        )
    labels_in = np.zeros(values.size, int) if segments is None or not relative else np.asarray(segments)
    if labels_in.shape != values.shape or not np.issubdtype(labels_in.dtype, np.integer):
        raise InputError(
            f"segments have shape {labels_in.shape}; expected one whole number per reading, {values.shape}"
        )
    sigma = None if u is None else np.broadcast_to(np.asarray(u, float), values.shape)
    for name, array in (("targets", points), ("distances", values), ("u", sigma)):
        if array is not None and not np.isfinite(array).all():
            raise InputError(f"{name}: reading {_first_bad(array)} (counted from 0) is not a finite number")
    if sigma is not None and (sigma <= 0).any():
        raise InputError(
            f"u of reading {int(np.argmin(sigma))} (counted from 0) is {sigma.min():g}; expected more than 0"
        )
    labels, index = np.unique(labels_in, return_inverse=True)
    _check_targets(points, index, relative)
    return points, values, labels.astype(int), index, sigma


def _first_bad(array: np.ndarray) -> int:
    """Row of the first entry that is not finite."""
    return int(np.argwhere(~np.isfinite(array))[0][0])


def _check_targets(points: Float[np.ndarray, "n d"], index: Int[np.ndarray, " n"], relative: bool) -> None:
    """Enough different targets for a position, not all on one line."""
    dimension = points.shape[1]
    different = np.unique(np.column_stack([index, points]), axis=0)
    taken = np.unique(index).size if relative else 0
    if len(different) - taken < dimension:
        dead_paths = f" and one more per segment for its dead path ({taken} segments)" if relative else ""
        raise InputError(
            f"too few targets for a station position: {len(different)} different targets, counted in each segment; "
            f"expected at least {dimension + taken}: {dimension}{dead_paths}. Measure more targets per segment"
        )
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[dimension - 2] < 1e-9 * spread[0] or spread[0] == 0:
        shape = "on one line: the station may turn around it" if dimension == 3 else "in one point"
        raise InputError(
            f"all targets lie {shape}; expected targets spread over a {'plane' if dimension == 3 else 'line'}"
        )


def _search(readings: Readings, guess: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
    """The best position on a part of the readings, and another one that is as good, or None."""
    coarse, medium = subsample(readings, _COARSE), subsample(readings, _MEDIUM)
    normal = np.linalg.svd(readings.targets @ readings.targets.T)[0][:, -1]
    starts = np.vstack([*([] if guess is None else [guess]), closed_form(medium), _spread(normal.size)])
    starts /= np.maximum(np.linalg.norm(starts, axis=1, keepdims=True) / _DISTANT, 1.0)
    found = refine(coarse, starts, 25)
    found = _distinct(found[np.argsort(robust_costs(coarse, found))])[:3]
    found = refine(medium, np.vstack([found, _mirrored(found, normal)]), 40)
    costs = robust_costs(medium, found)
    order = np.argsort(costs)
    found, costs = found[order], costs[order] * (readings.distances.size / medium.distances.size)
    possible = _distinct(found[2 * (costs - costs[0]) < _INDISTINCT])
    possible = possible[np.linalg.norm(possible, axis=1) < max(_DISTANT, 2 * np.linalg.norm(possible[0]))]
    if guess is not None:
        possible = possible[np.argsort(np.linalg.norm(possible - guess, axis=1))]
    return possible[0], possible[1] if len(possible) > 1 else None


def _distinct(positions: Float[np.ndarray, "b d"]) -> Float[np.ndarray, "c d"]:
    """The positions without repetition, order kept."""
    kept: list[np.ndarray] = []
    for position in positions:
        if all(np.linalg.norm(position - other) > 1e-3 * (1 + np.linalg.norm(other)) for other in kept):
            kept.append(position)
    return np.array(kept)


def _mirrored(positions: Float[np.ndarray, "b d"], normal: Float[np.ndarray, " d"]) -> Float[np.ndarray, "b d"]:
    """Mirror images in the plane through the origin with this unit normal."""
    return positions - 2 * np.outer(positions @ normal, normal)


def _spread(dimension: int) -> Float[np.ndarray, "b d"]:
    """Start positions all around, near and far: a Fibonacci lattice on the sphere, radii in turn."""
    count = 4 * len(_RADII)
    height = (2 * np.arange(count) + 1) / count - 1 if dimension == 3 else np.zeros(count)
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - height**2)
    directions = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), height])[:, :dimension]
    return directions * np.resize(_RADII, count)[:, None]


def _finish(readings: Readings, position: Float[np.ndarray, " d"]):
    """Position from all readings, residuals, dead paths and scale; biweight only where redundancy carries it."""
    biweight = readings.redundancy >= 10
    found = refine(readings, position[None], 60)
    if biweight:
        found = refine(readings, found, 40, biweight=True)
    scale = robust_scale(readings, first_residuals(readings, found))
    weights = robust_weights(readings, first_residuals(readings, found), scale, biweight)
    misfit, _ = misfits(readings, found)
    residuals = centred(readings, misfit, weights)[0]
    dead_paths = (misfit[0] - residuals)[readings.first]
    return found[0], residuals, dead_paths, float(scale[0, 0])
