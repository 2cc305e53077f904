"""The shape of a path beyond its named terms, as waves around the circle whose size the readings tell.

A machine's path errs alike in both senses and all runs, smoothly, by more than any few terms hold. On a full circle that is
of no matter, because waves of other orders leave a term alone. On an arc, and next to windows that only one sense passes
through, they lean on every term. So the path is

    y = A β + Σ_k (c_k cos kφ + s_k sin kφ) + ε,    c_k, s_k of variance τ² d_k² beforehand, k = 3 … K

β the named terms, of which nothing is known beforehand, ε of u times a common factor, d_k one of six spectra (`spectra`).
Every τ of a grid with every spectrum counts by its restricted likelihood; values are the mean over them, and u contains their
spread. So u of β has in it what waves can do to it that the readings do not see. Beforehand τ, the spread at k = 3, is between
0.1 µm and 30 µm, and no size likelier than another: on full circles that is of no matter, on an arc of 100° it is nearly all
there is. The factor never falls below 1 where u is known.

Reference: restricted maximum likelihood, Patterson and Thompson, Biometrika 58 (1971) 545; the same model as universal kriging.
Not modelled: waves that differ from sense to sense, such as a reversal that depends on the position.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, solve_triangular
from scipy.special import ive

LOWEST = 3
_HIGHEST = 24  # orders of waves, at most
_OF_STEPS = 0.7  # of the highest order that steps of the angle can carry
_POWERS = (1.0, 2.0, 3.0)
_SMOOTH = (1.0, 4.0, 16.0)  # (radius / length over which errors are alike)²
_TAUS = np.exp(np.linspace(np.log(1e-5), np.log(10.0), 29))  # mm, of the third order, before the common factor
_SIZES = (1e-4, 0.03)  # mm: after it, smallest and largest
_OUTSIDE = 1e6  # in -2 log likelihood
_FAINT = 1e-8  # spread of a wave, of that of the lowest order: less is none
_NOTHING = 1e-6  # share of a point of the grid that does not count
_UNIT = 1e-3  # mm: u where none is known, before the common factor
_LEAST = 1e-10  # of the largest singular value: a combination of terms that no reading sees
_SHARE = 1e-6  # of a term in such a combination


class Fitted(NamedTuple):
    """`value` (p + w,): terms, then waves; `u` likewise; `unknown` (p,): terms that the readings do not determine;
    `scatter`: the factor of u, or the scatter of the readings where none is known; `ratio`: the factor before it is held at
    1 or above."""

    value: np.ndarray
    u: np.ndarray
    unknown: np.ndarray
    scatter: float
    ratio: float


def waves(angle: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Columns cos kφ and sin kφ by turns, (m, w), and the order of each, (w,).

    `angle` (m,), `step` between readings [degrees]: no order is higher than steps of that width carry.

    >>> waves(np.arange(0.0, 360.0, 20.0), 20.0)[1].tolist()
    [3, 3, 4, 4, 5, 5, 6, 6]
    """
    highest = int(np.clip(_OF_STEPS * 180.0 / step, LOWEST, _HIGHEST))
    orders = np.repeat(np.arange(LOWEST, highest + 1), 2)
    phase = np.deg2rad(angle)[:, None] * orders
    return np.where(np.arange(len(orders)) % 2 == 0, np.cos(phase), np.sin(phase)), orders


def fit_waves(A: np.ndarray, Z: np.ndarray, orders: np.ndarray, y: np.ndarray, u: np.ndarray | None) -> Fitted:
    """Named terms and waves by restricted maximum likelihood.

    Args:
        A: Factors of the terms, shape (m, p).
        Z: Factors of the waves, shape (m, w).
        orders: Order of each wave, shape (w,).
        y: Deviations, shape (m,) [mm].
        u: Their standard uncertainties, shape (m,) [mm]; None: unknown, and alike.

    >>> angle = np.arange(0.0, 360.0, 5.0)
    >>> Z, orders = waves(angle, 5.0)
    >>> found = fit_waves(np.ones((72, 1)), Z, orders, 0.002 + 0.001 * Z[:, 2], np.full(72, 1e-5))
    >>> found.value[:1].round(6).tolist(), found.value[3:4].round(6).tolist()
    ([0.002], [0.001])
    """
    weight = np.full(len(y), 1.0 / _UNIT) if u is None else 1.0 / u
    seen, unknown = _seen(weight[:, None] * A)
    reduced = np.asarray(np.linalg.qr(weight[:, None] * np.column_stack([A @ seen, Z, y]), mode="r"))
    freedom = max(len(y) - seen.shape[1], 1)
    least = 0.0 if u is None else 1.0
    shapes = spectra(orders)
    grid = [_one(reduced, 1.0 / (tau * shape), freedom, least) for shape in shapes for tau in _TAUS]
    sizes = np.array([one.ratio * tau for one, tau in zip(grid, np.tile(_TAUS, len(shapes)), strict=True)])
    likely = np.array([one.likelihood for one in grid]) + _OUTSIDE * ((sizes < _SIZES[0]) | (sizes > _SIZES[1]))
    share = np.exp(-0.5 * (likely - likely.min()))
    share /= share.sum()
    mean, deviation = _mean(grid, share, seen)
    ratio = float(share @ [one.ratio for one in grid])
    return Fitted(mean, deviation, unknown, ratio * _UNIT if u is None else max(ratio, 1.0), ratio)


def spectra(orders: np.ndarray) -> list[np.ndarray]:
    """Spreads of waves by their order, (w,), 1 at the lowest one.

    Powers of the order; and those of a function whose values are alike as exp(-d²/2ℓ²) at places of the circle a chord d
    apart: the square is the modified Bessel function I_k(R²/ℓ²).

    >>> [s.round(3).tolist() for s in spectra(np.array([3, 6]))][:2]
    [[1.0, 0.5], [1.0, 0.25]]
    """
    powers = [(LOWEST / orders) ** p for p in _POWERS]
    bells = [np.sqrt(np.maximum(ive(orders, c) / ive(LOWEST, c), _FAINT**2)) for c in _SMOOTH]
    return [*powers, *bells]


class _One(NamedTuple):
    """With one spread of the waves: -2 log of the restricted likelihood but for a constant, its common factor `ratio` at
    the best, values, and a root of their covariance."""

    likelihood: float
    ratio: float
    value: np.ndarray
    root: np.ndarray


def _seen(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Combinations of terms that the readings see, (p, r), scaled; and which terms take part in others, (p,)."""
    size = np.linalg.norm(A, axis=0)
    size[size == 0.0] = 1.0
    singular, right = np.linalg.svd(A / size, full_matrices=False)[1:]
    kept = singular > _LEAST * singular[0]
    unknown = np.abs(right[~kept]).max(axis=0, initial=0.0) > _SHARE
    return right[kept].T / size[:, None], unknown


def _one(reduced: np.ndarray, known: np.ndarray, freedom: int, least: float) -> _One:
    """Solution with waves of which `known`, 1 / their spread, (w,), is known beforehand; the right side is the last column."""
    w = len(known)
    prior = np.zeros((w, reduced.shape[1]))
    prior[:, -1 - w : -1] = np.diag(known)
    R = np.asarray(np.linalg.qr(np.vstack([reduced, prior]), mode="r"))
    square = max(float(R[-1, -1]) ** 2, 1e-300)
    spread = 2.0 * np.sum(np.log(np.abs(np.diagonal(R)[:-1]))) - 2.0 * np.sum(np.log(known))
    inverse = solve_triangular(R[:-1, :-1], np.eye(len(R) - 1))
    ratio = float(np.sqrt(square / freedom))
    root = max(ratio, least) * inverse
    return _One(freedom * np.log(square / freedom) + float(spread), ratio, inverse @ R[:-1, -1], root)


def _mean(grid: list[_One], share: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of terms and waves over the grid, and their u with the spread over it."""
    count = len(grid[0].value) - seen.shape[1]
    back = block_diag(seen, np.eye(count))
    counted = [(one, s) for one, s in zip(grid, share, strict=True) if s > _NOTHING]
    values = np.stack([back @ one.value for one, _ in counted])
    shares = np.array([s for _, s in counted])
    mean = shares @ values / shares.sum()
    within = sum(s * np.sum((back @ one.root) ** 2, axis=1) for one, s in counted)
    return mean, np.sqrt((within + shares @ (values - mean) ** 2) / shares.sum())
