"""`fit_streamed`: campaigns larger than memory, one part of the readings after the other.

First a sample of the campaign is fitted completely by `fit`. It places the stations, decides what is determined, estimates the
smoothness of the functions and gives a solution to begin with. Then all readings are used, part by part: for normal equations
at the start (in single precision), for gradients until the minimum is reached, for normal equations there, which give the
covariance, and for residuals, which give the verdict.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from volid.backend.steps import Step
from volid.backend.threads import one_blas_thread
from volid.campaign import Campaign
from volid.effects import TYPES
from volid.effects.environment.reduction import reduced, starts_of
from volid.effects.environment.stream import ReducedStream
from volid.exceptions import InputError
from volid.fitting.assembly import Every
from volid.fitting.change_of_datum import EXTRAPOLATED
from volid.fitting.diagnosis.tally import Tally
from volid.fitting.equations.choice import engine_for_fit, engine_for_stream
from volid.fitting.equations.engine import Engine, Equations
from volid.fitting.equations.free_directions import FreeDirections
from volid.fitting.equations.freedom import degrees_of_freedom
from volid.fitting.equations.problem import Problem, build_problem, reweight, scatter, with_random_effects
from volid.fitting.equations.solver import Objective, solve
from volid.fitting.equations.system import Normal
from volid.fitting.smooth_fit import SmoothFit
from volid.fitting.smoothness.scatter import with_scatter
from volid.fitting.solution import Solution
from volid.fitting.stages import How, Progress, Stages, breakdown_named
from volid.model.machine import Datum
from volid.observations import KINDS
from volid.observations.base import NuisanceTable, with_large_errors

SAMPLE = 10_000  # rows that stations, rank and smoothness are decided on
STREAMED = "streamed"  # option of a solution: number of readings that it was made of


class Stream(Protocol):
    """Where the readings come from: `volid.CampaignStream`, or anything like it."""

    rows: int
    n_readings: int

    def parts(self) -> Iterator[Campaign]:
        """All readings, in campaigns that fit into memory."""
        ...

    def sample(self, rows: int) -> Campaign:
        """About so many rows, some of every station and segment among them."""
        ...


class _Part(NamedTuple):
    campaign: Campaign
    problem: Problem


class _Parts:
    """The parts of a stream as problems that share the unknowns of one complete problem."""

    def __init__(
        self,
        stream: Stream,
        fitter: SmoothFit,
        complete: Problem,
        table: NuisanceTable,
        engine: Engine,
        progress: Progress,
    ) -> None:
        self.stream, self.complete, self.table, self.engine, self.progress = stream, complete, table, engine, progress
        assert fitter.optimum is not None
        self.scatter, self.z = fitter.scatter, fitter.optimum.z
        self.prior = engine.equations(
            replace(complete.system, blocks=())
        )  # what is known beforehand, without any reading

    def __call__(self, what: str) -> Iterator[_Part]:
        system, done = self.complete.system, 0
        for raw in self.stream.parts():
            campaign = with_random_effects(raw, dict(self.table.starts), self.engine)
            known = len(self.table.entries)
            problem = build_problem(campaign, self.complete.model, table=self.table, engine=self.engine)
            if len(self.table.entries) > known:
                name = self.table.entries[known].name
                raise InputError(
                    f"{campaign.source}: the sample has no reading with '{name}'; expected some of every label"
                )
            if self.scatter:
                campaign = with_scatter(campaign, problem, self.z, self.scatter)
                problem = reweight(problem, campaign, [np.ones(s.readings.shape) for s in campaign.sets])
            bare = replace(problem.system, prior_value=np.zeros(0), prior_root=np.zeros((0, system.size)))
            yield _Part(campaign, problem._replace(equations=self.engine.equations(bare)))
            done += sum(len(s) for s in campaign.sets)
            self.progress(Step(done, self.stream.rows, "rows", of=what))


class _StreamObjective(Objective):
    """Cost, gradient and JᵀJ summed over the parts; prior knowledge counts once, as a part without readings."""

    def __init__(self, parts: _Parts, free: np.ndarray) -> None:
        self.free, self._stream, self._passes = FreeDirections(free), parts, 0

    def full_normal(self, z: np.ndarray, rough: bool) -> Normal:
        """Cost, gradient and JᵀJ in z."""
        return Normal(*self._sums(lambda equations: equations.normal(z, rough)))

    def full_slope(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """Cost and gradient in z."""
        cost, gradient = self._sums(lambda equations: equations.slope(z))
        return cost, gradient

    def _sums(self, function: Callable[[Equations], Sequence[Any]]) -> list[Any]:
        self._passes += 1
        total = list(function(self._stream.prior))
        for part in self._stream(f"pass {self._passes}"):
            total = [a + b for a, b in zip(total, function(part.problem.equations), strict=True)]
        return total


@one_blas_thread()
@breakdown_named()
def fit_streamed(
    stream: Stream,
    *,
    datum: Datum | None = None,
    prior: Solution | None = None,
    sample: int = SAMPLE,
    accept_large_errors: bool = False,
    progress: Progress | None = None,
) -> Solution:
    """Identify a machine's error model from a campaign that need not fit into memory.

    The minimum, its covariance, chi-square and all group tests are those of all readings. The start values, what is determined,
    and the smoothness of the functions are decided on a `sample` of that many rows. The solution contains the readings of the
    sample only; therefore Monte Carlo and budgets, which repeat the fit, refuse it.

    Args:
        stream: the readings, as `volid.CampaignStream` reads them part by part.
        datum: The datum of the solution, the same as in `fit`.
        prior: An earlier solution, the same as in `fit`.
        sample: Number of rows of the sample.
        accept_large_errors: Take errors of any size without asking, the same as in `fit`.
        progress: Function that is called with messages, the same as in `fit`.

    Raises:
        InputError: as `fit` does, and for drift effects, whose scopes span all parts.

    >>> import volid
    >>> from pathlib import Path
    >>> from tempfile import mkdtemp
    >>> path = Path(mkdtemp()) / "campaign.h5"
    >>> volid.save_campaign(volid.load_campaign("datasets/published_positioning/campaign.toml"), path)
    >>> volid.fit_streamed(volid.CampaignStream(path)).statistics.n_readings
    70
    """
    progress = progress or (lambda message: None)
    progress("reading a sample")
    few = stream.sample(sample)
    if few.environments:
        stream = ReducedStream(stream, starts_of(few))
        few = reduced(few, stream.starts)
    if accept_large_errors:
        few = with_large_errors(few)
    _check_effects(few)
    stages = Stages.begin(few, prior, progress, How(solve, engine_for_fit(few)))
    fitter = stages.solved()
    table = NuisanceTable(stages.task.starts)
    complete = build_problem(stages.task.campaign, fitter.problem.model, prior=fitter.prior, table=table)
    assert [e.name for e in table.entries] == [e.name for e in fitter.problem.nuisance]
    parts = _Parts(stream, fitter, complete, table, engine_for_stream(stream.n_readings), progress)
    assert fitter.optimum is not None
    objective = _StreamObjective(parts, fitter.free)
    fitter.optimum = solve(complete, fitter.optimum.z, fitter.free, objective)
    tally, squares = _residuals(parts, fitter, few, stream.n_readings)
    pseudo = np.asarray(complete.system.prior_residual(fitter.optimum.z))
    dof = degrees_of_freedom(stream.n_readings, complete, fitter.free)
    every = Every(tally.adequacy(dof, float(pseudo @ pseudo)), stream.n_readings)
    solution = stages.solution(fitter, every=every)
    solution = _of_all_readings(solution, stream.n_readings, few.n_readings, squares)
    return solution if datum in (None, solution.datum) else solution.in_datum(datum)


def _of_all_readings(solution: Solution, n: int, n_sample: int, squares: dict[str, tuple[float, int]]) -> Solution:
    """The solution that says it is made of `n` readings, `n_sample` of which it holds; `squares` as in `_residuals`."""
    rms = {name: float(np.sqrt(total / count)) for name, (total, count) in squares.items()}
    note = (
        f"{n:,} readings were read part by part; smoothness and rank were decided on {n_sample:,} of them, which are "
        "the readings this solution holds"
    )
    return replace(
        solution,
        statistics=solution.statistics._replace(n_readings=n, residual_rms=rms),
        options={**solution.options, STREAMED: n},
        notes=(*solution.notes, note),
    )


def _check_effects(campaign: Campaign) -> None:
    for s in campaign.sets:
        if KINDS[s.kind].is_whole(s):
            raise InputError(
                f"set '{s.name}': its rows refer to each other and cannot be fitted part by part; fit the campaign in memory"
            )
        for effect in s.effects:
            if TYPES[effect.type].spans_campaign:
                raise InputError(
                    f"set '{s.name}', effect '{effect.name}': {effect.type} spans all parts of the campaign and cannot be "
                    "fitted part by part; fit the campaign in memory, or thin it out"
                )


def _residuals(
    parts: _Parts, fitter: Any, few: Campaign, n_readings: int
) -> tuple[Tally, dict[str, tuple[float, int]]]:
    """Group sums of all readings at the minimum, and per set the sum of squared residuals and their number."""
    tally = Tally(few, n_readings)
    squares: dict[str, tuple[float, int]] = {}
    z, factor = fitter.optimum.z, fitter.root().T
    for part in parts("residuals"):
        equations, campaign = part.problem.equations, part.campaign
        values = scatter(part.problem, campaign, equations.predictions(z))
        leverages = scatter(part.problem, campaign, equations.quadratic_forms(z, factor))
        residuals = [s.readings - v for s, v in zip(campaign.sets, values, strict=True)]
        whitened = [r / s.u for r, s in zip(residuals, campaign.sets, strict=True)]
        tally.add(campaign, whitened, leverages, [np.ones(r.shape, dtype=bool) for r in residuals])
        for s, r in zip(campaign.sets, residuals, strict=True):
            total, n = squares.get(s.name, (0.0, 0))
            squares[s.name] = total + float(np.sum(r**2)), n + r.size
    return tally, squares


def check_refittable(solution: Solution, what: str) -> None:
    """Raises `InputError` when a solution does not hold all readings that it was made of, or was changed since."""
    if EXTRAPOLATED in solution.options:
        raise InputError(
            f"{what} repeats the fit, but this solution is extrapolated; take the one that it was made from"
        )
    if STREAMED in solution.options:
        raise InputError(
            f"{what} repeats the fit, but this solution holds {solution.campaign.n_readings:,} of its "
            f"{solution.options[STREAMED]:,} readings (they were read part by part); fit the campaign in memory, or use u and U "
            "from propagation, which comprise all readings"
        )
