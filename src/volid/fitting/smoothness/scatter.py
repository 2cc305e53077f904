"""What is independent from position to position: waves shorter than the knots' spacing, whose period nobody has stated.

A smooth function cannot follow them, so they stay in the residuals, and they are errors of the machine, not of the instrument:
they belong to every u. What tells them from a u that is too small as a whole is their direction. With residuals v, leverages h,
and the whitened sensitivity a_d of every reading to a translation of the machine in direction d,

    v ~ N(0, (1 - h) (κ + Σ_d σ_d² a_d²)),   d = X, Y, Z,

with κ ≥ 1 for everything that has no direction. σ_d by maximum likelihood; it counts only where it gains `GAIN` in the log
likelihood over κ alone. κ is not applied: that is a matter of the verdict. Readings beyond 4 standard deviations have no say.

Not modelled: that readings at one position share their part, so that means over few, often repeated positions are uncertain by it
too; positions on fewer levels than a spline has segments, where nothing tells such a part from the function itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from volid.campaign import Campaign
from volid.fitting.diagnosis.hold_out import rows_by_reading
from volid.fitting.equations.problem import Problem
from volid.fitting.smoothness.processes import Process
from volid.model.error_model import MEAN, ErrorModel

GAIN = 12.0  # of the log likelihood: chance alone exceeds it once in 10⁵ campaigns
OWN_GAIN = 4.0  # of one direction beside the others
SUSPECT = 3.0  # standard deviations of the unit weight above 1 from which a scatter is looked for
TRIMMED = 4.0  # standard deviations
LEAST = 100  # readings


def positioning(model: ErrorModel, processes: Sequence[Process]) -> dict[str, str]:
    """Positioning functions of linear axes whose smoothness is estimated, by direction: what carries the scatter."""
    smooth = {n for p in processes if p.part == MEAN for n in p.names}
    names = (f"E{letter}{letter}" for letter in "XYZ")
    return {n[1]: n for n in names if n in smooth and (n, MEAN) in model.by_name}


def squared_sensitivities(problem: Problem, campaign: Campaign, z: np.ndarray, names: Mapping[str, str]) -> np.ndarray:
    """a² of every reading and direction, (d, n): readings in the order of sets, rows, columns [1/mm²], over their u."""
    factor = np.zeros((len(names), problem.system.size))
    for i, name in enumerate(names.values()):
        factor[i, problem.model.by_name[name, MEAN].coefficients] = 1.0  # B-splines sum to 1
    return rows_by_reading(problem, campaign, problem.equations.projected(z, factor)).T ** 2


def estimated(
    whitened: np.ndarray, redundancy: np.ndarray, squares: np.ndarray, names: Mapping[str, str]
) -> dict[str, float]:
    """σ by direction [mm], {} where chance or a κ explains the residuals.

    `whitened` v, `redundancy` 1 - h, (n,), and `squares` (d, n), of the readings in use, over u² each.
    """
    if len(whitened) < LEAST or not len(squares):
        return {}
    ratio = whitened**2 / np.maximum(redundancy, 1e-3)
    scale = np.mean(squares, axis=1)
    if not np.any(scale > 0.0):
        return {}
    kept = np.ones(len(ratio), dtype=bool)
    found = np.zeros(len(scale))
    for _ in range(3):
        plain = _minimum(ratio[kept], np.zeros((0, int(kept.sum()))), np.zeros(0))
        full = _minimum(ratio[kept], squares[:, kept] / scale[:, None], found)
        found = full[1][1:]
        expected = full[1][0] + found @ (squares / scale[:, None])
        now = ratio <= TRIMMED**2 * expected
        if np.array_equal(now, kept):
            break
        kept = now
    if plain[0] - full[0] < GAIN:
        return {}
    scaled = squares[:, kept] / scale[:, None]
    used = [i for i in range(len(scale)) if found[i] > 0.0]
    used = [
        i for i in used if _minimum(ratio[kept], np.delete(scaled, i, 0), np.delete(found, i))[0] - full[0] > OWN_GAIN
    ]
    _, best = _minimum(ratio[kept], scaled[used], found[used])
    return {list(names)[i]: float(np.sqrt(x / scale[i])) for i, x in zip(used, best[1:], strict=True)}


def _minimum(ratio: np.ndarray, squares: np.ndarray, start: np.ndarray) -> tuple[float, np.ndarray]:
    """½ Σ (log s + ratio/s), s = κ + Σ x_d squares_d, minimised over κ ≥ 1 and x ≥ 0; the value, and (κ, x)."""
    from scipy.optimize import minimize  # takes a tenth of a second to import, and few fits ask for it

    columns = np.vstack([np.ones(len(ratio)), squares])

    def value(x: np.ndarray) -> tuple[float, np.ndarray]:
        s = x @ columns
        return 0.5 * float(np.sum(np.log(s) + ratio / s)), 0.5 * columns @ ((1.0 - ratio / s) / s)

    bounds = [(1.0, None), *[(0.0, None)] * len(squares)]
    first = np.concatenate([[1.0], np.maximum(start, 0.1)])
    found = minimize(value, first, jac=True, bounds=bounds, method="L-BFGS-B")
    return float(found.fun), np.asarray(found.x)


def with_scatter(campaign: Campaign, problem: Problem, z: np.ndarray, sigma: Mapping[str, float]) -> Campaign:
    """The campaign with u² of every reading enlarged by a known scatter, at z; `problem`: of the campaign as it is."""
    names = {direction: f"E{direction}{direction}" for direction in sigma}
    return enlarged(campaign, squared_sensitivities(problem, campaign, z, names), names, sigma)


def enlarged(campaign: Campaign, squares: np.ndarray, names: Mapping[str, str], sigma: Mapping[str, float]) -> Campaign:
    """The campaign with u² of every reading enlarged by the scatter; `squares` (d, n) as above."""
    weights = np.array([sigma.get(direction, 0.0) ** 2 for direction in names])
    factors = np.split(np.sqrt(1.0 + weights @ squares), np.cumsum([s.readings.size for s in campaign.sets])[:-1])
    sets = [replace(s, u=s.u * f.reshape(s.u.shape)) for s, f in zip(campaign.sets, factors, strict=True)]
    return replace(campaign, sets=tuple(sets))
