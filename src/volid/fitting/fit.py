"""`fit`: from a campaign to a solution, in the order of the work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from volid.backend.threads import one_blas_thread
from volid.campaign import Campaign
from volid.effects.environment.reduction import reduced
from volid.exceptions import InputError
from volid.fitting.broken_beams import MOST, with_new_segments
from volid.fitting.diagnosis.robust import down_weight, name_outliers, set_aside
from volid.fitting.equations.choice import engine_for_compiled_solver, engine_for_fit, engine_named
from volid.fitting.equations.solver import solve
from volid.fitting.mixed.components import Component, components_of
from volid.fitting.mixed.estimation import Estimation
from volid.fitting.mixed.remarks import with_components
from volid.fitting.smooth_fit import SmoothFit
from volid.fitting.solution import Solution
from volid.fitting.stages import How, Progress, Stages, breakdown_named
from volid.model.machine import Datum
from volid.observations.base import with_large_errors

CHORD, OPTIMISTIX = "chord", "optimistix"


def _silent(message: str) -> None:
    del message


@one_blas_thread()
@breakdown_named()
def fit(
    campaign: Campaign,
    *,
    robust: bool = False,
    datum: Datum | None = None,
    prior: Solution | None = None,
    estimate_u: bool | str | Sequence[str] = False,
    solver: str = CHORD,
    engine: str | None = None,
    accept_large_errors: bool = False,
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
        estimate_u: estimate the u of the readings anew, by restricted maximum likelihood: True or "all" for every set, or names
            of sets; one factor for the readings of each unit. The u of the solution are the stated ones times these factors
            (`Solution.variance_components`), and the solution is that of a campaign which states them so. Sets that hardly
            anything checks keep their u. Not part of u of the result: that the factors are uncertain themselves.
        solver: "chord" (few assemblies of the normal equations) or "optimistix" (a solver of that library, one assembly per
            step); both reach the same minimum.
        engine: "interpreted" (NumPy) or "compiled" (JAX); None: the one with which the whole fit takes less time. The solver
            "optimistix" is a compiled program, and takes "compiled" only.
        accept_large_errors: take errors of any size without asking whether readings are in another unit; the same as the option
            `large_errors` of every set.
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
    if accept_large_errors:
        campaign = with_large_errors(campaign)
    campaign = reduced(campaign)
    how = _how(campaign, robust, solver, engine)
    request = _Request(robust, datum, prior, how, progress or _silent)
    components = components_of(campaign, estimate_u)
    return _with_estimated_u(campaign, components, request) if components else _fit(campaign, request)


class _Request(NamedTuple):
    """What is asked of a fit."""

    robust: bool
    datum: Datum | None
    prior: Solution | None
    how: How
    progress: Progress


def _how(campaign: Campaign, robust: bool, solver: str, engine: str | None) -> How:
    """Solver and engine by their names. Raises `InputError` for unknown ones, and for a pair that does not go together."""
    if solver not in (CHORD, OPTIMISTIX):
        raise InputError(f"solver is '{solver}'; expected '{CHORD}' or '{OPTIMISTIX}'")
    if solver == CHORD:
        return How(solve, engine_for_fit(campaign, robust=robust) if engine is None else engine_named(engine))
    from volid.fitting.equations.optimistix_solver import solve_by_optimistix  # takes a second to import

    return How(solve_by_optimistix, engine_for_compiled_solver(engine))


def _fit(campaign: Campaign, asked: _Request) -> Solution:
    stages = Stages.begin(campaign, asked.prior, asked.progress, asked.how, asked.robust)
    fitter, outliers = stages.solved(), None
    if asked.robust:
        stages, fitter = _without_breaks(stages, fitter, asked.how)
        asked.progress("looking for outliers")
        factors = down_weight(fitter.residuals_only, fitter.factors)
        outliers = name_outliers(fitter.weighted, set_aside(fitter.weighted(factors)))
        fitter = fitter.without(outliers)
    solution = stages.solution(fitter, outliers)
    return solution if asked.datum in (None, solution.datum) else solution.in_datum(asked.datum)


def _with_estimated_u(campaign: Campaign, components: tuple[Component, ...], asked: _Request) -> Solution:
    """The solution of the campaign with the u of `components` as the residuals show them."""
    stages = Stages.begin(campaign, asked.prior, asked.progress, asked.how, asked.robust)
    fitter = stages.solved()
    if asked.robust:
        stages, fitter = _without_breaks(stages, fitter, asked.how)
    changed, found = Estimation(stages, fitter, components).run()
    solution = _fit(changed, asked)
    broken = [w for w in stages.warnings if w not in solution.notes]  # beams that are mended now
    return with_components(replace(solution, notes=(*solution.notes, *broken)), found)


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
