"""One least-squares fit and what is asked of it: refits with other weights, residuals, leverages, the covariance's root."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from volid.campaign import Campaign
from volid.exceptions import InputError, VolidError
from volid.fitting.diagnosis.hold_out import held_out_residuals
from volid.fitting.diagnosis.identifiability import Identifiability, analyse
from volid.fitting.diagnosis.robust import Weighted
from volid.fitting.equations.problem import Problem, reweight, scatter
from volid.fitting.equations.solver import Optimum, solve

Method = Callable[..., Optimum]  # as `solver.solve`


class Fitter:
    """A problem restricted to its determined directions; refits with other weights start at the last optimum."""

    def __init__(self, campaign: Campaign, problem: Problem, found: Identifiability, method: Method = solve) -> None:
        self.campaign, self.problem, self.found, self.method = campaign, problem, found, method
        self.free = problem.free @ found.basis
        self.optimum: Optimum | None = None
        self.factors = [np.ones(s.readings.shape) for s in campaign.sets]
        self._root: tuple[Optimum, np.ndarray] | None = None  # of that optimum

    def solve(self, factors: list[np.ndarray]) -> Optimum:
        """Optimum with square-root weights `factors` (m, k) per set. Raises `VolidError` when nothing converges."""
        self.factors = factors
        weighted = reweight(self.problem, self.campaign, factors)
        start = None if self.optimum is None else self.optimum.z
        self.optimum = self.method(weighted, start, self.free)
        if not np.all(np.isfinite(self.optimum.z)):
            raise VolidError("the fit diverged; check units, stations and axis positions")
        return self.optimum

    def without(self, outliers: list[np.ndarray]) -> Fitter:
        """Refit without the outliers; what is determined is decided again, since outliers alone may have determined it."""
        factors = [np.where(o, 0.0, 1.0) for o in outliers]
        weighted = reweight(self.problem, self.campaign, factors)
        refit = Fitter(self.campaign, self.problem, analyse(weighted, self.campaign), self.method)
        refit.solve(factors)
        return refit

    def whitened(self) -> list[np.ndarray]:
        """(reading - predicted)/u at the optimum, all readings."""
        assert self.optimum is not None
        blocks = self.problem.equations.predictions(self.optimum.z)
        values = scatter(self.problem, self.campaign, blocks)
        return [(s.readings - p) / s.u for s, p in zip(self.campaign.sets, values, strict=True)]

    def root(self) -> np.ndarray:
        """Square root L of the covariance of z, C = L Lᵀ, shape (size, rank): by scaled Cholesky factorisation."""
        assert self.optimum is not None
        if self._root is None or self._root[0] is not self.optimum:
            self._root = (self.optimum, self._factorised())
        return self._root[1]

    def _factorised(self) -> np.ndarray:
        assert self.optimum is not None
        matrix = self.optimum.normal.matrix
        if not np.all(np.isfinite(matrix)) or np.any(np.diagonal(matrix) <= 0.0):
            raise InputError(
                "the fit broke down: readings and positions contradict each other; check units and axis columns"
            )
        scale = 1.0 / np.sqrt(np.diagonal(matrix))
        try:
            lower = np.linalg.cholesky(matrix * np.outer(scale, scale))
        except np.linalg.LinAlgError:
            raise VolidError(
                "the fit broke down: the covariance cannot be computed, because readings and positions contradict each other, or "
                "the readings that take part determine too little; check that every reading stands in the row of its position"
            ) from None
        inverse = np.linalg.solve(lower, np.diag(scale))
        return np.asarray(self.free @ inverse.T)

    def leverages(self) -> list[np.ndarray]:
        """h_ii of the readings that take part with full weight."""
        assert self.optimum is not None
        equations = reweight(self.problem, self.campaign, self.factors).equations
        blocks = equations.quadratic_forms(self.optimum.z, self.root().T)
        return scatter(self.problem, self.campaign, blocks)

    def held_out(self) -> tuple[np.ndarray, ...]:
        """Whitened residuals, every rotary position predicted from all others; empty without rotary axes."""
        assert self.optimum is not None
        problem = reweight(self.problem, self.campaign, self.factors)
        return held_out_residuals(problem, self.campaign, self.optimum.z, self.root(), self.whitened())

    def weighted(self, factors: list[np.ndarray]) -> Weighted:
        """Refit, then residuals and leverages, for the search of outliers."""
        self.solve(factors)
        return Weighted(self.whitened(), self.leverages())

    def residuals_only(self, factors: list[np.ndarray]) -> list[np.ndarray]:
        """Refit, then residuals."""
        self.solve(factors)
        return self.whitened()
