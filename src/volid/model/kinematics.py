"""The kinematic model: functional point, pose and deviation of a machine with given error values (CONVENTIONS 2, 3, 5).

Everything here takes *error values* (already evaluated at the positions) and not coefficients: `errors` has shape
(6·(n_axes + 1), m), six rows X, Y, Z [mm], A, B, C [rad] for each axis from the workpiece to the tool, then the six
constants of the tool frame S. Positions `q` have shape (n_axes, m). All functions are pure, differentiable and `vmap`-able.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from volid.backend.elementary import computed_once, constant_like, in_rows
from volid.model.geometry import Vector, add, rotate_about, rotate_small, rotation_vector, skew, subtract
from volid.model.iso230 import LINEAR_AXES
from volid.model.machine import Axis, Machine

if TYPE_CHECKING:
    from jaxtyping import Float

ROWS = 6
RADIAN = np.pi / 180.0


def chain_of(machine: Machine) -> Machine:
    """The machine reduced to its kinematic chain: equal chains share compiled programs whatever their names."""
    return Machine(name="", structure="", axes=machine.axes)


def _components(values: Any, start: int) -> Vector:
    return values[start], values[start + 1], values[start + 2]


def _turned(frame: np.ndarray, x: Vector) -> Vector:
    """Components from an axis's error frame to the machine frame."""
    if np.array_equal(frame, np.eye(3)):
        return x
    turned = [sum(float(frame[i, k]) * x[k] for k in range(3)) for i in range(3)]
    return turned[0], turned[1], turned[2]


class ErrorMotion(NamedTuple):
    """Error motion of one body: translation and rotation vector about `point`, machine frame directions."""

    translation: Vector
    rotation: Vector
    point: Vector


def error_motion(machine: Machine, i: int, errors: Any) -> ErrorMotion:
    """Error motion number `i`: of axis i, or of the tool frame when i = n_axes."""
    translation, rotation = _components(errors, ROWS * i), _components(errors, ROWS * i + 3)
    if i == len(machine.axes):
        return ErrorMotion(translation, rotation, (0.0, 0.0, 0.0))
    axis = machine.axes[i]
    frame = axis.frame
    return ErrorMotion(_turned(frame, translation), _turned(frame, rotation), axis.error_point)


def _error_factor(motion: ErrorMotion, x: Vector, is_vector: bool, inverse: bool = False) -> Vector:
    """D: x -> p + R (x - p) + e, or its inverse; only R for a free vector."""
    rotation = motion.rotation
    if inverse:
        rotation = (-rotation[0], -rotation[1], -rotation[2])
        if not is_vector:
            x = subtract(x, motion.translation)
    if is_vector:
        return rotate_small(rotation, x)
    x = add(rotate_small(rotation, subtract(x, motion.point)), motion.point)
    return x if inverse else add(x, motion.translation)


def nominal_factor(axis: Axis, q: Any, x: Vector, is_vector: bool) -> Vector:
    """N: translation by q along the axis, or rotation by q [degrees] about its line through `point`."""
    if axis.is_linear:
        shift = [0.0, 0.0, 0.0]
        shift[LINEAR_AXES.index(axis.letter)] = q
        return x if is_vector else add(x, (shift[0], shift[1], shift[2]))
    angle = q * RADIAN
    if is_vector:
        return rotate_about(axis.unit_vector, angle, x)
    return add(rotate_about(axis.unit_vector, angle, subtract(x, axis.point)), axis.point)


def error_first(axis: Axis) -> bool:
    """Whether the error motion acts first and the axis then moves its result, N·D, or the reverse, D·N (CONVENTIONS 3)."""
    return axis.is_linear != axis.primed


def _axis_factor(machine: Machine, i: int, q: Any, errors: Any, x: Vector, is_vector: bool, inverse: bool) -> Vector:
    """One factor of the chain or its inverse: N·D or D·N, by side and type of axis (CONVENTIONS 3)."""
    axis = machine.axes[i]
    position = -q[i] if inverse else q[i]
    if errors is None:
        return nominal_factor(axis, position, x, is_vector)
    motion = error_motion(machine, i, errors)
    if error_first(axis) != inverse:
        return nominal_factor(axis, position, _error_factor(motion, x, is_vector, inverse), is_vector)
    return _error_factor(motion, nominal_factor(axis, position, x, is_vector), is_vector, inverse)


def transform(
    machine: Machine, q: Any, errors: Any | None, x: Vector, *, start: int, stop: int = 0, is_vector: bool = False
) -> Vector:
    """Carry point (or free vector) `x` from the frame of body number `start` to that of body number `stop`.

    Bodies count from the workpiece (0) to the tool (n_axes). Towards the workpiece T = factor(stop) ⋯ factor(start - 1),
    towards the tool the inverse factors in turn. With `errors` None the chain is the nominal one.
    """
    if stop <= start:
        for i in range(start - 1, stop - 1, -1):
            x = computed_once(_axis_factor(machine, i, q, errors, x, is_vector, False))
    else:
        for i in range(start, stop):
            x = computed_once(_axis_factor(machine, i, q, errors, x, is_vector, True))
    return x


def from_tool_frame(machine: Machine, errors: Any | None, x: Vector, is_vector: bool = False) -> Vector:
    """Point or vector fixed in the tool frame, carried through the constant motion of the tool frame: D_S · x."""
    return x if errors is None else _error_factor(error_motion(machine, len(machine.axes), errors), x, is_vector)


def to_tool_frame(machine: Machine, errors: Any | None, x: Vector, is_vector: bool = False) -> Vector:
    """Inverse of `from_tool_frame`."""
    return x if errors is None else _error_factor(error_motion(machine, len(machine.axes), errors), x, is_vector, True)


def functional_point(machine: Machine, q: Any, tool: Vector, errors: Any | None = None, stop: int = 0) -> Vector:
    """Functional point in workpiece coordinates (or in the frame of body `stop`) [mm]: T(q) · D_S · tool. CONVENTIONS 2."""
    n = len(machine.axes)
    return transform(machine, q, errors, from_tool_frame(machine, errors, tool), start=n, stop=stop)


def to_machine_frame(machine: Machine, q: Any, x: Vector) -> Vector:
    """R_wᵀ x: turn a workpiece-frame vector back by the nominal rotations of the primed rotary axes (CONVENTIONS 5)."""
    for i, axis in enumerate(machine.axes):
        if axis.primed and not axis.is_linear:
            x = nominal_factor(axis, -q[i], x, True)
    return x


def point_deviation(machine: Machine, q: Any, tool: Vector, errors: Any) -> Vector:
    """Deviation of the functional point, actual - nominal, in the machine frame [mm]. CONVENTIONS 5."""
    workpiece = subtract(functional_point(machine, q, tool, errors), functional_point(machine, q, tool))
    return to_machine_frame(machine, q, workpiece)


def orientation_deviation(machine: Machine, q: Any, errors: Any) -> Vector:
    """Rotation vector of actual · nominal⁻¹ in the machine frame [rad]. CONVENTIONS 5."""
    n = len(machine.axes)
    columns = []
    for k in range(3):
        unit: Vector = tuple(constant_like(q[0], float(k == i)) for i in range(3))  # type: ignore[assignment]
        # R_actual · R_nominalᵀ applied to a unit vector: back through the nominal chain, forward through the actual one.
        x = unit
        for i in range(n):
            x = nominal_factor(machine.axes[i], -q[i], x, True)
        x = from_tool_frame(machine, errors, x, True)
        columns.append(transform(machine, q, errors, x, start=n, is_vector=True))
    return to_machine_frame(machine, q, rotation_vector((columns[0], columns[1], columns[2])))


def deviation(machine: Machine, q: Any, tool: Vector, errors: Any) -> Any:
    """Six components of the deviation, shape (6, m): X, Y, Z [mm] of the functional point, A, B, C [rad]."""
    parts = point_deviation(machine, q, tool, errors) + orientation_deviation(machine, q, errors)
    return in_rows(parts, np.shape(q[0]))


def carry(
    machine: Machine,
    positions: Float[np.ndarray, "m axes"],
    points: Float[np.ndarray, "*m 3"],
    start: int,
    stop: int = 0,
) -> Float[np.ndarray, "m 3"]:
    """Nominal places of points fixed in one body, seen from another: the nominal chain, NumPy in and out.

    `positions` (m, n_axes) [mm, °]; `points` (m, 3) or (3,) [mm] in the frame of body number `start`; the result, (m, 3) [mm],
    in that of body number `stop`. Bodies count from the workpiece (0) to the tool (n_axes), as in `transform`.
    """
    q = np.atleast_2d(np.asarray(positions, dtype=float)).T
    x, y, z = np.broadcast_to(np.asarray(points, dtype=float), (q.shape[1], 3)).T
    return _rows(transform(machine, q, None, (x, y, z), start=start, stop=stop), q.shape[1])


def nominal_rotation(machine: Machine, positions: np.ndarray, start: int, stop: int) -> np.ndarray:
    """Nominal rotation from the frame of body number `start` to that of `stop`, (m, 3, 3); `positions` (m, n_axes) [mm, °]."""
    q = np.atleast_2d(np.asarray(positions, dtype=float)).T
    units = [tuple(np.full(q.shape[1], c) for c in unit) for unit in np.eye(3)]
    turned = [transform(machine, q, None, x, start=start, stop=stop, is_vector=True) for x in units]  # type: ignore[arg-type]
    return np.stack([_rows(x, q.shape[1]) for x in turned], axis=2)


def nominal_point(
    machine: Machine, positions: Float[np.ndarray, "m axes"], tool: Float[np.ndarray, "*m 3"], body: int = 0
) -> Float[np.ndarray, "m 3"]:
    """Nominal functional point in the frame of body number `body`, by default the workpiece's, (m, 3) [mm].

    `positions` (m, n_axes) [mm, °], `tool` (m, 3) or (3,) [mm]. CONVENTIONS 2.

    >>> import volid
    >>> machine = volid.load_machine("models/wYXbZt_vertical.toml")
    >>> nominal_point(machine, np.array([[20.0, 10.0, -30.0]]), np.array([0.0, 0.0, -150.0])).tolist()  # Y, X, Z
    [[10.0, 20.0, -180.0]]
    """
    return carry(machine, positions, tool, len(machine.axes), body)


def turn(axis: Axis, degrees: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 3 3"]:
    """Rotations by some angles (m,) [°] about the direction of a rotary axis, (m, 3, 3)."""
    angle = np.asarray(degrees, dtype=float) * RADIAN
    c, s = (f(angle)[:, None, None] for f in (np.cos, np.sin))
    along = np.asarray(axis.unit_vector)
    return np.asarray(c * np.eye(3) + s * skew(along) + (1.0 - c) * np.outer(along, along))


def side_rotation(machine: Machine, positions: Float[np.ndarray, "m axes"], primed: bool) -> Float[np.ndarray, "m 3 3"]:
    """Nominal rotation of one side's rotary axes at positions (m, n_axes), (m, 3, 3).

    `primed`: R_w of the table, from the machine frame to the workpiece frame; else R_h of the head, from the tool frame to the
    machine frame (CONVENTIONS 5).
    """
    turned = None
    for i, axis in enumerate(machine.axes):
        if axis.primed == primed and not axis.is_linear:
            own = turn(axis, positions[:, i])
            turned = own if turned is None else turned @ own
    return np.tile(np.eye(3), (len(positions), 1, 1)) if turned is None else turned


def _rows(x: Vector, m: int) -> np.ndarray:
    """A vector of components (m,) or numbers as points (m, 3)."""
    return np.stack([np.broadcast_to(np.asarray(c, dtype=float), (m,)) for c in x], axis=1)
