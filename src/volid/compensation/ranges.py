"""Over which positions tables and grids reach: the measured part of each travel, unless more is asked for.

Where nothing was measured, the values of a spline are extrapolated and have no basis, but a control would apply them. Outside a
table or grid, a control keeps the end value instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from volid.compensation.base import Base
from volid.compensation.grids.grid import AnyGrid
from volid.compensation.tables.error_table import ErrorTable
from volid.compensation.types import LINE, TYPES
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.model.iso230 import LINEAR_AXES, SPINDLE
from volid.model.machine import Axis
from volid.model.requests import ask_metres

CONSENT = "Measure there, or write extrapolated values, flagged outside = 1, with `extrapolate`"
Ranges = Mapping[str, tuple[float, float]]


def chosen_ranges(
    solution: Solution, asked: Ranges | None = None, extrapolate: bool = False
) -> dict[str, tuple[float, float]]:
    """Lowest and highest position of tables and grids by axis letter [mm or °].

    A range in `asked` is taken as it is. Otherwise the range is the part of the travel that was measured, or all of it with
    `extrapolate`. An end of travel that was measured to within 1 % of the travel is kept, as in `Solution.outside`, and full
    turns stay closed. An axis measured at one position has no measured part; it keeps its travel, and `refuse_extrapolation`
    names it. Raises `InputError` for a range that does not rise, that leaves the travel, or, without `extrapolate`, the
    measured part.
    """
    axes = solution.campaign.machine.axes
    found = {a.letter: a.travel if extrapolate else measured_part(solution, a) for a in axes}
    for letter, (low, high) in (asked or {}).items():
        axis = solution.campaign.machine.axis(letter)
        if not axis.travel[0] <= low < high <= axis.travel[1]:
            raise InputError(
                f"`ranges={letter}={low:g}:{high:g}`; expected a range that rises within the travel "
                f"{axis.travel[0]:g} … {axis.travel[1]:g} {axis.unit}"
            )
        ask_metres(solution.campaign.machine, {letter: (low, high)}, "`ranges`")
        found[letter] = (low, high)
        beyond = "" if extrapolate else _beyond(solution, letter, (low, high))
        if beyond:
            raise InputError(f"{beyond}. {CONSENT}")
    return found


def measured_part(solution: Solution, axis: Axis) -> tuple[float, float]:
    """The part of the travel that was measured [mm or °]; see `chosen_ranges`."""
    slack = 0.01 * axis.length
    low, high = (float(v) for v in solution.measured_range()[solution.machine.index(axis.letter)])
    if solution.machine.axis(axis.letter).is_full_turn or high - low <= slack:
        return axis.travel
    start, end = axis.travel
    return (start if low <= start + slack else low, end if high >= end - slack else high)


def cut_notes(solution: Solution, ranges: Ranges, letters: Iterable[str]) -> list[str]:
    """One sentence for each of the axes whose range is not its travel, in the order X … C."""
    notes = []
    for axis in (solution.campaign.machine.axis(a) for a in sorted(set(letters) - {SPINDLE}, key="XYZABC".index)):
        low, high = ranges[axis.letter]
        if (low, high) != axis.travel:
            notes.append(
                f"{axis.letter} {low:g} … {high:g} {axis.unit} of the travel {axis.travel[0]:g} … {axis.travel[1]:g}: measured "
                f"{_measured(solution, axis)}; a control holds the end values outside"
            )
    return notes


def refuse_extrapolation(solution: Solution, made: Iterable[ErrorTable | AnyGrid], base: Base, ranges: Ranges) -> None:
    """Raises `InputError` when a table or grid, or the specific lines that it holds, leave what was measured."""
    for one in made:
        axes: tuple[str, ...] = (one.axis,) if isinstance(one, ErrorTable) else one.axes
        if isinstance(one, ErrorTable):
            name, lines = f"table {one.function}", one.axis in LINEAR_AXES
        else:
            name = f"{one.type} grid of {', '.join(axes)}"
            lines = one.type in TYPES and TYPES[one.type].based_on == LINE
        wrong = [_beyond(solution, a, ranges[a]) for a in axes if a in ranges]
        if lines:
            wrong += [_crossing(solution, a.letter, base) for a in solution.machine.linear]
        reasons = "; ".join(text for text in wrong if text)
        if reasons or one.outside.any():
            raise InputError(f"{name}: {reasons or 'positions lie outside what was measured'}. {CONSENT}")


def _beyond(solution: Solution, letter: str, wanted: tuple[float, float]) -> str:
    axis, (low, high) = solution.campaign.machine.axis(letter), wanted
    if not _outside(solution, letter, np.array([low, high])).any():
        return ""
    index = solution.machine.index(letter)
    start, end = solution.measured_range()[index] if axis.is_full_turn else measured_part(solution, axis)
    text = f"axis {letter} over {low:g} … {high:g} {axis.unit} leaves the measured {_measured(solution, axis)}"
    possible = start < end and not _outside(solution, letter, np.array([start, end])).any()
    return f"{text}; give `ranges={letter}={start:g}:{end:g}`" if possible else text


def _crossing(solution: Solution, letter: str, base: Base) -> str:
    axis = solution.machine.axis(letter)
    at = float(base.at[solution.machine.index(letter)])
    if not _outside(solution, letter, np.array([at])).any():
        return ""
    return (
        f"the specific lines cross at {letter} = {at:g} {axis.unit}, outside the measured {_measured(solution, axis)}; give "
        f"another `at`"
    )


def _outside(solution: Solution, letter: str, column: np.ndarray) -> np.ndarray:
    positions = np.zeros((len(column), len(solution.machine.axes)))
    positions[:, solution.machine.index(letter)] = column
    return solution.outside(positions, (letter,))


def _measured(solution: Solution, axis: Axis) -> str:
    low, high = solution.measured_range()[solution.machine.index(axis.letter)]
    return f"{low:g} {axis.unit} alone" if low == high else f"{low:g} … {high:g} {axis.unit}"
