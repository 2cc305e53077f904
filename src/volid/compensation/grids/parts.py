"""Which errors belong to which spatial grid: linear axes, rotary axes of the table, rotary axes of the head (CONVENTIONS 5).

The deviation is, to second order, the sum of what each body's errors cause alone. A part is that sum restricted to some axes:
the columns of the other axes' parameters are set to zero, in the model itself, so that values, uncertainties and the test
whether the data determine them follow from one place.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from volid.exceptions import InputError
from volid.fitting.datum import split_null_space
from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.prediction.determination import known_deviations
from volid.fitting.prediction.deviations import deviation_values, estimable, standard_uncertainties
from volid.fitting.results import Deviations
from volid.fitting.solution import Solution
from volid.model.error_functions import motion_names
from volid.model.error_model import ErrorModel
from volid.model.iso230 import DIRECTIONS, SPINDLE, parse
from volid.model.kinematics import carry
from volid.model.machine import Machine

TABLE, HEAD = "table", "head"
LEFT_OUT = "not in the model"  # a note begins with it


def rotary_letters(machine: Machine, side: str) -> tuple[str, ...]:
    """Rotary axes of the table (primed) or of the head (not primed), workpiece to tool."""
    return tuple(a.letter for a in machine.axes if not a.is_linear and a.primed == (side == TABLE))


def part_letters(machine: Machine, part: str | None) -> frozenset[str]:
    """Axes whose errors a grid holds: of the linear axes (`part` None) or of a side.

    The constants of the tool frame, S, turn with a swivelling head and are then part of its grid; without one they are constant
    like a linear axis's, and part of the linear grid.
    """
    head = rotary_letters(machine, HEAD)
    if part is None:
        linear = frozenset(a.letter for a in machine.linear)
        return linear if head else linear | {SPINDLE}
    return frozenset((*head, SPINDLE)) if part == HEAD else frozenset(rotary_letters(machine, TABLE))


def part_model(model: ErrorModel, letters: frozenset[str]) -> ErrorModel:
    """The model with the errors of the axes `letters` alone: columns of the others' parameters set to zero."""
    keep = np.zeros(model.n_parameters)
    for f in model.functions:
        if parse(f.name).axis in letters:
            keep[f.parameters] = 1.0
    return model if keep.all() else replace(model, parametrisation=model.parametrisation * keep)


def evaluate_part(
    solution: Solution, letters: frozenset[str], positions: np.ndarray, tool: np.ndarray, own: tuple[str, ...]
) -> Deviations:
    """Deviations caused by the errors of the axes `letters` alone, others perfect; `outside` by the axes `own` only.

    Undetermined combinations that only move the workpiece frame, or cancel between table and head, stay at the 0 that the fit
    gave them and count as determined: a matter of datum (`split_null_space`).
    """
    model = solution.model
    part = part_model(model, letters)
    theta, still = np.asarray(solution.parameters), np.zeros_like(positions)
    null, covariance = np.asarray(solution.null_space), solution.parameter_covariance
    outside = solution.outside(positions, own)
    if part is model:
        values, u, found = known_deviations(model, theta, covariance, null, positions, tool, still)
        return Deviations(values, u, found.known, outside, found.rigid)
    # the parts of one machine share one frame, so none is moved into its own
    values = deviation_values(part, theta, positions, tool, still)
    u = standard_uncertainties(part, theta, covariance, positions, tool, still)
    _, lost = split_null_space(model, null)
    known = estimable(part, lost, parameter_units(model), positions, tool, still)
    return Deviations(np.where(known, values, np.nan), np.where(known, u, np.nan), known, outside)


def full_positions(machine: Machine, letters: tuple[str, ...], positions: np.ndarray) -> np.ndarray:
    """Positions (n, k) of `letters` as positions of all axes: other linear axes at their reference, other rotary ones at 0."""
    full = np.tile([a.reference if a.is_linear else 0.0 for a in machine.axes], (len(positions), 1))
    full[:, [machine.index(a) for a in letters]] = positions
    return full


def side_body(machine: Machine, side: str) -> int:
    """Number of the body that bears a side's rotary axes: the stator of the one nearest the bed.

    Raises `InputError` when a linear axis lies between them: then their errors depend on its position too.
    """
    places = [machine.index(a) for a in rotary_letters(machine, side)]
    if places != list(range(places[0], places[-1] + 1)):
        raise InputError(
            f"rotary grid: in '{machine.structure}' a linear axis lies between the rotary axes of the {side}; their errors "
            "then depend on its position too, and no grid over the rotary positions alone holds them"
        )
    return places[-1] + 1 if side == TABLE else places[0]


def lever_points(machine: Machine, side: str, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Nominal functional point in the frame of the body that bears the rotary axes of a side, shape (m, 3) [mm].

    Table: linear positions plus (rotated) tool vector. Head: the rotated tool vector, turned about the axes' own lines. The
    lever arm of a rotary grid is this less the grid's reference point.
    """
    return carry(machine, positions, tool, len(machine.axes), side_body(machine, side))


def rotated_tool(machine: Machine, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Tool vector that the linear grid takes, (m, 3) [mm]: turned by the rotary axes of the head."""
    if rotary_letters(machine, HEAD):
        return lever_points(machine, HEAD, positions, tool)
    return np.broadcast_to(np.asarray(tool, dtype=float), (len(positions), 3))


def tool_reaching(machine: Machine, side: str, positions: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Tool vectors (m, 3) [mm] that nominally put the functional point at `point` of the body that bears the rotary axes."""
    return carry(machine, positions, point, side_body(machine, side), len(machine.axes))


def turning_linear_axes(machine: Machine) -> tuple[str, ...]:
    """Linear axes whose errors turn with a rotary axis: between workpiece and rotary table, or between head and tool."""
    table = [machine.index(a) for a in rotary_letters(machine, TABLE)]
    head = [machine.index(a) for a in rotary_letters(machine, HEAD)]
    return tuple(
        a.letter
        for i, a in enumerate(machine.axes)
        if a.is_linear and ((table and i < max(table)) or (head and i > min(head)))
    )


def left_out(machine: Machine, letters: Iterable[str]) -> list[str]:
    """Error motions of these axes that the machine file switches off, axis by axis."""
    used = motion_names(machine)
    return [f"E{d}{a}" for a in DIRECTIONS if a in letters for d in DIRECTIONS if f"E{d}{a}" not in used]


def part_notes(solution: Solution, letters: frozenset[str]) -> list[str]:
    """What a grid of these axes' errors leaves out, in words: functions switched off, cross effects, axes that turn."""
    machine, notes = solution.machine, []
    missing = left_out(machine, letters)
    if missing:
        notes.append(f"{LEFT_OUT}: {', '.join(missing)}; their effect is not in this grid")
    for f in solution.model.functions:
        others = [machine.letters[s.axis] for s in f.splines]
        foreign = [a for a in others if a not in letters]
        if f.part == "mean" and parse(f.name).axis in letters and foreign:
            at = ", ".join(
                f"{a} = {machine.axis(a).reference if machine.axis(a).is_linear else 0.0:g}" for a in foreign
            )
            notes.append(f"{f.name} depends on {', '.join(foreign)} too; the grid holds it at {at}")
    held, _ = split_null_space(solution.model, np.asarray(solution.null_space))
    names = [
        f.name
        for f in solution.model.functions
        if np.any(np.abs(held[f.parameters]) > 1e-6 * np.abs(held).max(initial=1e-9))
    ]
    names = [n for n in dict.fromkeys(names) if parse(n).axis in letters]
    if names:
        notes.append(
            f"{', '.join(names)}: the same as a place of the workpiece or of the other side, held together at 0"
        )
    turning = [a for a in turning_linear_axes(machine) if a in letters]
    if turning:
        notes.append(f"errors of {', '.join(turning)} turn with a rotary axis; the grid holds for the rotary axes at 0")
    return notes
