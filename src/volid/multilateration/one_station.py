"""Readings of one station to known targets in numbers: closed-form positions and their robust refinement.

Dead paths never appear as unknowns, because all quantities are centred segment by segment (variable projection).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Float, Int

HUBER = 1.345  # 95 % efficiency under normal noise, Huber 1981
BIWEIGHT = 4.685  # 95 % efficiency under normal noise, Beaton and Tukey 1974
FARTHEST = 1000.0  # extents; no step leads farther away, where ranges drown in rounding


@dataclass(frozen=True)
class Readings:
    """Readings sorted by segment, targets centred; lengths in units of the targets' extent."""

    targets: Float[np.ndarray, "d n"]
    distances: Float[np.ndarray, " n"]
    u: Float[np.ndarray, " n"]
    first: Int[np.ndarray, " s"]
    counts: Int[np.ndarray, " s"]
    relative: bool
    floor: float  # least robust scale of residual / u

    @property
    def redundancy(self) -> int:
        """Number of readings minus number of unknowns, at least 1."""
        unknowns = self.targets.shape[0] + self.relative * self.first.size
        return max(self.distances.size - unknowns, 1)


def as_readings(targets, distances, counts, relative, u) -> Readings:
    """Readings whose `targets`, shape (n, d), are already sorted by segment and centred."""
    floor = 1e-13 * (1.0 + np.abs(distances).max()) if u is None else 1.0
    return Readings(
        targets=np.ascontiguousarray(targets.T),
        distances=distances,
        u=np.ones(distances.size) if u is None else u,
        first=np.cumsum(counts) - counts,
        counts=counts,
        relative=relative,
        floor=floor,
    )


def subsample(readings: Readings, size: int) -> Readings:
    """About `size` readings, evenly through time, and at least five of each segment where it has them."""
    if readings.distances.size <= size:
        return readings
    share = size / readings.distances.size
    wanted = np.minimum(readings.counts, np.maximum(5, np.ceil(share * readings.counts))).astype(int)
    slot = np.arange(wanted.sum()) - np.repeat(np.cumsum(wanted) - wanted, wanted)
    keep = np.repeat(readings.first, wanted) + slot * np.repeat(readings.counts, wanted) // np.repeat(wanted, wanted)
    u = None if readings.floor < 1 else readings.u[keep]
    return as_readings(readings.targets[:, keep].T, readings.distances[keep], wanted, readings.relative, u)


def closed_form(readings: Readings) -> Float[np.ndarray, "b d"]:
    """Linear start positions: with full rank, and within the best-fit plane plus and minus the height above it."""
    p, d = readings.targets, readings.distances
    known = (p**2).sum(axis=0) - d**2
    ones = np.ones_like(d)
    d_c, p_c, y_c = (centred(readings, value, ones) for value in (d, p, known))
    if readings.relative:  # y = 2 p·s - 2 d δ - k: take the part along d out of p and y, segment by segment
        p_c, y_c = (value - _along(readings, value, d_c) for value in (p_c, y_c))
    vectors, sizes, axes = np.linalg.svd(2 * p_c.T, full_matrices=False)
    parts = (y_c @ vectors) / np.maximum(sizes, 1e-12 * sizes[0])
    in_plane = parts[:-1] @ axes[:-1]
    remaining = known - 2 * in_plane @ p
    height = _height(readings, remaining, in_plane) * axes[-1]
    return np.array([parts @ axes, in_plane + height, in_plane - height])


def _along(readings: Readings, values: np.ndarray, d_c: np.ndarray) -> np.ndarray:
    """Regression of each row of centred values on centred distances, by segment."""
    variance = np.add.reduceat(d_c**2, readings.first)
    slope = np.add.reduceat(values * d_c, readings.first, axis=-1) / np.maximum(variance, 1e-24)
    return np.repeat(slope, readings.counts, axis=-1) * d_c


def _height(readings: Readings, remaining: np.ndarray, in_plane: np.ndarray) -> float:
    """Distance from the plane, from k_j = |s|² - δ_j² and the rest -2 d δ_j - k_j, mean over readings."""
    dead_path = np.zeros_like(remaining)
    if readings.relative:
        d_c = centred(readings, readings.distances, np.ones_like(remaining))
        variance = np.repeat(np.add.reduceat(d_c**2, readings.first), readings.counts)
        slope = np.repeat(np.add.reduceat(remaining * d_c, readings.first), readings.counts) / np.maximum(
            variance, 1e-24
        )
        dead_path = -slope / 2
    k = -(remaining + 2 * readings.distances * dead_path)
    return float(np.sqrt(max(np.median(k + dead_path**2) - in_plane @ in_plane, 0.0)))


def centred(readings: Readings, values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Values, shape (..., n), minus their weighted mean in each segment; unchanged when there are no dead paths."""
    if not readings.relative:
        return values
    sums, shares = (np.add.reduceat(part, readings.first, axis=-1) for part in (values * weights, weights))
    return values - np.repeat(sums / shares, readings.counts, axis=-1)


def misfits(readings: Readings, positions: Float[np.ndarray, "b d"]):
    """Reading minus range, shape (b, n), and derivative of the range by the position, shape (b, d, n)."""
    beams = positions[:, :, None] - readings.targets
    ranges = np.maximum(np.sqrt(np.einsum("bdn,bdn->bn", beams, beams)), 1e-12)
    return readings.distances - ranges, beams / ranges[:, None]


def robust_scale(readings: Readings, residuals: Float[np.ndarray, "b n"]) -> Float[np.ndarray, "b 1"]:
    """Robust standard deviation of residual / u: median absolute value, for the unknowns' share enlarged."""
    median = np.median(np.abs(residuals / readings.u), axis=-1, keepdims=True)
    enlarged = 1.4826 * median * np.sqrt(readings.distances.size / readings.redundancy)
    return np.maximum(enlarged, readings.floor)


def robust_weights(readings: Readings, residuals: np.ndarray, scale: np.ndarray, biweight: bool) -> np.ndarray:
    """Robust weights divided by u²: Huber's, or Tukey's biweight with a trace left so that every segment keeps some weight."""
    z = np.abs(residuals / readings.u) / scale
    if biweight:
        robust = np.maximum((1 - np.minimum(z / BIWEIGHT, 1) ** 2) ** 2, 1e-4 / np.maximum(z, 1) ** 2)
    else:
        robust = HUBER / np.maximum(z, HUBER)
    return robust / readings.u**2


def first_residuals(readings: Readings, positions: Float[np.ndarray, "b d"]) -> Float[np.ndarray, "b n"]:
    """Residuals with each dead path the median of its segment, which outliers do not move."""
    misfit, _ = misfits(readings, positions)
    if not readings.relative:
        return misfit
    bounds = zip(readings.first, readings.first + readings.counts, strict=True)
    medians = np.stack([np.median(misfit[:, a:b], axis=1) for a, b in bounds], axis=1)
    return misfit - np.repeat(medians, readings.counts, axis=1)


def refine(
    readings: Readings, positions: Float[np.ndarray, "b d"], iterations: int, biweight: bool = False
) -> Float[np.ndarray, "b d"]:
    """Damped Gauss-Newton on several positions at once, dead paths eliminated, weights renewed in each iteration.

    A step is taken when it lowers the weighted sum of squares, which bounds the robust cost from above.
    """
    residuals = first_residuals(readings, positions)
    scale, damping = robust_scale(readings, residuals), np.full(len(positions), 1e-3)
    enough = 1e-3 * np.median(readings.u) / np.sqrt(readings.distances.size)
    for _ in range(iterations):
        scale = scale if biweight else robust_scale(readings, residuals)
        weights = robust_weights(readings, residuals, scale, biweight)
        misfit, slopes = misfits(readings, positions)
        residuals, jacobian = centred(readings, misfit, weights), centred(readings, slopes, weights[:, None])
        step = _step(residuals, jacobian, weights, damping)
        trial = centred(readings, misfits(readings, positions + step)[0], weights)
        better = (weights * trial**2).sum(axis=1) < (weights * residuals**2).sum(axis=1)
        better &= np.linalg.norm(positions + step, axis=1) < FARTHEST
        positions = np.where(better[:, None], positions + step, positions)
        residuals = np.where(better[:, None], trial, residuals)
        damping = np.clip(damping * np.where(better, 0.1, 10.0), 1e-12, 1e9)
        if (np.linalg.norm(step, axis=1) < np.maximum(enough * scale[:, 0], 1e-14)).all():
            break
    return positions


def _step(residuals, jacobian, weights, damping) -> Float[np.ndarray, "b d"]:
    """Levenberg-Marquardt step of each position; small (d x d) normal equations, columns scaled to 1."""
    normal = (jacobian * weights[:, None]) @ jacobian.transpose(0, 2, 1)
    gradient = np.einsum("bdn,bn->bd", jacobian, weights * residuals)
    size = np.sqrt(np.maximum(np.einsum("bdd->bd", normal), 1e-300))
    scaled = normal / size[:, :, None] / size[:, None, :]
    scaled += damping[:, None, None] * np.eye(size.shape[1])
    return np.linalg.solve(scaled, (gradient / size)[:, :, None])[:, :, 0] / size


def robust_costs(readings: Readings, positions: Float[np.ndarray, "b d"]) -> Float[np.ndarray, " b"]:
    """Huber's cost of each position, all on the smallest of their scales."""
    residuals = first_residuals(readings, positions)
    z = np.abs(residuals / readings.u) / robust_scale(readings, residuals).min()
    return np.where(z < HUBER, z**2 / 2, HUBER * (z - HUBER / 2)).sum(axis=1)
