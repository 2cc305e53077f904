"""`fit`: from a campaign to a solution, in the order of the work."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.linalg import cho_factor, cho_solve

from volid.campaign import Campaign
from volid.checks import check_campaign
from volid.error_functions import motion_names
from volid.error_model import build_model
from volid.exceptions import InputError, VolidError
from volid.fitting import resolution
from volid.fitting.adequacy import SuspectReading, assess, reading_label
from volid.fitting.equations import predict_all, quadratic_forms
from volid.fitting.holdout import held_out_residuals
from volid.fitting.identifiability import NAMED, Identifiability, analyse
from volid.fitting.interpreted import interpreted, is_small
from volid.fitting.prior import check_prior, prior_notes, prior_of, shared_names
from volid.fitting.problem import Problem, build_problem, pad_rows, reweight, scatter, with_random_effects
from volid.fitting.robust import Weighted, down_weight, name_outliers, set_aside
from volid.fitting.solution import Residuals, Solution, Statistics
from volid.fitting.solver import Optimum, solve
from volid.fitting.starts import find_starts
from volid.machine import Datum, Machine

Progress = Callable[[str], None]
Method = Callable[..., Optimum]  # as `solver.solve`
CHORD, OPTIMISTIX = "chord", "optimistix"


def _silent(message: str) -> None:
    del message


class _Fitter:
    """A problem restricted to its determined directions; refits with other weights start at the last optimum."""

    def __init__(self, campaign: Campaign, problem: Problem, found: Identifiability, method: Method = solve) -> None:
        self.campaign, self.problem, self.found, self.method = campaign, problem, found, method
        self.free = problem.free @ found.basis
        self.optimum: Optimum | None = None
        self.factors = [np.ones(s.readings.shape) for s in campaign.sets]

    def solve(self, factors: list[np.ndarray]) -> Optimum:
        """Optimum with square-root weights `factors` (m, k) per set. Raises `VolidError` when nothing converges."""
        self.factors = factors
        weighted = reweight(self.problem, self.campaign, factors)
        start = None if self.optimum is None else self.optimum.z
        self.optimum = self.method(weighted, start, self.free)
        if not np.all(np.isfinite(self.optimum.z)):
            raise VolidError("the fit diverged; check units, stations and axis positions")
        return self.optimum

    def without(self, outliers: list[np.ndarray]) -> _Fitter:
        """Refit without the outliers; what is determined is decided anew, since they may have carried it alone."""
        factors = [np.where(o, 0.0, 1.0) for o in outliers]
        weighted = reweight(self.problem, self.campaign, factors)
        refit = _Fitter(self.campaign, self.problem, analyse(weighted, self.campaign), self.method)
        refit.solve(factors)
        return refit

    def whitened(self) -> list[np.ndarray]:
        """(reading - predicted)/u at the optimum, all readings."""
        assert self.optimum is not None
        blocks = predict_all(self.problem.system, self.optimum.z)
        values = scatter(self.problem, self.campaign, blocks)
        return [(s.readings - p) / s.u for s, p in zip(self.campaign.sets, values, strict=True)]

    def root(self) -> np.ndarray:
        """Square root L of the covariance of z, C = L Lᵀ, shape (size, rank): by scaled Cholesky factorisation."""
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
                "the covariance cannot be computed: the readings that are left determine too little"
            ) from None
        inverse = np.linalg.solve(lower, np.diag(scale))
        return np.asarray(self.free @ inverse.T)

    def leverages(self) -> list[np.ndarray]:
        """h_ii of the readings that take part with full weight."""
        assert self.optimum is not None
        system = reweight(self.problem, self.campaign, self.factors).system
        blocks = quadratic_forms(system, self.optimum.z, pad_rows(self.root().T))
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


class _Resolved(NamedTuple):
    fitter: _Fitter
    resolution: resolution.Resolution


class _Task(NamedTuple):
    """What stays the same over all stages of one fit."""

    campaign: Campaign
    starts: dict[Any, float]
    prior: Solution | None
    robust: bool
    progress: Progress
    method: Method

    def fitter(self, segments: resolution.Segments, carrier: resolution.Segments) -> _Fitter:
        """A fitter for stated segments."""
        model = build_model(self.campaign.machine, segments, carrier=carrier)
        known = None if self.prior is None else prior_of(self.prior, model)
        problem = build_problem(self.campaign, model, self.starts, known)
        return _Fitter(self.campaign, problem, analyse(problem, self.campaign), self.method)


def _check_counts(task: _Task, segments: resolution.Segments, carrier: resolution.Segments) -> None:
    campaign = task.campaign
    model = build_model(campaign.machine, segments, carrier=carrier)
    known = None if task.prior is None else prior_of(task.prior, model)
    problem = build_problem(campaign, model, task.starts, known)
    n_free, n_known = problem.free.shape[1], problem.system.prior_root.shape[0]
    if campaign.n_readings + n_known < n_free:
        raise InputError(
            f"{campaign.source or 'campaign'}: {campaign.n_readings} readings for {n_free} parameters "
            f"({model.n_parameters} of the error model, {n_free - model.n_parameters} of stations and "
            "instruments); take more readings, or lower [model] segments or switch functions off"
        )


def _given(prior: Solution | None, machine: Machine) -> tuple[resolution.Segments, resolution.Segments]:
    """Segments and carriers that a prior fixes."""
    if prior is None:
        return {}, {}
    names = shared_names(prior, machine) & set(motion_names(machine))
    return (
        {n: v for n, v in prior.model.segments.items() if n in names},
        {n: v for n, v in prior.model.carrier.items() if n in names},
    )


def _resolve(task: _Task) -> _Resolved:
    """Choose the spline resolution on a preliminary fit, and set up the final one."""
    campaign, machine = task.campaign, task.campaign.machine
    known, known_carrier = _given(task.prior, machine)
    carrier, automatic = resolution.limits(campaign, known_carrier)
    coarsest = {n: resolution.candidates(c)[0] if n in automatic else known.get(n, c) for n, c in carrier.items()}
    _check_counts(task, coarsest, carrier)
    guess = {**resolution.first_guess(carrier, automatic), **known}
    if not automatic:
        return _Resolved(task.fitter(guess, carrier), resolution.Resolution(guess, carrier))
    task.progress("preliminary fit")
    preliminary = task.fitter(guess, carrier)
    optimum = preliminary.solve(preliminary.factors)
    factors = preliminary.factors
    if task.robust:
        factors = down_weight(preliminary.residuals_only, factors)
        optimum = preliminary.solve(factors)
    task.progress("choosing the spline resolution by held-out prediction")
    chosen = resolution.choose(preliminary.problem, campaign, optimum.z, factors, carrier, guess, automatic)
    return _Resolved(task.fitter(chosen.segments, carrier), chosen)


@contextmanager
def breakdown_named() -> Iterator[None]:
    """Also a decorator: raises `InputError` in place of a factorisation that fails, which no sound campaign causes."""
    try:
        yield
    except np.linalg.LinAlgError as problem:
        raise InputError(
            f"the fit broke down ({problem}): readings, positions and travels contradict each other; check that positions, "
            "travels, tool vectors, stations and readings are in mm, and that every axis column holds its own axis"
        ) from problem


@breakdown_named()
def fit(
    campaign: Campaign,
    *,
    robust: bool = False,
    datum: Datum | None = None,
    prior: Solution | None = None,
    solver: str = CHORD,
    progress: Progress | None = None,
) -> Solution:
    """Identify a machine's error model from a campaign by nonlinear least squares.

    Minimises Σ ((reading - predicted)/u)² over error functions, stations, dead paths and other nuisance parameters, all
    at once. Undetermined combinations are found first, named, and left at zero. `robust`: gross outliers are found with
    Huber's loss and normalised residuals, named and set aside. `datum`: the solution is transformed into it after the fit.
    `prior`: an earlier solution of axes that this machine has too (linear axes measured before); its functions, with their
    covariance, count as readings. `solver`: "chord" (few assemblies of the normal equations) or "optimistix" (a solver of that
    library, one assembly a step); both end at the same minimum. `progress`: called with a message at every stage.

    Raises `InputError` when the campaign cannot be fitted (fewer readings than parameters, a slip in units, duplicated
    rows). ISO/TR 16907 8; CONVENTIONS 3, 4, 6.
    """
    with interpreted(is_small(campaign)):
        return _fit(campaign, robust, datum, prior, _method(solver), progress or _silent)


def _method(solver: str) -> Method:
    """The solver by its name. Raises `InputError` for an unknown one."""
    if solver not in (CHORD, OPTIMISTIX):
        raise InputError(f"solver is '{solver}'; expected '{CHORD}' or '{OPTIMISTIX}'")
    if solver == CHORD:
        return solve
    from volid.fitting.optimistix_solver import solve_by_optimistix  # takes a second to import

    return solve_by_optimistix


def _fit(
    campaign: Campaign,
    robust: bool,
    datum: Datum | None,
    prior: Solution | None,
    method: Method,
    progress: Progress,
) -> Solution:
    progress("checking the campaign")
    warnings = check_campaign(campaign)
    progress("locating stations")
    starts = find_starts(campaign)
    if prior is not None:
        check_prior(prior, campaign.machine)
        warnings = (*warnings, *prior_notes(prior))
        prior = prior if prior.datum == campaign.machine.datum else prior.in_datum(campaign.machine.datum)
    measured, campaign = campaign, with_random_effects(campaign, starts)
    resolved = _resolve(_Task(campaign, starts, prior, robust, progress, method))
    fitter = resolved.fitter
    progress("solving")
    fitter.solve(fitter.factors)
    outliers = [np.zeros(s.readings.shape, dtype=bool) for s in campaign.sets]
    if robust:
        progress("looking for outliers")
        factors = down_weight(fitter.residuals_only, fitter.factors)
        outliers = name_outliers(fitter.weighted, set_aside(fitter.weighted(factors)))
        fitter = fitter.without(outliers)
    solution = _solution(
        fitter, resolved.resolution, outliers, warnings, {"robust": robust, "prior": prior is not None}
    )
    solution = replace(solution, campaign=measured)
    return solution if datum in (None, solution.datum) else solution.in_datum(datum)


def _outlier_readings(campaign: Campaign, whitened: list[np.ndarray], outliers: list[np.ndarray]) -> tuple[Any, ...]:
    found = []
    for s, r, o in zip(campaign.sets, whitened, outliers, strict=True):
        for i, k in zip(*np.nonzero(o), strict=True):
            label = reading_label(s, int(i), int(k))
            found.append(SuspectReading(s.where(int(i)), label, float(r[i, k] * s.u[i, k]), float(r[i, k])))
    return tuple(sorted(found, key=lambda x: -abs(x.normalised)))


def _notes(fitter: _Fitter, chosen: resolution.Resolution, held: tuple[str, ...], optimum: Optimum) -> tuple[str, ...]:
    notes = []
    if not optimum.converged:
        notes.append("the iteration stopped before full convergence")
    if held:
        notes.append(
            f"constant tool rotation {', '.join(held)}: not determined by these stations and tool vectors, held at 0"
        )
    if chosen.at_limit:
        notes.append(f"finest resolution on offer taken for {', '.join(chosen.at_limit)}: shorter waves may remain")
    if fitter.found.nuisance_defect:
        notes.append(f"{fitter.found.nuisance_defect} combinations of station or instrument parameters not determined")
    return tuple(notes)


def _held(fitter: _Fitter) -> tuple[str, ...]:
    """Tool-frame rotations that cannot be stated because part of them is held at 0."""
    names = [f.name for f in fitter.problem.model.functions if f.name.endswith("0S")]
    directions = fitter.found.tool_rotation
    return tuple(n for n, row in zip(names, directions, strict=False) if np.any(row**2 > NAMED))


def _solution(
    fitter: _Fitter,
    chosen: resolution.Resolution,
    outliers: list[np.ndarray],
    warnings: tuple[str, ...],
    options: dict[str, Any],
) -> Solution:
    optimum, problem, campaign = fitter.optimum, fitter.problem, fitter.campaign
    assert optimum is not None
    n = problem.model.layout.n_coefficients
    root = fitter.root()
    to_theta = problem.model.parametrisation.T
    reduced = np.vstack([to_theta @ root[:n], root[n:]])
    # P is block orthonormal only where carrier and chosen splines agree: solve instead of transposing
    gram = problem.model.parametrisation.T @ problem.model.parametrisation
    factor = cho_factor(gram) if len(gram) else None
    if factor is not None:
        reduced[: len(gram)] = cho_solve(factor, reduced[: len(gram)])
    theta = cho_solve(factor, to_theta @ optimum.z[:n]) if factor is not None else np.zeros(0)
    whitened, leverages = fitter.whitened(), fitter.leverages()
    active = [~o for o in outliers]
    used = sum(int(a.sum()) for a in active)
    pseudo = np.asarray(problem.system.prior_root) @ (optimum.z - np.asarray(problem.system.prior_mean))
    prior_chi, dof = float(pseudo @ pseudo), used + len(pseudo) - fitter.free.shape[1]
    residuals = tuple(r * s.u for r, s in zip(whitened, campaign.sets, strict=True))
    held = _held(fitter)
    return Solution(
        parameters=jnp.asarray(theta),
        nuisance=jnp.asarray(optimum.z[n:]),
        covariance=jnp.asarray(reduced @ reduced.T),
        null_space=jnp.asarray(fitter.found.null_space),
        held_directions=jnp.asarray(fitter.found.tool_rotation),
        model=problem.model,
        campaign=campaign,
        nuisance_table=problem.nuisance,
        adequacy=assess(campaign, whitened, leverages, active, dof, prior_chi),
        statistics=Statistics(
            n_readings=used,
            n_parameters=fitter.free.shape[1],
            residual_rms={
                s.name: float(np.sqrt(np.mean(r[a] ** 2))) if a.any() else float("nan")
                for s, r, a in zip(campaign.sets, residuals, active, strict=True)
            },
            iterations=optimum.iterations,
            converged=optimum.converged,
            held_out_weight=chosen.weight,
        ),
        readings=Residuals(
            residuals,
            tuple(r / np.sqrt(np.maximum(1.0 - h, 1e-9)) for r, h in zip(whitened, leverages, strict=True)),
            tuple(outliers),
            _outlier_readings(campaign, whitened, outliers),
            tuple(h * s.u for h, s in zip(fitter.held_out(), campaign.sets, strict=False)),
        ),
        statements=fitter.found.statements,
        undetermined=fitter.found.undetermined,
        notes=(*campaign.warnings, *warnings, *_notes(fitter, chosen, held, optimum)),
        options=options,
        prior_root=jnp.asarray(_theta_prior(problem)) if options["prior"] else None,
    )


def _theta_prior(problem: Problem) -> np.ndarray:
    """Pseudo-readings of an earlier solution as rows on θ."""
    known = sum(bool(np.isfinite(e.prior_u) and e.prior_u > 0) for e in problem.nuisance)
    n = problem.model.layout.n_coefficients
    return np.asarray(problem.system.prior_root)[known:, :n] @ problem.model.parametrisation
