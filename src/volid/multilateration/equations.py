"""The distance equations in numbers: residuals, Jacobian, descent, inner constraints, rank, and what is not determined."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from volid.backend.rms import rms
from volid.exceptions import InputError

RANK_TOLERANCE = 1e-9  # singular values of the Jacobian divided by u, relative to the largest; rounding leaves 1e-15
_ITERATIONS = 100


@dataclass(frozen=True)
class Equations:
    """A distance network in numbers: coordinates minus their mean, points as rows; one row per observation."""

    approximate: Float[np.ndarray, "p d"]
    free: Bool[np.ndarray, " p"]
    start: Int[np.ndarray, " m"]
    end: Int[np.ndarray, " m"]
    readings: Float[np.ndarray, " m"]
    u: Float[np.ndarray, " m"]

    @property
    def extent(self) -> float:
        """Root mean square distance of the points from their mean."""
        return rms(np.linalg.norm(self.approximate, axis=1))

    def residuals(self, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, " m"]:
        """Reading - predicted at coordinates x, divided by u."""
        return (self.readings - np.linalg.norm(x[self.end] - x[self.start], axis=1)) / self.u

    def jacobian(self, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "m k"]:
        """Derivative of the predicted distances by the free coordinates, divided by u: plus and minus the direction."""
        beams = x[self.end] - x[self.start]
        directions = beams / (np.maximum(np.linalg.norm(beams, axis=1), 1e-12 * self.extent) * self.u)[:, None]
        rows, full = np.arange(self.u.size), np.zeros((self.u.size, *x.shape))
        full[rows, self.end], full[rows, self.start] = directions, -directions
        return full[:, self.free].reshape(self.u.size, -1)

    def moved(self, x: Float[np.ndarray, "p d"], step: Float[np.ndarray, " k"]) -> Float[np.ndarray, "p d"]:
        """Coordinates x with a step in the free ones."""
        result = x.copy()
        result[self.free] += step.reshape(-1, x.shape[1])
        return result


def part(equations: Equations, kept: np.ndarray, weights: np.ndarray | None = None) -> Equations:
    """The network of the observations `kept`, with u divided by the square root of the weights."""
    u = equations.u if weights is None else equations.u / np.sqrt(weights)
    return replace(
        equations, start=equations.start[kept], end=equations.end[kept], readings=equations.readings[kept], u=u[kept]
    )


def descend(equations: Equations, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "p d"]:
    """Gauss-Newton with minimum-norm steps, halved until they lower the sum of squares."""
    residuals = equations.residuals(x)
    for _ in range(_ITERATIONS):
        step = np.linalg.lstsq(equations.jacobian(x), residuals, rcond=RANK_TOLERANCE)[0]
        for halving in range(30):
            trial = equations.moved(x, step * 0.5**halving)
            changed = equations.residuals(trial)
            if changed @ changed < residuals @ residuals:
                break
        else:
            return x
        small = np.abs(trial - x).max() < 1e-10 * equations.extent
        x, residuals = trial, changed
        if small:
            return x
    worst = int(np.argmax(np.abs(residuals)))
    raise InputError(
        f"no solution within {_ITERATIONS} iterations from the approximate coordinates; the worst observation is "
        f"number {worst + 1} of those used. Expected better approximate coordinates, or readings without mixed-up names"
    )


def nearest(equations: Equations, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "p d"]:
    """Of the solutions equivalent to x the one nearest the approximate coordinates: the inner constraints.

    It also refines the solution, because each iteration is a full Gauss-Newton step.
    """
    origin = equations.approximate[equations.free].ravel()
    for _ in range(_ITERATIONS):
        jacobian = equations.jacobian(x)
        correction = x[equations.free].ravel() - origin
        wanted = np.linalg.lstsq(jacobian, equations.residuals(x) + jacobian @ correction, rcond=RANK_TOLERANCE)[0]
        x = equations.moved(x, wanted - correction)
        if np.abs(wanted - correction).max() < 1e-12 * equations.extent:
            break
    return x


def decomposition(equations: Equations, x: np.ndarray, kept: np.ndarray):
    """Singular value decomposition of the Jacobian of the observations `kept`, cut at its rank; axes as rows."""
    vectors, sizes, axes = np.linalg.svd(part(equations, kept).jacobian(x), full_matrices=False)
    rank = int((sizes > RANK_TOLERANCE * sizes[0]).sum())
    return vectors[:, :rank], sizes[:rank], axes[:rank]


def normalised(equations: Equations, x: np.ndarray, kept: np.ndarray, decomposed) -> Float[np.ndarray, " m"]:
    """Residuals over their standard deviation: u² minus the predicted distance's variance, plus for those left out."""
    _, sizes, axes = decomposed
    jacobian = equations.jacobian(x)
    prediction = ((jacobian @ axes.T / sizes) ** 2).sum(axis=1)
    inside = ((jacobian @ axes.T @ axes - jacobian) ** 2).sum(axis=1) < 1e-12 * (jacobian**2).sum(axis=1)
    variance = np.where(kept, 1 - prediction, 1 + prediction)
    checked = (variance > 1e-9) & inside
    return np.where(checked, equations.residuals(x) / np.sqrt(np.where(checked, variance, 1.0)), np.nan)


def undetermined(equations: Equations, x: np.ndarray, axes: np.ndarray) -> tuple[int, list[int]]:
    """Number of rigid motions that are not determined, and the points that the other combinations not determined move."""
    rigid = _rigid_motions(equations, x)
    others = axes.shape[1] - axes.shape[0] - rigid.shape[1]
    if others <= 0:
        return rigid.shape[1], []
    motion = np.linalg.svd(np.vstack([axes, rigid.T]))[2][-others:].T
    weights = np.ones(axes.shape[1])
    for _ in range(50):  # take off the rigid motion that most points follow: least sum of the points' movements
        rows = np.sqrt(weights)[:, None]
        apart = motion - rigid @ np.linalg.lstsq(rigid * rows, motion * rows, rcond=None)[0]
        movement = np.linalg.norm(apart.reshape(-1, x.shape[1] * others), axis=1)
        weights = np.repeat(1 / np.maximum(movement, 1e-6 * movement.max()), x.shape[1])
    return rigid.shape[1], np.flatnonzero(equations.free)[movement > 0.01 * movement.max()].tolist()


def _rigid_motions(equations: Equations, x: np.ndarray) -> Float[np.ndarray, "k g"]:
    """Orthonormal basis of the free points' displacements by rigid motions that leave the fixed points in place."""
    count, dimension = x.shape
    pairs = [(0, 1)] if dimension == 2 else [(0, 1), (0, 2), (1, 2)]
    turns = np.zeros((count, dimension, len(pairs)))
    for k, (a, b) in enumerate(pairs):
        turns[:, a, k], turns[:, b, k] = -x[:, b] / equations.extent, x[:, a] / equations.extent
    motions = np.concatenate([np.broadcast_to(np.eye(dimension), (count, dimension, dimension)), turns], axis=2)
    moving = motions[equations.free].reshape(-1, motions.shape[2])
    holding = motions[~equations.free].reshape(-1, motions.shape[2])
    if holding.size:
        _, sizes, axes = np.linalg.svd(holding)
        moving = moving @ axes[int((sizes > RANK_TOLERANCE * sizes[0]).sum()) :].T
    basis, sizes, _ = np.linalg.svd(moving, full_matrices=False)
    return basis[:, sizes > RANK_TOLERANCE * np.sqrt(count)]
