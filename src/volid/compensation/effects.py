"""What each effect of a compensation type is made of: the error values that a control's kinematic model should hold.

An effect keeps, of every axis, six error values that depend on that axis (CONVENTIONS 3); the deviation they cause follows
from the kinematic model. Types on a *specific line* (L-POS, L-STR, L-SQU) hold what the functional point does along the lines
through `at` with the base tool, lever effects there included; L-ANG holds the angular error motions, less what they do on
these lines. So

    L-POS + L-STR + L-SQU + L-ANG = L-VOL  of a rigid machine, but for the constant deviation at `at`.

R-RAX likewise holds the translations at one point: at an elevation above the table, on its line, or at the tip of the base tool;
R-ANG the tilts, less what they do there. Everything is linear in the parameters θ, so that values and uncertainties come
together.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from volid.compensation.base import Base, model_errors
from volid.compensation.grids.sides import HEAD, rotary_letters
from volid.compensation.types import (
    ANG,
    LINEAR_EFFECTS,
    LINEAR_SPEC,
    POR,
    POS,
    RAX,
    ROTARY_ANG,
    ROTARY_EFFECTS,
    ROTARY_POS,
    ROTARY_SPEC,
    SQU,
    STR,
)
from volid.fitting.solution import Solution
from volid.model.iso230 import LINEAR_AXES, SPINDLE, ErrorName
from volid.model.jacobian import influence
from volid.model.kinematics import ROWS
from volid.model.machine import Axis, Machine
from volid.model.splines import quadrature

# Gauss-Legendre quadrature of the slope of a straightness line, uniform over the travel as the datum's
PANELS, PANEL_NODES = 60, 3


def effect_errors(
    solution: Solution, effects: Sequence[str], base: Base, positions: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    """Error values that the `effects` leave to a control, as linear map of θ, (m, 6·(n_axes + 1), n) [mm, rad].

    `positions`, `directions`: (m, n_axes). All four effects of the linear axes together are the model itself, cross effects
    included (L-VOL); so are all four of the rotary axes (R-VOL).
    """
    linear = {a.letter for a in solution.machine.linear} | ({SPINDLE} if not _has_head(solution.machine) else set())
    wanted = set(effects)
    out = np.zeros((len(positions), ROWS * (len(solution.machine.axes) + 1), solution.model.n_parameters))
    for own, group, selected in ((True, LINEAR_EFFECTS, LINEAR_SPEC), (False, ROTARY_EFFECTS, ROTARY_SPEC)):
        if set(group) <= wanted or selected in wanted:
            names = None if set(group) <= wanted else base.functions

            def keep(error: ErrorName, own: bool = own, names: tuple[str, ...] | None = names) -> bool:
                return (error.axis in linear) == own and (names is None or str(error) in names)

            turn = base.turn if names is None else None
            out = out + model_errors(solution, positions, directions, keep, turn)
            wanted -= set(group)
    return out + line_errors(solution, tuple(e for e in effects if e in wanted), base, positions, directions)


def line_errors(
    solution: Solution, effects: Sequence[str], base: Base, positions: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    """As `effect_errors`, every effect by itself and on its lines: what single-axis tables can hold. Cross effects at `at`."""
    machine = solution.machine
    out = np.zeros((len(positions), ROWS * (len(machine.axes) + 1), solution.model.n_parameters))
    for i, axis in enumerate(machine.axes):
        if set(effects) & set(LINEAR_EFFECTS if axis.is_linear else ROTARY_EFFECTS):
            own, inverse = np.unique(np.stack([positions[:, i], directions[:, i]], axis=1), axis=0, return_inverse=True)
            values = axis_errors(solution, axis, effects, base, own[:, 0], own[:, 1])
            out[:, ROWS * i : ROWS * i + ROWS] = values[np.asarray(inverse).ravel()]
    out[:, -ROWS:] = tool_frame_errors(solution, effects, base)
    return out


def axis_errors(
    solution: Solution, axis: Axis, effects: Sequence[str], base: Base, own: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """Six error values of one axis along its line through `at`, as linear map of θ, (m, 6, n)."""
    function = _linear_axis if axis.is_linear else _rotary_axis
    return function(solution, axis, effects, base, own, direction)


def _on_line(
    solution: Solution, axis: Axis, base: Base, own: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and directions (m, n_axes): the axis moves, all others stand at `at`, their direction unknown."""
    i = solution.machine.index(axis.letter)
    positions, ways = np.tile(base.at, (len(own), 1)), np.zeros((len(own), len(base.at)))
    positions[:, i], ways[:, i] = own, direction
    return positions, ways


def _linear_axis(
    solution: Solution, axis: Axis, effects: Sequence[str], base: Base, own: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    k = LINEAR_AXES.index(axis.letter)
    out = np.zeros((len(own), ROWS, solution.model.n_parameters))
    if {POS, STR, SQU} & set(effects):
        line = _moved(solution, axis, base, own, direction, rotations=False)
        slope = _slope(solution, axis, base) * (own - base.at[solution.machine.index(axis.letter)])[:, None, None]
        across = np.array([j for j in range(3) if j != k])
        if POS in effects:
            out[:, k] += line[:, k]
        if STR in effects:
            out[:, across] += (line - slope)[:, across]
        if SQU in effects:
            out[:, across] += slope[:, across]
    if ANG in effects:
        positions, ways = _on_line(solution, axis, base, own, direction)
        errors = model_errors(solution, positions, ways, lambda e: e.axis == axis.letter and _is_angular(e), None)
        i = ROWS * solution.machine.index(axis.letter)
        out[:, 3:] += errors[:, i + 3 : i + ROWS]
        out[:, :3] -= _moved(solution, axis, base, own, direction, rotations=True)
    return out


def _is_angular(error: ErrorName) -> bool:
    """A rotation as a function of position: squareness is a slope of translations."""
    return error.is_rotation and not error.location


def _moved(
    solution: Solution, axis: Axis, base: Base, own: np.ndarray, direction: np.ndarray, *, rotations: bool
) -> np.ndarray:
    """Deviation of the functional point along the axis's line less that at `at`, (m, 3, n) [mm]; `rotations`: by angular
    errors alone.

    Of all linear axes' errors: where the other axes stand turned by their angular errors, they turn this one's motion.
    """
    positions, ways = _on_line(solution, axis, base, own, direction)
    errors = model_errors(
        solution,
        np.vstack([positions, base.at]),
        np.vstack([ways, np.zeros_like(base.at)]),
        lambda e: e.axis in LINEAR_AXES and (not rotations or _is_angular(e)),
        base.turn,
    )
    rows = [r for i, a in enumerate(solution.machine.axes) if a.is_linear for r in range(ROWS * i, ROWS * i + ROWS)]
    lever = influence(solution.machine, np.vstack([positions, base.at]), base.tool)[:, :3, rows]
    caused = lever @ errors[:, rows]
    return np.asarray(caused[:-1] - caused[-1])


def _slope(solution: Solution, axis: Axis, base: Base) -> np.ndarray:
    """Least-squares slope of the line, uniform over the travel, (3, n): squareness where it is across the axis."""
    x, weight = quadrature(*axis.travel, PANELS, PANEL_NODES)
    line = _moved(solution, axis, base, x, np.zeros(len(x)), rotations=False)
    arm = x - 0.5 * sum(axis.travel)
    return np.asarray(np.tensordot(weight * arm, line, axes=(0, 0)) / (weight @ arm**2))


def _rotary_axis(
    solution: Solution, axis: Axis, effects: Sequence[str], base: Base, own: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    positions, ways = _on_line(solution, axis, base, own, direction)
    i = ROWS * solution.machine.index(axis.letter)
    own_rows = slice(i, i + ROWS)
    motion = model_errors(solution, positions, ways, lambda e: e.axis == axis.letter and not e.location)[:, own_rows]
    constant = model_errors(solution, positions, ways, lambda e: e.axis == axis.letter and e.location, base.turn)[
        :, own_rows
    ]
    along = axis.frame.T @ np.asarray(axis.unit_vector)
    own_turn = np.outer(along, along)
    tilt = (np.eye(3) - own_turn) @ motion[:, 3:]
    shift = np.cross(tilt, _lever(solution.machine, axis, base)[None, :, None], axis=1)
    out = np.zeros_like(motion)
    if ROTARY_POS in effects:
        out[:, 3:] += own_turn @ (motion + constant)[:, 3:]
    if RAX in effects:
        out[:, :3] += motion[:, :3] + shift
    if ROTARY_ANG in effects:
        out[:, 3:] += tilt
        out[:, :3] -= shift
    if POR in effects:
        out += constant
        out[:, 3:] -= own_turn @ constant[:, 3:]
    return out


def _lever(machine: Machine, axis: Axis, base: Base) -> np.ndarray:
    """From the axis's error point to where R-RAX holds, in the frame of its components (3,) [mm]."""
    if axis.primed:
        place = np.asarray(axis.point) + base.elevation * np.asarray(axis.unit_vector)
    else:
        place = base.tool
    return np.asarray(axis.frame.T @ (place - np.asarray(axis.error_point)))


def tool_frame_errors(solution: Solution, effects: Sequence[str], base: Base) -> np.ndarray:
    """Constants of the tool frame, (6, n): of L-ANG, zero for the base tool; with a head all of them belong to R-POR."""
    n = solution.model.n_parameters
    zero = np.zeros((1, len(base.at)))
    errors = model_errors(solution, zero, zero, lambda e: e.axis == SPINDLE, base.turn)[0, -ROWS:]
    if _has_head(solution.machine):
        return errors if POR in effects else np.zeros((ROWS, n))
    if ANG not in effects:
        return np.zeros((ROWS, n))
    errors[:3] = -np.cross(errors[3:], base.tool[:, None], axis=0)
    return errors


def _has_head(machine: Machine) -> bool:
    return bool(rotary_letters(machine, HEAD))
