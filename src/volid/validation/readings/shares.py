"""Which share of readings with E_n > 1 is usual when the solution is right.

On average it is 4.6 %, the share of normal numbers beyond two standard deviations. What the readings have in common (the
uncertainty of the prediction, of a tool, of an instrument's scale) moves many of them together: the share is then mostly near 0,
and now and then a half. So it is drawn, from the covariance of the residuals.
"""

from __future__ import annotations

import numpy as np

from volid.validation.readings.whitened import Whitened

WITHIN = 0.95  # of right solutions
DRAWS, FEWEST, BLOCK, WORK = (
    1000,
    100,
    50,
    4e9,
)  # draws at most and at least, at a time; multiplications that are worth it


def usual_share(whitened: Whitened, limit: float, least: float) -> tuple[float, float]:
    """Shares of readings whose |residual| / u exceeds `limit`, between which 95 % of right solutions lie.

    `least`: variance over u² from which a reading counts; (NaN, NaN) where none does.
    """
    counted = whitened.variance > least
    if not counted.any():
        return float("nan"), float("nan")
    one = np.sqrt(whitened.variance[counted])[:, None]
    size = counted.size * (whitened.turned.shape[1] + whitened.basis.shape[1] + 1)
    draws = int(np.clip(WORK / size, FEWEST, DRAWS))
    rng, basis, found = np.random.default_rng(0), whitened.basis, []
    for start in range(0, draws, BLOCK):
        x = rng.standard_normal((counted.size, min(BLOCK, draws - start)))
        residual = whitened.coloured(x - basis @ (basis.T @ x))[counted]
        found.append(np.mean(np.abs(residual) > limit * one, axis=0))
    low, high = np.quantile(np.concatenate(found), [0.5 - WITHIN / 2, 0.5 + WITHIN / 2])
    return float(low), float(high)
