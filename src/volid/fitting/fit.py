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
from volid.fitting.assembly import Assembly, Every
from volid.fitting.broken_beams import MOST, with_new_segments
from volid.fitting.diagnosis.alternatives.readings import WHOLE
from volid.fitting.diagnosis.robust import down_weight, name_outliers, set_aside
from volid.fitting.diagnosis.verdict import explained_otherwise, perhaps_u
from volid.fitting.equations.choice import engine_for_compiled_solver, engine_for_fit, engine_named
from volid.fitting.equations.engine import Engine
from volid.fitting.equations.problem import Problem, build_problem, nothing_known, with_random_effects
from volid.fitting.equations.solver import solve
from volid.fitting.fitter import Method
from volid.fitting.open_frame import in_open_frame
from volid.fitting.prior import check_prior, prior_notes, prior_of, stated_segments
from volid.fitting.remarks import remarks
from volid.fitting.segments import segments_of
from volid.fitting.shape_notes import shape_notes
from volid.fitting.smooth_fit import SmoothFit
from volid.fitting.smoothness.geometry import measured_machine, range_notes
from volid.fitting.smoothness.processes import processes_of
from volid.fitting.solution import EARLIER_LEVELS, EARLIER_RANGES, Solution
from volid.fitting.starts import find_starts
from volid.model.error_model import build_model
from volid.model.machine import Datum, Machine
from volid.plausibility.checks import check_campaign

Progress = Callable[[str], None]
CHORD, OPTIMISTIX = "chord", "optimistix"
LARGER, SAME = 6, 0.02  # times that a larger u is tried, and relative change of it that is none


def _silent(message: str) -> None:
    del message


class How(NamedTuple):
    """Solver and engine of a fit."""

    method: Method
    engine: Engine


class _Task(NamedTuple):
    """What stays the same over all stages of one fit. `machine`: with travels cut to what was measured."""

    campaign: Campaign
    machine: Machine
    starts: dict[Any, float]
    prior: Solution | None
    robust: bool
    progress: Progress
    method: Method
    engine: Engine


def _check_counts(campaign: Campaign, problem: Problem, n_smooth: int) -> None:
    """Raises `InputError` when there are more parameters than readings, all that is known beforehand counted."""
    n_free, n_known, n = problem.free.shape[1], problem.system.prior_root.shape[0], problem.model.n_parameters
    if campaign.n_readings + n_known + n_smooth < n_free:
        raise InputError(
            f"{campaign.source or 'campaign'}: {campaign.n_readings} readings for {n_free - n_smooth} parameters "
            f"({n - n_smooth} of the error model, {n_free - n} of stations and "
            "instruments); take more readings, or lower [model] segments or switch functions off"
        )


def _prepared(task: _Task) -> SmoothFit:
    """The problem, what of it is determined, and whose smoothness is to be estimated."""
    given = {} if task.prior is None else stated_segments(task.prior, task.machine)
    segments = segments_of(task.machine, given)
    model = build_model(task.machine, segments.numbers)
    known = nothing_known(model) if task.prior is None else prior_of(task.prior, model)
    problem = build_problem(task.campaign, model, task.starts, known, engine=task.engine)
    found = SmoothFit(task.campaign, problem, known, processes_of(model, segments.smooth), task.method)
    _check_counts(task.campaign, problem, found.n_smooth)
    return found


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

    Where the machine file does not state segments, every function may have any shape, and how smooth it is follows from the
    readings by maximum of their marginal likelihood; what that leaves open between the positions is part of every u. Functions,
    reference lines and means refer to the measured range of each axis.

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


def _measured_by(prior: Solution) -> dict[str, tuple[float, float]]:
    """Measured ranges by axis letter."""
    return {
        axis.letter: (float(low), float(high))
        for axis, (low, high) in zip(prior.machine.axes, prior.measured_range(), strict=True)
    }


class Stages:
    """The stages of one fit, in their order: `begin` (checks, stations), `solved` (smoothness, solve), `solution`."""

    def __init__(self, measured: Campaign, task: _Task, warnings: tuple[str, ...]) -> None:
        self.measured, self.task, self.warnings = measured, task, warnings

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
        machine = measured_machine(campaign, {} if prior is None else _measured_by(prior))
        task = _Task(noisy, machine, starts, prior, robust, progress, how.method, how.engine)
        return cls(campaign, task, (*warnings, *range_notes(campaign.machine, machine)))

    def solved(self) -> SmoothFit:
        """Solve, with the smoothness of the functions estimated."""
        self.task.progress("preparing")
        fitter = _prepared(self.task)
        self.task.progress("solving")
        fitter.solve_with_smoothness(fitter.factors, self.task.robust)
        return fitter

    def solution(
        self, fitter: SmoothFit, outliers: list[np.ndarray] | None = None, every: Every | None = None
    ) -> Solution:
        """The solution at the fitter's optimum; `every`: tests of all readings, where the campaign holds some of them."""
        self.task.progress("testing the model")
        if outliers is None:
            outliers = [np.zeros(s.readings.shape, dtype=bool) for s in self.measured.sets]
        options: dict[str, Any] = {"robust": self.task.robust, "prior": self.task.prior is not None}
        if self.task.prior is not None:
            options[EARLIER_RANGES] = {a: list(r) for a, r in _measured_by(self.task.prior).items()}
            options[EARLIER_LEVELS] = {a: list(v) for a, v in self.task.prior.levels().items()}
        own = fitter.waves = dict(fitter.scatter)
        earlier = {} if self.task.prior is None else dict(self.task.prior.scatter)
        if fitter.processes:
            fitter.scatter = {n: max(earlier.get(n, 0.0), own.get(n, 0.0)) for n in {**earlier, **own}}
        found = Assembly(fitter, outliers).solution(self.warnings, options, self.task.starts, every)
        if own and every is None and explained_otherwise(found.adequacy):
            self.task.progress("testing the model without waves")
            fitter = fitter.without_scatter()
            fitter.scatter = dict(earlier)
            found = Assembly(fitter, outliers).solution(self.warnings, options, self.task.starts, every)
        if fitter.processes and every is None and not fitter.scatter and perhaps_u(found.adequacy):
            found = self._with_larger_u(fitter, found, outliers, options)
        found = in_open_frame(found)
        notes = (*found.notes, *shape_notes(found, fitter.found.weak))
        found = replace(found, campaign=self.measured)
        return replace(found, notes=(*notes, *remarks(found)))

    def _with_larger_u(
        self, fitter: SmoothFit, found: Solution, outliers: list[np.ndarray], options: dict[str, Any]
    ) -> Solution:
        """The solution for readings that are all worse than stated, where that explains the misfit; else as it is.

        The smoothness depends on u: with one that is too small, functions follow the noise, and hold-outs show it.
        """
        self.task.progress("testing the model with a larger u")
        kappa, other = found.adequacy.unit_weight, found
        for _ in range(LARGER):
            now = fitter.with_larger_u(kappa)
            other = Assembly(now, outliers).solution(self.warnings, options, self.task.starts)
            kappa, last = other.adequacy.unit_weight, kappa
            if abs(kappa / last - 1.0) < SAME:
                break
        return other if other.adequacy.causes and other.adequacy.causes[0].cause == WHOLE else found


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
        stages, fitter = _without_breaks(stages, fitter, how)
        progress("looking for outliers")
        factors = down_weight(fitter.residuals_only, fitter.factors)
        outliers = name_outliers(fitter.weighted, set_aside(fitter.weighted(factors)))
        fitter = fitter.without(outliers)
    solution = stages.solution(fitter, outliers)
    return solution if datum in (None, solution.datum) else solution.in_datum(datum)


def _without_breaks(stages: Stages, fitter: SmoothFit, how: How) -> tuple[Stages, SmoothFit]:
    """The stages of the campaign with new segments where beams were broken."""
    task = stages.task
    for _ in range(MOST):
        task.progress("looking for broken beams")
        campaign, notes = with_new_segments(stages.measured, fitter, stages.task.starts)
        if not notes:
            break
        kept = tuple(dict.fromkeys((*stages.warnings, *notes)))
        if campaign is stages.measured:
            stages.warnings = kept
            break
        stages = Stages.begin(campaign, task.prior, task.progress, how, task.robust)
        stages.warnings = tuple(dict.fromkeys((*kept, *stages.warnings)))
        fitter = stages.solved()
    return stages, fitter
