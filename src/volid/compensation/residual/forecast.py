"""What each compensation type leaves over the working volume, with coverage intervals (ISO/TR 16907 11.1).

Over the working volume, for every draw of the parameters,

    remaining = e(draw) + what the altered command moves + repeatability,    the command from tables and grids of the estimate,
    as a control holds them,

so that the result includes the uncertainty of the solution, interpolation, least increment, wrong tool data, poles, all errors
that a type does not correct, and the repeatability of the machine for one approach to each place (see `repeats`). Where the
compensation is made from a simpler solution, e is still that of the full one. The
least-squares rigid motion of the workpiece frame is subtracted from the translations of the functional point, and its rotation
from the orientation. The draws are the Monte Carlo samples of the solution when it has them, else normal draws from its
covariance. Not included: thermal change of the machine, which limits what can be reached; a limit that the campaign's conditions
state is passed on. Repeatability of what no reading came back to is not included either, and named.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from volid.backend.steps import Step
from volid.compensation.base import Base
from volid.compensation.grids.request import Rule
from volid.compensation.motion import Motion, asked_motion
from volid.compensation.package import Compensation, CompensationRequest, compensation_of
from volid.compensation.residual.fields import Field, field_over
from volid.compensation.residual.prediction import (
    MOST_SAMPLES,
    Prediction,
    parameter_draws,
    predictions,
    with_worst_places,
)
from volid.compensation.residual.repeats import Repeats, repeats_of
from volid.compensation.residual.tools import campaign_tools
from volid.compensation.residual.volume import volumetric_summary
from volid.compensation.reversal import NONE as NO_REVERSAL
from volid.compensation.reversal import reversal_text
from volid.compensation.tables.sampling import Sampling
from volid.exceptions import NotDeterminedError
from volid.fitting.prediction.largest import Places, whole_volume
from volid.fitting.solution import Solution
from volid.model.requests import SHORT, checked_vectors

if TYPE_CHECKING:
    from jaxtyping import Float

NONE = "none"


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
        in_datum: Largest deviation before compensation in the stated datum, its rigid motion included, as `volumetric_summary`
            finds it, shape (k,) [mm]; NaN where the data do not determine it.
        notes: What else a user should know.
        repeats: The repeatability that is in the predictions, and the thermal limit that is not.
        repeats_rms: What repeatability alone leaves of the functional point, RMS length over the inside of the volume, shape (k,)
            [mm].

    >>> import numpy as np
    >>> Forecast((), np.zeros((1, 3)), 400, "the covariance of the solution", np.array([0.058])).draws
    400
    """

    columns: tuple[Column, ...]
    tools: Float[np.ndarray, "k 3"]
    draws: int
    source: str
    in_datum: Float[np.ndarray, " k"]
    notes: tuple[str, ...] = field(default_factory=tuple)
    repeats: Repeats = field(default_factory=Repeats)
    repeats_rms: Float[np.ndarray, " k"] | None = None


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
    made_from: Solution | None = None,
    every_tool: bool = False,
    repeatability: Mapping[str, float] | float | None = None,
    most_draws: int = MOST_SAMPLES,
    loaded: Mapping[str, Compensation] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Forecast:
    """Predictions for each list of types, after "none", for each tool vector.

    Args:
        solution: A solution, as `volid.fit` makes it.
        lists: Lists of types of ISO/TR 16907, such as [["L-VOL"], ["L-POS", "L-STR"]].
        base: What the types are based on, as `volid.compensation_base` makes it.
        tools: Tool vectors for which the predictions are made, shape (k, 3) [mm]; the base tool by default.
        places: Where the deviation is evaluated. By default the entire working volume: RMS and 95 % over 1024 places spread
            evenly, the largest values also over corners, edges and faces, and over the places that a search finds.
        tables, grids, points, form, rule, ranges: The same as in `compensate`.
        control: Options of `Control`: increment, clamped, poles, correct_motion.
        tool_error: Tool vector that the control uses minus the true one, (3,) [mm].
        seed: Seed of the random numbers that the draws of the parameters come from.
        made_from: The solution that tables and grids are computed from, and `base`, such as that of `best_rigid`; by default
            `solution` itself. What remains is always that of `solution`.
        every_tool: Whether the predictions are made for the other tool vectors of the campaign too, at most 8 in all, as far as
            the data determine the deviation for them.
        repeatability: Standard deviation of the functional point [mm], or of positions by axis letter [mm or degrees], in
            place of
            what the campaign shows; 0 leaves it out.
        most_draws: At most so many draws of the parameters.
        loaded: Further columns by name: compensations as they are, such as those read from files of a control, on the machine in
            the state in which it was measured.
        progress: Function that is called with messages about the progress.

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
    given = base.tool[None] if tools is None else np.atleast_2d(tools)
    _ask(solution, given, tool_error)
    fields, notes = _fields(solution, places, given, every_tool)
    draws, source = parameter_draws(solution, seed, most_draws)
    repeats = repeats_of(solution, repeatability)
    task = _Task(
        fields,
        draws,
        _Believed(control or {}, np.asarray(tool_error)),
        places is None,
        repeats,
        progress or (lambda _: None),
    )
    source_of_values = solution if made_from is None else made_from
    made = [(names, compensation_of(source_of_values, names, request)) for names in ((), *lists)]
    columns = _columns([*made, *(((name,), given) for name, given in (loaded or {}).items())], task)
    used = np.array([f.tool for f in fields])
    in_datum = np.array([volumetric_summary(solution, tuple(t)).before_max for t in used.tolist()])
    alone = np.array([_rms_of(repeats, f) for f in fields])
    notes = [*notes, *_notes(solution, columns)]
    return Forecast(tuple(columns), used, len(draws), source, in_datum, tuple(notes), repeats, alone)


def _rms_of(repeats: Repeats, field: Field) -> float:
    """RMS length of what repeatability alone does to the functional point, over the places spread evenly [mm]."""
    found = repeats.columns(field.machine, field.places, field.tool)[field.places.even, :3]
    return float(np.sqrt((found**2).sum(axis=(1, 2)).mean()))


def _ask(solution: Solution, tools: np.ndarray, tool_error: Sequence[float]) -> None:
    """Raises `InputError` for tool vectors that look like another unit than mm, or a wrong one far off the true one."""
    solution.ask(tools, name="tools")
    if np.linalg.norm(checked_vectors("tool_error", tool_error)) >= SHORT:  # shorter is what such an error usually is
        solution.ask(tool_error, name="tool_error")


def _fields(
    solution: Solution, places: Places | None, tools: np.ndarray, every_tool: bool
) -> tuple[list[Field], list[str]]:
    """Fields for the tool vectors given, and for others of the campaign that the data determine; what is left out, in words."""
    where = whole_volume(solution.model) if places is None else places
    found, lost = [field_over(solution, where, t) for t in tools], 0
    for tool in campaign_tools(solution, tools[0])[1:] if every_tool else ():
        if any(np.allclose(tool, f.tool) for f in found):
            continue
        try:
            found.append(field_over(solution, where, tool))
        except NotDeterminedError:
            lost += 1
    return found, [f"tool vectors left out, for which the data do not determine the deviation: {lost}"] if lost else []


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


class _Task(NamedTuple):
    """What all columns share: fields, one per tool vector; draws of θ less its estimate (s, n); what a control believes; whether
    to `search` for the largest; the repeatability; where to say how far it is."""

    fields: Sequence[Field]
    draws: np.ndarray
    believed: _Believed
    search: bool
    repeats: Repeats
    say: Callable[[str], None]


def _columns(made: Sequence[tuple[Sequence[str], Compensation]], task: _Task) -> list[Column]:
    """Predictions of all lists for each tool vector, one vector after the other."""
    machine, believed = task.fields[0].machine, task.believed
    found: list[list[Prediction]] = [[] for _ in made]
    unintended = np.zeros(len(made))
    for k, plain in enumerate(task.fields):
        acting = [compensation.control(machine, **believed.of(plain.tool)) for _, compensation in made]
        own = with_worst_places(plain, acting) if task.search else [plain] * len(acting)
        for i, result in enumerate(predictions(plain, list(zip(own, acting, strict=True)), task.draws, task.repeats)):
            found[i].append(result)
            moved = np.linalg.norm(acting[i].unintended_motion(own[i].places.positions, own[i].tool), axis=1)
            unintended[i] = max(unintended[i], float(moved.max()))
            task.say(Step(k * len(made) + i + 1, len(task.fields) * len(made), "predictions"))
    return [
        Column(" + ".join(names) or NONE, tuple(p), _motion(compensation, task), float(u), compensation)
        for (names, compensation), p, u in zip(made, found, unintended, strict=True)
    ]


def _motion(made: Compensation, task: _Task) -> Motion:
    """What a compensation asks of the axes with the first tool vector, without the steps of the least increment, which have no
    speed."""
    first = task.fields[0]
    smooth = {k: v for k, v in task.believed.of(first.tool).items() if k != "increment"}
    return asked_motion(made.control(first.machine, **smooth), first.places.positions, first.tool)
