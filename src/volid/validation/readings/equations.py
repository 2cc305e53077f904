"""Readings of another campaign linearised around what a solution predicts.

With reading = predicted(θ, ν) + error, over u of each reading,

    r = G a + B b + e,   a ~ N(0, 1), e ~ N(0, 1), b unknown:

G: the solution's covariance, J L with Σ = L Lᵀ, and calibrated values of the campaign's own instruments, times their u. B: what
the campaign has of its own, stations, dead paths, offsets, alignments, spheres, and what the solution does not determine. Neither
can take up a disagreement: the machine moves within its covariance only, and b is projected out.

A systematic effect that both campaigns name alike, with `per` = "campaign" or "tool", is one and the same unknown: it enters with
the value and the covariance with θ that the solution has of it. All other effects are new ones, and drifts are: they begin anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from volid.campaign import Campaign
from volid.compensation.control import Control
from volid.effects import TYPES
from volid.fitting.diagnosis.hold_out import rows_by_reading
from volid.fitting.diagnosis.sensitivities import Sensitivities, of_readings
from volid.fitting.equations.choice import INTERPRETED, engine_named
from volid.fitting.equations.problem import Problem, build_problem, scatter, with_random_effects
from volid.fitting.equations.solver import solve
from volid.fitting.smoothness.scatter import with_scatter
from volid.fitting.solution import Solution
from volid.fitting.starts import find_starts
from volid.model.error_model import MEAN, ErrorModel
from volid.observations.base import Nuisance
from volid.validation.readings.compensated import shifts, without_control

LEAST = 1e-14  # of the largest variance: rounding


@dataclass(frozen=True, eq=False)
class Linear:
    """n readings in the order of sets, rows, columns, over their u. `r` (n,); `known` G (n, g); `open` B (n, b).

    `z`: where they are linearised, θ of the solution and the campaign's own unknowns at their best. `campaign`: with the u used.
    """

    problem: Problem
    campaign: Campaign
    z: np.ndarray
    r: np.ndarray
    known: np.ndarray
    open: np.ndarray

    @property
    def model(self) -> ErrorModel:
        """The solution's error model."""
        return self.problem.model

    @cached_property
    def u(self) -> np.ndarray:
        """u of every reading, (n,)."""
        return np.concatenate([s.u.ravel() for s in self.campaign.sets])

    @cached_property
    def seen(self) -> Sensitivities:
        """How readings answer error values and tool vectors."""
        return of_readings(self.problem, self.campaign, self.z)

    def along(self, steps: np.ndarray) -> np.ndarray:
        """J · steps (size, k) of z, (n, k)."""
        return _along(self.problem, self.campaign, self.z, steps)

    def of_parameters(self, steps: np.ndarray) -> np.ndarray:
        """J · steps (n_parameters, k) of θ, (n, k)."""
        return self.along(np.pad(self.model.parametrisation @ steps, ((0, self.problem.system.n_nuisance), (0, 0))))

    def by_set(self, values: np.ndarray) -> tuple[np.ndarray, ...]:
        """Numbers of all readings as one array (m, k) per set."""
        parts = np.split(values, np.cumsum([s.readings.size for s in self.campaign.sets])[:-1])
        return tuple(p.reshape(s.readings.shape) for p, s in zip(parts, self.campaign.sets, strict=True))


def linear(solution: Solution, campaign: Campaign, control: Control | None = None) -> Linear:
    """The readings of a campaign around what the solution predicts; its machine is the solution's.

    `control`: what compensated while they were read; they are then taken as they would be without.
    """
    engine, starts = engine_named(INTERPRETED), find_starts(campaign)
    campaign = with_random_effects(campaign, starts, engine)
    problem = build_problem(campaign, solution.model, starts, engine=engine)
    unknowns = _Unknowns.of(solution, problem)
    z = _at_their_best(problem, unknowns)
    if control is not None:  # seen from where the stations stand, which the readings have told
        campaign = without_control(campaign, shifts(problem, campaign, z, control))
        problem = build_problem(campaign, solution.model, starts, engine=engine)
        z = _at_their_best(problem, unknowns)
    if sizes := _scatter(solution):
        campaign = with_scatter(campaign, problem, z, sizes)
        problem = build_problem(campaign, solution.model, starts, engine=engine)
    return _around(solution, campaign, problem, unknowns, z)


def _around(solution: Solution, campaign: Campaign, problem: Problem, unknowns: _Unknowns, z: np.ndarray) -> Linear:
    calibrated = unknowns.steps(unknowns.calibrated)
    back = _along(problem, campaign, z, calibrated) @ (z - unknowns.start)[unknowns.n + unknowns.calibrated]
    known = np.hstack([_known(solution, unknowns), calibrated * unknowns.u[unknowns.calibrated]])
    opened = np.hstack([unknowns.steps(unknowns.free), _open(solution, unknowns.size)])
    ways = [_along(problem, campaign, z, steps) for steps in (known, opened)]
    return Linear(problem, campaign, z, _residual(problem, campaign, z) + back, *ways)


@dataclass(frozen=True, eq=False)
class _Unknowns:
    """The unknowns of a campaign beside a solution. `start`: z with what the solution says. `n`: coefficients before the nuisance
    parameters. `u`: of each of these beforehand. Numbers of nuisance parameters: `shared`, by the number of the same unknown in
    the solution; `calibrated`, known to within their u; `free`."""

    start: np.ndarray
    n: int
    u: np.ndarray
    shared: dict[int, int]
    calibrated: np.ndarray
    free: np.ndarray

    @classmethod
    def of(cls, solution: Solution, problem: Problem) -> _Unknowns:
        n, entries = problem.model.layout.n_coefficients, problem.nuisance
        shared = shared_effects(solution, entries)
        start = np.array(problem.start)
        start[:n] = problem.model.parametrisation @ np.asarray(solution.parameters)
        for own, number in shared.items():
            start[n + own] = np.asarray(solution.nuisance)[number]
        u = np.array([e.prior_u for e in entries])
        others = np.array([i not in shared for i in range(len(entries))], dtype=bool)
        calibrated = np.flatnonzero(others & (u > 0.0) & np.isfinite(u))
        return cls(start, n, u, shared, calibrated, np.flatnonzero(others & ~np.isfinite(u)))

    @property
    def size(self) -> int:
        """Length of z."""
        return len(self.start)

    def steps(self, numbers: np.ndarray) -> np.ndarray:
        """One column (size, k) for each of some nuisance parameters."""
        found = np.zeros((self.size, len(numbers)))
        found[self.n + numbers, np.arange(len(numbers))] = 1.0
        return found


def shared_effects(solution: Solution, entries: Sequence[Nuisance]) -> dict[int, int]:
    """Effects that a campaign (`entries`: its unknowns) has in common with a solution: number there by number here.

    A drift is none of them: it begins anew with the clock of every campaign.
    """
    drifts = {e.name for s in solution.campaign.sets for e in s.effects if TYPES[e.type].spans_campaign}
    theirs = {e.key: i for i, e in enumerate(solution.nuisance_table) if e.effect and e.effect not in drifts}
    return {i: theirs[e.key] for i, e in enumerate(entries) if e.effect and _spans(e) and e.key in theirs}


def _spans(entry: Nuisance) -> bool:
    """Whether an effect is the same in every campaign: that of the instrument, or of one tool, not of a set-up."""
    scope = str(entry.key[2]) if len(entry.key) > 2 else "?"
    return scope == "" or scope.startswith("tool ")


def _at_their_best(problem: Problem, unknowns: _Unknowns) -> np.ndarray:
    """z with the campaign's own unknowns where its readings want them, the machine held as the solution has it."""
    moving = unknowns.steps(np.concatenate([unknowns.free, unknowns.calibrated]))
    problem = problem._replace(start=unknowns.start)
    return solve(problem, None, moving).z if moving.shape[1] else unknowns.start


def _known(solution: Solution, unknowns: _Unknowns) -> np.ndarray:
    """Root (size, g) of the solution's covariance, as steps of z: its θ, and the effects that both have."""
    n_parameters, model = solution.model.n_parameters, solution.model
    here, there = list(unknowns.shared), list(unknowns.shared.values())
    own = np.concatenate([np.arange(n_parameters), n_parameters + np.array(there, dtype=int)])
    covariance = np.asarray(solution.covariance)[np.ix_(own, own)]
    scale = np.sqrt(np.maximum(np.diagonal(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > LEAST * max(float(values[-1]), 1e-300) if len(values) else np.zeros(0, dtype=bool)
    root = scale[:, None] * vectors[:, kept] * np.sqrt(values[kept])
    steps = np.zeros((unknowns.size, root.shape[1]))
    steps[: unknowns.n] = model.parametrisation @ root[:n_parameters]
    steps[unknowns.n + np.array(here, dtype=int)] = root[n_parameters:]
    return steps


def _open(solution: Solution, size: int) -> np.ndarray:
    """Steps (size, k) of z along what the solution does not determine, or holds at 0."""
    model = solution.model
    held = np.zeros((model.n_parameters, np.asarray(solution.held_directions).shape[1]))
    for f, row in zip(model.tool_frame, np.asarray(solution.held_directions), strict=False):
        held[f.parameters] = row
    steps = np.hstack([np.asarray(solution.null_space), held])
    return np.pad(model.parametrisation @ steps, ((0, size - model.layout.n_coefficients), (0, 0)))


def _scatter(solution: Solution) -> dict[str, float]:
    """Standard deviation by direction of what is independent from position to position [mm]."""
    there = {d for d in "XYZ" if (f"E{d}{d}", MEAN) in solution.model.by_name}
    return {d: solution.factor * u for d, u in solution.scatter.items() if d in there}


def _residual(problem: Problem, campaign: Campaign, z: np.ndarray) -> np.ndarray:
    """(reading - predicted)/u of every reading, (n,)."""
    values = scatter(problem, campaign, problem.equations.predictions(z))
    return np.concatenate([((s.readings - p) / s.u).ravel() for s, p in zip(campaign.sets, values, strict=True)])


def _along(problem: Problem, campaign: Campaign, z: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """J · `steps` (size, k), one row for every reading, (n, k)."""
    if not steps.shape[1]:
        return np.zeros((campaign.n_readings, 0))
    return rows_by_reading(problem, campaign, problem.equations.projected(z, np.ascontiguousarray(steps.T)))
