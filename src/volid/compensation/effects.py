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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from volid.compensation.nominal import influence
from volid.compensation.parts import HEAD, rotary_letters
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
from volid.error_model import ROWS
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.iso230 import LINEAR_AXES, SPINDLE, ErrorName, parse
from volid.machine import Axis, Machine
from volid.splines import Basis, design_matrix

PANELS, PANEL_NODES = (
    60,
    3,
)  # Gauss-Legendre quadrature of the slope of a straightness line: uniform over the travel, as the datum's


@dataclass(frozen=True, eq=False)
class Base:
    """On what a compensation is based.

    `at`: positions of all axes where the specific lines cross, (n_axes,), machine axis order. `tool`: base tool vector (3,) [mm].
    `elevation`: of R-RAX and R-ANG above the `point` of a table's axis, along its line [mm]. `functions`: symbols that L-SPEC and
    R-SPEC use. `turn`: rotation of the machine frame as linear map of θ, (3, n), see `alignment`; None: the datum's own.
    """

    at: np.ndarray
    tool: np.ndarray
    elevation: float = 0.0
    functions: tuple[str, ...] = ()
    turn: np.ndarray | None = None


def base_of(
    solution: Solution,
    tool: Sequence[float],
    at: Mapping[str, float] | None = None,
    elevation: float = 0.0,
    functions: Sequence[str] = (),
) -> Base:
    """A base: the lines through `at` (by axis letter; default the datum's origin, rotary axes at 0).

    Raises `InputError` for an axis that the machine does not have, a position outside its travel, a function that the model
    lacks.
    """
    machine, origin = solution.machine, dict(solution.datum.reference)
    full = np.array([origin.get(a.letter, a.reference) if a.is_linear else 0.0 for a in machine.axes])
    for letter, value in (at or {}).items():
        low, high = machine.axis(letter).travel
        if not low <= value <= high:
            raise InputError(f"--at {letter}={value:g} lies outside the travel; expected {low:g} … {high:g}")
        full[machine.index(letter)] = value
    wrong = [f for f in functions if f not in solution.model.names]
    if wrong:
        raise InputError(f"--functions {', '.join(wrong)}: not in the model; it has {', '.join(solution.model.names)}")
    return Base(full, np.asarray(tool, dtype=float), float(elevation), tuple(functions))


def condensed(solution: Solution, base: Base) -> tuple[Solution, Base]:
    """The same error functions with one parameter each, 1: for values without uncertainty, at a tenth of the cost."""
    model, theta = solution.model, np.asarray(solution.parameters)
    p = np.zeros((len(model.parametrisation), len(model.functions)))
    functions = []
    for k, f in enumerate(model.functions):
        p[f.coefficients, k] = model.parametrisation[f.coefficients, f.parameters] @ theta[f.parameters]
        functions.append(replace(f, parameters=slice(k, k + 1)))
    small = replace(model, functions=tuple(functions), parametrisation=p)
    turn = None
    if base.turn is not None:
        turn = np.zeros((3, len(functions)))
        turn[:, 0] = base.turn @ theta
    return replace(solution, model=small, parameters=np.ones(len(functions))), replace(base, turn=turn)


def model_errors(
    solution: Solution,
    positions: np.ndarray,
    directions: np.ndarray,
    keep: Callable[[ErrorName], bool],
    turn: np.ndarray | None = None,
) -> np.ndarray:
    """Error values of the model's functions that `keep` accepts, as linear map of θ, (m, 6·(n_axes + 1), n).

    `turn`: rotation of the machine frame (3, n): directions of linear axes, tool frame and rotary axes change against it.
    """
    model = solution.model
    values: dict[Basis, np.ndarray] = {}
    out = np.zeros((len(positions), ROWS * (len(model.machine.axes) + 1), model.n_parameters))
    for f, term in zip(model.functions, model.layout.terms, strict=True):
        if keep(parse(f.name)):
            if term.basis not in values:
                values[term.basis] = _basis_values(term.basis, positions, directions)
            block = model.parametrisation[f.coefficients, f.parameters]
            out[:, term.row, f.parameters] += term.sign * values[term.basis] @ block
    if turn is not None:
        _turn_frame(solution, out, positions, keep, turn)
    return out


def _turn_frame(
    solution: Solution, out: np.ndarray, positions: np.ndarray, keep: Callable[[ErrorName], bool], turn: np.ndarray
) -> None:
    """What a rotation of the machine frame adds to the constants: minus it for what is tool-ward of the bed, and the opposite for
    a table, whose axis lines stay where they are."""
    machine = solution.machine
    rotary = [i for i, a in enumerate(machine.axes) if not a.is_linear]
    table, head = [i for i in rotary if machine.axes[i].primed], [i for i in rotary if not machine.axes[i].primed]
    for i, axis in enumerate(machine.axes):
        rows = slice(ROWS * i, ROWS * i + 3), slice(ROWS * i + 3, ROWS * i + ROWS)
        if axis.is_linear and keep(ErrorName("C", axis.letter, True)):
            slope = np.cross(turn, np.eye(3)[LINEAR_AXES.index(axis.letter)][:, None], axis=0)
            out[:, rows[0]] -= (positions[:, i] - axis.reference)[:, None, None] * slope
        elif i in (table[-1:] + head[:1]) and keep(ErrorName("C" if axis.letter != "C" else "A", axis.letter, True)):
            out[:, rows[1]] += (1.0 if axis.primed else -1.0) * (axis.frame.T @ turn)
    if not head and keep(ErrorName("A", SPINDLE, True)):
        out[:, -3:] -= turn


def _basis_values(basis: Basis, positions: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """`splines.evaluate` without compilation, (m, size)."""
    values = np.ones((len(positions), 1))
    for spline in basis.factors:
        right = design_matrix(spline, positions[:, spline.axis])
        values = (values[:, :, None] * right[:, None, :]).reshape(len(positions), -1)
    if basis.linear is not None:
        values = values * (positions[:, basis.linear[0]] - basis.linear[1])[:, None]
    if basis.directed >= 0:
        values = values * 0.5 * directions[:, basis.directed][:, None]
    return values


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
    for own, group, whole in ((True, LINEAR_EFFECTS, LINEAR_SPEC), (False, ROTARY_EFFECTS, ROTARY_SPEC)):
        if set(group) <= wanted or whole in wanted:
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
    nodes, weights = np.polynomial.legendre.leggauss(PANEL_NODES)
    edges = np.linspace(*axis.travel, PANELS + 1)
    x = (0.5 * (edges[:-1] + edges[1:])[:, None] + 0.5 * (edges[1] - edges[0]) * nodes).ravel()
    line = _moved(solution, axis, base, x, np.zeros(len(x)), rotations=False)
    arm, weight = x - 0.5 * sum(axis.travel), np.tile(weights, PANELS)
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
