"""Error functions of a solution as tables of numbers, each with its standard uncertainty; `Solution` describes the functions."""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from volid.backend.consent import ask_memory, in_digits
from volid.backend.even_points import evenly, every_step, number_of_steps
from volid.fitting.prediction.spread import linear_uncertainty
from volid.fitting.results import FunctionValue
from volid.model.axis_lines import MACHINE, LineRow, line_row
from volid.model.error_functions import reference_of
from volid.model.error_model import LOCATION, MEAN, WAVES
from volid.model.iso230 import describe, parse
from volid.model.linear_maps import function_rows
from volid.model.requests import ask_step, checked_count

if TYPE_CHECKING:
    from jaxtyping import Float

    from volid.fitting.solution import Solution


LARGEST = 10**12  # points per travel, far beyond any memory
PER_WAVE, MOST = 12, 4001  # positions per short wave of a stated pitch, and most of a function
POINTS, ACROSS = 21, 21  # positions of a function, and of the second axis of a cross effect
ROW, FLOAT = 1000.0, 24.0  # bytes of a row of the table, and of a parameter at a position while it is computed


def functions(solution: Solution, step: float | None, points: int) -> list[FunctionValue]:
    """All functions: motions tabulated over the travels, and constants."""
    _ask_size(solution, step, points)
    rows = []
    for name in solution.model.names:
        if (name, LOCATION) in solution.model.by_name:
            rows.append(location(solution, name))
        else:
            rows += motion(solution, name, _positions(solution, name, step, points))
    return rows


def _ask_size(solution: Solution, step: float | None, points: int) -> None:
    """Raises `InputError` for a step longer than all travels, or for more positions than are taken without a question."""
    checked_count("points", points, 2, LARGEST)
    reach = {axis.letter: axis.travel for axis in solution.machine.axes}
    if step is None:
        numbers = dict.fromkeys(reach, float(points))
    else:
        ask_step(step, reach)
        numbers = {a: number_of_steps(*ends, step) for a, ends in reach.items()}
    longest = max(numbers, key=lambda a: numbers[a])
    rows = sum(numbers[parse(n).axis] for n in solution.model.names if (n, LOCATION) not in solution.model.by_name)
    asked = f"`points={points}`" if step is None else f"`step={step:g}`"
    what = f"{asked}: {in_digits(numbers[longest])} positions of {longest}, {in_digits(rows)} rows of functions"
    needed = ROW * rows + FLOAT * numbers[longest] * solution.model.n_parameters
    ask_memory(what, needed, "Take a larger step or fewer points")


def _positions(solution: Solution, name: str, step: float | None, points: int) -> np.ndarray:
    """Where a function is tabulated: `step`, else the knots of a polygon (degree 1), else `points` per travel."""
    axis = solution.machine.axis(parse(name).axis)
    spline = solution.model.by_name[name, "mean"].splines[0]
    if step is None:
        return evenly(*axis.travel, spline.segments + 1 if spline.degree == 1 else points)
    return every_step(*axis.travel, step)


def location(solution: Solution, name: str) -> FunctionValue:
    """A constant with its standard uncertainty, location errors as axis average line in the machine frame; NaN when the data do
    not determine it. Raises `KeyError` for a constant that is not in the model."""
    _ = solution.model.by_name[name, LOCATION]
    return constant(solution, LineRow(name, name, MACHINE, line_row(solution.model, name)))


def constant(solution: Solution, line: LineRow) -> FunctionValue:
    """The value of one of the rows of `volid.model.axis_lines.constant_rows`, under its symbol."""
    unknown = bool(solution.is_not_determined(line.row[None])[0]) or line.name in solution.held_tool_rotation
    value = float(line.row @ np.asarray(solution.parameters))
    u = float(linear_uncertainty(line.row, solution.parameter_covariance))
    value, u = (np.nan, np.nan) if unknown else (value, u)
    return FunctionValue(line.symbol, parse(line.name).axis, np.nan, 0, value, u)


def motion(solution: Solution, name: str, positions: Float[np.ndarray, " m"]) -> list[FunctionValue]:
    """An error motion at positions of its axis, shape (m,) [mm or degrees], for each approach direction if it has reversal."""
    axis = parse(name).axis
    result = []
    for direction in _directions(solution, name):
        values, u = _with_u(solution, name, solution.motion_rows(name, positions, direction))
        numbers = zip(positions.tolist(), values.tolist(), u.tolist(), strict=True)
        result += [FunctionValue(name, axis, x, direction, v, s) for x, v, s in numbers]
    return result


def _directions(solution: Solution, name: str) -> tuple[int, ...]:
    return (1, -1) if (name, "reversal") in solution.model.by_name else (0,)


def _with_u(solution: Solution, name: str, rows: Float[np.ndarray, "m n"]) -> tuple[np.ndarray, np.ndarray]:
    """Values and u, each (m,), of rows on θ of an error motion; NaN where the data do not determine them."""
    u = np.hypot(linear_uncertainty(rows, solution.parameter_covariance), solution.scatter_of(name))
    unknown = solution.is_not_determined(rows)
    return tuple(np.where(unknown, np.nan, found) for found in (rows @ np.asarray(solution.parameters), u))  # type: ignore[return-value]


class WholeMotion(NamedTuple):
    """An error motion everywhere on its measured range, so that its range and its largest u can be told.

    `rows`: (m, n) on θ; `directions`: of approach, (m,), +1, -1 or 0; `values`, `u`: (m,) [mm or rad], NaN where not determined.
    """

    rows: np.ndarray
    directions: np.ndarray
    values: np.ndarray
    u: np.ndarray


def whole_motion(solution: Solution, name: str, points: int) -> WholeMotion:
    """An error motion at `points` positions of its axis, both directions of approach: at all knots of a polygon, at
    `PER_WAVE` positions in every short wave, and of a cross effect at `ACROSS` positions of the second axis each."""
    machine = solution.machine
    q = np.array([[reference_of(machine, solution.datum, a.letter)] for a in machine.axes])
    splines = solution.model.by_name[name, MEAN].splines
    for spline in splines[1:]:
        q = np.repeat(q, ACROSS, axis=1)
        q[spline.axis] = evenly(*machine.axes[spline.axis].travel, ACROSS)
    own = _positions(solution, name, None, points)
    if (name, WAVES) in solution.model.by_name:
        own = np.union1d(own, evenly(*machine.axis(parse(name).axis).travel, points_with_waves(solution, name, points)))
    count = q.shape[1]
    q = np.tile(q, len(own))
    q[machine.index(parse(name).axis)] = np.repeat(own, count)
    ways = _directions(solution, name)
    rows = np.concatenate([function_rows(solution.model, name, q, np.full_like(q, way)) for way in ways])
    return WholeMotion(rows, np.repeat(ways, q.shape[1]), *_with_u(solution, name, rows))


def points_with_waves(solution: Solution, name: str, points: int) -> int:
    """At least `points`, and more where short waves of a stated pitch need them: in step with the pitch, all would meet the same
    phase, and show no wave."""
    if (name, WAVES) not in solution.model.by_name:
        return points
    axis = solution.machine.axis(parse(name).axis)
    return min(MOST, max(points, ceil(PER_WAVE * axis.length / axis.pitch)))


def summary_functions(solution: Solution) -> list[tuple[str, str, float, float]]:
    """For every function: symbol, words, range over the travel and largest u [mm or rad]; NaN if not determined."""
    result = []
    for name in solution.model.names:
        if (name, LOCATION) in solution.model.by_name:
            found = location(solution, name)
            values, u = np.array([found.value]), np.array([found.u])
        else:
            _, _, values, u = whole_motion(solution, name, POINTS)
        spread = float(np.ptp(values)) if len(values) > 1 else float(values[0])
        result.append((name, describe(name), spread, float(u.max())))
    return result
