"""What a residual that is smooth over the angle can do to terms that are fitted: it is the same in all runs, and no noise.

Readings of one machine err alike wherever they are taken at one angle, whatever the run and the sense. The residuals, averaged by
angle, are taken for a stationary process; its covariance γ at an angular distance is the mean product of residuals that far apart, up
to the first distance where that is not positive. A term with gain g (its change with each reading) then has the variance gᵀΓg.
"""

from __future__ import annotations

import numpy as np

_TURN = 360.0


def correlated_variance(
    gain: np.ndarray, residual: np.ndarray, angle: np.ndarray, used: np.ndarray, step: float
) -> np.ndarray:
    """Variance of terms by what the residuals have in common with their neighbours.

    Args:
        gain: ∂term/∂reading, shape (p, m).
        residual: Residuals, shape (m,).
        angle: Angles, shape (m,) [degrees].
        used: Readings that the fit used, shape (m,).
        step: Step of the angles [degrees]: bins of that width are averaged over.

    Returns:
        Shape (p,), in the terms' squared units; 0 where neighbours have nothing in common.

    >>> angle = np.arange(0.0, 360.0, 5.0)
    >>> mean = np.full((1, 72), 1.0 / 72.0)
    >>> noise = np.tile([1.0, -1.0], 36)
    >>> correlated_variance(mean, noise, angle, angle >= 0.0, 5.0).tolist()
    [0.0]
    """
    bins = max(8, round(_TURN / max(step, 1.0)))
    number = np.floor(np.mod(angle + 0.5 * _TURN / bins, _TURN) / _TURN * bins).astype(int) % bins
    count = np.bincount(number[used], minlength=bins)
    filled = count > 0
    mean = np.bincount(number[used], weights=residual[used], minlength=bins) / np.maximum(count, 1)
    gamma = _covariance(mean, filled)
    distance = np.abs(np.arange(bins)[:, None] - np.arange(bins))
    covariance = gamma[np.minimum(distance, bins - distance)]
    own = np.stack([np.bincount(number, weights=row, minlength=bins) for row in gain])
    return np.asarray(np.maximum(np.einsum("pi,ij,pj->p", own, covariance, own), 0.0))


def _covariance(mean: np.ndarray, filled: np.ndarray) -> np.ndarray:
    """γ at distances of 0, 1, … half the bins; at 0 that of the nearest neighbours, in which noise has no part."""
    half = len(mean) // 2
    gamma = np.zeros(half + 1)
    for k in range(1, half + 1):
        pairs = filled & np.roll(filled, -k)
        product = float(np.mean((mean * np.roll(mean, -k))[pairs])) if pairs.any() else 0.0
        if product <= 0.0:
            break
        gamma[k] = product
    gamma[0] = gamma[1]
    return gamma
