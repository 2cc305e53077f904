"""Least-squares refits of many synthetic data sets that differ from one solved campaign by little: exact, and in batches.

Unknowns x = (θ, ν) with covariance C = H⁻¹ on what the data determine. A trial has whitened noise ε on the readings and on the
pseudo-readings of prior knowledge. The first step is linear, x₁ = x₀ + C Jᵀε, one matrix product for all trials of a batch; then

    x ← x - C g(x),   g = J(x)ᵀ r(x),   r = w (prediction(x) - reading)

with the gradient of every trial and the shared H, until the estimated distance to the minimum is below `TOLERANCE` standard
uncertainties. Near the solution g is taken to second order (`second_order`), whose error is estimated; trials for
which that is too much go on with the exact gradient. A chord with J frozen would never arrive: its fixed point is another. What H
lacks, Σ r ∇²r, makes the steps shrink by a share that is measured in a few trials. Trials that do not arrive are left to the full
solver. Robust fits repeat the search for outliers.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from volid.backend.lazy import jnp
from volid.fitting.diagnosis.robust import Weighted, critical_value, down_weight, name_outliers, set_aside
from volid.fitting.equations.engine import Engine
from volid.fitting.solution import Solution
from volid.uncertainty.trials.centre import Centre
from volid.uncertainty.trials.curvature import LARGEST, Curvature, curvatures, hessian_bytes
from volid.uncertainty.trials.curvature import TRIALS as AT_ONCE
from volid.uncertainty.trials.draws import room_for
from volid.uncertainty.trials.refit_steps import TRIALS, corrected, exact_step, linear_step, turned

TOLERANCE = 1e-6  # standard uncertainties
STEPS = 6  # steps at most, before a trial is solved anew


class Refits(NamedTuple):
    """`x`: (b, p), θ and ν of every trial. `error`: (b,) estimated distance to the minimum, in standard uncertainties.
    `chi_square`: (b,). `solved`: (b,) True where the full solver was needed. `outliers`: (b,) readings set aside anew."""

    x: np.ndarray
    error: np.ndarray
    chi_square: np.ndarray
    solved: np.ndarray
    outliers: np.ndarray


def joined(parts: list[Refits]) -> Refits:
    """Refits one after another."""
    return Refits(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _padded(values: np.ndarray, rows: int) -> np.ndarray:
    """(b, …) with zeros below, (rows, …)."""
    return values if len(values) == rows else np.pad(values, ((0, rows - len(values)), (0, 0)))


class Refitter(Centre):
    """Refits synthetic data sets drawn around a solution; see the module."""

    def __init__(self, solution: Solution, engine: Engine | None = None) -> None:
        super().__init__(solution, engine)
        self._shrinking: float | None = None

    def prepare(self) -> None:
        """Everything that the first refit would make, for refits in several threads."""
        if self.curvature is not None:
            self._measure_shrinking()

    def refit(self, noise: np.ndarray, prior_noise: np.ndarray | None = None) -> Refits:
        """Minimum of every trial; `noise` (b, N) and `prior_noise` (b, r), whitened."""
        if prior_noise is None:
            prior_noise = np.zeros((len(noise), self.n_prior))
        parts = [slice(i, i + AT_ONCE) for i in range(0, max(len(noise), 1), AT_ONCE)]
        return joined([self._refit(noise[p], prior_noise[p]) for p in parts])

    def _refit(self, noise: np.ndarray, prior_noise: np.ndarray) -> Refits:
        """At most `AT_ONCE` trials."""
        b = len(noise)
        x, error, chi = (a.copy() for a in self._bent(noise, prior_noise))
        left = np.flatnonzero(~(error <= TOLERANCE))
        if left.size:
            x[left], error[left], chi[left] = self._exact(x[left], noise[left], prior_noise[left])
        result = Refits(self.centre + x, error, chi, np.zeros(b, bool), np.zeros(b, int))
        return self._finish(result, noise, prior_noise)

    def _bent(self, noise: np.ndarray, prior_noise: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x - x₀ of every trial to second order, its estimated error, and chi-square; no claim where there is no curvature."""
        b = len(noise)
        eps, prior = (_padded(a, AT_ONCE) for a in (noise, prior_noise))
        first, linear = (np.asarray(a) for a in linear_step(self.frozen, eps, prior))
        if self.curvature is None:
            return first[:b], np.full(b, np.inf), np.full(b, np.nan)
        self._measure_shrinking()
        x, error, chi = self._passes(first, turned(eps))
        return x[:b], np.where(np.isfinite(error), error, np.inf)[:b], (linear + chi)[:b]

    def _passes(self, first: np.ndarray, eps: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Passes of the second-order correction until the estimated error of all trials is small, or of third order."""
        x, shift, third, shrinking = first, self._size(first), None, self._shrinking or 0.0
        error, chi = np.full(len(first), np.inf), np.full(len(first), np.nan)
        for _ in range(STEPS):
            new, chi = (np.asarray(a) for a in corrected(self.frozen, self.curvature, first, x, eps))
            last, x = self._size(new - x), new
            if third is None:
                with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                    third = last * last / np.maximum(shift, 1e-300)
            error = np.fmax(shrinking * last, third)
            if np.all((error <= TOLERANCE) | (third > TOLERANCE) | ~np.isfinite(error)):
                break
        return x, error, chi

    def _exact(
        self, x: np.ndarray, noise: np.ndarray, prior_noise: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Steps with the exact gradient from x (b, p), relative to x₀: as `_bent` for trials far from the solution."""
        b = len(x)
        width = b if b <= TRIALS else -(-b // TRIALS) * TRIALS
        start, eps, prior = (jnp.asarray(np.pad(a, ((0, width - b), (0, 0)))) for a in (x, noise, prior_noise))
        first, error, chi = np.full(b, np.inf), np.full(b, np.inf), np.full(b, np.nan)
        for _ in range(STEPS):
            new, chi_square = exact_step(self.frozen, start, eps, prior)
            last = self._size(new - start)[:b]
            start, chi = new, np.asarray(chi_square)[:b]
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                ratio = np.where(np.isfinite(first), last / np.maximum(first, 1e-300), 1.0)
                error = np.where(ratio < 1.0, last * np.fmax(ratio, self._shrinking or 0.0), np.inf)
                error = np.where(last <= TOLERANCE, np.fmin(error, last), error)
            first = last
            if np.all(error <= TOLERANCE):
                break
        return np.asarray(start)[:b], error, chi

    @cached_property
    def curvature(self) -> list[Curvature] | None:
        """Second derivatives of all readings at the solution; None where there are too many to keep."""
        if hessian_bytes(self.problem.system) > LARGEST:
            return None
        units = [entry.unit for entry in self.solution.nuisance_table]
        return curvatures(self.problem.system, np.asarray(self.frozen.z), self.numbers, units)

    def _measure_shrinking(self) -> float:
        """The share by which a correction shrinks from one pass to the next, largest over some trials of plain noise.

        JᵀJ at the solution stands for the Hessian of every trial; what it lacks, Σ r ∇²r, decides.
        """
        if self._shrinking is None:
            rng = np.random.default_rng(0)
            noise = rng.standard_normal(out=room_for(AT_ONCE, self.n_readings))
            prior = rng.standard_normal((AT_ONCE, self.n_prior))
            first = x = np.asarray(linear_step(self.frozen, noise, prior)[0])
            eps, sizes = turned(noise), []
            for _ in range(2):
                new = np.asarray(corrected(self.frozen, self.curvature, first, x, eps)[0])
                sizes.append(self._size(new - x))
                x = new
            self._shrinking = float(np.max(sizes[1] / np.maximum(sizes[0], 1e-300), initial=0.0))
        return self._shrinking

    def _size(self, step: Any) -> np.ndarray:
        """Largest change of a parameter in standard uncertainties, per trial."""
        seen = self.u > 0.0
        return np.asarray(np.max(np.abs(np.asarray(step)[:, seen]) / self.u[seen], axis=1, initial=0.0))

    def _finish(self, result: Refits, noise: np.ndarray, prior_noise: np.ndarray) -> Refits:
        """Solve anew what has not converged, and what has outliers in a robust fit."""
        for i in np.flatnonzero(~(result.error <= TOLERANCE)):
            result.x[i], result.chi_square[i] = self.solve_fully(noise[i], prior_noise[i], self.factors)
            result.error[i], result.solved[i] = 0.0, True
        if self.robust:
            self._search_outliers(result, noise, prior_noise)
        return result

    def _search_outliers(self, result: Refits, noise: np.ndarray, prior_noise: np.ndarray) -> None:
        """Repeat the robust fit in every trial in which a reading exceeds the critical value; the others would end as they are.

        Reweighted, then set aside and taken back as in the fit itself, with the leverages of the solution.
        """
        base = np.concatenate([f.ravel() for f in self.factors])
        limit = critical_value(int(base.sum())) * np.sqrt(self.redundancy())
        leverages = self.by_set(1.0 - self.redundancy())
        for i in range(len(noise)):
            if not np.any((np.abs(self.residuals(result.x[i], noise[i])) > limit) & (base > 0.0)):
                continue

            def residuals(factors: list[np.ndarray], i: int = i) -> list[np.ndarray]:
                both = [f * own for f, own in zip(factors, self.factors, strict=True)]
                result.x[i], result.chi_square[i] = self.solve_fully(noise[i], prior_noise[i], both)
                return self.by_set(self.residuals(result.x[i], noise[i]))

            weights = down_weight(residuals, self.factors)
            found = set_aside(Weighted(residuals(weights), leverages))
            found = name_outliers(lambda f, run=residuals: Weighted(run(f), leverages), found)  # type: ignore[misc]
            residuals([np.where(o, 0.0, 1.0) for o in found])
            result.solved[i] = True
            result.outliers[i] = int(np.sum(np.concatenate([o.ravel() for o in found]) & (base > 0.0)))
