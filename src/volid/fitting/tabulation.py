"""Error functions of a solution as tables of numbers, each with its standard uncertainty; `Solution` describes the functions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from volid.backend.consent import ask_memory, in_digits
from volid.backend.even_points import evenly, every_step, number_of_steps
from volid.fitting.prediction.spread import linear_uncertainty
from volid.fitting.results import FunctionValue
from volid.model.axis_lines import MACHINE, LineRow, line_row
from volid.model.error_model import LOCATION
from volid.model.iso230 import describe, parse
from volid.model.requests import ask_step, checked_count

if TYPE_CHECKING:
    from jaxtyping import Float

    from volid.fitting.solution import Solution


LARGEST = 10**12  # points per travel, far beyond any memory
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
    for direction in (1, -1) if (name, "reversal") in solution.model.by_name else (0,):
        rows = solution.motion_rows(name, positions, direction)
        values = rows @ np.asarray(solution.parameters)
        scatter = solution.scatter_of(name)
        u = np.hypot(linear_uncertainty(rows, solution.parameter_covariance), scatter)
        unknown = solution.is_not_determined(rows)
        for x, v, s, not_determined in zip(positions, values, u, unknown, strict=True):
            v, s = (np.nan, np.nan) if not_determined else (float(v), float(s))
            result.append(FunctionValue(name, axis, float(x), direction, v, s))
    return result


def summary_functions(solution: Solution) -> list[tuple[str, str, float, float]]:
    """For every function: symbol, words, range over the travel and largest u [mm or rad]; NaN if not determined."""
    result = []
    for name in solution.model.names:
        values = [r for r in solution.functions() if r.name == name]
        numbers = np.array([v.value for v in values])
        spread = float(np.ptp(numbers)) if len(values) > 1 else float(numbers[0])
        result.append((name, describe(name), spread, float(max(v.u for v in values))))
    return result
