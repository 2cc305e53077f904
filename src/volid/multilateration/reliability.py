"""How the readings check each other, and how well each point is known: what geodesists ask of a network.

Redundancy numbers, minimal detectable errors and their influence (Baarda), normalised residuals, error ellipsoids.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import gammaincinv, ndtri

from volid.multilateration.determination import Determination
from volid.multilateration.equations import Equations

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

SIGNIFICANCE, POWER = 0.001, 0.8  # of the test that a minimal detectable error refers to
NON_CENTRALITY = float(ndtri(1 - SIGNIFICANCE / 2) + ndtri(POWER)) ** 2  # 17.07, Baarda 1968
PROBABILITY = 0.95  # of the confidence ellipsoid
_NOTHING = 1e-9  # redundancy number below which no other reading checks one; rounding leaves 1e-12


@dataclass(frozen=True)
class Reliability:
    """What the other readings can tell of each reading.

    Attributes:
        redundancy: r, shape (m,): the share of an error of the reading that its residual shows, 0 to 1; their sum is the
            number of degrees of freedom. NaN for readings left out.
        detectable: Shape (m,), unit of the distances: the least error √17.07 u/√r that the test of its normalised residual at
            significance 0.1 % finds with probability 80 %. NaN where no other reading checks it.
        influence: Shape (m,), unit of the distances: how far that error, undetected, moves the point that it moves most.
        influenced: Shape (m,), number of that point; -1 where `influence` is NaN.
    """

    redundancy: Float[np.ndarray, " m"]
    detectable: Float[np.ndarray, " m"]
    influence: Float[np.ndarray, " m"]
    influenced: np.ndarray


@dataclass(frozen=True)
class Ellipsoids:
    """Standard error ellipsoids of the points, in the plane ellipses.

    Attributes:
        axes: Semi-axes, shape (p, d), unit of the distances, largest first: square roots of the eigenvalues of the covariance
            of the point, from the stated u. NaN along directions that are not determined, which come first; 0 for fixed points.
        directions: Shape (p, d, d), the unit vector of each semi-axis as a row.
        scale: Factor for the ellipsoid that holds the point with 95 %: √ of that quantile of chi-square with d degrees of
            freedom, 2.448 in the plane and 2.796 in space.
    """

    axes: Float[np.ndarray, "p d"]
    directions: Float[np.ndarray, "p d d"]
    scale: float


def chi2_quantile(probability: float, freedom: float) -> float:
    """Quantile of chi-square, as in `scipy.stats`, which takes longer to import than most reports to compute."""
    return float(2.0 * gammaincinv(0.5 * freedom, probability))


def confidence_scale(dimension: int, probability: float = PROBABILITY) -> float:
    """Semi-axes of the confidence ellipsoid over those of the standard one."""
    return float(np.sqrt(chi2_quantile(probability, dimension)))


def ellipsoids(
    equations: Equations, covariance: Float[np.ndarray, "k k"], moved: Float[np.ndarray, "p d q"], visible: float
) -> Ellipsoids:
    """Ellipsoids of all points; `moved`: how far directions that are not determined move them.

    A direction of a point counts as not determined where that is more than the share `visible` of its u.
    """
    count, d = equations.approximate.shape
    axes, directions = np.zeros((count, d)), np.tile(np.eye(d), (count, 1, 1))
    for row, j in enumerate(np.flatnonzero(equations.free)):
        block = covariance[d * row : d * row + d, d * row : d * row + d]
        axes[j], directions[j] = _ellipsoid(block, moved[j], visible)
    return Ellipsoids(axes, directions, confidence_scale(d))


def _ellipsoid(block: Float[np.ndarray, "d d"], moved: Float[np.ndarray, "d q"], visible: float):
    """Semi-axes and unit vectors of one point, what is not determined first."""
    base, sizes, _ = np.linalg.svd(np.hstack([moved, np.zeros_like(block)]))
    variances = np.maximum(np.einsum("da,de,ea->a", base, block, base), 0.0)
    lost = (sizes[: len(block)] > visible * np.sqrt(variances)) & (sizes[: len(block)] > 1e-5 * sizes[0])
    rest = base[:, ~lost]
    values, vectors = np.linalg.eigh(rest.T @ block @ rest)
    known = (rest @ vectors)[:, ::-1]
    lengths = np.concatenate([np.full(lost.sum(), np.nan), np.sqrt(np.maximum(values[::-1], 0.0))])
    return lengths, _upward(np.vstack([base[:, lost].T, known.T]))


def _upward(vectors: Float[np.ndarray, "d d"]) -> Float[np.ndarray, "d d"]:
    """The same axes with their largest component positive."""
    largest = np.argmax(np.abs(vectors).round(9), axis=1)
    return vectors * np.where(vectors[np.arange(len(vectors)), largest] < 0, -1.0, 1.0)[:, None]


def reliability(equations: Equations, kept: Bool[np.ndarray, " m"], found: Determination) -> Reliability:
    """Redundancy numbers of the readings kept and what follows from them; `found` is of those alone."""
    m, d = kept.size, equations.approximate.shape[1]
    redundancy, detectable, influence, influenced = np.full((4, m), np.nan)
    redundancy[kept] = 1 - (found.vectors**2).sum(axis=1) - _shared(equations, kept)[kept]
    redundancy[np.abs(redundancy) < _NOTHING] = 0.0
    checked = np.flatnonzero(redundancy > 0)
    detectable[checked] = np.sqrt(NON_CENTRALITY / redundancy[checked]) * equations.u[checked]
    if checked.size:
        rows = found.vectors[(np.cumsum(kept) - 1)[checked]][:, ~found.weak]
        errors = rows * (detectable / equations.u)[checked, None]
        shifts = (found.axes[~found.weak].T / found.sizes[~found.weak]) @ errors.T
        lengths = np.linalg.norm(shifts.reshape(-1, d, checked.size), axis=1)
        influence[checked] = lengths.max(axis=0)
        influenced[checked] = np.flatnonzero(equations.free)[lengths.argmax(axis=0)]
    return Reliability(redundancy, detectable, influence, np.nan_to_num(influenced, nan=-1).astype(int))


def _shared(equations: Equations, kept: Bool[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Variance of the offset that the readings kept give, over u² of the reading; infinite where none gives one."""
    shares = equations.shares_by(kept)
    if shares is None:
        return np.zeros(kept.size)
    squares = np.asarray(shares.power(2).sum(axis=0)).ravel()
    return np.where((equations.group >= 0) & (squares == 0), np.inf, squares)


def normalised(equations: Equations, x: np.ndarray, kept: np.ndarray, decomposed) -> Float[np.ndarray, " m"]:
    """Residuals over their standard deviation: u² minus the predicted distance's variance, plus for those left out."""
    _, sizes, axes = decomposed
    jacobian = equations.centred(equations.uncentred_jacobian(x), kept)
    prediction = ((jacobian @ axes.T / sizes) ** 2).sum(axis=1) + _shared(equations, kept)
    inside = ((jacobian @ axes.T @ axes - jacobian) ** 2).sum(axis=1) <= 1e-12 * (jacobian**2).sum(axis=1)
    variance = np.where(kept, 1 - prediction, 1 + prediction)
    checked = (variance > _NOTHING) & inside & np.isfinite(variance)
    return np.where(checked, equations.residuals(x, kept) / np.sqrt(np.where(checked, variance, 1.0)), np.nan)
