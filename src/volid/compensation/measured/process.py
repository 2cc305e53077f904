"""Interpolation between measured places: one Gaussian process for each of X, Y and Z, of which no kinematics is assumed.

A component of the deviation is a free linear function of the axis positions plus Matérn processes of order 5/2,

    cov(f(q), f(q')) = s² m(r) + a² Σ_j m(|q_j - q_j'| / (b · range_j)),   m(r) = (1 + √5 r + 5 r²/3) exp(-√5 r),
    r² = Σ_j ((q_j - q_j') / (l_j · range_j))²,

with one length l_j for each axis, plus what is independent from place to place (n). The second term is one function of each axis,
all of one size a and length b: it can change between places whatever its values at other positions of the other axes say, so an
axis that was measured at two positions, or along with others on a diagonal, is as uncertain there as the functions of the other
axes are large. s, l, a, b and n have the largest marginal likelihood times wide priors: s and a around 5 µm, l and b around half
a range, n around a third of the readings' u. Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, 2.7, 4.2.1,
5.4; Duvenaud, Nickisch and Rasmussen, Additive Gaussian Processes, 2011. Order 5/2, two derivatives, is rougher than error
functions are: the interpolation between places is trusted less than with the smoothness of `volid fit`.

Places on few levels of an axis see nothing between the levels, and a short wave looks like a smooth one there. Therefore every
inner level of an axis is predicted from all others; where the predictions miss by more than their u, all u of the interpolation
are enlarged by that factor, which is stated.

Not modelled: a field that is smoother in one part than in another (a step within a smooth field gets too small a u near it).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from volid.compensation.measured.points import MeasuredPoints

SIZE, SIZE_SPREAD = 5e-3, 1.5  # mm: median of s; standard deviation of log s
LENGTH, LENGTH_SPREAD = 0.5, 0.7  # ranges; of log l
SHARE, SHARE_SPREAD = 0.3, 1.0  # median of n over the readings' RMS u; of log n
BOUNDS = 5.0  # standard deviations of the priors
FREE = 10.0  # standard deviation of what is free, over the largest deviation; at least FREE_LEAST
FREE_LEAST = 1.0  # mm
FEWEST = 8  # places with one tool vector
FULL_LEVEL = 4  # places on a level, on average: fewer are scattered places
NOTICED = 1.2  # factor of u that counts: chance alone stays below
LEARNT = 300  # places that s, l and n are estimated from


class Smoothness(NamedTuple):
    """Of one component: size s [mm], lengths l by varying axis (d,) [ranges], a [mm] and b [ranges] of functions of one axis, and
    n [mm]; factor by which u is enlarged because levels held out are missed by more than their u, and the number of that axis
    among the varying ones (-1: none)."""

    size: float
    lengths: np.ndarray
    own_size: float
    own_length: float
    scatter: float
    factor: float = 1.0
    axis: int = -1


@dataclass(frozen=True, eq=False)
class Scale:
    """Axis positions as numbers of order 1. `columns`: of the axes that vary; `middle`, `range_`: (d,) [mm]."""

    columns: tuple[int, ...]
    middle: np.ndarray
    range_: np.ndarray

    @classmethod
    def of(cls, positions: np.ndarray) -> Scale:
        """From the measured places (m, n_axes)."""
        low, high = positions.min(axis=0), positions.max(axis=0)
        columns = tuple(np.flatnonzero(high - low > 1e-3).tolist())
        return cls(columns, 0.5 * (low + high)[list(columns)], (high - low)[list(columns)])

    def __call__(self, positions: np.ndarray) -> np.ndarray:
        """Positions (m, n_axes) as (m, d), within ±½ where measured."""
        return np.asarray((positions[:, list(self.columns)] - self.middle) / self.range_)


def matern(one: np.ndarray, other: np.ndarray, smooth: Smoothness) -> np.ndarray:
    """Covariance of a component between places (a, d) and (b, d), (a, b) [mm²], the free part not included."""
    together = _fall(np.sqrt(_squares(one, other, smooth.lengths).sum(axis=0)))
    apart = _fall(np.sqrt(_squares(one, other, np.full(one.shape[1], smooth.own_length)))).sum(axis=0)
    return np.asarray(smooth.size**2 * together + smooth.own_size**2 * apart)


def _fall(r: np.ndarray) -> np.ndarray:
    """(1 + r + r²/3) exp(-r), with √5 in r."""
    return np.asarray((1.0 + r + r * r / 3.0) * np.exp(-r))


def _by_length(squares: np.ndarray) -> np.ndarray:
    """Derivative of `_fall` by log of the length, over the squares of r that this length is in."""
    r = np.sqrt(squares)
    return np.asarray((1.0 + r) * np.exp(-r) / 3.0)


def _squares(one: np.ndarray, other: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """5 ((q_j - q_j') / l_j)², (d, a, b)."""
    return np.array(
        [5.0 * ((a[:, None] - b[None]) / length) ** 2 for a, b, length in zip(one.T, other.T, lengths, strict=True)]
    )


def free_part(x: np.ndarray) -> np.ndarray:
    """What is free: a constant and a line in every varying axis, (m, d + 1)."""
    return np.hstack([np.ones((len(x), 1)), x])


def freedom_of(values: np.ndarray) -> float:
    """Standard deviation of the coefficients of what is free [mm]: wide beside the deviations."""
    return max(FREE_LEAST, FREE * float(np.abs(values).max(initial=0.0)))


def smoothness_of(points: MeasuredPoints, scale: Scale) -> tuple[Smoothness, Smoothness, Smoothness]:
    """s, l and n of X, Y and Z, from all tool vectors together."""
    groups = [points.with_tool(t) for t in points.tools]
    share = max(1, -(-len(points) // LEARNT))
    groups = [g[::share] for g in groups if len(g[::share]) > len(scale.columns) + 1]
    found = [_learnt(points, scale, groups, k) for k in range(3)]
    return found[0], found[1], found[2]


def _learnt(points: MeasuredPoints, scale: Scale, groups: list[np.ndarray], k: int) -> Smoothness:
    from scipy.optimize import minimize

    variance = np.diag(points.covariance)[k * len(points) : (k + 1) * len(points)]
    blocks = [_Block.of(scale(points.positions[g]), points.deviation[g, k], variance[g]) for g in groups]
    u = max(float(np.sqrt(np.mean(variance))), 1e-7)
    d = len(scale.columns)
    centre = np.log(np.array([SIZE, *[LENGTH] * d, SIZE, LENGTH, SHARE * u]))
    spread = np.array([SIZE_SPREAD, *[LENGTH_SPREAD] * d, SIZE_SPREAD, LENGTH_SPREAD, SHARE_SPREAD])

    def cost(z: np.ndarray) -> tuple[float, np.ndarray]:
        parts = [b.cost(centre + spread * z) for b in blocks]
        value = sum(p[0] for p in parts) + 0.5 * float(z @ z)
        return value, spread * sum(p[1] for p in parts) + z

    best = minimize(cost, np.zeros(len(centre)), jac=True, method="L-BFGS-B", bounds=[(-BOUNDS, BOUNDS)] * len(centre))
    phi = np.exp(centre + spread * best.x)
    found = Smoothness(float(phi[0]), phi[1:-3], float(phi[-3]), float(phi[-2]), float(phi[-1]))
    missed = [_missed(blocks, found, j) for j in range(d)]
    worst = int(np.argmax(missed))
    return found._replace(factor=missed[worst], axis=worst) if missed[worst] > NOTICED else found


def _missed(blocks: list[_Block], smooth: Smoothness, j: int) -> float:
    """RMS of what inner levels of axis j miss when they are predicted from all others, over its u; 1 where there are no levels.

    With A the inverse of the covariance of the readings y, rows B held out: y_B - prediction = (A_BB)⁻¹ (A y)_B, covariance
    (A_BB)⁻¹.
    """
    squares: list[np.ndarray] = []
    for block in blocks:
        levels = np.unique(np.round(block.x[:, j], 4), return_inverse=True)[1]
        if not 2 < levels.max() + 1 <= len(levels) / FULL_LEVEL:
            continue
        total = matern(block.x, block.x, smooth) + block.free + np.diag(block.variance + smooth.scatter**2)
        inverse = np.linalg.inv(total)
        pulled = inverse @ block.y
        for level in range(1, int(levels.max())):
            out = np.flatnonzero(levels == level)
            covariance = np.linalg.inv(inverse[np.ix_(out, out)])
            squares.append((covariance @ pulled[out]) ** 2 / np.diag(covariance))
    return max(1.0, float(np.sqrt(np.mean(np.concatenate(squares))))) if squares else 1.0


class _Block(NamedTuple):
    """Places (m, d), deviations (m,) and variances (m,) of one component with one tool vector; what is free (m, m)."""

    x: np.ndarray
    y: np.ndarray
    variance: np.ndarray
    free: np.ndarray

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray, variance: np.ndarray) -> _Block:
        columns = freedom_of(y) * free_part(x)
        return cls(x, y, variance, columns @ columns.T)

    def cost(self, phi: np.ndarray) -> tuple[float, np.ndarray]:
        """-log marginal likelihood and its gradient by φ = (log s, log l, log a, log b, log n)."""
        size, lengths, (own_size, own_length, scatter) = np.exp(phi[0]), np.exp(phi[1:-3]), np.exp(phi[-3:])
        squares = _squares(self.x, self.x, lengths)
        alone = _squares(self.x, self.x, np.full(len(lengths), own_length))
        sum_ = squares.sum(axis=0)
        kernel, slope = size**2 * _fall(np.sqrt(sum_)), size**2 * _by_length(sum_)
        apart = own_size**2 * _fall(np.sqrt(alone)).sum(axis=0)
        stretch = own_size**2 * (_by_length(alone) * alone).sum(axis=0)
        total = kernel + apart + self.free
        total[np.diag_indices(len(total))] += self.variance + scatter**2
        factor = cho_factor(total, lower=True)
        alpha = cho_solve(factor, self.y)
        weight = np.outer(alpha, alpha) - cho_solve(factor, np.eye(len(total)))
        gradient = [np.sum(weight * kernel), *(0.5 * np.sum(weight * slope * s) for s in squares)]
        gradient += [np.sum(weight * apart), 0.5 * np.sum(weight * stretch)]
        gradient.append(scatter**2 * np.trace(weight))
        value = 0.5 * float(self.y @ alpha) + float(np.log(np.diag(factor[0])).sum())
        return value, -np.array(gradient)


class Process:
    """The field given the measured points: values and covariances at any places of a measured tool vector.

    What is known of the frame: the rigid motion of the workpiece frame that fits the field at all measured places of all tool
    vectors best is taken out once. A second station's frame is unknown beside the first's.
    """

    def __init__(self, points: MeasuredPoints, scale: Scale, smooth: tuple[Smoothness, Smoothness, Smoothness]) -> None:
        self.points, self.scale, self.smooth = points, scale, smooth
        self.freedom = freedom_of(points.deviation)
        self.x = scale(points.positions)
        m = len(points)
        self.own = [points.with_tool(t) for t in points.tools]
        prior = np.zeros((3 * m, 3 * m))
        for g in self.own:
            for k in range(3):
                rows = g + k * m
                prior[np.ix_(rows, rows)] = self._prior(self.x[g], self.x[g], k)
        noise = points.covariance + np.diag(np.repeat([s.scatter**2 for s in smooth], m))
        frames = self.freedom * points.frame_columns(range(1, len(points.stations)))
        total = prior + noise + frames @ frames.T
        self.factor = np.linalg.cholesky(total)
        rows = points.motion_rows()
        unit = np.maximum(np.abs(rows).max(axis=0), 1e-9)
        self.motion = np.linalg.pinv(rows / unit, rcond=1e-9) / unit[:, None]
        self.across = prior @ self.motion.T  # covariance of all places with the motion taken out, (3m, 6)
        self.half = solve_triangular(self.factor, self.across, lower=True)
        self.white = solve_triangular(self.factor, points.values, lower=True)
        self.mean_motion = self.half.T @ self.white
        self.motion_covariance = self.motion @ self.across - self.half.T @ self.half

    def _prior(self, one: np.ndarray, other: np.ndarray, k: int) -> np.ndarray:
        return matern(one, other, self.smooth[k]) + self.freedom**2 * free_part(one) @ free_part(other).T

    def _variance(self, axes: int, k: int) -> float:
        """Variance of a component at any place, that of its free part not included [mm²]."""
        return self.smooth[k].size ** 2 + axes * self.smooth[k].own_size ** 2

    def at(self, positions: np.ndarray, tool: np.ndarray, motion_rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values and u (a, 3) [mm] at places (a, n_axes) with a measured tool vector; `motion_rows` (a, 3, 6) of these places."""
        x, own, m = self.scale(positions), self.points.with_tool(tool), len(self.points)
        values, u = np.empty((len(x), 3)), np.empty((len(x), 3))
        for k in range(3):
            prior = self._prior(x, self.x[own], k)
            full = np.zeros((3 * m, len(x)))
            full[own + k * m] = prior.T
            half = solve_triangular(self.factor, full, lower=True, overwrite_b=True, check_finite=False)
            rows = motion_rows[:, k]
            values[:, k] = half.T @ self.white - rows @ self.mean_motion
            own_variance = self._variance(x.shape[1], k) + self.freedom**2 * (free_part(x) ** 2).sum(axis=1)
            variance = own_variance - (half**2).sum(axis=0)
            across = prior @ self.motion[:, own + k * m].T - half.T @ self.half
            variance += np.einsum("ai,ij,aj->a", rows, self.motion_covariance, rows) - 2.0 * (rows * across).sum(axis=1)
            u[:, k] = np.sqrt(self.smooth[k].factor ** 2 * np.maximum(variance, 0.0) + self.smooth[k].scatter ** 2)
        return values, u
