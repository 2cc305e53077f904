"""On what a compensation is based, and the model's error functions as a linear map of the parameters θ, in plain NumPy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.model.error_functions import reference_of
from volid.model.iso230 import LINEAR_AXES, SPINDLE, ErrorName
from volid.model.jacobian import influence
from volid.model.kinematics import ROWS
from volid.model.linear_maps import error_value_rows
from volid.model.machine import Axis
from volid.model.requests import ask_metres, ask_place, checked_number, checked_vectors

CHUNK = 256  # places at a time


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
    """On what a compensation is based: specific lines, tool vector, elevation, functions.

    Args:
        solution: A solution, as `volid.fit` makes it.
        tool: base tool vector, (3,) [mm].
        at: Position by axis letter where the specific lines cross [mm or °]; by default the origin of the datum, and 0 for rotary
            axes.
        elevation: Elevation of R-RAX and R-ANG above the `point` of a table's axis, along its line [mm].
        functions: ISO 230-1 symbols that L-SPEC and R-SPEC use.

    Raises:
        InputError: the machine does not have an axis, a position lies outside its travel, the model lacks a function, or numbers
            look like another unit than mm (see `volid.accept_unusual`).

    Source: ISO/TR 16907 10.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> base = volid.compensation_base(solution, (0.0, 0.0, -150.0), {"A": 10.0})
    >>> base.at[solution.machine.index("A")].item(), base.tool.tolist()
    (10.0, [0.0, 0.0, -150.0])
    """
    _ask(solution, tool, at or {}, elevation)
    machine, origin = solution.machine, dict(solution.datum.reference)
    full = np.array([origin.get(a.letter, a.reference) if a.is_linear else 0.0 for a in machine.axes])
    for letter, value in (at or {}).items():
        low, high = solution.campaign.machine.axis(letter).travel
        if not low <= value <= high:
            raise InputError(f"`at={letter}={value:g}` lies outside the travel; expected {low:g} … {high:g}")
        full[machine.index(letter)] = value
    wrong = [f for f in functions if f not in solution.model.names]
    if wrong:
        raise InputError(f"`functions={', '.join(wrong)}`: not in the model; it has {', '.join(solution.model.names)}")
    return Base(full, np.asarray(tool, dtype=float), float(elevation), tuple(functions))


def _ask(solution: Solution, tool: Sequence[float], at: Mapping[str, float], elevation: float) -> None:
    """Raises `InputError` for what is no tool vector, position or height, or looks like another unit than mm."""
    machine = solution.campaign.machine
    solution.ask(checked_vectors("tool", tool)[0])
    ask_metres(machine, at, "`at`")
    ask_place(machine, "elevation", (0.0, 0.0, checked_number("elevation", elevation)))


def condensed(solution: Solution, base: Base) -> tuple[Solution, Base]:
    """The same error functions with one parameter each, equal to 1: gives values without uncertainty at a tenth of the cost."""
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

    `turn`: rotation of the machine frame (3, n) about the datum's origin, see `_turn_frame`.
    """
    out = error_value_rows(solution.model, positions.T, directions.T, keep)
    if turn is not None:
        _turn_frame(solution, out, positions, keep, turn)
    return out


def deviation_rows(
    solution: Solution, positions: np.ndarray, directions: np.ndarray, tool: np.ndarray, turn: np.ndarray | None = None
) -> np.ndarray:
    """Deviation of the entire model as linear map of θ at the nominal machine, (m, 6, n); `tool` (m, 3) or (3,) [mm]."""
    tools, parts = np.broadcast_to(tool, (len(positions), 3)), []
    for start in range(0, len(positions), CHUNK):
        rows = slice(start, start + CHUNK)
        errors = model_errors(solution, positions[rows], directions[rows], lambda _: True, turn)
        parts.append(influence(solution.machine, positions[rows], tools[rows]) @ errors)
    return np.concatenate(parts)


def _turn_frame(
    solution: Solution, out: np.ndarray, positions: np.ndarray, keep: Callable[[ErrorName], bool], turn: np.ndarray
) -> None:
    """What a rotation t of the machine frame about the datum's origin r adds to the errors, (m, 6·(n_axes + 1), n).

    Cut at the stator of the table, the chain is T = table · rest, and the same machine is T = (table · G) (G⁻¹ · rest) as well.
    All that carries the tool is turned by -t about r, and the table's stator by +t. The axis lines of the table therefore stay
    where they are, and their location errors, rotations and positions, are those in the new frame. Both parts together do not
    change; without a table, G is a motion of the workpiece frame. A linear axis turns as long as no rotary axis lies between it
    and the bed.
    """
    machine = solution.machine
    rotary = [i for i, a in enumerate(machine.axes) if not a.is_linear]
    table = [i for i in rotary if machine.axes[i].primed][-1:]  # that nearest the bed, if there is one
    head = [i for i in rotary if not machine.axes[i].primed][:1]
    first, last = [*table, -1][0], [*head, len(machine.axes)][0]
    linear = [i for i, a in enumerate(machine.axes) if a.is_linear and first < i < last]
    origin = _turn_linear(solution, out, positions, linear, keep, turn)
    for i in table:
        _turn_location(machine.axes[i], out[:, ROWS * i : ROWS * i + ROWS], origin, keep, turn)
    for i in head:
        _turn_location(machine.axes[i], out[:, ROWS * i : ROWS * i + ROWS], np.zeros(3), keep, -turn)
    if not head and keep(ErrorName("A", SPINDLE, True)):
        out[:, -3:] -= turn


def _turn_linear(
    solution: Solution,
    out: np.ndarray,
    positions: np.ndarray,
    linear: Sequence[int],
    keep: Callable[[ErrorName], bool],
    turn: np.ndarray,
) -> np.ndarray:
    """Subtract from the errors of the `linear` axes the slopes that a rotation gives their lines; their references (3,) [mm]."""
    origin = np.zeros(3)
    for i in linear:
        letter = solution.machine.axes[i].letter
        k = LINEAR_AXES.index(letter)
        origin[k] = reference_of(solution.machine, solution.datum, letter)
        if keep(ErrorName("C", letter, True)):
            slope = np.cross(turn, np.eye(3)[k][:, None], axis=0)
            out[:, ROWS * i : ROWS * i + 3] -= (positions[:, i] - origin[k])[:, None, None] * slope
    return origin


def _turn_location(
    axis: Axis, out: np.ndarray, centre: np.ndarray, keep: Callable[[ErrorName], bool], turn: np.ndarray
) -> None:
    """Add to the errors of a rotary axis, (m, 6, n), what a rotation about `centre` does to its location errors."""
    if keep(ErrorName("C" if axis.letter != "C" else "A", axis.letter, True)):
        arm = np.asarray(axis.error_point) - centre
        out += np.concatenate([axis.frame.T @ np.cross(turn, arm[:, None], axis=0), axis.frame.T @ turn])
