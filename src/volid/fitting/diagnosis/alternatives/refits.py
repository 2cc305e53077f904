"""The same campaign fitted on another chain, or without a slip: what alternatives that change the model itself are compared by.

Some of the readings are fitted on both, with functions as smooth as those of the fit, so that their chi-squares can be compared.
Where positions are nominally the same, one step from the solution is enough.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign
from volid.exceptions import VolidError
from volid.fitting.diagnosis.alternatives.base import Alternative, Judged, profile
from volid.fitting.diagnosis.around import Around, Fit
from volid.fitting.equations.choice import engine_named
from volid.fitting.equations.problem import Prior, Problem, build_problem
from volid.fitting.equations.solver import solve
from volid.fitting.nominal import few
from volid.fitting.starts import find_starts
from volid.model.error_model import ErrorModel, build_model
from volid.observations.base import NuisanceTable

RIDGE = 1e-10  # of scaled normal equations, for what the readings leave open


class Other(NamedTuple):
    """The campaign as it would be otherwise: cause, itself and its cure in words, whether positions are nominally elsewhere."""

    cause: str
    what: str
    cure: str
    campaign: Campaign
    elsewhere: bool = False


class Refitted(NamedTuple):
    """Some rows of the campaign with their chi-square `now`, how many degrees of freedom they have, and for how much in all
    readings one unit of gain stands (`scale`)."""

    campaign: Campaign
    now: float
    freedom: int
    scale: float

    @property
    def unit_weight(self) -> float:
        """sqrt(chi²/dof) of these rows."""
        return float(np.sqrt(self.now / max(self.freedom, 1)))


def refitted(fit: Fit, campaign: Campaign, around: Around, again: bool) -> Refitted:
    """Some rows of a campaign fitted as they stand; `again`: also from new start values."""
    own = campaign.n_readings / fit.campaign.n_readings
    now = min(chi_square_on(fit, campaign, e) for e in ((True, False) if again else (False,)))
    return Refitted(campaign, now, int(fit.share * own * around.freedom), around.share / (fit.share * own))


def judged_others(fit: Fit, base: Refitted, others: Iterable[Other], least: float = 1.0) -> Iterator[Judged]:
    """Other campaigns with what they gain, in all readings and as the share that is here would show it.

    Both fits have as many unknowns, so that the difference of -2 log likelihood needs no allowance; that chance makes it as large
    as g has a probability below exp(-g/2) (Markov's inequality for the likelihood ratio; Royall 2000). `least`: unit weight over
    that of the campaign as it stands, at most.
    """
    others = list(others)
    for other in others:
        found = chi_square_on(fit, other.campaign, other.elsewhere)
        if not found <= least**2 * base.now:
            continue
        gain = base.scale * max(profile(base.now, base.freedom) - profile(found, base.freedom), 0.0)
        nothing = np.zeros((fit.campaign.n_readings, 0))
        alternative = Alternative(other.cause, other.what, other.cure, nothing, tried=float(len(others)))
        chance, beyond = min(-0.5 * gain + float(np.log(len(others))), 0.0), np.full(1, np.inf)
        yield Judged(alternative, base.scale * (base.now - found), gain, 0, chance, np.zeros(0), beyond)


def some_rows(campaign: Campaign, factors: list[np.ndarray], rows: int) -> Campaign:
    """Some of the rows that take part, evenly over each set."""
    return few(campaign, rows, [np.all(f > 0.0, axis=1) for f in factors])


def chi_square_on(fit: Fit, campaign: Campaign, elsewhere: bool) -> float:
    """Chi-square of a campaign on its machine; infinite where it cannot be fitted.

    `elsewhere`: positions are nominally elsewhere than in the fit, so that stations and all else are found anew.
    """
    try:
        problem, start = _problem(fit, campaign, elsewhere)
        if elsewhere:
            return 2.0 * float(solve(problem, start, problem.free).cost)
        return _one_step(problem, start)
    except (VolidError, np.linalg.LinAlgError):
        return float("inf")


def _problem(fit: Fit, campaign: Campaign, elsewhere: bool) -> tuple[Problem, np.ndarray]:
    """The problem on the campaign's machine, with functions as smooth as those of the fit, and where to start."""
    own = fit.problem.model
    model = build_model(campaign.machine, own.segments)
    place = _same_parameters(model, own)
    rows = fit.smooth_rows
    known = np.zeros((len(rows), model.n_parameters))
    known[:, place[:, 0]] = rows[:, place[:, 1]]
    prior = Prior(np.zeros(len(rows)), known)
    table = NuisanceTable(find_starts(campaign) if elsewhere else {**fit.starts, **_values(fit)})
    problem = build_problem(campaign, model, prior=prior, table=table, engine=engine_named("interpreted"))
    start = problem.start.copy()
    if not elsewhere:
        theta = np.zeros(model.n_parameters)
        theta[place[:, 0]] = (own.projection @ fit.z[: own.layout.n_coefficients])[place[:, 1]]
        start[: model.layout.n_coefficients] = model.parametrisation @ theta
    return problem, start


def _values(fit: Fit) -> dict[object, float]:
    """Values of the unknowns beside the functions, by key; what is known beforehand keeps its start."""
    values = fit.z[fit.problem.model.layout.n_coefficients :].tolist()
    pairs = zip(fit.problem.nuisance, values, strict=True)
    return {entry.key: value for entry, value in pairs if np.isinf(entry.prior_u)}


def _same_parameters(model: ErrorModel, own: ErrorModel) -> np.ndarray:
    """Numbers of parameters that both models have, (k, 2): in `model` and in `own`."""
    pairs = []
    for key, function in model.by_name.items():
        if key in own.by_name:
            a, b = function.parameters, own.by_name[key].parameters
            if a.stop - a.start == b.stop - b.start:
                pairs += list(zip(range(a.start, a.stop), range(b.start, b.stop), strict=True))
    return np.unique(np.array(pairs, dtype=int).reshape(-1, 2), axis=0)


def _one_step(problem: Problem, z: np.ndarray) -> float:
    """Chi-square after one Gauss-Newton step, by the quadratic model of the cost."""
    normal = problem.equations.normal(z)
    matrix, gradient = problem.free.T @ normal.matrix @ problem.free, problem.free.T @ normal.gradient
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    scaled = matrix * scale[:, None] * scale
    scaled[np.diag_indices(len(scaled))] += RIDGE
    half = np.linalg.solve(np.linalg.cholesky(scaled), scale * gradient)
    return 2.0 * float(normal.cost) - float(half @ half)
