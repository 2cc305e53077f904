"""A fit in which the smoothness of the error functions is estimated: `Fitter` with the smoothness as pseudo-readings.

First the smoothness takes its ordinary value and the problem is solved. There the readings' information on the error functions
gives the smoothness by marginal likelihood (`smoothness.evidence`), with which the problem is solved again from where it
stands. The information does not depend on the smoothness, so once is enough. Where the residuals show waves too short for any
smooth function, u of the readings is enlarged by these (`smoothness.scatter`), and both are estimated again.
"""

from __future__ import annotations

import numpy as np

from volid.campaign import Campaign
from volid.exceptions import VolidError
from volid.fitting.diagnosis.robust import down_weight
from volid.fitting.equations.problem import Prior, Problem, reweight, with_prior
from volid.fitting.equations.solver import solve
from volid.fitting.fitter import Fitter, Method
from volid.fitting.results import SmoothPrior, read_only
from volid.fitting.smoothness.evidence import Information, Smoothness, estimate, first_guess
from volid.fitting.smoothness.geometry import determined
from volid.fitting.smoothness.information import information
from volid.fitting.smoothness.processes import Process
from volid.fitting.smoothness.scatter import SUSPECT, enlarged, estimated, positioning, squared_sensitivities

PASSES = 2  # of scatter, then of all the rest with it


class SmoothFit(Fitter):
    """A problem restricted to its determined directions, with the smoothness of some functions.

    `known`: what is known of θ from an earlier solution. `processes`: whose smoothness is estimated. `factors`: square-root
    weights per set, 0 for readings that are set aside, on which what is determined depends.
    """

    def __init__(
        self,
        campaign: Campaign,
        problem: Problem,
        known: Prior,
        processes: tuple[Process, ...],
        method: Method = solve,
        factors: list[np.ndarray] | None = None,
    ) -> None:
        found = determined(campaign, problem, known, processes, factors)
        super().__init__(campaign, problem, found, method)
        self.known, self.processes = known, processes
        self.scatter: dict[str, float] = {}
        self.waves: dict[str, float] = {}  # the part of `scatter` that this campaign showed
        self.is_broken_down = False  # whether the smoothness could not be estimated
        self.kappa = 1.0  # by which all readings' u is taken to be too small
        self.measured, self.bare = campaign, problem
        self._take(first_guess(processes))

    @property
    def n_smooth(self) -> int:
        """Number of pseudo-readings of the smoothness."""
        return len(self.smooth_rows)

    @property
    def prior(self) -> Prior:
        """What is known of θ, the smoothness included."""
        return self.known.and_smooth(self.smooth_rows)

    def _take(self, smoothness: Smoothness) -> None:
        self.smoothness = smoothness
        # readings of κu and pseudo-readings W are, but for a common factor, readings of u and pseudo-readings κW
        self.smooth_rows = self.kappa * smoothness.rows(self.problem.model.n_parameters)
        self.problem = with_prior(self.problem, self.prior)

    def solve_with_smoothness(self, factors: list[np.ndarray], robust: bool = False) -> None:
        """Optimum with square-root weights `factors`, and the smoothness that they give.

        `robust`: gross readings have no say in it.
        """
        self.solve(factors)
        if not self.processes:
            return
        if robust:
            self.solve(down_weight(self.residuals_only, factors))
        self._estimate(factors)
        if not robust:  # gross readings, of which there may be some still, are no waves of the machine
            self._add_scatter(factors)

    def _estimate(self, factors: list[np.ndarray]) -> None:
        """The smoothness from where the fit stands, and the optimum with it; where that breaks down, both stay as they are.

        It does where functions would have to be as large as travels: readings of another machine, or positions that are wrong.
        The verdict says so.
        """
        before, optimum = self.smoothness, self.optimum
        try:
            self._take(estimate(self.processes, self._information(), self.smoothness.phi))
            self.solve(factors)
            self.root()
        except (np.linalg.LinAlgError, VolidError):
            self._take(before)
            self.optimum, self.is_broken_down = optimum, True

    def _add_scatter(self, factors: list[np.ndarray]) -> None:
        """What is independent from position to position: u of the readings grows by it, where the residuals show it."""
        names, active = positioning(self.problem.model, self.processes), _joined(factors) > 0.0
        v = _joined(self.whitened())[active]
        freedom = max(len(v) + self.n_smooth - self.free.shape[1], 1)
        if not names or float(v @ v) < freedom * (1.0 + SUSPECT * np.sqrt(2.0 / freedom)):
            return
        measured, bare = self.measured, self.bare
        assert self.optimum is not None
        squares = squared_sensitivities(bare, measured, self.optimum.z, names)
        for _ in range(PASSES):
            now = _joined([s.u for s in self.campaign.sets]) / _joined([s.u for s in measured.sets])
            v, left = _joined(self.whitened()) * now, 1.0 - _joined(self.leverages())
            self.scatter = estimated(v[active], left[active], squares[:, active], names)
            self.campaign = enlarged(measured, squares, names, self.scatter) if self.scatter else measured
            self.problem = reweight(bare, self.campaign, [np.ones(f.shape) for f in factors])
            self._take(self.smoothness)
            self.solve(factors)
            self._estimate(factors)
            if not self.scatter:
                return

    def _information(self) -> Information:
        assert self.optimum is not None
        found = information(self.problem, self.found.basis, self.optimum.z, self.optimum.normal, self.smooth_rows)
        return found._replace(matrix=found.matrix / self.kappa**2, vector=found.vector / self.kappa**2)

    def without(self, outliers: list[np.ndarray]) -> SmoothFit:
        """Refit without the outliers; what is determined is decided again, since outliers alone may have determined it."""
        factors = [np.where(o, 0.0, 1.0) for o in outliers]
        refit = SmoothFit(self.measured, self.bare, self.known, self.processes, self.method, factors)
        refit._take(self.smoothness)
        refit.solve_with_smoothness(factors)
        return refit

    def without_scatter(self) -> SmoothFit:
        """Refit with the readings' u as stated: something else explains what looked independent from position to position."""
        refit = SmoothFit(self.measured, self.bare, self.known, self.processes, self.method, self.factors)
        refit._take(self.smoothness)
        refit.solve(self.factors)
        refit._estimate(self.factors)
        return refit

    def with_larger_u(self, kappa: float) -> SmoothFit:
        """Refit with the smoothness that the functions have when all readings are worse than stated by the factor κ.

        u stays as it is: the covariance is that of the readings' stated u, and κ² times as large in truth.
        """
        refit = SmoothFit(self.measured, self.bare, self.known, self.processes, self.method, self.factors)
        refit.kappa = kappa
        refit._take(self.smoothness)
        refit.solve(self.factors)
        refit._estimate(self.factors)
        return refit

    def with_u(self, campaign: Campaign, factors: list[np.ndarray]) -> SmoothFit:
        """The fit of the same readings with other u, those of `campaign`; it begins at this optimum, and is not yet solved."""
        problem = reweight(self.bare, campaign, [np.ones(s.readings.shape) for s in campaign.sets])
        refit = SmoothFit(campaign, problem, self.known, self.processes, self.method, factors)
        refit._take(self.smoothness)
        refit.optimum = self.optimum
        return refit

    def solve_without_waves(self, factors: list[np.ndarray]) -> None:
        """Optimum with square-root weights `factors`, and the smoothness that they give; every misfit counts as noise."""
        self.solve(factors)
        if self.processes:
            self._estimate(factors)

    def smoothness_slopes(self) -> tuple[list[np.ndarray], np.ndarray]:
        """Lᵀ ∂Q/∂φ L (r, r) for every parameter φ of the smoothness, L the root of the covariance of z; covariance of φ."""
        theta = self.problem.model.projection @ self.root()[: self.problem.model.layout.n_coefficients]
        found = []
        for i, process in enumerate(self.processes):
            _, slopes = process.precision_with_slopes(self.smoothness.of(i))
            own = theta[process.parameters]
            found += [own.T @ slope @ own for slope in slopes]
        return found, self.smoothness.covariance

    def smooth_prior(self, theta: np.ndarray, root: np.ndarray) -> SmoothPrior | None:
        """What the solution holds of the smoothness, at θ.

        `root` L (n + k, r): covariance of (θ, ν) at the estimated smoothness = L Lᵀ.
        """
        if not self.processes:
            return None
        noise = self.smoothness.noise(theta)
        n = self.problem.model.n_parameters
        spread = root @ (root[:n].T @ (self.smooth_rows.T @ noise))
        names = tuple(f"{p.label} {what}" for p in self.processes for what in p.parameter_names)
        return SmoothPrior(
            names=names,
            values=read_only(self.smoothness.phi),
            u=read_only(np.sqrt(np.diagonal(self.smoothness.covariance))),
            root=read_only(self.smooth_rows),
            noise=read_only(noise),
            spread=read_only(spread),
            scatter=self.scatter,
        )


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    """Arrays (m, k) of the sets as one, in the order of sets, rows, columns."""
    return np.concatenate([np.asarray(p).ravel() for p in parts])
