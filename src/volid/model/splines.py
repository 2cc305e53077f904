"""Uniform B-splines: bases, tensor products, and the linear functionals that a datum needs.

A basis is a small hashable description; `evaluate` turns it into numbers for many positions at once, in NumPy or in JAX, which
can differentiate the functions with respect to position.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import space


class Spline(NamedTuple):
    """B-spline of `degree` with `segments` equal intervals on [low, high], over axis number `axis`.

    `periodic`: the function has period high - low (360° of a rotary axis); `segments` must exceed `degree`.
    """

    axis: int
    low: float
    high: float
    segments: int
    degree: int
    periodic: bool = False

    @property
    def size(self) -> int:
        """Number of coefficients: segments + degree, or segments when periodic."""
        return self.segments if self.periodic else self.segments + self.degree


class Basis(NamedTuple):
    """What a block of coefficients is multiplied with.

    `factors`: none for a constant, one spline for a function of its axis, two for a tensor product (cross effect).
    `linear`: (axis number, reference) for the factor q - reference, used by squareness. `directed`: number of the axis
    whose approach direction / 2 multiplies the basis (reversal), or -1.
    """

    factors: tuple[Spline, ...] = ()
    linear: tuple[int, float] | None = None
    directed: int = -1

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return int(np.prod([f.size for f in self.factors], dtype=int)) if self.factors else 1


def spline_interval(spline: Spline, x: Any) -> tuple[Any, Any]:
    """Number of the interval in which each `x` lies, and x in interval widths from the interval's lower end."""
    functions = space(x)
    t = (x - spline.low) * (spline.segments / (spline.high - spline.low))
    if spline.periodic:
        t = t - spline.segments * functions.floor(t / spline.segments)
    interval = functions.clip(functions.floor(t), 0, spline.segments - 1)
    return interval, t - interval


def local_values(spline: Spline, u: Any) -> list[Any]:
    """Values of the degree + 1 basis functions that are not 0 in an interval, at `u` in interval widths from its lower end.

    Number r of them belongs to coefficient interval + r (modulo the number of segments when periodic). Cox-de Boor recursion on
    integer knots (Piegl and Tiller, The NURBS Book, algorithm A2.2).
    """
    functions = space(u)
    local = [functions.ones_like(u)]
    for d in range(1, spline.degree + 1):
        saved = functions.zeros_like(u)
        following = []
        for r in range(d):
            share = local[r] * (1.0 / d)
            following.append(saved + (r + 1 - u) * share)
            saved = (u + d - r - 1) * share
        local = [*following, saved]
    return local


def spline_values(spline: Spline, x: Any, first: Any = 0, count: int | None = None) -> Any:
    """Values of the basis functions at `x`, shape (size, m), or of `count` of them from number `first` on, (count, m).

    Outside [low, high] the end polynomials go on.
    """
    functions = space(x)
    interval, u = spline_interval(spline, x)
    number = functions.arange(spline.size if count is None else count, dtype=u.dtype) + first
    offset = number[:, None] - interval[None, :]
    if spline.periodic:
        offset = functions.where(offset < 0, offset + spline.segments, offset)
    values = enumerate(local_values(spline, u))
    return sum(functions.where(offset == r, weight[None, :], 0.0) for r, weight in values)


def evaluate(basis: Basis, q: Any, direction: Any) -> Any:
    """Basis values at positions `q`, shape (n_axes, m), approached in `direction` (n_axes, m); shape (size, m)."""
    values = space(q).ones((1, q.shape[1]))
    for factor in basis.factors:
        right = spline_values(factor, q[factor.axis])
        values = (values[:, None, :] * right[None, :, :]).reshape(-1, q.shape[1])
    if basis.linear is not None:
        values = values * (q[basis.linear[0]] - basis.linear[1])
    if basis.directed >= 0:
        values = values * (0.5 * direction[basis.directed])
    return values


def design_matrix(spline: Spline, x: np.ndarray) -> np.ndarray:
    """Values of all basis functions at `x`, shape (m, size), NumPy: the transpose of `spline_values`."""
    return np.asarray(spline_values(spline, np.atleast_1d(np.asarray(x, dtype=float)))).T


@lru_cache(maxsize=512)
def value_row(spline: Spline, x: float) -> np.ndarray:
    """Row of the functional f -> f(x), shape (size,)."""
    return design_matrix(spline, np.array([x]))[0]


@cache
def gauss_legendre(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights (n,) over -1 … 1; hundreds of nodes take longer to find than everything that they are used for."""
    return np.polynomial.legendre.leggauss(n)


@lru_cache(maxsize=64)
def quadrature(low: float, high: float, segments: int, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights, `order` per segment, that integrate over [low, high]."""
    nodes, weights = gauss_legendre(order)
    edges = np.linspace(low, high, segments + 1)
    half = 0.5 * (edges[1] - edges[0])
    return (0.5 * (edges[:-1] + edges[1:])[:, None] + half * nodes).ravel(), np.tile(half * weights, segments)


def segments_within(spline: Spline, low: float, high: float) -> int:
    """Number of the spline's segments within [low, high], whose ends are knots."""
    return round(spline.segments * (high - low) / (spline.high - spline.low))


@lru_cache(maxsize=512)
def slope_row(spline: Spline, low: float, high: float) -> np.ndarray:
    """Row of the functional f -> least-squares slope over [low, high], whose ends are knots, shape (size,).

    slope = ∫ (x - mid) f dx / ∫ (x - mid)² dx, uniform weight, by Gauss-Legendre quadrature that is exact for the spline.
    """
    x, w = quadrature(low, high, segments_within(spline, low, high), spline.degree // 2 + 2)
    arm = x - 0.5 * (low + high)
    return (w * arm) @ design_matrix(spline, x) / np.sum(w * arm**2)


def mean_row(spline: Spline, low: float, high: float) -> np.ndarray:
    """Row of the functional f -> mean over [low, high], whose ends are knots, shape (size,). Exact quadrature."""
    return harmonic_rows(spline, low, high)[0]


@lru_cache(maxsize=512)
def harmonic_rows(spline: Spline, low: float, high: float) -> np.ndarray:
    """Rows of f -> mean of f, of f cos x and of f sin x over [low, high] with x in degrees, shape (3, size).

    Gauss-Legendre quadrature, [low, high] ending at knots: exact for the mean, better than 1e-12 of the largest value for the
    others.
    """
    within = segments_within(spline, low, high)
    segments = within * max(1, int(np.ceil((high - low) / within / 15.0)))
    x, w = quadrature(low, high, segments, spline.degree // 2 + 6)
    values = design_matrix(spline, x)
    angle = np.deg2rad(x)
    return np.stack([(w * f) @ values for f in (np.ones_like(x), np.cos(angle), np.sin(angle))]) / np.sum(w)


@lru_cache(maxsize=512)
def end_slope_row(spline: Spline, low: float, high: float) -> np.ndarray:
    """Row of the functional f -> slope of the line through the points at both ends of [low, high], shape (size,)."""
    return (value_row(spline, high) - value_row(spline, low)) / (high - low)


@lru_cache(maxsize=512)
def refinement(coarse: Spline, fine: Spline) -> np.ndarray:
    """Coefficients in `fine` of every basis function of `coarse`, shape (fine.size, coarse.size).

    Exact when fine.segments is a multiple of coarse.segments (knot insertion), which it must be.
    """
    if fine.segments % coarse.segments or fine.degree != coarse.degree or fine.periodic != coarse.periodic:
        raise ValueError(f"{fine.segments} segments do not refine {coarse.segments} segments")
    x = np.linspace(fine.low, fine.high, 4 * fine.size)
    return np.linalg.lstsq(design_matrix(fine, x), design_matrix(coarse, x), rcond=None)[0]
