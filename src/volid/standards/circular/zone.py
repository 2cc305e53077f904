"""Circles through a path: the two concentric ones that enclose it most narrowly, and the least-squares one.

A point of the path stands at p = c0 + L·d, with L the length that was read and d the direction from the centre c0. Its
distance from a centre c0 + x is L - d·x to first order; what is left out, (d×x)²/(2R), is taken into account by beginning
again at the new centre. The minimum zone is then a linear programme in x, the inner radius and the width: it has one
optimum, and no start value.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_DONE = 1e-7  # mm: the centre moves no farther
_ROUNDS = 12
_MICRO = 1e3  # µm in a mm: what the linear programme computes in, whose tolerances are absolute


class Zone(NamedTuple):
    """Two concentric circles about a path.

    `centre` (2,) [mm], from the one that the radii were read from; `inner` radius, less the nominal one, and `width` [mm].
    `weights` (m,): ∂width/∂reading; they are not 0 where a circle touches the path.
    """

    centre: np.ndarray
    inner: float
    width: float
    weights: np.ndarray


def minimum_zone(direction: np.ndarray, deviation: np.ndarray, radius: float) -> Zone:
    """The concentric circles with the least radial separation that enclose a path.

    Args:
        direction: Unit vectors from the centre, shape (m, 2).
        deviation: Radii less `radius`, shape (m,) [mm].
        radius: Nominal radius [mm].

    Returns:
        The circles. On an arc centre and radius can exchange, and the separation can be far less than about a given centre.

    Reference: minimum zone circles, ISO/TS 12181-1 and ISO 230-4; the programme is Chebyshev's approximation by a circle.

    >>> phi = np.linspace(0.0, 2.0 * np.pi, 361)
    >>> direction = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    >>> zone = minimum_zone(direction, 0.005 * np.sin(2.0 * phi) + 0.02 * np.cos(phi), 100.0)
    >>> round(zone.width, 6), round(float(zone.centre[0]), 5)
    (0.01, 0.02)
    """
    from scipy.optimize import linprog  # slow to import

    length = radius + deviation
    points, centre = length[:, None] * direction, np.zeros(2)
    one, none = np.ones((len(points), 1)), np.zeros((len(points), 1))
    for _ in range(_ROUNDS):
        away = points - centre
        distance = np.linalg.norm(away, axis=1)
        d, y = away / distance[:, None], _MICRO * (distance - radius)
        A = np.block([[-d, -one, -one], [d, one, none]])  # y - d·x <= inner + width and >= inner
        free = [(-_MICRO * radius, _MICRO * radius)] * 2 + [(None, None), (0.0, None)]
        found = linprog([0.0, 0.0, 0.0, 1.0], A, np.concatenate([-y, y]), bounds=free, method="highs")
        step = found.x[:2] / _MICRO
        centre = centre + step
        if np.linalg.norm(step) < _DONE:
            break
    lower, upper = found.ineqlin.marginals[len(y) :], found.ineqlin.marginals[: len(y)]
    return Zone(centre, float(found.x[2]) / _MICRO, float(found.x[3]) / _MICRO, lower - upper)


class LeastSquaresCircle(NamedTuple):
    """`centre` (2,): place of the bar's socket from the centre of the path, which errors move too; `radius`: mean radius less the
    nominal one, by part (k,); `direction` (m, 2): from the socket to the commanded points; `deviation` (m,): radii about it, less
    the nominal one [mm]. `gain` (2 + k, m): ∂(centre, radius)/∂reading."""

    centre: np.ndarray
    radius: np.ndarray
    direction: np.ndarray
    deviation: np.ndarray
    gain: np.ndarray


def least_squares_circle(
    direction: np.ndarray, deviation: np.ndarray, radius: float, part: np.ndarray, share: np.ndarray
) -> LeastSquaresCircle:
    """Where the socket stands, such that the lengths that are read fit circles best.

    A bar of length L from a socket at c to the commanded point R·n reads L = |R·n - c| + deviation: exact in c. Radii are taken
    about it; each part of the readings has its own mean radius.

    Args:
        direction: Unit vectors n from the programmed centre, shape (m, 2).
        deviation: Lengths that were read less `radius`, shape (m,) [mm].
        radius: Nominal radius [mm].
        part: Number of the part, shape (m,), from 0.
        share: Part of the path that each reading stands for, shape (m,).

    >>> phi = np.linspace(0.0, 2.0 * np.pi, 73)
    >>> n = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    >>> read = np.linalg.norm(100.0 * n - [0.3, -0.1], axis=1) - 100.0 + 0.002
    >>> circle = least_squares_circle(n, read, 100.0, np.zeros(73, dtype=int), np.ones(73))
    >>> circle.centre.round(6).tolist(), circle.radius.round(6).tolist()
    ([0.3, -0.1], [0.002])
    """
    parts = (part[:, None] == np.arange(part.max() + 1)).astype(float)
    centre, weight = np.zeros(2), np.sqrt(share)
    for _ in range(_ROUNDS):
        away = radius * direction - centre
        distance = np.linalg.norm(away, axis=1)
        d, y = away / distance[:, None], deviation + radius - distance
        gain = np.linalg.pinv(weight[:, None] * np.hstack([-d, parts])) * weight
        found = gain @ y
        centre = centre + found[:2]
        if np.linalg.norm(found[:2]) < _DONE:
            break
    return LeastSquaresCircle(centre, found[2:], d, y, gain)
