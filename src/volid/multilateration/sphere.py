"""The centre of a sphere from points on it: geometric least squares, its covariance, and touches that contradict the others.

The residual of a touch is v = |p - c| - r: the point p, the centre c, the radius r of the fitted sphere. Σ v² is least (the
orthogonal distance fit, Forbes 1989, "Least-squares best-fit geometric elements", NPL Report DITC 140/89). With unit
normals n = (p - c)/r, the cofactor matrix of (c, r) is Q = (AᵀA)⁻¹ with rows A = (-n, -1), or (-n) where r is known; the
covariance is u² Q, with u the standard uncertainty of one touch along the normal.

A touch probe reports the centre of its ball: then r is the radius of the sphere plus that of the ball. Not modelled: form
errors of sphere and ball, and a pre-travel of the probe that depends on the direction; they show as scatter, and u contains
them only as far as they change from touch to touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import fdtri

from volid.exceptions import InputError, NotDeterminedError

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

_FLAT = 1e-9  # singular value, of the largest, below which touches lie on one circle
_STEP = 1e-13  # of the radius: smaller steps change nothing
_STEPS = 200
_CHANCE = 1e-3  # of taking the wrong one of two centres


@dataclass(frozen=True, eq=False)
class Sphere:
    """A fitted sphere and how well touches of unit uncertainty determine it.

    Args:
        centre: Shape (3,). [mm]
        radius: Of the fitted sphere, stylus ball included. [mm]
        cofactor: Shape (4, 4) of centre and radius, or (3, 3) of the centre where the radius was known. [1]
        residuals: |p - c| - r of every touch, also of those not used; shape (n,). [mm]
        redundancies: Share of an error of a touch that appears in its own residual, 0 to 1; NaN where not used. Shape (n,).
        used: Which touches took part, shape (n,).

    >>> import numpy as np
    >>> touches = np.concatenate([np.eye(3), -np.eye(3)]) * 15.0 + [100.0, 50.0, -20.0]
    >>> sphere = fit_sphere(touches)
    >>> np.round(sphere.centre, 6).tolist(), round(sphere.radius, 6), sphere.degrees_of_freedom
    ([100.0, 50.0, -20.0], 15.0, 2)
    """

    centre: Float[np.ndarray, " 3"]
    radius: float
    cofactor: Float[np.ndarray, "p p"]
    residuals: Float[np.ndarray, " n"]
    redundancies: Float[np.ndarray, " n"]
    used: Bool[np.ndarray, " n"]

    @property
    def degrees_of_freedom(self) -> int:
        """Touches used minus unknowns."""
        return int(self.used.sum()) - len(self.cofactor)

    @property
    def square_sum(self) -> float:
        """Σ v² of the touches used. [mm²]"""
        return float((self.residuals[self.used] ** 2).sum())

    def covariance(self, u: float) -> Float[np.ndarray, "3 3"]:
        """Covariance of the centre with touches of standard uncertainty `u` [mm]. [mm²]"""
        return u**2 * self.cofactor[:3, :3]

    def check_coverage(self, u: float) -> None:
        """Raises `NotDeterminedError` where touches of standard uncertainty `u` [mm] leave the centre too uncertain to linearise.

        A centre that lies off by d changes the distances by d²/(2r) more than the linear equations say. That must stay below u.
        """
        largest = float(np.sqrt(np.linalg.eigvalsh(self.covariance(u))[-1]))
        if largest**2 > 2.0 * self.radius * max(u, 0.0):
            raise NotDeterminedError(
                f"the touches cover too small a part of the sphere: with u = {1e3 * u:.3g} µm of a touch, the centre would be "
                f"uncertain by {largest:.3g} mm. Touch the pole and at least four points near the equator"
            )


def fit_sphere(points: ArrayLike, radius: float | None = None, used: ArrayLike | None = None) -> Sphere:
    """The sphere that fits points best, as the docstring of the module describes it.

    Args:
        points: Touches (centres of the stylus ball), shape (n, 3). [mm]
        radius: That of the fitted sphere where it is known: of the sphere plus that of the stylus ball. [mm]
        used: Which touches take part, shape (n,); all by default.

    Raises:
        InputError: The array has another shape, holds something not finite, or the radius is not above 0.
        NotDeterminedError: Fewer than four touches, or all on one circle.

    >>> fit_sphere([[0, 0, 1], [1, 0, 0], [-1, 0, 0]])
    Traceback (most recent call last):
    ...
    volid.exceptions.NotDeterminedError: 3 touches; a sphere needs at least four that do not lie on one circle
    """
    p = np.asarray(points, dtype=float)
    _check(p, radius)
    kept = np.ones(len(p), bool) if used is None else np.asarray(used, dtype=bool)
    n = int(kept.sum())
    if n < 4:
        raise NotDeterminedError(f"{n} touches; a sphere needs at least four that do not lie on one circle")
    middle = p[kept].mean(axis=0)
    centre, r = _best(p[kept] - middle, radius)
    normals = (p - middle - centre) / np.maximum(np.linalg.norm(p - middle - centre, axis=1), 1e-300)[:, None]
    residuals = np.linalg.norm(p - middle - centre, axis=1) - r
    cofactor, influence = _cofactor(_design(normals[kept], radius))
    redundancies = np.full(len(p), np.nan)
    redundancies[kept] = 1.0 - influence
    return Sphere(centre + middle, float(r), cofactor, residuals, redundancies, kept)


def _check(p: np.ndarray, radius: float | None) -> None:
    if p.ndim != 2 or p.shape[1] != 3:
        raise InputError(f"`points` has shape {p.shape}; expected (n, 3), a row of x, y, z for every touch")
    if not np.isfinite(p).all():
        raise InputError("`points` holds a number that is not finite; remove the touch")
    if radius is not None and not (np.isfinite(radius) and radius > 0.0):
        raise InputError(
            f"`radius` is {radius:g}; expected a number above 0 (mm), that of the sphere plus the stylus ball"
        )


def _best(p: np.ndarray, radius: float | None) -> tuple[np.ndarray, float]:
    """Centre and radius of least Σ v²; `p` is centred.

    With a known radius, touches near one circle fit a centre on either side of it. Raises `NotDeterminedError` where the
    ratio of the two Σ v² can be chance (F distribution, 0.1 %)."""
    start = _algebraic(p)
    found = _refined(p, start, radius)
    if radius is None:
        return found
    normal = np.linalg.svd(p, full_matrices=False)[2][2]
    mirrored = np.append(found[0] - 2.0 * (found[0] @ normal) * normal, radius)
    other = _refined(p, mirrored, radius)
    costs = [_cost(p, centre, r) for centre, r in (found, other)]
    apart = np.linalg.norm(found[0] - other[0]) > 1e-6 * radius
    freedom = len(p) - 3
    if apart and max(costs) <= fdtri(freedom, freedom, 1.0 - _CHANCE) * min(costs):
        raise NotDeterminedError(
            "the touches lie so near one circle that the centre fits on either side of it; touch the pole too"
        )
    return found if costs[0] <= costs[1] else other


def _refined(p: np.ndarray, start: np.ndarray, radius: float | None) -> tuple[np.ndarray, float]:
    """Centre and radius of least Σ v² near `start` (4,), by damped Gauss-Newton steps."""
    r = start[3] if radius is None else radius
    x = np.append(start[:3], r) if radius is None else start[:3]
    damping, cost = 0.0, _cost(p, x, r)
    for _ in range(_STEPS):
        design, v = _linear(p, x, r, radius)
        step = _damped(design, v, damping)
        new = x + step
        new_r = float(new[3]) if radius is None else r
        if (new_cost := _cost(p, new, new_r)) <= cost * (1.0 + 1e-14):
            x, r, cost, damping = new, new_r, new_cost, damping / 10.0
        else:
            damping = max(10.0 * damping, 1e-6)
        if np.abs(step).max() < _STEP * (abs(r) + np.abs(p).max()):
            break
    return x[:3], abs(r)


def _algebraic(p: np.ndarray) -> np.ndarray:
    """Centre and radius with |p|² = 2 p·c + (r² - |c|²), which is linear.

    Raises `NotDeterminedError` for touches on one circle or line.
    """
    scale = float(np.abs(p).max()) or 1.0
    rows = np.column_stack([2.0 * p / scale, np.ones(len(p))])
    found, _, rank, values = np.linalg.lstsq(rows, (p**2).sum(axis=1) / scale**2, rcond=_FLAT)
    if rank < 4:
        raise NotDeterminedError(
            "all touches lie on one circle, whose axis the centre may lie on anywhere; touch the pole too"
            if values[2] > _FLAT * values[0]
            else "all touches lie on one line; touch the pole and at least four points near the equator"
        )
    return scale * np.append(found[:3], np.sqrt(max(found[3] + found[:3] @ found[:3], 0.0)))


def _design(normals: np.ndarray, radius: float | None) -> np.ndarray:
    return -normals if radius is not None else np.column_stack([-normals, -np.ones(len(normals))])


def _linear(p: np.ndarray, x: np.ndarray, r: float, radius: float | None) -> tuple[np.ndarray, np.ndarray]:
    away = p - x[:3]
    lengths = np.maximum(np.linalg.norm(away, axis=1), 1e-300)
    return _design(away / lengths[:, None], radius), lengths - r


def _cost(p: np.ndarray, x: np.ndarray, r: float) -> float:
    return float(((np.linalg.norm(p - x[:3], axis=1) - r) ** 2).sum())


def _damped(design: np.ndarray, v: np.ndarray, damping: float) -> np.ndarray:
    rows = np.vstack([design, np.sqrt(damping) * np.eye(design.shape[1])])
    step, *_ = np.linalg.lstsq(rows, -np.append(v, np.zeros(design.shape[1])), rcond=None)
    return np.asarray(step)


def _cofactor(design: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(AᵀA)⁻¹ and the diagonal of A (AᵀA)⁻¹ Aᵀ. Raises `NotDeterminedError` for touches that leave a direction open."""
    left, values, right = np.linalg.svd(design, full_matrices=False)
    if values[-1] < _FLAT * values[0]:
        raise NotDeterminedError(
            "all touches lie on one circle, whose axis the centre may lie on anywhere; touch the pole too"
        )
    inverse = right.T / values
    return inverse @ inverse.T, (left**2).sum(axis=1)
