"""What the distances determine: rank, datum, directions that move nothing, and those that count to second order only.

A direction is a motion of the free coordinates. The singular values of the Jacobian tell to first order how the distances follow
it. Where an unknown point lies in the plane of the points it is measured from, its height moves nothing to first order; the
sum of squares has a minimum all the same, because the distances depend on the square. Close to that plane the first order is
still not enough: what it calls one standard uncertainty leads so far that the second order is larger.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigvalsh

from volid.multilateration.equations import Equations, part

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

RANK_TOLERANCE = 1e-9  # singular values of the Jacobian divided by u, relative to the largest; rounding leaves 1e-15
_LINEAR = 0.5  # second order over u at one standard uncertainty; a point as high above the plane as its u has this one
_STRAIGHT = 1e-6  # share of the second derivative that other coordinates do not take up: below, the direction is free
VISIBLE = 0.1  # share of u: what a direction that is not determined adds to a coordinate, below which u may stand
_ITERATIONS = 100


@dataclass(frozen=True)
class Determination:
    """Singular value decomposition of the Jacobian of the observations kept, cut at its rank r, and its null space.

    Attributes:
        vectors: Shape (m, r), left singular vectors.
        sizes: Shape (r,).
        axes: Shape (r, k), right singular vectors as rows.
        weak: Shape (r,), directions of which the first order does not hold over one standard uncertainty.
        rigid: Shape (k, g), rigid motions of all points that leave the fixed ones in place.
        open: Shape (k, q), orthonormal: the other directions that move no distance to first order.
        reach: Shape (q,), how far the second order allows to go along them: it moves the distances by u. Infinite: it does not
            limit.
        weak_reach: The same along the weak axes, in their order.
    """

    vectors: Float[np.ndarray, "m r"]
    sizes: Float[np.ndarray, " r"]
    axes: Float[np.ndarray, "r k"]
    weak: Bool[np.ndarray, " r"]
    rigid: Float[np.ndarray, "k g"]
    open: Float[np.ndarray, "k q"]
    reach: Float[np.ndarray, " q"]
    weak_reach: Float[np.ndarray, " w"]

    @property
    def covariance(self) -> Float[np.ndarray, "k k"]:
        """Covariance of the coordinates from what is determined to first order."""
        axes = self.axes[~self.weak] / self.sizes[~self.weak, None]
        return axes.T @ axes

    @property
    def held(self) -> Float[np.ndarray, "k h"]:
        """Directions that are limited by the second order alone."""
        return np.hstack([self.axes[self.weak].T, self.open[:, np.isfinite(self.reach)]])


def decomposition(equations: Equations, x: np.ndarray, kept: np.ndarray):
    """Singular value decomposition of the Jacobian of the observations `kept`, cut at its rank; axes as rows."""
    vectors, sizes, axes = np.linalg.svd(part(equations, kept).jacobian(x), full_matrices=False)
    rank = int((sizes > RANK_TOLERANCE * sizes[0]).sum())
    return vectors[:, :rank], sizes[:rank], axes[:rank]


def determine(equations: Equations, x: Float[np.ndarray, "p d"]) -> Determination:
    """What the observations determine at coordinates x."""
    jacobian = equations.jacobian(x)
    missing = max(jacobian.shape[1] - jacobian.shape[0], 0)  # rows of zeros: then all right singular vectors come
    vectors, sizes, axes = np.linalg.svd(
        np.vstack([jacobian, np.zeros((missing, jacobian.shape[1]))]), full_matrices=False
    )
    rank = int((sizes > RANK_TOLERANCE * sizes[0]).sum())
    vectors = vectors[: jacobian.shape[0]]
    rigid = rigid_motions(equations, x)
    opened = _apart(axes[rank:].T, rigid)
    weak, weak_reach = _weak(equations, x, vectors[:, :rank], sizes[:rank], axes[:rank])
    strong = vectors[:, :rank][:, ~weak]
    return Determination(
        vectors[:, :rank],
        sizes[:rank],
        axes[:rank],
        weak,
        rigid,
        opened,
        _reach(equations, x, opened, strong),
        weak_reach,
    )


def _apart(null: Float[np.ndarray, "k n"], rigid: Float[np.ndarray, "k g"]) -> Float[np.ndarray, "k q"]:
    """Orthonormal basis of the null space without the rigid motions."""
    others = max(null.shape[1] - rigid.shape[1], 0)
    if not others or not rigid.shape[1]:
        return null[:, :others]
    return np.linalg.svd(null - rigid @ (rigid.T @ null), full_matrices=False)[0][:, :others]


def _reach(equations: Equations, x: np.ndarray, motions: np.ndarray, strong: np.ndarray) -> Float[np.ndarray, " q"]:
    """How far along each motion the second order moves the distances by u; infinite where other coordinates take it up."""
    bending = equations.bending(x, motions)
    left = np.linalg.norm(bending - strong @ (strong.T @ bending), axis=0)
    bends = left > _STRAIGHT * np.linalg.norm(bending, axis=0)
    return np.sqrt(np.where(bends, 2 / np.where(bends, left, 1.0), np.inf))


def _most_bending(equations: Equations, x: np.ndarray) -> float:
    """A bound of the second derivative along any unit motion."""
    degree = np.bincount(np.concatenate([equations.start, equations.end])).max()
    return float(2 * degree / (np.maximum(equations.beams(x).lengths, 1e-12 * equations.extent) * equations.u).min())


def _weak(equations: Equations, x: np.ndarray, vectors: np.ndarray, sizes: np.ndarray, axes: np.ndarray):
    """Which axes the second order overrules within one standard uncertainty, and how far it lets them go."""
    suspicious = 0.5 * _most_bending(equations, x) > _LINEAR * sizes**2
    reach = _reach(equations, x, axes[suspicious].T, vectors[:, ~suspicious])
    overruled = 1 / sizes[suspicious] ** 2 > _LINEAR * reach**2
    weak = np.zeros(sizes.size, bool)
    weak[np.flatnonzero(suspicious)[overruled]] = True
    return weak, reach[overruled]


def first_order_holds(equations: Equations, x: Float[np.ndarray, "p d"]) -> bool:
    """Whether the first order determines all but rigid motions, and nothing so weakly that the second order matters.

    Quick, from the smallest eigenvalue of JᵀJ; near the limit the answer is no.
    """
    rigid, normal = rigid_motions(equations, x), equations.curvature(x, exact=False)
    full = normal + np.trace(normal) / len(normal) * (rigid @ rigid.T)
    return float(eigvalsh(full, subset_by_index=[0, 0])[0]) * _LINEAR > 0.5 * _most_bending(equations, x)


def nearest(equations: Equations, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "p d"]:
    """Of the solutions equivalent to x the one nearest the approximate coordinates: the inner constraints.

    It also refines the solution, because each iteration is a full Gauss-Newton step; directions that the second order limits stay
    where they are.
    """
    origin, simple = equations.approximate[equations.free].ravel(), first_order_holds(equations, x)
    for _ in range(_ITERATIONS):
        jacobian, correction = equations.jacobian(x), x[equations.free].ravel() - origin
        right = equations.residuals(x) + jacobian @ correction
        if simple:
            wanted = np.linalg.lstsq(jacobian, right, rcond=RANK_TOLERANCE)[0]
        else:
            found = determine(equations, x)
            strong = ~found.weak
            wanted = found.axes[strong].T @ (found.vectors[:, strong].T @ right / found.sizes[strong])
            wanted += found.held @ (found.held.T @ correction)
        x = equations.moved(x, wanted - correction)
        if np.abs(wanted - correction).max() < 1e-12 * equations.extent:
            break
    return x


def rigid_motions(equations: Equations, x: np.ndarray) -> Float[np.ndarray, "k g"]:
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


def movement(equations: Equations, found: Determination) -> Float[np.ndarray, "p d q"]:
    """How far directions that are not determined move each coordinate, rigid motions of most points taken off.

    Infinite reach counts as the extent of the network.
    """
    reach = np.minimum(np.concatenate([found.reach, found.weak_reach]), equations.extent)
    motion = np.hstack([found.open, found.axes[found.weak].T])
    if found.rigid.shape[1] and found.open.shape[1]:
        motion = _sparse(motion, found.rigid, equations.approximate.shape[1])
    full = np.zeros((*equations.approximate.shape, reach.size))
    full[equations.free] = (motion * reach).reshape(equations.free.sum(), full.shape[1], reach.size)
    return full


def _sparse(motion: Float[np.ndarray, "k q"], rigid: Float[np.ndarray, "k g"], d: int) -> Float[np.ndarray, "k q"]:
    """Motions without the rigid one that most points follow: least sum of the points' movements.

    When fewer than half the points stay (a flat network in space has no rigid body larger than a triangle), as they were.
    """
    weights, apart = np.ones(len(motion)), motion
    for _ in range(50):
        rows = np.sqrt(weights)[:, None]
        apart = motion - rigid @ np.linalg.lstsq(rigid * rows, motion * rows, rcond=None)[0]
        size = np.linalg.norm(apart.reshape(len(motion) // d, d * motion.shape[1]), axis=1)
        weights = np.repeat(1 / np.maximum(size, 1e-6 * size.max()), d)
    moved = size > 0.01 * size.max()
    return motion if moved.mean() > 0.5 else apart * np.repeat(moved, d)[:, None]


def held_by_the_datum(equations: Equations, covariance: Float[np.ndarray, "k k"]) -> Bool[np.ndarray, "p d"]:
    """Coordinates of free points that no distance determines: without a variance, because inner constraints alone hold them."""
    variance = np.full(equations.approximate.shape, np.inf)
    variance[equations.free] = np.diag(covariance).reshape(-1, equations.approximate.shape[1])
    return variance < (RANK_TOLERANCE * equations.u.min()) ** 2


def not_determined(
    equations: Equations, covariance: Float[np.ndarray, "k k"], moved: Float[np.ndarray, "p d q"]
) -> Bool[np.ndarray, "p d"]:
    """Coordinates that are moved by more than a tenth of their u, rounding left aside."""
    variance = np.zeros(moved.shape[:2])
    variance[equations.free] = np.diag(covariance).reshape(-1, moved.shape[1])
    size = np.linalg.norm(moved, axis=2)
    largest = size.max(axis=1, keepdims=True, initial=0.0)
    return (size > VISIBLE * np.sqrt(variance)) & (size > 1e-5 * largest) & (size > 0)
