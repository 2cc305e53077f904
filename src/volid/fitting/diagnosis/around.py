"""A fit linearised around its optimum, as hold-outs and tests of alternatives take it.

With whitened residuals v = (reading - predicted)/u, J L the whitened Jacobian times a root of the covariance C = L Lᵀ, and
H = J C Jᵀ, a sound model leaves v with the covariance 1 - H, prior knowledge included. Further unknowns a with the whitened
sensitivities A would bring chi-square down by bᵀM⁻¹b, M = Aᵀ(1 - H)A, b = Aᵀv, and move what the fit says by -L (J L)ᵀ A a.
Exact for a model that is linear in its unknowns, and to second order of the errors here.

A campaign of very many readings is thinned out evenly first, and the linear fit to those that are left stands for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from volid.campaign import Campaign
from volid.fitting.diagnosis.hold_out import rows_by_reading
from volid.fitting.diagnosis.outcome import Outcome
from volid.fitting.diagnosis.sensitivities import Sensitivities, of_displacement, of_readings
from volid.fitting.equations.choice import engine_named
from volid.fitting.equations.problem import Problem, build_problem, reweight, scatter
from volid.observations import KINDS
from volid.observations.base import NuisanceTable

AT_MINIMUM = 0.01  # standard uncertainties of the gradient, more than rounding
MOST = 40_000_000  # numbers of J L, 320 MB: above, readings are thinned out


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit at its optimum.

    `problem`, `campaign` (with the u that it used), z, `root` L of its covariance. `factors` (m, k) per set: square-root weights,
    0 for readings that are set aside. `starts` of its unknowns, `smooth_rows` of the functions' smoothness on θ. `share`: of the
    readings that the fit was made of, how many are here.
    """

    problem: Problem
    campaign: Campaign
    z: np.ndarray
    root: np.ndarray
    factors: list[np.ndarray]
    starts: Mapping[Any, float]
    smooth_rows: np.ndarray
    share: float = 1.0


@dataclass(frozen=True, eq=False)
class Around:
    """What a fit looks like to tests of alternatives; n readings in the order of sets, rows, columns, over their u.

    `campaign`: the readings that are here, all or some. `share`: of all readings. `v` (n,): residuals; 0 where set aside.
    `rows` (n, r): J L. `seen`: how readings answer. `outcome`: what a fit is for. `chi_square`, `freedom`: of all readings of the
    fit. `factor` (n,): square-root weights, 0 for readings that are set aside.
    """

    campaign: Campaign
    share: float
    v: np.ndarray
    rows: np.ndarray
    factor: np.ndarray
    seen: Sensitivities
    outcome: Outcome
    chi_square: float
    freedom: int

    @property
    def active(self) -> np.ndarray:
        """Readings that take part, bool (n,)."""
        return np.asarray(self.factor > 0.0)

    @cached_property
    def target(self) -> np.ndarray:
        """Sensitivities to a displacement of the target in the workpiece frame, (3, n) [1/mm]."""
        return of_displacement(self.campaign.machine, self.seen)

    @property
    def positions(self) -> np.ndarray:
        """Positions of every reading, (n, n_axes) [mm or degrees]: the first, where it has two."""
        return self.seen.positions[: len(self.v)]

    @cached_property
    def weight(self) -> np.ndarray:
        """1/u of every reading times its square-root weight, (n,)."""
        return np.asarray(self.factor / self._joined([s.u for s in self.campaign.sets]))

    @cached_property
    def set_number(self) -> np.ndarray:
        """Which set every reading belongs to, (n,)."""
        return self._joined([np.full(s.readings.shape, i) for i, s in enumerate(self.campaign.sets)])

    @cached_property
    def row(self) -> np.ndarray:
        """Row of every reading within its set, (n,)."""
        shapes = [s.readings.shape for s in self.campaign.sets]
        return self._joined([np.broadcast_to(np.arange(m)[:, None], (m, k)) for m, k in shapes])

    @cached_property
    def tools(self) -> np.ndarray:
        """Tool vector of every reading, (n, 3) [mm]."""
        return np.concatenate([np.repeat(s.tool, s.readings.shape[1], axis=0) for s in self.campaign.sets])

    def labels(self, label: str) -> np.ndarray:
        """A text column of every reading, (n,); "" where its kind does not have it."""
        parts = [s.labels.get(label, np.full(len(s), "")) for s in self.campaign.sets]
        wide = [np.repeat(p.astype(str), s.readings.shape[1]) for p, s in zip(parts, self.campaign.sets, strict=True)]
        return np.concatenate(wide)

    @cached_property
    def standing(self) -> np.ndarray:
        """What every reading is made from or to, "station S1", "sphere P1", "" where there is nothing, (n,)."""
        found = []
        for s in self.campaign.sets:
            kind = KINDS[s.kind]
            label = "station" if "station" in kind.labels else kind.standing
            names = [f"{label} {name}" for name in s.labels[label].astype(str)] if label else [""] * len(s)
            found.append(np.repeat(np.array(names, dtype=str), s.readings.shape[1]))
        return np.concatenate(found)

    @cached_property
    def has_time(self) -> bool:
        """Whether every reading has its time; else the order of the rows stands for it."""
        return all(s.time is not None and bool(np.all(np.isfinite(s.time))) for s in self.campaign.sets)

    @cached_property
    def when(self) -> np.ndarray:
        """Time of every reading [s], or its place in the order of rows, (n,)."""
        if self.has_time:
            parts = [np.repeat(np.asarray(s.time, dtype=float), s.readings.shape[1]) for s in self.campaign.sets]
            return np.concatenate(parts)
        first = np.cumsum([0, *(len(s) for s in self.campaign.sets)])
        return np.asarray(first[self.set_number] + self.row, dtype=float)

    @cached_property
    def temperature(self) -> np.ndarray | None:
        """Recorded temperature of every reading [°C], (n,); None where it is not recorded, or does not change."""
        given = [s.temperature for s in self.campaign.sets]
        if any(t is None or not np.all(np.isfinite(t)) for t in given):
            return None
        parts = [np.repeat(np.asarray(t), s.readings.shape[1]) for t, s in zip(given, self.campaign.sets, strict=True)]
        values = np.concatenate(parts)
        return values if np.ptp(values) > 1e-6 else None

    def where(self, i: int) -> str:
        """File and row of reading i."""
        return self.campaign.sets[int(self.set_number[i])].where(int(self.row[i]))

    def _joined(self, parts: list[np.ndarray]) -> np.ndarray:
        return np.concatenate([np.asarray(p).ravel() for p in parts])


def around(fit: Fit, outcome: Outcome, chi_square: float, freedom: int, most: int = MOST) -> Around:
    """The fit around its optimum; `outcome`: in the directions of `fit.root`; `most`: numbers of J L that are kept."""
    campaign, factors, share = _thinned(fit, most)
    same = campaign is fit.campaign and fit.problem.engine.name == "interpreted"
    problem = fit.problem if same else _rebuilt(fit, campaign)
    problem = reweight(problem, campaign, factors)
    values = scatter(problem, campaign, problem.equations.predictions(fit.z))
    sets = zip(factors, campaign.sets, values, strict=True)
    v = [np.where(f > 0.0, f * (s.readings - p) / s.u, 0.0) for f, s, p in sets]
    whole = np.concatenate([r.ravel() for r in v])
    rows = rows_by_reading(problem, campaign, problem.equations.projected(fit.z, fit.root.T))
    if share < 1.0 or _slope(fit, whole, rows) > AT_MINIMUM:
        whole, rows, outcome = _fitted(fit, whole, rows, outcome)
    seen = of_readings(problem, campaign, fit.z)
    weights = np.concatenate([f.ravel() for f in factors])
    return Around(campaign, share, whole, rows, weights, seen, outcome, chi_square, freedom)


def _thinned(fit: Fit, most: int) -> tuple[Campaign, list[np.ndarray], float]:
    """Every so-manieth row, evenly over each set, with its weights, and their share."""
    step = fit.campaign.n_readings * fit.root.shape[1] / most
    if step <= 1.0:
        return fit.campaign, fit.factors, fit.share
    sets, factors = [], []
    for s, f in zip(fit.campaign.sets, fit.factors, strict=True):
        numbers = np.unique(np.linspace(0, len(s) - 1, max(int(len(s) / step), min(len(s), 2))).astype(int))
        sets.append(s.rows_of(numbers))
        factors.append(f[numbers])
    campaign = replace(fit.campaign, sets=tuple(sets))
    return campaign, factors, fit.share * campaign.n_readings / fit.campaign.n_readings


def _rebuilt(fit: Fit, campaign: Campaign) -> Problem:
    """The problem of some of the readings, with the unknowns of all, in the engine that compiles nothing."""
    table = NuisanceTable.of(fit.problem.nuisance)
    table.starts = fit.starts
    return build_problem(campaign, fit.problem.model, table=table, engine=engine_named("interpreted"))


def _slope(fit: Fit, v: np.ndarray, rows: np.ndarray) -> float:
    """How far the fit stands from its minimum, in standard uncertainties: some stop before they are there."""
    system = fit.problem.system
    known = (np.asarray(system.prior_root) @ fit.root).T @ np.asarray(system.prior_residual(fit.z))
    return float(np.max(np.abs(rows.T @ v - known), initial=0.0))


def _fitted(fit: Fit, v: np.ndarray, rows: np.ndarray, outcome: Outcome) -> tuple[np.ndarray, np.ndarray, Outcome]:
    """Residuals, rows and outcome at the minimum of the linear fit to the readings that are here, with all prior knowledge."""
    system = fit.problem.system
    known = np.asarray(system.prior_root) @ fit.root
    matrix = rows.T @ rows + known.T @ known
    lower = np.linalg.cholesky(matrix + 1e-12 * np.trace(matrix) / len(matrix) * np.eye(len(matrix)))
    pull = rows.T @ v - known.T @ np.asarray(system.prior_residual(fit.z))
    step = solve_triangular(lower, solve_triangular(lower, pull, lower=True), lower=True, trans="T")
    turned = solve_triangular(lower, rows.T, lower=True).T
    return v - rows @ step, turned, outcome.turned(lower)
