"""From the optimum of a fit to a solution: parameters, covariance, residuals, statistics, and what is said about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from volid.backend.rms import rms
from volid.campaign import Campaign
from volid.fitting.change_of_datum import held_constants
from volid.fitting.diagnosis.adequacy import Adequacy, SuspectReading, suspect
from volid.fitting.diagnosis.around import Around, Fit, around
from volid.fitting.diagnosis.outcome import outcome_of
from volid.fitting.diagnosis.tally import assess
from volid.fitting.diagnosis.verdict import judge, untested
from volid.fitting.equations.freedom import degrees_of_freedom
from volid.fitting.equations.problem import Problem
from volid.fitting.equations.solver import Optimum
from volid.fitting.mixed.set_tests import set_tests, with_sets
from volid.fitting.results import Residuals, Statistics, read_only
from volid.fitting.smooth_fit import SmoothFit
from volid.fitting.solution import Solution


class Every(NamedTuple):
    """Tests of all readings, and their number, where a solution holds some of them only."""

    tested: Adequacy
    n_readings: int


class Assembly:
    """A fitter at its optimum, and what a solution takes from it. `outliers`: (m, k) bool per set, not used in the fit."""

    def __init__(self, fitter: SmoothFit, outliers: list[np.ndarray]) -> None:
        self.fitter, self.outliers = fitter, outliers
        self.problem: Problem = fitter.problem
        self.campaign: Campaign = fitter.campaign
        assert fitter.optimum is not None
        self.optimum: Optimum = fitter.optimum
        self.active = [~o for o in outliers]
        self.n_used = sum(int(a.sum()) for a in self.active)
        self.tests: tuple[Around, Fit] | None = None  # what the verdict was made from, once there is one

    def solution(
        self,
        warnings: tuple[str, ...],
        options: dict[str, Any],
        starts: Mapping[Any, float],
        every: Every | None = None,
    ) -> Solution:
        """The solution. `warnings`: of the checks before the fit; `options`: what was asked of it; `starts`: of the unknowns;
        `every`: the tests of all readings, where the campaign holds some of them."""
        theta, root = self._parameters()
        smooth = self.fitter.smooth_prior(theta, root)
        covariance = root @ root.T
        if smooth is not None:
            covariance += smooth.spread @ smooth.spread.T
        found = Solution(
            parameters=read_only(theta),
            nuisance=read_only(self.optimum.z[self.problem.model.layout.n_coefficients :]),
            covariance=read_only(covariance),
            null_space=read_only(self.fitter.found.null_space),
            held_directions=read_only(self.fitter.found.tool_rotation),
            model=self.problem.model,
            campaign=self.campaign,
            nuisance_table=self.problem.nuisance,
            adequacy=self.tested() if every is None else every.tested,
            statistics=self._statistics(),
            readings=self._readings(),
            statements=self.fitter.found.statements,
            undetermined=self.fitter.found.undetermined,
            notes=(*self.campaign.warnings, *warnings, *self._notes()),
            options=options,
            prior_root=read_only(self.fitter.known.root) if options["prior"] else None,
            smooth=smooth,
        )
        adequacy = self._judged(found, root, starts, 1.0 if every is None else self.n_used / every.n_readings)
        return replace(found, adequacy=adequacy, covariance=read_only(adequacy.factor**2 * covariance))

    def _judged(self, found: Solution, root: np.ndarray, starts: Mapping[Any, float], share: float) -> Adequacy:
        """The verdict on the tests of a solution. `root`: of the covariance of (θ, ν); `share`: of all readings that are here."""
        tested, n = found.adequacy, found.model.n_parameters
        if tested.degrees_of_freedom <= 0:
            return untested(tested)
        extra = found.smooth_spread[:n]
        outcome = outcome_of(self.campaign, found.model, found.parameters, root[:n], extra, found.scatter_u())
        fit = Fit(
            self.problem, self.campaign, self.optimum.z, self.fitter.root(), self.fitter.factors, starts,
            self.fitter.smooth_rows, share,
        )  # fmt: skip
        self.tests = around(fit, outcome, tested.chi_square, tested.degrees_of_freedom), fit
        judged = judge(*self.tests, found.machine, tested, self.fitter.waves)
        return with_sets(judged, set_tests(self.tests[0]))

    @cached_property
    def _whitened(self) -> list[np.ndarray]:
        return self.fitter.whitened()

    @cached_property
    def _leverages(self) -> list[np.ndarray]:
        return self.fitter.leverages()

    @cached_property
    def _residuals(self) -> tuple[np.ndarray, ...]:
        return tuple(r * s.u for r, s in zip(self._whitened, self.campaign.sets, strict=True))

    def _parameters(self) -> tuple[np.ndarray, np.ndarray]:
        """θ from the coefficients, and the square root of the covariance of (θ, ν).

        P is block orthonormal only where carrier and chosen splines agree: solve with PᵀP instead of transposing.
        """
        n, root, basis = (
            self.problem.model.layout.n_coefficients,
            self.fitter.root(),
            self.problem.model.parametrisation,
        )
        gram = basis.T @ basis
        if not len(gram):
            return np.zeros(0), root[n:]
        factor = cho_factor(gram)
        theta = cho_solve(factor, basis.T @ self.optimum.z[:n])
        return theta, np.vstack([cho_solve(factor, basis.T @ root[:n]), root[n:]])

    def tested(self) -> Adequacy:
        """Chi-square and group tests; what is known beforehand counts as readings."""
        system = self.problem.system
        pseudo = np.asarray(system.prior_residual(self.optimum.z))
        freedom = degrees_of_freedom(self.n_used, self.problem, self.fitter.free)
        return assess(self.campaign, self._whitened, self._leverages, self.active, freedom, float(pseudo @ pseudo))

    def _statistics(self) -> Statistics:
        sets = zip(self.campaign.sets, self._residuals, self.active, strict=True)
        by_set = {s.name: rms(r[a]) for s, r, a in sets}
        return Statistics(
            n_readings=self.n_used,
            n_parameters=self.fitter.free.shape[1],
            residual_rms=by_set,
            iterations=self.optimum.iterations,
            converged=self.optimum.converged,
        )

    def _readings(self) -> Residuals:
        """Residuals of every reading, also normalised and predicted from the others."""
        pairs = zip(self._whitened, self._leverages, strict=True)
        return Residuals(
            residuals=self._residuals,
            normalised=tuple(r / np.sqrt(np.maximum(1.0 - h, 1e-9)) for r, h in pairs),
            outliers=tuple(self.outliers),
            outlier_readings=self._outlier_readings(),
            held_out=tuple(h * s.u for h, s in zip(self.fitter.held_out(), self.campaign.sets, strict=False)),
        )

    def _outlier_readings(self) -> tuple[SuspectReading, ...]:
        """The readings that were set aside, the largest residual first."""
        found = []
        for s, r, o in zip(self.campaign.sets, self._whitened, self.outliers, strict=True):
            for i, k in np.argwhere(o).tolist():
                found.append(suspect(s, i, k, float(r[i, k]), float(r[i, k])))
        return tuple(sorted(found, key=lambda x: -abs(x.normalised)))

    def _notes(self) -> list[str]:
        notes, found = [], self.fitter.found
        fixed = held_constants(self.problem.model, found.tool_rotation)
        if not self.optimum.converged:
            notes.append("the iteration stopped before full convergence")
        if fixed:
            notes.append(
                f"constant tool rotation {', '.join(fixed)}: not determined by these stations and tool vectors, held at 0"
            )
        if scatter := self.fitter.scatter:
            sizes = " and ".join(f"{1e3 * u:.2f} µm in {direction} direction" for direction, u in scatter.items())
            notes.append(
                f"waves too short for the functions: {sizes} (standard deviation), independent from position to position and "
                "part of every u; where it is the pitch of a screw, state it as `pitch` of the axis"
            )
        if self.fitter.is_broken_down:
            notes.append(
                "the smoothness of the functions could not be estimated from these readings; what it brings to u is missing"
            )
        if found.nuisance_defect:
            notes.append(f"{found.nuisance_defect} combinations of station or instrument parameters not determined")
        return notes
