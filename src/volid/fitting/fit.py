"""`fit`: from a campaign to a solution, in the order of the work."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from volid.backend.threads import one_blas_thread
from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.fitting.assembly import Assembly
from volid.fitting.diagnosis import resolution
from volid.fitting.diagnosis.identifiability import analyse
from volid.fitting.diagnosis.robust import down_weight, name_outliers, set_aside
from volid.fitting.equations.choice import engine_for_compiled_solver, engine_for_fit, engine_named
from volid.fitting.equations.engine import Engine
from volid.fitting.equations.problem import Prior, Problem, build_problem, with_model, with_random_effects
from volid.fitting.equations.solver import solve
from volid.fitting.fitter import Fitter, Method
from volid.fitting.prior import check_prior, prior_notes, prior_of, shared_names
from volid.fitting.solution import Solution
from volid.fitting.starts import find_starts
from volid.model.error_functions import motion_names
from volid.model.error_model import build_model
from volid.model.machine import Datum, Machine
from volid.plausibility.checks import check_campaign

Progress = Callable[[str], None]
CHORD, OPTIMISTIX = "chord", "optimistix"


def _silent(message: str) -> None:
    del message


class How(NamedTuple):
    """Solver and engine of a fit."""

    method: Method
    engine: Engine


class _Resolved(NamedTuple):
    fitter: Fitter
    resolution: resolution.Resolution


class _Task(NamedTuple):
    """What stays the same over all stages of one fit."""

    campaign: Campaign
    starts: dict[Any, float]
    prior: Solution | None
    robust: bool
    progress: Progress
    method: Method
    engine: Engine

    def problem(
        self, segments: resolution.Segments, carrier: resolution.Segments, like: Problem | None = None
    ) -> Problem:
        """The problem for stated segments; `like`: one with the same carrier, whose readings are taken as they are."""
        model = build_model(self.campaign.machine, segments, carrier=carrier)
        known = None if self.prior is None else prior_of(self.prior, model)
        if like is not None and like.model.layout == model.layout:
            return with_model(like, model, known)
        return build_problem(self.campaign, model, self.starts, known, engine=self.engine)

    def fitter(self, problem: Problem) -> Fitter:
        """A fitter for what of a problem is determined."""
        return Fitter(self.campaign, problem, analyse(problem, self.campaign), self.method)


def _check_counts(campaign: Campaign, problem: Problem) -> None:
    """Raises `InputError` when even the coarsest splines have more parameters than there are readings."""
    n_free, n_known, n = problem.free.shape[1], problem.system.prior_root.shape[0], problem.model.n_parameters
    if campaign.n_readings + n_known < n_free:
        raise InputError(
            f"{campaign.source or 'campaign'}: {campaign.n_readings} readings for {n_free} parameters "
            f"({n} of the error model, {n_free - n} of stations and "
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
    guess = {**resolution.first_guess(carrier, automatic), **known}
    first = task.problem(guess, carrier)
    _check_counts(campaign, task.problem(coarsest, carrier, like=first))
    if not automatic:
        return _Resolved(task.fitter(first), resolution.Resolution(guess, carrier))
    task.progress("preliminary fit")
    preliminary = task.fitter(first)
    optimum = preliminary.solve(preliminary.factors)
    factors = preliminary.factors
    if task.robust:
        factors = down_weight(preliminary.residuals_only, factors)
        optimum = preliminary.solve(factors)
    task.progress("choosing the spline resolution by held-out prediction")
    chosen = resolution.choose(preliminary.problem, campaign, optimum.z, factors, carrier, guess, automatic)
    return _Resolved(task.fitter(task.problem(chosen.segments, carrier, like=first)), chosen)


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


@one_blas_thread()
@breakdown_named()
def fit(
    campaign: Campaign,
    *,
    robust: bool = False,
    datum: Datum | None = None,
    prior: Solution | None = None,
    solver: str = CHORD,
    engine: str | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Identify a machine's error model from a campaign by nonlinear least squares.

    Minimises Σ ((reading - predicted)/u)² over the error functions, stations, dead paths and all other unknowns at once. What the
    readings do not determine is found first, is named in the solution, and stays at zero. Not modelled: thermal behaviour,
    dynamics and load.

    Args:
        campaign: the readings, with their machine.
        robust: find gross outliers with Huber's loss and normalised residuals, name them, and set them aside.
        datum: the solution is transformed into it after the fit; None: the machine's.
        prior: an earlier solution of axes that this machine has too (linear axes measured before); its functions count as
            readings, with their covariance.
        solver: "chord" (few assemblies of the normal equations) or "optimistix" (a solver of that library, one assembly per
            step); both reach the same minimum.
        engine: "interpreted" (NumPy) or "compiled" (JAX); None: the one with which the whole fit takes less time. The solver
            "optimistix" is a compiled program, and takes "compiled" only.
        progress: called with a message at every stage.

    Raises:
        InputError: the campaign cannot be fitted: fewer readings than parameters, a wrong unit, duplicated rows, ….
        VolidError: nothing converges.

    Source: ISO/TR 16907 8; CONVENTIONS 3, 4, 6.

    >>> import volid
    >>> campaign = volid.load_campaign("datasets/published_positioning/campaign.toml")
    >>> solution = volid.fit(campaign)
    >>> solution.statistics.converged, solution.fully_determined
    (True, True)
    """
    if not isinstance(campaign, Campaign):
        raise InputError(
            f"fit takes a Campaign; got {type(campaign).__name__}. Read a file with volid.load_campaign(path)"
        )
    return _fit(campaign, robust, datum, prior, _how(campaign, robust, solver, engine), progress or _silent)


def _how(campaign: Campaign, robust: bool, solver: str, engine: str | None) -> How:
    """Solver and engine by their names. Raises `InputError` for unknown ones, and for a pair that does not go together."""
    if solver not in (CHORD, OPTIMISTIX):
        raise InputError(f"solver is '{solver}'; expected '{CHORD}' or '{OPTIMISTIX}'")
    if solver == CHORD:
        return How(solve, engine_for_fit(campaign, robust=robust) if engine is None else engine_named(engine))
    from volid.fitting.equations.optimistix_solver import solve_by_optimistix  # takes a second to import

    return How(solve_by_optimistix, engine_for_compiled_solver(engine))


class Stages:
    """The stages of one fit, in their order: `begin` (checks, stations), `solved` (resolution, solve), `solution`."""

    def __init__(self, measured: Campaign, task: _Task, warnings: tuple[str, ...]) -> None:
        self.measured, self.task, self.warnings = measured, task, warnings
        self._chosen: resolution.Resolution | None = None

    @classmethod
    def begin(
        cls,
        campaign: Campaign,
        prior: Solution | None,
        progress: Progress,
        how: How,
        robust: bool = False,
    ) -> Stages:
        """Check the campaign and find start values."""
        progress("checking the campaign")
        warnings = check_campaign(campaign)
        progress("locating stations")
        starts = find_starts(campaign)
        if prior is not None:
            check_prior(prior, campaign.machine)
            warnings = (*warnings, *prior_notes(prior))
            prior = prior if prior.datum == campaign.machine.datum else prior.in_datum(campaign.machine.datum)
        noisy = with_random_effects(campaign, starts, how.engine)
        return cls(campaign, _Task(noisy, starts, prior, robust, progress, how.method, how.engine), warnings)

    def solved(self) -> Fitter:
        """Choose the resolution and solve."""
        resolved = _resolve(self.task)
        self._chosen = resolved.resolution
        self.task.progress("solving")
        resolved.fitter.solve(resolved.fitter.factors)
        return resolved.fitter

    def prior_of(self, fitter: Fitter) -> Prior | None:
        """The prior knowledge that an earlier solution gives about the parameters of the fitter's model."""
        return None if self.task.prior is None else prior_of(self.task.prior, fitter.problem.model)

    def solution(self, fitter: Fitter, outliers: list[np.ndarray] | None = None) -> Solution:
        """The solution at the fitter's optimum."""
        assert self._chosen is not None
        if outliers is None:
            outliers = [np.zeros(s.readings.shape, dtype=bool) for s in self.measured.sets]
        options = {"robust": self.task.robust, "prior": self.task.prior is not None}
        found = Assembly(fitter, self._chosen, outliers).solution(self.warnings, options)
        return replace(found, campaign=self.measured)


def _fit(
    campaign: Campaign,
    robust: bool,
    datum: Datum | None,
    prior: Solution | None,
    how: How,
    progress: Progress,
) -> Solution:
    stages = Stages.begin(campaign, prior, progress, how, robust)
    fitter, outliers = stages.solved(), None
    if robust:
        progress("looking for outliers")
        factors = down_weight(fitter.residuals_only, fitter.factors)
        outliers = name_outliers(fitter.weighted, set_aside(fitter.weighted(factors)))
        fitter = fitter.without(outliers)
    solution = stages.solution(fitter, outliers)
    return solution if datum in (None, solution.datum) else solution.in_datum(datum)
