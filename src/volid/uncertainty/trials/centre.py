"""The solution that synthetic data sets are drawn around: its problem, its unknowns, and refits by the solver of the fit itself.

Unknowns x = (θ, ν) with z = T x. Readings are numbered 0 … N - 1 in the order of the campaign's sets, row by row.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from volid.backend.lazy import jax, jnp
from volid.campaign import Campaign
from volid.effects.prediction import groups_of
from volid.fitting.equations.choice import engine_for_trials
from volid.fitting.equations.engine import Engine
from volid.fitting.equations.problem import Problem, build_problem, reweight, with_random_effects
from volid.fitting.equations.solver import solve
from volid.fitting.equations.system import System
from volid.fitting.smoothness.scatter import with_scatter
from volid.fitting.solution import Solution
from volid.fitting.starts import find_starts
from volid.observations.base import NuisanceTable
from volid.uncertainty.trials.refit_steps import Frozen, tiles_of

LARGEST_ROWS = 256 * 2**20  # bytes of TᵀJᵀ that are kept
_SINGULAR = 1e-12  # of the largest eigenvalue of the correlation matrix: below, rounding


class Centre:
    """A solution with what all refits share.

    `n_readings`: N, scalar readings. `n_prior`: r, pseudo-readings: nuisance parameters known beforehand (effects, calibrated
    lengths), numbers `known` of the table, then those of an earlier solution, then those of the smoothness; `prior` (r, p):
    their rows on x. `centre`: x₀. `u` (p,): standard uncertainties. `factors`: 0 for readings set aside, else 1, (m, k) per
    set. `engine`: of full refits, by default the one that suits them.
    """

    def __init__(self, solution: Solution, engine: Engine | None = None) -> None:
        self.solution = solution
        self.robust = bool(solution.options.get("robust", False))
        self.engine = engine or engine_for_trials(self.robust)
        self.starts = _starts(solution)
        self.campaign = self._with_scatter(with_random_effects(solution.campaign, self.starts, self.engine))
        self.factors = _factors(solution, self.campaign)
        self.problem, self.numbers = self._in_tiles()
        self.centre = np.concatenate([np.asarray(solution.parameters), np.asarray(solution.nuisance)])
        self.u = np.sqrt(np.maximum(np.diagonal(np.asarray(solution.covariance)), 0.0)) / solution.factor
        self.known = _known_nuisance(solution)
        self.nuisance_prior = self._nuisance_prior()
        self.n_readings = self.campaign.n_readings
        earlier = np.pad(solution.prior_rows, ((0, 0), (0, len(solution.nuisance))))
        self.prior = np.vstack([self.nuisance_prior, earlier])
        self.n_prior = len(self.prior)

    def _with_scatter(self, campaign: Campaign) -> Campaign:
        """The campaign with u of every reading as in the fit, what is independent from position to position included."""
        found = self.solution.scatter
        if not found:
            return campaign
        problem = build_problem(campaign, self.solution.model, self.starts, engine=self.engine)
        theta, nuisance = np.asarray(self.solution.parameters), np.asarray(self.solution.nuisance)
        z = np.concatenate([self.solution.model.parametrisation @ theta, nuisance])
        return with_scatter(campaign, problem, z, found)

    def _in_tiles(self) -> tuple[Problem, list[np.ndarray]]:
        """The problem, its blocks cut into tiles, and the readings' numbers at their places."""
        problem = build_problem(self.campaign, self.solution.model, self.starts, engine=self.engine)
        problem = reweight(problem, self.campaign, self.factors)
        numbers = _reading_numbers(problem, self.campaign)
        cut = [tiles_of(b, n) for b, n in zip(problem.system.blocks, numbers, strict=True)]
        system = replace(problem.system, blocks=tuple(block for block, _ in cut))
        return problem._replace(equations=self.engine.equations(system)), [number for _, number in cut]

    @cached_property
    def basis(self) -> np.ndarray:
        """T with z = T x, shape (size, p)."""
        n, p = self.solution.model.n_parameters, self.solution.model.parametrisation
        basis = np.zeros((self.problem.system.size, len(self.centre)))
        basis[: p.shape[0], :n] = p
        basis[p.shape[0] :, n:] = np.eye(len(self.centre) - n)
        return basis

    def _nuisance_prior(self) -> np.ndarray:
        """Pseudo-readings of nuisance parameters known beforehand, as rows on x."""
        rows = np.zeros((len(self.known), len(self.centre)))
        entries = self.solution.nuisance_table
        places = self.solution.model.n_parameters + self.known
        rows[np.arange(len(rows)), places] = [1.0 / entries[j].prior_u for j in self.known]
        return rows

    @property
    def z(self) -> np.ndarray:
        """z₀ = T x₀."""
        return np.asarray(self.basis @ self.centre)

    @cached_property
    def frozen(self) -> Frozen:
        """What the programs of all trials take: arrays of JAX, which a budget does without."""
        basis, z, equations = self.basis, self.z, self.problem.equations
        weighted = None
        if 8 * basis.shape[1] * self.n_readings <= LARGEST_ROWS:
            weighted = jnp.asarray(self._by_reading(equations.projected(z, basis.T)))
        aside = np.flatnonzero(np.concatenate([(f <= 0.0).ravel() for f in self.factors]))
        return Frozen(
            system=jax.tree.map(jnp.asarray, self.problem.system),
            z=jnp.asarray(z),
            basis=jnp.asarray(basis),
            covariance=jnp.asarray(self.solution.bare_covariance),
            prior=jnp.asarray(self.prior),
            predictions=[jnp.asarray(p) for p in equations.predictions(z)],
            numbers=[jnp.asarray(n) for n in self.numbers],
            weighted=weighted,
            aside=jnp.asarray(aside),
        )

    def _by_reading(self, rows: list[np.ndarray]) -> np.ndarray:
        """Columns (n_chunks, p, k·rows) of all blocks in the order of the readings, (p, N); 0 for those without weight."""
        found = np.zeros((len(self.centre), self.n_readings))
        for block, own, numbers in zip(self.problem.system.blocks, rows, self.numbers, strict=True):
            for chunk, number, weight in zip(own, numbers, block.weight, strict=True):
                seen = weight.ravel() > 0.0
                found[:, number.ravel()[seen]] = chunk[:, seen]
        return found

    def noise_of(self, readings: list[np.ndarray]) -> np.ndarray:
        """Whitened noise (b, N) of given readings, one array (b, m, k) per set: (reading - prediction at the solution)/u."""
        exact = self.flat_predictions()
        flat = np.concatenate([np.asarray(r).reshape(len(r), -1) for r in readings], axis=1)
        return np.asarray((flat - exact) / self._u)

    def flat_predictions(self) -> np.ndarray:
        return self._flat(self.frozen.predictions)

    def _flat(self, blocks: list[Any]) -> np.ndarray:
        """Values that stand in blocks as (N,), in the order of the readings."""
        values = np.zeros(self.n_readings)
        for own, numbers in zip(blocks, self.numbers, strict=True):
            values[numbers.ravel()] = np.asarray(own).ravel()
        return values

    @cached_property
    def _u(self) -> np.ndarray:
        """Standard uncertainties of the readings, (N,)."""
        return np.concatenate([s.u.ravel() for s in self.campaign.sets])

    def solve_fully(
        self, noise: np.ndarray, prior_noise: np.ndarray, factors: list[np.ndarray]
    ) -> tuple[np.ndarray, float]:
        """One trial by the solver of the fit itself, from the solution: x and chi-square; NaN when it diverges."""
        exact = self.flat_predictions()
        basis, z = self.basis, self.z
        root = self.prior @ np.linalg.pinv(basis)
        system = self._with_readings(self.by_set(exact + noise * self._u), factors)
        equations = self.problem.equations.changed(replace(system, prior_root=root, prior_value=root @ z + prior_noise))
        found = solve(self.problem._replace(equations=equations), z, basis @ self.whitened_directions())
        if not found.converged:
            return np.full(len(self.centre), np.nan), float("nan")
        x = np.linalg.lstsq(basis, found.z, rcond=None)[0]
        return x, 2.0 * found.cost

    def whitened_directions(self) -> np.ndarray:
        """Columns L (p, r) with C = L Lᵀ, what the data do not determine left out."""
        u = np.where(self.u > 0.0, self.u, 1.0)
        values, vectors = np.linalg.eigh(np.asarray(self.solution.bare_covariance) / np.outer(u, u))
        kept = values > _SINGULAR * values[-1]
        return np.asarray(u[:, None] * vectors[:, kept] * np.sqrt(values[kept]))

    def _with_readings(self, readings: list[np.ndarray], factors: list[np.ndarray]) -> System:
        """The system with other readings (m, k) and square-root weights per set."""
        flat = np.concatenate([r.ravel() for r in readings])
        weights = np.concatenate([(f / s.u).ravel() for f, s in zip(factors, self.campaign.sets, strict=True)])
        blocks = []
        for block, number in zip(self.problem.system.blocks, self.numbers, strict=True):
            weight = np.where(block.weight > 0.0, weights[number], 0.0)
            blocks.append(replace(block, reading=flat[number], weight=weight))
        return replace(self.problem.system, blocks=tuple(blocks))

    def redundancy(self) -> np.ndarray:
        """1 - h of every reading at the solution, shape (N,)."""
        return self._redundancy

    @cached_property
    def _redundancy(self) -> np.ndarray:
        root = self.basis @ self.whitened_directions()
        leverages = self._flat(self.problem.equations.quadratic_forms(self.z, root.T))
        return np.asarray(np.maximum(1.0 - leverages, 1e-6))

    def by_set(self, flat: np.ndarray) -> list[np.ndarray]:
        """Values of all readings (N,) as one array (m, k) per set."""
        ends = np.cumsum([s.readings.size for s in self.campaign.sets])[:-1]
        parts = np.split(flat, ends)
        return [part.reshape(s.readings.shape) for part, s in zip(parts, self.campaign.sets, strict=True)]

    def residuals(self, x: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """Whitened residuals (N,), reading - prediction, of one trial."""
        values = self._flat(self.problem.equations.predictions(self.basis @ x))
        return np.asarray(noise - (values - self.flat_predictions()) / self._u)


def _factors(solution: Solution, campaign: Campaign) -> list[np.ndarray]:
    """Square-root weights (m, k) per set: 0 for readings that the fit set aside."""
    if not solution.readings.outliers:
        return [np.ones(s.readings.shape) for s in campaign.sets]
    return [np.where(o, 0.0, 1.0) for o in solution.readings.outliers]


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
