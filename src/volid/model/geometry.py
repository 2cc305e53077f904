"""Rigid motions on component arrays: a vector is a tuple (x, y, z) of equally shaped arrays.

Separate component arrays instead of (m, 3) arrays keep the long dimension contiguous, which makes a fit several times faster
on a CPU. Only `skew`, `across_pair` and `best_rigid_motion` take vectors as rows of an array.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from volid.backend.elementary import cos_sin, sqrt

if TYPE_CHECKING:
    from jaxtyping import Float

Vector = tuple[Any, Any, Any]


def three_numbers(given: Any) -> tuple[float, float, float] | None:
    """Three finite numbers that somebody has stated; None for anything else."""
    try:
        x, y, z = (float(v) for v in given)
    except (TypeError, ValueError, OverflowError):
        return None
    return (x, y, z) if np.all(np.isfinite([x, y, z])) else None


def add(a: Vector, b: Vector) -> Vector:
    """Sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def subtract(a: Vector, b: Vector) -> Vector:
    """Difference a - b of two vectors."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def skew(v: np.ndarray) -> np.ndarray:
    """[v]×, (..., 3, 3), of vectors given as rows (..., 3): [v]× x = v × x, and what a rotation ω does is ω × v = [v]×ᵀ ω."""
    result = np.zeros((*np.shape(v), 3))
    result[..., [2, 0, 1], [1, 2, 0]] = v
    result[..., [1, 2, 0], [2, 0, 1]] = -v
    return result


def across_pair(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two orthonormal vectors (3,) across the unit vector `direction` (3,); coordinate directions when it is one."""
    first = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = first - direction * (direction @ first)
    first = first / np.linalg.norm(first)
    return first, np.cross(direction, first)


def dot(a: Vector, b: Vector) -> Any:
    """Scalar product a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(a: Vector) -> Any:
    """Euclidean length."""
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def rotate_small(rotation: Vector, x: Vector) -> Vector:
    """Turn `x` by a small rotation vector: x + ω × x + ω × (ω × x) / 2.

    Exact to second order; what is left out is θ³/6: 2e-10 mm per metre at 100 µrad, 2e-7 mm at 1 mrad. Not meant for
    nominal rotations; see `rotate_about`.
    """
    first = cross(rotation, x)
    second = cross(rotation, first)
    return x[0] + first[0] + 0.5 * second[0], x[1] + first[1] + 0.5 * second[1], x[2] + first[2] + 0.5 * second[2]


def rotate_exactly(rotation: Vector, x: Vector) -> Vector:
    """Turn `x` by the exact rotation by 2 arctan(|o|/2) about o: a rotation vector to third order, smooth at 0 and of any size.

    x + (o × x + o × (o × x) / 2) / (1 + |o|²/4) (Cayley's transform; Bauchau, Flexible Multibody Dynamics, 13.4).
    """
    first = cross(rotation, x)
    second = cross(rotation, first)
    share = 1.0 / (1.0 + 0.25 * dot(rotation, rotation))
    return tuple(x[i] + share * (first[i] + 0.5 * second[i]) for i in range(3))  # type: ignore[return-value]


def rotate_about(direction: tuple[float, float, float], angle: Any, x: Vector) -> Vector:
    """Turn `x` by `angle` [rad] about the unit vector `direction` (Rodrigues' formula)."""
    c, s = cos_sin(angle)
    along = (direction[0] * x[0] + direction[1] * x[1] + direction[2] * x[2]) * (1.0 - c)
    turned = cross(direction, x)
    return (
        c * x[0] + s * turned[0] + direction[0] * along,
        c * x[1] + s * turned[1] + direction[1] * along,
        c * x[2] + s * turned[2] + direction[2] * along,
    )


def turned_direction(frame: Sequence[Any], angles: Sequence[Any]) -> Vector:
    """The unit vector `frame`[0], turned by two tangents towards `frame`[1] and [2], by a rotation vector, or not.

    With two, (d + β1 a + β2 b) / sqrt(1 + β1² + β2²), for d, a, b at right angles.
    """
    if not len(angles):
        return tuple(frame[0])  # type: ignore[return-value]
    if len(angles) == 3:
        return rotate_exactly(tuple(angles), tuple(frame[0]))  # type: ignore[arg-type]
    size = sqrt(1.0 + angles[0] * angles[0] + angles[1] * angles[1])
    along, first, second = frame
    return tuple((along[i] + angles[0] * first[i] + angles[1] * second[i]) / size for i in range(3))  # type: ignore[return-value]


def rotation_vector(columns: tuple[Vector, Vector, Vector]) -> Vector:
    """Rotation vector [rad] of a rotation close to the identity, given by its three columns: the antisymmetric part.

    sin(θ)·axis instead of θ·axis: below 2e-10 rad at 1 mrad.
    """
    ex, ey, ez = columns
    return 0.5 * (ey[2] - ez[1]), 0.5 * (ez[0] - ex[2]), 0.5 * (ex[1] - ey[0])


class RigidMotion(NamedTuple):
    """x -> R x + t: `rotation` R, shape (3, 3), and `translation` t, shape (3,) [mm]."""

    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, " 3"]

    def __call__(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Points (m, 3) [mm] carried along."""
        return np.asarray(points @ self.rotation.T + self.translation)


def best_rigid_motion(points: Float[np.ndarray, "m 3"], targets: Float[np.ndarray, "m 3"]) -> RigidMotion:
    """The rigid motion that carries `points` onto `targets`, both (m, 3) [mm], with the least sum of squared distances.

    By the singular value decomposition of the cross-covariance, mirror images excluded (Kabsch, Acta Cryst. A32 (1976) 922;
    Umeyama, IEEE PAMI 13 (1991) 376). Points on one line leave the rotation about it open: one of many is returned.

    >>> square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    >>> quarter_turn = best_rigid_motion(square, np.roll(square, -1, axis=0))
    >>> quarter_turn.rotation.round(9) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    >>> (quarter_turn.translation.round(9) + 0.0).tolist()
    [1.0, 0.0, 0.0]
    """
    centre, middle = points.mean(axis=0), targets.mean(axis=0)
    u, _, vt = np.linalg.svd((points - centre).T @ (targets - middle))
    rotation = vt.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))]) @ u.T
    return RigidMotion(rotation, middle - rotation @ centre)
