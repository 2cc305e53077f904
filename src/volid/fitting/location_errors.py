"""Location errors of rotary axes as a table in ISO notation: the axis average line, relative to what was asked for.

`volid.model.axis_lines` has the formula and the sign: minus that of the parameter for an axis that carries the workpiece.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.fitting.prediction.spread import linear_uncertainty
from volid.fitting.results import FunctionValue
from volid.fitting.solution import Solution
from volid.model.axis_lines import MACHINE, full_symbol, line_row
from volid.model.error_functions import reference_of
from volid.model.error_model import LOCATION
from volid.model.geometry import skew
from volid.model.iso230 import DIRECTIONS, ROTARY_AXES, parse
from volid.model.machine import Axis


@dataclass(frozen=True)
class LocationError:
    """One location error of a rotary axis, with its standard uncertainty; lengths [mm], rotations [rad].

    Args:
        name: ISO 230-1 symbol, such as EX0C.
        axis: letter of the axis.
        relative_to: "machine" or the letter of a rotary axis.
        parameter: parameter, tool relative to workpiece: minus `line` for an axis that carries the workpiece. An axis that
            another one carries has the sum of both relative to the machine frame, lever arm included.
        line: what the symbol means: displacement or tilt of the axis average line at the nominal `point` of the axis, machine
            frame directions, other axes at 0.
        u: standard uncertainty of both; NaN where the data do not determine them.
        remark: what else a reader should know.

    Source: ISO 230-1, ISO 230-7; CONVENTIONS 3. `volid.location_errors` has another example.

    >>> LocationError("EX0C", "C", "machine", -0.0196, 0.0196, 0.0002).symbol
    'EX0C'
    """

    name: str
    axis: str
    relative_to: str
    parameter: float
    line: float
    u: float
    remark: str = ""

    @property
    def symbol(self) -> str:
        """The symbol with its datum axis in brackets, EB(0A)C, or as ISO 230-1 has it for the machine frame, EB0C."""
        return full_symbol(self.name, self.relative_to)


def location_errors(solution: Solution, relative_to: str | None = None) -> list[LocationError]:
    """Two positions and two orientations of every rotary axis, relative to the machine frame or to another rotary axis.

    Relative to the machine frame, an axis that another one carries (C' on A', A under C) has the errors of both, at the
    commanded zero of the carrier; with that carrier as `relative_to` it has its own parameters. A remark marks errors along and
    about the line of `relative_to`, because not the line but its zero and the machine frame define them.

    Args:
        solution: A solution for a machine with rotary axes.
        relative_to: letter of a rotary axis; None or "machine": the machine frame.

    Raises:
        InputError: `relative_to` is no rotary axis of the machine, or it stands on the other side, with the linear axes in
            between; ask for the machine frame then.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> first = volid.location_errors(solution)[0]
    >>> first.name, round(1e3 * first.parameter, 1), round(1e3 * first.line, 1)  # [µm]; C carries the workpiece
    ('EX0C', -19.6, 19.6)
    """
    machine = solution.machine
    datum = None if relative_to in (None, MACHINE) else machine.axis(str(relative_to))
    if datum is not None and datum.is_linear:
        raise InputError(
            f"location errors: relative_to = '{relative_to}' is a linear axis; expected a rotary one, or none"
        )
    rows: list[LocationError] = []
    for axis in machine.axes:
        if axis.is_linear or axis is datum:
            continue
        if datum is not None and datum.primed != axis.primed:
            raise InputError(
                f"location errors: {axis.letter} and {datum.letter} stand on two sides of the machine; ask for both relative to "
                "the machine frame"
            )
        rows += _of_axis(solution, axis, datum)
    return rows


def _of_axis(solution: Solution, axis: Axis, datum: Axis | None) -> list[LocationError]:
    sign = -1.0 if axis.primed else 1.0
    along = ROTARY_AXES.index(axis.letter)
    to, result = MACHINE if datum is None else datum.letter, []
    for k in (i for i in range(6) if i % 3 != along):
        name = f"E{DIRECTIONS[k]}0{axis.letter}"
        row = line_row(solution.model, name, to)
        line = float(row @ np.asarray(solution.parameters))
        u = float(linear_uncertainty(row, solution.parameter_covariance))
        if solution.is_not_determined(row[None])[0]:
            line, u = np.nan, np.nan
        result.append(LocationError(name, axis.letter, to, sign * line, line, u, _remark(axis, k, datum)))
    return result


def location_parameter(solution: Solution, name: str) -> FunctionValue:
    """The model's parameter of a constant, tool relative to workpiece, with its standard uncertainty; NaN if not determined.

    This is what a virtual machine takes (`volid.Truth`) and what adds to the error motions of the axis. ISO 230-1 means the axis
    average line by the symbol, `Solution.location`, which for an axis that carries the workpiece has the other sign.

    Args:
        solution: A solution.
        name: Symbol of a constant in the model (KeyError for another one).

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> round(1e3 * volid.location_parameter(solution, "EX0C").value, 1), round(1e3 * solution.location("EX0C").value, 1)
    (-19.6, 19.6)
    """
    i = solution.model.by_name[name, LOCATION].parameters.start
    unit = np.eye(solution.model.n_parameters)[i : i + 1]
    value, u = float(np.asarray(solution.parameters)[i]), float(np.sqrt(np.asarray(solution.covariance)[i, i]))
    if solution.is_not_determined(unit)[0] or name in solution.held_tool_rotation:
        value, u = np.nan, np.nan
    return FunctionValue(name, parse(name).axis, np.nan, 0, value, u)


def _remark(axis: Axis, component: int, datum: Axis | None) -> str:
    if datum is None:
        return ""
    along = abs(axis.frame[:, component % 3] @ np.asarray(datum.unit_vector))
    if along < 1e-9:
        return ""
    how = "about" if component >= 3 else "along"
    return f"{how} the line of {datum.letter}: refers to its zero and the machine frame, not to its line alone"


# ------------------------------------------------------------------------ error motions with mean <-> location errors


class Split(NamedTuple):
    """Error motions of a rotary axis taken apart (CONVENTIONS 4): `location` and `corotating` by symbol, `motions` (m, 6).

    `location`: parameters, tool relative to workpiece, by the symbols of the model, the zero included. `corotating`: the vectors
    fixed in the rotor, radial [mm] and tilt [rad], at position 0, shape (2, 3): errors of the neighbouring axis, of the
    workpiece's or the tool's place.
    """

    location: dict[str, float]
    corotating: np.ndarray
    motions: np.ndarray


def motions_with_mean(solution: Solution, letter: str, positions: np.ndarray) -> list[FunctionValue]:
    """Error motions of a rotary axis with its location errors added: what an instrument on the axis sees, with u.

    The rows are ordered by component, then by position; the approach direction is 0. Values that are not determined are NaN.
    """
    axis, result = solution.machine.axis(letter), []
    if axis.is_linear:
        raise InputError(f"error motions with mean: {letter} is a linear axis; expected a rotary one")
    positions = np.asarray(positions, dtype=float)
    for d in DIRECTIONS:
        name = f"E{d}{letter}"
        rows = solution.motion_rows(name, positions, 0)
        constant = solution.model.by_name.get((f"E{d}0{letter}", "location"))
        if constant is not None:
            rows[:, constant.parameters] += 1.0
        if not rows.any():
            continue
        values, not_determined = rows @ np.asarray(solution.parameters), solution.is_not_determined(rows)
        u = linear_uncertainty(rows, solution.parameter_covariance)
        for x, v, s, unknown in zip(positions, values, u, not_determined, strict=True):
            result.append(
                FunctionValue(
                    name, letter, float(x), 0, np.nan if unknown else float(v), np.nan if unknown else float(s)
                )
            )
    return result


def split_mean(solution: Solution, letter: str, positions: np.ndarray, values: np.ndarray) -> Split:
    """Divide tabulated error motions (m, 6) [mm, rad] into location errors, co-rotating parts and zero-mean motions.

    This is the inverse of `motions_with_mean`, for tables of any origin. `positions` are evenly spaced over the travel, both ends
    included (mean by the trapezoidal rule). The zero is the angular positioning at the reference, interpolated.
    """
    axis = solution.machine.axis(letter)
    x, values = np.asarray(positions, dtype=float), np.asarray(values, dtype=float)
    step = np.diff(x)
    weight = 0.5 * (np.append(step, 0.0) + np.append(0.0, step)) / np.sum(step)
    along = axis.frame.T @ np.asarray(axis.unit_vector)
    across = np.eye(3) - np.outer(along, along)
    turn = -1.0 if axis.primed else 1.0
    angle = np.deg2rad(x)
    rotor = np.cos(angle)[:, None, None] * across + turn * np.sin(angle)[:, None, None] * skew(
        along
    )  # (m, 3, 3): rotor-fixed vector -> stator
    reference = reference_of(solution.machine, solution.datum, letter)
    mean, corotating, motions = np.zeros(6), np.zeros((2, 3)), np.zeros_like(values)
    for half in (0, 1):
        part = values[:, 3 * half : 3 * half + 3]
        design = np.concatenate([np.broadcast_to(across, rotor.shape), rotor], axis=2)
        normal = np.einsum("m,mki,mkj->ij", weight, design, design)
        found = np.linalg.pinv(normal, rcond=1e-10) @ np.einsum("m,mki,mk->i", weight, design, part)
        constant = across @ found[:3]
        about = part @ along
        constant = constant + along * (np.interp(reference, x, about) if half else weight @ about)
        mean[3 * half : 3 * half + 3], corotating[half] = constant, across @ found[3:]
        motions[:, 3 * half : 3 * half + 3] = part - constant - rotor @ corotating[half]
    names = {f"E{d}0{letter}": float(v) for d, v in zip(DIRECTIONS, mean, strict=True)}
    return Split(names, corotating, motions)
