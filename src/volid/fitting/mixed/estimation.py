"""u of some sets estimated anew from the residuals: rounds of a fit and a step of the variance components until both agree.

The smoothness of functions is estimated in each round with the u of that round, so that both are at the maximum of their common
likelihood. A robust fit sets gross readings aside first, with a scale of every component from the median of its residuals, and
again with the u that was found. What is independent from position to position (waves too short for a function) cannot be told
from a larger u of all sets, and counts as such here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from volid.campaign import Campaign
from volid.fitting.diagnosis.robust import down_weight, name_outliers, set_aside
from volid.fitting.equations.problem import reweight, with_random_effects
from volid.fitting.mixed.components import Component, scaled
from volid.fitting.mixed.records import ESTIMATED, UNFINISHED, VarianceComponent
from volid.fitting.mixed.reml import Score, information
from volid.fitting.smooth_fit import SmoothFit
from volid.fitting.stages import Stages

ROUNDS = 25
ARRIVED = 1e-5  # step of ln σ² over its standard uncertainty; of a smoothness, which is estimated less finely
ARRIVED_SMOOTH = 0.02
LEAST_REDUNDANCY = 5.0  # of a component: with less its factor has a standard uncertainty of a third and more
BOUND = 100.0  # factors beyond it, or below its inverse, are no matter of an instrument
MEDIANS = 5  # rounds with the scale from medians
AGAIN = 3  # searches for gross readings
NORMAL_MEDIAN = 0.6745  # of the absolute value of a normal variable


@dataclass
class _At:
    """Where the estimation stands: ln σ² of every component, its fit, and readings set aside (m, k) per set."""

    tau: np.ndarray
    fitter: SmoothFit
    outliers: list[np.ndarray]
    score: Score | None = None


class Estimation:
    """The estimation of the factors of `components`, from the first fit of `stages` on."""

    def __init__(self, stages: Stages, fitter: SmoothFit, components: tuple[Component, ...]) -> None:
        self.stages, self.task, self.components = stages, stages.task, components
        nothing = [np.zeros(s.readings.shape, dtype=bool) for s in stages.measured.sets]
        self.at = _At(np.zeros(len(components)), fitter, nothing)
        self.free = np.ones(len(components), dtype=bool)
        self.arrived = True

    def run(self) -> tuple[Campaign, tuple[VarianceComponent, ...]]:
        """The campaign with the u that was found, and what was found."""
        if self.task.robust:
            self._scale_by_medians()
        for _ in range(AGAIN if self.task.robust else 1):
            before = self.at.outliers
            if self.task.robust:
                self.at.outliers = self._gross()
            self._maximise()
            if all(np.array_equal(a, b) for a, b in zip(before, self.at.outliers, strict=True)):
                break
        return scaled(self.stages.measured, self.components, self._factors(self.at.tau)), self._found()

    # -------------------------------------------------------------------------------------------------------------------- fits

    def _factors(self, tau: np.ndarray) -> np.ndarray:
        return np.asarray(np.exp(0.5 * tau))

    def _fit_with(self, tau: np.ndarray) -> SmoothFit:
        """A fit with these factors, that begins at the last one; not yet solved."""
        of_sets = scaled(self.stages.measured, self.components, self._factors(tau))
        return self.at.fitter.with_u(with_random_effects(of_sets, self.task.starts, self.task.engine), self._weights())

    def _weights(self) -> list[np.ndarray]:
        return [np.where(o, 0.0, 1.0) for o in self.at.outliers]

    def _solve(self, tau: np.ndarray) -> None:
        """Fit with these factors, the smoothness included."""
        self.at.tau, self.at.fitter = tau, self._fit_with(tau)
        self.at.fitter.solve_without_waves(self._weights())

    def _maximise(self) -> None:
        """Steps to the maximum; what is hardly redundant there stays as stated, and the others go on without it."""
        for _ in range(len(self.components) + 1):
            self._iterate()
            score = self.at.score
            assert score is not None
            weak = self.free & (score.redundancy < LEAST_REDUNDANCY)
            if not weak.any():
                return
            worst = np.flatnonzero(weak)[np.argmin(score.redundancy[weak])]
            self.free[worst], self.at.tau[worst] = False, 0.0

    def _iterate(self) -> None:
        limit = 2.0 * np.log(BOUND)
        for number in range(ROUNDS):
            self.task.progress(f"estimating u of the sets, round {number + 1}")
            self._solve(np.where(self.free, self.at.tau, 0.0))
            self.at.score = score = self._score()
            own = np.ix_(self.free, self.free)
            part = Score(score.squares[self.free], score.redundancy[self.free], score.information[own])
            new = np.clip(self.at.tau[self.free] + part.step, -limit, limit)
            sizes = np.abs(new - self.at.tau[self.free]) / np.sqrt(np.diagonal(part.covariance))
            self.arrived = float(np.max(sizes, initial=0.0)) < (ARRIVED_SMOOTH if self.at.fitter.processes else ARRIVED)
            if self.arrived:
                return
            self.at.tau[self.free] = new

    # ------------------------------------------------------------------------------------------------------------ likelihood

    def _score(self) -> Score:
        """Score and information of all components at the fit."""
        fitter, weights = self.at.fitter, self._weights()
        v, h, shares = fitter.whitened(), fitter.leverages(), self._shares()
        squares, redundancy, squared, products = [], [], [], []
        for component in self.components:
            i, used = component.number, component.rows & (weights[component.number] > 0.0)
            s = np.where(used, shares[i], 0.0)
            squares.append(float(np.sum(s * np.where(used, v[i], 0.0) ** 2)))
            redundancy.append(float(np.sum(s * (1.0 - np.where(used, h[i], 0.0)))))
            squared.append(float(np.sum(s**2 * (1.0 - 2.0 * np.where(used, h[i], 0.0)))))
            products.append(self._product(i, np.sqrt(s)))
        slopes, covariance = fitter.smoothness_slopes()
        found = information(np.array(squared), products, slopes, covariance)
        return Score(np.array(squares), np.array(redundancy), found)

    def _shares(self) -> list[np.ndarray]:
        """What part of the variance of every reading is that of its u, without effects that are drawn anew."""
        own = scaled(self.stages.measured, self.components, self._factors(self.at.tau))
        return [(a.u / b.u) ** 2 for a, b in zip(own.sets, self.at.fitter.campaign.sets, strict=True)]

    def _product(self, number: int, root_shares: np.ndarray) -> np.ndarray:
        """Lᵀ Jᵀ S J L of the readings of one component, `root_shares` (m, k) of its set, 0 for others."""
        fitter = self.at.fitter
        factors = [np.zeros(s.readings.shape) for s in fitter.campaign.sets]
        factors[number] = root_shares
        problem = reweight(fitter.problem, fitter.campaign, factors)
        bare = replace(problem.system, prior_value=np.zeros(0), prior_root=np.zeros((0, problem.system.size)))
        assert fitter.optimum is not None
        root = fitter.root()
        matrix = np.asarray(problem.equations.changed(bare).normal(fitter.optimum.z).matrix)
        return np.asarray(root.T @ matrix @ root)

    # ------------------------------------------------------------------------------------------------------------ gross readings

    def _scale_by_medians(self) -> None:
        """Factors from medians of residuals, which gross readings do not move, in fits with Huber's weights."""
        for _ in range(MEDIANS):
            fitter = self._fit_with(self.at.tau)
            fitter.solve_without_waves(down_weight(fitter.residuals_only, self._weights()))
            v, h = fitter.whitened(), fitter.leverages()
            step = np.array([_scale(v[c.number][c.rows], h[c.number][c.rows]) for c in self.components])
            self.at.fitter, self.at.tau = fitter, np.clip(self.at.tau + step, -9.0, 9.0)
            if np.max(np.abs(step), initial=0.0) < 0.1:
                return

    def _gross(self) -> list[np.ndarray]:
        """Readings to set aside, with the u that was found so far."""
        fitter = self._fit_with(self.at.tau)
        factors = down_weight(fitter.residuals_only, [np.ones(s.readings.shape) for s in fitter.campaign.sets])
        return name_outliers(fitter.weighted, set_aside(fitter.weighted(factors)))

    # -------------------------------------------------------------------------------------------------------------------- result

    def _found(self) -> tuple[VarianceComponent, ...]:
        score, factors, weights = self.at.score, self._factors(self.at.tau), self._weights()
        assert score is not None
        deviation = np.full(len(factors), np.nan)
        own = np.ix_(self.free, self.free)
        part = Score(score.squares[self.free], score.redundancy[self.free], score.information[own])
        deviation[self.free] = 0.5 * factors[self.free] * np.sqrt(np.diagonal(part.covariance))
        return tuple(
            VarianceComponent(
                set=c.set,
                part=c.part,
                n=int(np.count_nonzero(c.rows & (weights[c.number] > 0.0))),
                redundancy=float(score.redundancy[g]),
                factor=float(factors[g]),
                u=float(deviation[g]),
                state=_too_few(score.redundancy[g]) if not self.free[g] else ESTIMATED if self.arrived else UNFINISHED,
            )
            for g, c in enumerate(self.components)
        )


def _too_few(redundancy: float) -> str:
    return f"kept as stated: {max(redundancy, 0.0):.1f} degrees of freedom are its own, and {LEAST_REDUNDANCY:g} are needed"


def _scale(v: np.ndarray, h: np.ndarray) -> float:
    """ln of the variance of whitened residuals `v` with leverages `h`, by their median; 0 where too few check others."""
    left = 1.0 - h
    if float(np.sum(left)) < LEAST_REDUNDANCY:
        return 0.0
    size = float(np.median(np.abs(v) / np.sqrt(np.maximum(left, 0.05)))) / NORMAL_MEDIAN
    return float(np.clip(2.0 * np.log(max(size, 1e-3)), -3.0, 3.0))
