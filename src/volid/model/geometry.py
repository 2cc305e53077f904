"""Rigid motions on component arrays: a vector is a tuple (x, y, z) of equally shaped arrays.

Separate component arrays instead of (m, 3) arrays keep the long dimension contiguous, which makes the whole fit several
times faster on a CPU.
"""

from __future__ import annotations

from typing import Any

from volid.backend.elementary import cos_sin, sqrt

Vector = tuple[Any, Any, Any]


def add(a: Vector, b: Vector) -> Vector:
    """Sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def subtract(a: Vector, b: Vector) -> Vector:
    """Difference a - b of two vectors."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


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


def rotation_vector(columns: tuple[Vector, Vector, Vector]) -> Vector:
    """Rotation vector [rad] of a nearly identical rotation given by its three columns: the antisymmetric part.

    sin(θ)·axis instead of θ·axis: below 2e-10 rad at 1 mrad.
    """
    ex, ey, ez = columns
    return 0.5 * (ey[2] - ez[1]), 0.5 * (ez[0] - ex[2]), 0.5 * (ex[1] - ey[0])
