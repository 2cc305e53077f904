"""The stages of a fit, and what stays the same over all of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.fitting.air import check_air
from volid.fitting.assembly import Assembly, Every
from volid.fitting.diagnosis.alternatives.readings import WHOLE
from volid.fitting.diagnosis.verdict import explained_otherwise, perhaps_u
from volid.fitting.equations.engine import Engine
from volid.fitting.equations.problem import Problem, build_problem, nothing_known, with_random_effects
from volid.fitting.fitter import Method
from volid.fitting.nominal import check_nominal
from volid.fitting.open_frame import in_open_frame
from volid.fitting.prior import check_prior, prior_notes, prior_of, stated_segments
from volid.fitting.questions import asked
from volid.fitting.remarks import remarks
from volid.fitting.segments import Segments, segments_of
from volid.fitting.shape_notes import shape_notes
from volid.fitting.smooth_fit import SmoothFit
from volid.fitting.smoothness.geometry import measured_machine, range_notes
from volid.fitting.smoothness.processes import processes_of
from volid.fitting.solution import EARLIER_LEVELS, EARLIER_RANGES, Solution
from volid.fitting.starts import find_starts
from volid.model.error_model import build_model
from volid.model.machine import Machine
from volid.observations.base import takes_large_errors
from volid.plausibility.checks import check_campaign

Progress = Callable[[str], None]
PESSIMISTIC, FREE = 0.5, 30  # unit weight of readings below which, and redundancy above which, u is estimated anew
FEW_SEGMENTS, MOST_SEGMENTS = 2000, 6000  # of all functions: no trouble to try, and what fits into memory and patience
LARGER, SAME = 6, 0.02  # times that a larger u is tried, and relative change of it that is none

NOT_FINITE = "infs or NaNs"  # SciPy's and NumPy's words for a matrix that has overflown


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


def _check_stated(task: _Task, segments: Segments) -> None:
    """Raises `InputError` for stated segments that no fit could determine or hold, before anything of that size is built."""
    stated = sum(math.prod(n) for name, n in segments.numbers.items() if name not in segments.smooth)
    most = min(MOST_SEGMENTS, max(FEW_SEGMENTS, task.campaign.n_readings))
    if stated > most:
        raise InputError(
            f"{task.campaign.source or 'campaign'}: the machine's functions have {stated} segments, and there are "
            f'{task.campaign.n_readings} readings; expected at most {most}, lower [model] segments or take "auto"'
        )


def _prepared(task: _Task) -> SmoothFit:
    """The problem, what of it is determined, and whose smoothness is to be estimated."""
    given = {} if task.prior is None else stated_segments(task.prior, task.machine)
    segments = segments_of(task.machine, given)
    _check_stated(task, segments)
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
    except ValueError as problem:  # of which `LinAlgError` is one
        if not isinstance(problem, np.linalg.LinAlgError) and NOT_FINITE not in str(problem):
            raise
        raise InputError(
            "the fit broke down: its equations have no solution that the digits of a computer can hold. Readings, positions and "
            "travels contradict each other, or some u are many orders of magnitude below the others; check that positions, "
            "travels, tool vectors, stations, readings and u are in mm, and that every axis column holds its own axis"
        ) from problem


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
        if not all(map(takes_large_errors, campaign.sets)):
            check_nominal(campaign)
        check_air(campaign)
        starts = find_starts(campaign)
        if prior is not None:
            check_prior(prior, campaign.machine)
            warnings = (*warnings, *prior_notes(prior, campaign))
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
        options = self._options()
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
        scale = 1.0 if every is not None else self._scale_of_u(fitter, found, outliers)
        return asked(replace(found, notes=(*notes, *remarks(found))), scale)

    def _options(self) -> dict[str, Any]:
        """What a solution keeps of how it was made."""
        options: dict[str, Any] = {"robust": self.task.robust, "prior": self.task.prior is not None}
        if self.task.prior is not None:
            options[EARLIER_RANGES] = {a: list(r) for a, r in _measured_by(self.task.prior).items()}
            options[EARLIER_LEVELS] = {a: list(v) for a, v in self.task.prior.levels().items()}
        return options

    def _scale_of_u(self, fitter: SmoothFit, found: Solution, outliers: list[np.ndarray]) -> float:
        """Residuals over their u, with the smoothness that belongs to residuals of that size; 1 where they are not far below.

        With a u that is far too large functions are taken for smoother than they are, and what they leave looks like noise.
        """
        tested = found.adequacy
        kappa = tested.reading_weight if tested.redundancy > FREE else 1.0
        if not kappa < PESSIMISTIC or not fitter.processes:
            return kappa
        self.task.progress("testing the model with a smaller u")
        for _ in range(LARGER):
            last, kappa = kappa, Assembly(fitter.with_larger_u(kappa), outliers).tested().reading_weight
            if abs(kappa / last - 1.0) < 5.0 * SAME:
                break
        return kappa

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
