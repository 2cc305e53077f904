"""What each compensation type leaves over the working volume, with coverage intervals (ISO/TR 16907 11.1).

At points over the travel, for every draw of the parameters,

    remaining = e(draw) + what the altered command moves,    the command from tables and grids of the estimate, as a control
    holds them,

so that the result includes the uncertainty of the solution, interpolation, least increment, wrong tool data, poles, and all
errors that a type does not correct. The least-squares rigid motion of the workpiece frame is subtracted from the translations of
the functional point, and its rotation from the orientation. The draws are the Monte Carlo samples of the solution when it has
them, else normal draws from its covariance. Not included: repeatability and thermal change of the machine, which limit what can
be reached.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from volid.compensation.base import Base
from volid.compensation.grids.request import Rule
from volid.compensation.motion import Motion, asked_motion
from volid.compensation.package import Compensation, CompensationRequest, compensation_of
from volid.compensation.residual.fields import LENGTHS, Field, Places, moved_by, quantities, volume_places
from volid.compensation.reversal import NONE as NO_REVERSAL
from volid.compensation.reversal import reversal_text
from volid.compensation.tables.sampling import Sampling
from volid.fitting.prediction.spread import covariance_root
from volid.fitting.solution import Solution
from volid.uncertainty.coverage import coverage_intervals

if TYPE_CHECKING:
    from jaxtyping import Float

DRAWS = 400
MOST_SAMPLES = 2000
NONE = "none"


class Prediction(NamedTuple):
    """What one compensation leaves for one tool vector, each (10,) in the order of `QUANTITIES` [mm, rad].

    `value`: mean over the draws of the largest and RMS length, the length that 95 % of the points keep, the largest |X|, |Y|,
    |Z| and the largest |A|, |B|, |C| of the orientation and the largest tilt of the tool axis, which is what a turning tool
    feels; `low`, `high`: 95 % coverage interval; `exact`: if the solution were exact. NaN: not determined by the data.
    """

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    exact: np.ndarray


@dataclass(frozen=True, eq=False)
class Column:
    """Predictions for one list of types, one per tool vector. `motion`: what the compensation asks of the axes. `unintended`:
    largest motion of the functional point by turned rotary axes [mm], which is corrected unless FOR stands alone."""

    name: str
    predictions: tuple[Prediction, ...]
    motion: Motion
    unintended: float
    compensation: Compensation


@dataclass(frozen=True, eq=False)
class Forecast:
    """What `forecast` predicts.

    Args:
        columns: Predictions without any compensation ("none"), followed by those of each list of types.
        tools: The tool vectors that the predictions hold for, shape (k, 3) [mm].
        draws: Number of draws of the parameters.
        source: Where the draws come from, in words.
        notes: What else a user should know.

    >>> import numpy as np
    >>> Forecast((), np.zeros((1, 3)), 400, "the covariance of the solution").draws
    400
    """

    columns: tuple[Column, ...]
    tools: Float[np.ndarray, "k 3"]
    draws: int
    source: str
    notes: tuple[str, ...] = field(default_factory=tuple)


def forecast(
    solution: Solution,
    lists: Sequence[Sequence[str]],
    base: Base,
    tools: Float[np.ndarray, "k 3"] | None = None,
    *,
    places: Places | None = None,
    tables: Sampling | None = None,
    grids: Sampling | None = None,
    points: int | None = None,
    form: str | None = None,
    rule: Rule | None = None,
    control: Mapping[str, Any] | None = None,
    tool_error: Sequence[float] = (0.0, 0.0, 0.0),
    seed: int = 0,
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> Forecast:
    """Predictions for each list of types, after "none", for each tool vector.

    Args:
        solution: A solution, as `volid.fit` makes it.
        lists: Lists of types of ISO/TR 16907, such as [["L-VOL"], ["L-POS", "L-STR"]].
        base: What the types are based on, as `volid.compensation_base` makes it.
        tools: Tool vectors for which the predictions are made, shape (k, 3) [mm]; the base tool by default.
        places: Where the deviation is evaluated; 512 places over the travels by default.
        tables, grids, points, form, rule, ranges: The same as in `compensate`.
        control: Options of `Control`: increment, clamped, poles, correct_motion.
        tool_error: Tool vector that the control uses minus the true one, (3,) [mm].
        seed: Seed of the random numbers that the draws of the parameters come from.

    Raises:
        InputError: as `compensate` and `Control` raise it.
        NotDeterminedError: the data do not determine the deviation of the functional point over the volume.

    Source: ISO/TR 16907 11.1.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> base = volid.compensation_base(solution, (0.0, 0.0, -150.0))
    >>> before, after = volid.forecast(solution, [["R-VOL"]], base, points=9).columns
    >>> after.name, bool(after.predictions[0].value[0] < 0.5 * before.predictions[0].value[0])
    ('R-VOL', True)
    """
    request = CompensationRequest(base, tables, grids, points, form, rule, uncertainty=False, ranges=ranges)
    places = volume_places(solution.machine) if places is None else places
    tools = base.tool[None] if tools is None else np.atleast_2d(tools)
    draws, source = parameter_draws(solution, seed)
    fields = [Field(solution, places, tool, base) for tool in tools]
    believed = _Believed(control or {}, np.asarray(tool_error))
    columns = [
        _column(names, compensation_of(solution, names, request), fields, draws, believed) for names in ((), *lists)
    ]
    return Forecast(tuple(columns), tools, len(draws), source, _notes(solution, columns))


class _Believed(NamedTuple):
    """What a control works with: `options` of `Control`, and the tool vector that it uses minus the true one, (3,) [mm]."""

    options: Mapping[str, Any]
    tool_error: np.ndarray

    def of(self, tool: np.ndarray) -> dict[str, Any]:
        """Options of a control for a true tool vector: with the vector that it uses, where that is another one."""
        return {**self.options, "tool": tuple(tool + self.tool_error)} if self.tool_error.any() else dict(self.options)


def _notes(solution: Solution, columns: Sequence[Column]) -> tuple[str, ...]:
    texts = {reversal_text(solution, g): None for c in columns for g in c.compensation.grids}
    return tuple(f"grids hold no reversal, what is left is predicted: {t}" for t in texts if t != NO_REVERSAL)


def parameter_draws(solution: Solution, seed: int = 0) -> tuple[np.ndarray, str]:
    """Draws of θ less its estimate, (s, n), and from where they are."""
    theta = np.asarray(solution.parameters)
    if solution.samples is not None:
        values = solution.samples.outputs(lambda x: x[:, : len(theta)])[:MOST_SAMPLES]
        return values - theta, "Monte Carlo samples of the solution"
    root = covariance_root(solution.parameter_covariance)
    return np.random.default_rng(seed).standard_normal(
        (DRAWS, root.shape[1])
    ) @ root.T, "the covariance of the solution"


def _column(
    names: Sequence[str], made: Compensation, fields: Sequence[Field], draws: np.ndarray, believed: _Believed
) -> Column:
    """Predictions for each tool vector, the motions asked for with the first one, and the largest unintended motion."""
    machine, first = fields[0].machine, fields[0]
    found, unintended = [], 0.0
    for of_tool in fields:
        q, acting = of_tool.places.positions, made.control(machine, **believed.of(of_tool.tool))
        altered = acting.command(q, of_tool.tool, of_tool.places.directions)
        found.append(_prediction(of_tool, moved_by(machine, q, altered, of_tool.tool), draws))
        unintended = max(unintended, float(np.linalg.norm(acting.unintended_motion(q, of_tool.tool), axis=1).max()))
    # without the steps of the least increment, which have no speed
    smooth = {k: v for k, v in believed.of(first.tool).items() if k != "increment"}
    motion = asked_motion(made.control(machine, **smooth), first.places.positions, first.tool)
    return Column(" + ".join(names) or NONE, tuple(found), motion, unintended, made)


def _prediction(field: Field, moved: np.ndarray, draws: np.ndarray) -> Prediction:
    centre = (field.estimate + moved)[None]
    exact = quantities(field.without_rigid_motion(centre), field.tool_axis)[0]
    spread = (draws @ field.gradient.reshape(-1, draws.shape[1]).T).reshape(len(draws), -1, 6)
    spread += field.scatter * np.random.default_rng(len(draws)).standard_normal(spread.shape)
    values = quantities(field.without_rigid_motion(centre + spread), field.tool_axis)
    bounds = coverage_intervals(values)
    result = [values.mean(axis=0), bounds.low, bounds.high, exact]
    if not field.angles_known:
        for numbers in result:
            numbers[len(LENGTHS) :] = np.nan
    return Prediction(*result)
