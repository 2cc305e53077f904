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

from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from volid.backend.lazy import jnp
from volid.campaign import Campaign
from volid.effects.prediction import groups_of
from volid.fitting.diagnosis.robust import Weighted, critical_value, down_weight, name_outliers, set_aside
from volid.fitting.equations.compiled import predict_all, quadratic_forms
from volid.fitting.equations.problem import Problem, build_problem, pad_rows, reweight, with_random_effects
from volid.fitting.equations.solver import solve
from volid.fitting.equations.system import System
from volid.fitting.solution import Solution
from volid.fitting.starts import find_starts
from volid.observations.base import NuisanceTable
from volid.uncertainty.trials.curvature import LARGEST, Curvature, curvatures, hessian_bytes
from volid.uncertainty.trials.curvature import TRIALS as AT_ONCE
from volid.uncertainty.trials.draws import room_for
from volid.uncertainty.trials.refit_steps import (
    TRIALS,
    Frozen,
    corrected,
    exact_step,
    linear_step,
    tiles_of,
    turned,
    weighted_rows,
)

TOLERANCE = 1e-6  # standard uncertainties
LARGEST_ROWS = 256 * 2**20  # bytes of TᵀJᵀ that are kept
STEPS = 6  # steps at most, before a trial is solved anew
_SINGULAR = 1e-12  # of the largest eigenvalue of the correlation matrix: below, rounding


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


class Refitter:
    """Refits synthetic data sets drawn around a solution; see the module.

    `n_readings`: N, scalar readings in the order of the campaign's sets, row by row. `n_prior`: r, pseudo-readings: nuisance
    parameters known beforehand (effects, calibrated lengths), then those of an earlier solution.
    """

    def __init__(self, solution: Solution) -> None:
        self.solution = solution
        self.starts = starts = _starts(solution)
        self.campaign = with_random_effects(solution.campaign, starts)
        factors = [np.where(o, 0.0, 1.0) for o in solution.readings.outliers]
        if not factors:
            factors = [np.ones(s.readings.shape) for s in self.campaign.sets]
        self.factors = factors
        problem = reweight(build_problem(self.campaign, solution.model, starts), self.campaign, factors)
        cut = [
            tiles_of(b, n) for b, n in zip(problem.system.blocks, _reading_numbers(problem, self.campaign), strict=True)
        ]
        self.problem: Problem = problem._replace(
            system=replace(problem.system, blocks=tuple(block for block, _ in cut), tiles=(None,) * len(cut))
        )
        numbers = [number for _, number in cut]
        theta, nuisance = np.asarray(solution.parameters), np.asarray(solution.nuisance)
        self.centre = np.concatenate([theta, nuisance])
        n, k = len(theta), len(nuisance)
        p = solution.model.parametrisation
        basis = np.zeros((self.problem.system.size, n + k))
        basis[: p.shape[0], :n] = p
        basis[p.shape[0] :, n:] = np.eye(k)
        self.known = _known_nuisance(solution)
        self.nuisance_prior = np.zeros((len(self.known), n + k))
        for i, j in enumerate(self.known):
            self.nuisance_prior[i, n + j] = 1.0 / solution.nuisance_table[j].prior_u
        prior = np.vstack([self.nuisance_prior, np.pad(solution.prior_rows, ((0, 0), (0, k)))])
        self.u = np.sqrt(np.maximum(np.diagonal(np.asarray(solution.covariance)), 0.0))
        z = jnp.asarray(basis @ self.centre)
        self.frozen = Frozen(
            system=self.problem.system,
            z=z,
            basis=jnp.asarray(basis),
            covariance=jnp.asarray(solution.covariance),
            prior=jnp.asarray(prior),
            predictions=predict_all(self.problem.system, z),
            numbers=numbers,
            weighted=None,
            aside=jnp.asarray(np.flatnonzero(np.concatenate([(f <= 0.0).ravel() for f in factors]))),
        )
        self.n_readings = self.campaign.n_readings
        self.n_prior = len(prior)
        if 8 * basis.shape[1] * self.n_readings <= LARGEST_ROWS:
            rows = jnp.asarray(weighted_rows(self.frozen, self.n_readings))
            self.frozen = replace(self.frozen, weighted=rows)
        self._shrinking: float | None = None
        self._robust = bool(solution.options.get("robust", False))
        self._redundancy: np.ndarray | None = None

    def prepare(self) -> None:
        """Everything that the first refit would make, for refits in several threads."""
        if self.curvature is not None:
            self._measure_shrinking()

    def noise_of(self, readings: list[np.ndarray]) -> np.ndarray:
        """Whitened noise (b, N) of given readings, one array (b, m, k) per set: (reading - prediction at the solution)/u."""
        exact = self._flat_predictions()
        flat = np.concatenate([np.asarray(r).reshape(len(r), -1) for r in readings], axis=1)
        return np.asarray((flat - exact) / self._u)

    def _flat_predictions(self) -> np.ndarray:
        return self._flat(self.frozen.predictions)

    def _flat(self, blocks: list[Any]) -> np.ndarray:
        """Values that stand in blocks as (N,), in the order of the readings."""
        values = np.zeros(self.n_readings)
        for own, numbers in zip(blocks, self.frozen.numbers, strict=True):
            values[np.asarray(numbers).ravel()] = np.asarray(own).ravel()
        return values

    @cached_property
    def _u(self) -> np.ndarray:
        """Standard uncertainties of the readings, (N,)."""
        return np.concatenate([s.u.ravel() for s in self.campaign.sets])

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
        if hessian_bytes(self.frozen.system) > LARGEST:
            return None
        units = [entry.unit for entry in self.solution.nuisance_table]
        return curvatures(self.frozen.system, self.frozen.z, self.frozen.numbers, units)

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
        if self._robust:
            self._search_outliers(result, noise, prior_noise)
        return result

    def solve_fully(
        self, noise: np.ndarray, prior_noise: np.ndarray, factors: list[np.ndarray]
    ) -> tuple[np.ndarray, float]:
        """One trial by the solver of the fit itself, from the solution: x and chi-square; NaN when it diverges."""
        exact = self._flat_predictions()
        system = self._with_readings(self._by_set(exact + noise * self._u), factors)
        root = np.asarray(self.frozen.prior) @ np.linalg.pinv(np.asarray(self.frozen.basis))
        mean = (
            np.asarray(self.frozen.z) + np.linalg.pinv(root) @ prior_noise if len(root) else np.asarray(self.frozen.z)
        )
        system = replace(system, prior_root=jnp.asarray(root), prior_mean=jnp.asarray(mean))
        free = np.asarray(self.frozen.basis) @ self._whitened_directions()
        found = solve(self.problem._replace(system=system), np.asarray(self.frozen.z), free)
        if not found.converged:
            return np.full(len(self.centre), np.nan), float("nan")
        x = np.linalg.lstsq(np.asarray(self.frozen.basis), found.z, rcond=None)[0]
        return x, 2.0 * found.cost

    def _whitened_directions(self) -> np.ndarray:
        """Columns L (p, r) with C = L Lᵀ, what the data do not determine left out."""
        u = np.where(self.u > 0.0, self.u, 1.0)
        values, vectors = np.linalg.eigh(np.asarray(self.frozen.covariance) / np.outer(u, u))
        kept = values > _SINGULAR * values[-1]
        return np.asarray(u[:, None] * vectors[:, kept] * np.sqrt(values[kept]))

    def _with_readings(self, readings: list[np.ndarray], factors: list[np.ndarray]) -> System:
        """The system with other readings (m, k) and square-root weights per set."""
        flat = np.concatenate([r.ravel() for r in readings])
        weights = np.concatenate([(f / s.u).ravel() for f, s in zip(factors, self.campaign.sets, strict=True)])
        blocks = []
        for block, numbers in zip(self.frozen.system.blocks, self.frozen.numbers, strict=True):
            number = np.asarray(numbers)
            weight = np.where(np.asarray(block.weight) > 0.0, weights[number], 0.0)
            blocks.append(replace(block, reading=jnp.asarray(flat[number]), weight=jnp.asarray(weight)))
        return replace(self.frozen.system, blocks=tuple(blocks))

    def redundancy(self) -> np.ndarray:
        """1 - h of every reading at the solution, shape (N,)."""
        if self._redundancy is None:
            root = np.asarray(self.frozen.basis) @ self._whitened_directions()
            leverages = self._flat(quadratic_forms(self.frozen.system, self.frozen.z, pad_rows(root.T)))
            self._redundancy = np.maximum(1.0 - leverages, 1e-6)
        return self._redundancy

    def _search_outliers(self, result: Refits, noise: np.ndarray, prior_noise: np.ndarray) -> None:
        """Repeat the robust fit in every trial in which a reading exceeds the critical value; the others would end as they are.

        Reweighted, then set aside and taken back as in the fit itself, with the leverages of the solution.
        """
        base = np.concatenate([f.ravel() for f in self.factors])
        limit = critical_value(int(base.sum())) * np.sqrt(self.redundancy())
        leverages = self._by_set(1.0 - self.redundancy())
        for i in range(len(noise)):
            if not np.any((np.abs(self._residuals(result.x[i], noise[i])) > limit) & (base > 0.0)):
                continue

            def residuals(factors: list[np.ndarray], i: int = i) -> list[np.ndarray]:
                both = [f * own for f, own in zip(factors, self.factors, strict=True)]
                result.x[i], result.chi_square[i] = self.solve_fully(noise[i], prior_noise[i], both)
                return self._by_set(self._residuals(result.x[i], noise[i]))

            weights = down_weight(residuals, self.factors)
            found = set_aside(Weighted(residuals(weights), leverages))
            found = name_outliers(lambda f, run=residuals: Weighted(run(f), leverages), found)  # type: ignore[misc]
            residuals([np.where(o, 0.0, 1.0) for o in found])
            result.solved[i] = True
            result.outliers[i] = int(np.sum(np.concatenate([o.ravel() for o in found]) & (base > 0.0)))

    def _by_set(self, flat: np.ndarray) -> list[np.ndarray]:
        """Values of all readings (N,) as one array (m, k) per set."""
        ends = np.cumsum([s.readings.size for s in self.campaign.sets])[:-1]
        parts = np.split(flat, ends)
        return [part.reshape(s.readings.shape) for part, s in zip(parts, self.campaign.sets, strict=True)]

    def _residuals(self, x: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """Whitened residuals (N,), reading - prediction, of one trial."""
        values = self._flat(predict_all(self.frozen.system, self.frozen.basis @ jnp.asarray(x)))
        return np.asarray(noise - (values - self._flat_predictions()) / self._u)


def _starts(solution: Solution) -> dict[Any, float]:
    """Start values by nuisance key as the fit had them; known stations are placed anew: the solution does not keep where."""
    campaign, table = solution.campaign, NuisanceTable()
    for observations in campaign.sets:
        groups_of(observations, campaign, table)
    placed = any(station.known and station.frame != "machine" for station in campaign.stations)
    if placed or list(table.keys) != [e.key for e in solution.nuisance_table]:
        return find_starts(campaign)
    return {key: solution.nuisance_table[number].start for key, number in table.keys.items()}


def _known_nuisance(solution: Solution) -> np.ndarray:
    """Numbers of the nuisance parameters that are known beforehand to within a u."""
    u = np.array([e.prior_u for e in solution.nuisance_table])
    return np.flatnonzero(np.isfinite(u) & (u > 0.0))


def _reading_numbers(problem: Problem, campaign: Campaign) -> list[np.ndarray]:
    """Number of the reading, 0 … N - 1, at every place of every block, (n_chunks, k, rows); padding repeats the first."""
    first = np.cumsum([0, *(s.readings.size for s in campaign.sets)])
    result = []
    for block, (number, rows) in zip(problem.system.blocks, problem.places, strict=True):
        chunks, k, length = block.reading.shape
        flat = np.full((chunks * length, k), first[number] + rows[0] * k) + np.arange(k)
        flat[: len(rows)] = first[number] + rows[:, None] * k + np.arange(k)
        result.append(flat.reshape(chunks, length, k).transpose(0, 2, 1))
    return result
