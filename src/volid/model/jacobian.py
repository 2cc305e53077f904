"""Geometric Jacobian: partial derivatives of the deviation with respect to the error values of every body.

A component of the deviation, c·x with a direction c, depends on the error motion D of one body through the point y at which it
acts and through the direction c as that body sees it, carried there by the transposed chain. With the rotation vector ω,

    ∂(c·D y)/∂t = c,   ∂(c·D y)/∂ω = y × c + (c (ω·y) + y (c·ω)) / 2 - ω (c·y)

(derivative of `geometry.rotate_small`). One pass along the chain for the point and three for directions, there and back, serve
all bodies, whereas reverse differentiation needs one pass per component. Siciliano and Khatib, Springer Handbook of Robotics,
chapter 2 (Jacobians).

A control computes with the same derivatives at the nominal machine. They stand here in NumPy: `influence`, `axis_directions`, and
what rigid motions of the workpiece and of the tool do to the deviation.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.backend.elementary import computed_once, constant_like
from volid.model.geometry import Vector, add, cross, rotate_small, skew, subtract
from volid.model.iso230 import LINEAR_AXES
from volid.model.kinematics import (
    ROWS,
    chain_of,
    error_first,
    error_motion,
    nominal_factor,
    nominal_point,
    side_rotation,
    turn,
)
from volid.model.machine import Axis, Machine

if TYPE_CHECKING:
    from jaxtyping import Float

REMEMBERED = 300  # positions, whose lever arms take half a megabyte


def deviation_partials(machine: Machine, q: Any, tool: Vector, errors: Any) -> list[list[Any]]:
    """∂(deviation)/∂(error values), 6 rows X, Y, Z, A, B, C of 6·(n_axes + 1) entries: (m,) arrays, or 0.0 where none depends.

    `q` (n_axes, m) [mm, °], `tool`: three (m,) arrays [mm], `errors`: 6·(n_axes + 1) arrays (m,) [mm, rad]. Units [1, mm/rad,
    rad/mm, 1].
    """
    n = len(machine.axes)
    units = [tuple(constant_like(q[0], float(i == k)) for i in range(3)) for k in range(3)]
    seen = _seen_by_bodies(machine, q, errors, units)
    point, vectors = tool, [_to_tool(machine, q, u) for u in units]
    rows: list[list[Any]] = [[0.0] * (ROWS * (n + 1)) for _ in range(6)]
    for i in range(n, -1, -1):
        motion = error_motion(machine, i, errors)
        axis = machine.axes[i] if i < n else None
        if axis is not None and not error_first(axis):
            point, vectors = _moved_by_axis(axis, q[i], point, vectors)
        arm = subtract(point, motion.point)
        for k in range(3):
            _put(rows[k], axis, ROWS * i, seen[i][k])
            _put(rows[k], axis, ROWS * i + 3, _by_rotation(seen[i][k], arm, motion.rotation))
            _put(rows[3 + k], axis, ROWS * i + 3, _of_orientation(k, seen[i], vectors, motion.rotation))
        point = add(add(rotate_small(motion.rotation, arm), motion.point), motion.translation)
        vectors = [rotate_small(motion.rotation, v) for v in vectors]
        if axis is not None and error_first(axis):
            point, vectors = _moved_by_axis(axis, q[i], point, vectors)
        point, vectors = computed_once(point), [computed_once(v) for v in vectors]
    return rows


def _seen_by_bodies(machine: Machine, q: Any, errors: Any, units: list[Any]) -> list[list[Vector]]:
    """The directions `units` of the machine frame as the error motion of every body sees them, from the workpiece on."""
    directions, seen = [_to_workpiece(machine, q, u) for u in units], []
    for i, axis in enumerate(machine.axes):
        before, directions = _directions_at(axis, q[i], error_motion(machine, i, errors).rotation, directions)
        seen.append(before)
    return [*seen, directions]


def _moved_by_axis(axis: Axis, q: Any, point: Vector, vectors: list[Vector]) -> tuple[Vector, list[Vector]]:
    """A point and directions, moved by the nominal motion of an axis."""
    return nominal_factor(axis, q, point, False), [nominal_factor(axis, q, v, True) for v in vectors]


def _of_orientation(k: int, seen: list[Vector], vectors: list[Vector], rotation: Vector) -> Vector:
    """∂(component k of the rotation)/∂ω of one body: half the skew part of what its error rotation does to the unit vectors."""
    one, other = (k + 1) % 3, (k + 2) % 3
    turned = subtract(
        _by_rotation(seen[other], vectors[one], rotation), _by_rotation(seen[one], vectors[other], rotation)
    )
    return 0.5 * turned[0], 0.5 * turned[1], 0.5 * turned[2]


def _to_workpiece(machine: Machine, q: Any, x: Vector) -> Vector:
    """Direction of the machine frame in workpiece coordinates, by the nominal rotary axes of the workpiece side."""
    for i in reversed(range(len(machine.axes))):
        if machine.axes[i].primed and not machine.axes[i].is_linear:
            x = computed_once(nominal_factor(machine.axes[i], q[i], x, True))
    return x


def _to_tool(machine: Machine, q: Any, x: Vector) -> Vector:
    """Direction of the machine frame in the tool frame, by the nominal rotary axes of the tool side."""
    for i, axis in enumerate(machine.axes):
        if not axis.primed and not axis.is_linear:
            x = computed_once(nominal_factor(axis, -q[i], x, True))
    return x


def _directions_at(axis: Axis, q: Any, rotation: Vector, found: list[Vector]) -> tuple[list[Vector], list[Vector]]:
    """Directions as the error motion of an axis sees them, and as the next body towards the tool does."""
    back = (-rotation[0], -rotation[1], -rotation[2])
    if error_first(axis):
        before = [computed_once(nominal_factor(axis, -q, c, True)) for c in found]
        return before, [computed_once(rotate_small(back, c)) for c in before]
    return found, [computed_once(nominal_factor(axis, -q, rotate_small(back, c), True)) for c in found]


def _by_rotation(c: Vector, y: Vector, w: Vector) -> Vector:
    """∂(c·R(ω) y)/∂ω of `rotate_small`."""
    first = cross(y, c)
    along, other = 0.5 * _dot(w, y), 0.5 * _dot(c, w)
    both = _dot(c, y)
    return tuple(first[k] + along * c[k] + other * y[k] - both * w[k] for k in range(3))  # type: ignore[return-value]


def _dot(a: Vector, b: Vector) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _put(row: list[Any], axis: Axis | None, start: int, x: Vector) -> None:
    """Partials by three error values in the axis's own frame, from machine frame components."""
    if axis is None or axis.is_linear or not axis.axis_frame:  # the machine's
        row[start : start + 3] = x
        return
    frame = axis.frame
    for k in range(3):
        row[start + k] = sum(float(frame[i, k]) * x[i] for i in range(3) if frame[i, k])


def influence(
    machine: Machine, positions: Float[np.ndarray, "m axes"], tool: Float[np.ndarray, "*m 3"]
) -> Float[np.ndarray, "m 6 errors"]:
    """`deviation_partials` at the nominal machine: lever arms and frames of all errors, shape (m, 6, 6·(n_axes + 1)).

    `positions` (m, n_axes) [mm, °], `tool` (m, 3) or (3,) [mm]. An error (e, ω) about point p, at the functional point x of its
    frame R, causes R (e + ω × (x - p)) and R ω. Products of two errors are left out: below 0.02 µm per metre at 100 µrad.
    """
    q = np.atleast_2d(np.asarray(positions, dtype=float))
    tools = np.asarray(tool, dtype=float)
    if not 0 < len(q) <= REMEMBERED:
        return _influence(machine, q, tools)
    return _remembered(chain_of(machine), q.shape, q.tobytes(), tools.shape, tools.tobytes())


@lru_cache(maxsize=64)
def _remembered(
    machine: Machine, places: tuple[int, ...], q: bytes, tools: tuple[int, ...], tool: bytes
) -> Float[np.ndarray, "m 6 errors"]:
    """The same, which tables and grids of all types ask for again, to be read only."""
    found = _influence(machine, np.frombuffer(q).reshape(places), np.frombuffer(tool).reshape(tools))
    found.flags.writeable = False
    return found


def _influence(machine: Machine, q: np.ndarray, tools: np.ndarray) -> Float[np.ndarray, "m 6 errors"]:
    q = q.T
    x, y, z = np.broadcast_to(tools, (q.shape[1], 3)).T
    n_errors = ROWS * (len(machine.axes) + 1)
    rows = deviation_partials(machine, q, (x, y, z), [0.0] * n_errors)
    result = np.empty((q.shape[1], 6, n_errors))
    for k, row in enumerate(rows):
        for j, partial in enumerate(row):
            result[:, k, j] = partial
    return result


def axis_directions(machine: Machine, positions: Float[np.ndarray, "m axes"]) -> Float[np.ndarray, "m 3 axes"]:
    """Direction of the motion or rotation of every axis in the machine frame, (m, 3, n_axes), at positions (m, n_axes).

    An axis is carried by the rotary axes between it and the bed: those of the table turn it back.
    """
    directions = np.empty((len(positions), 3, len(machine.axes)))
    primed = [i for i, axis in enumerate(machine.axes) if axis.primed][::-1]
    others = [i for i, axis in enumerate(machine.axes) if not axis.primed]
    for side, sense in ((primed, -1.0), (others, 1.0)):  # outwards from the bed
        turned = np.tile(np.eye(3), (len(positions), 1, 1))
        for i in side:
            axis = machine.axes[i]
            if axis.is_linear:
                directions[:, :, i] = turned[:, :, LINEAR_AXES.index(axis.letter)]
            else:
                directions[:, :, i] = turned @ np.asarray(axis.unit_vector)
                turned = turned @ turn(axis, sense * positions[:, i])
    return directions


def axis_rows(
    machine: Machine, positions: Float[np.ndarray, "m axes"], tool: Float[np.ndarray, "*m 3"]
) -> Float[np.ndarray, "m 6 axes"]:
    """What moving one axis a little does to functional point and orientation, machine frame, (m, 6, n_axes).

    [1 and rad/mm for a linear axis, mm/° and rad/° for a rotary one.] Nominal chain, by central differences over 1 mm or 0.001°,
    exact for linear axes and to 1e-10 of the arm for rotary ones. `positions` (m, n_axes) [mm, °], `tool` (m, 3) or (3,) [mm].
    """
    back = side_rotation(machine, positions, True).transpose(0, 2, 1)
    rows = np.zeros((len(positions), 6, len(machine.axes)))
    directions = axis_directions(machine, positions)
    for i, axis in enumerate(machine.axes):
        half = np.zeros(len(machine.axes))
        half[i] = 0.5 if axis.is_linear else 0.0005
        moved = nominal_point(machine, positions + half, tool) - nominal_point(machine, positions - half, tool)
        rows[:, :3, i] = (back @ moved[:, :, None])[:, :, 0] / (2.0 * half[i])
        if not axis.is_linear:
            rows[:, 3:, i] = np.deg2rad(directions[:, :, i]) * (-1.0 if axis.primed else 1.0)
    return rows


def rigid_motion_rows(
    machine: Machine, positions: Float[np.ndarray, "m axes"], tool: Float[np.ndarray, "*m 3"]
) -> Float[np.ndarray, "m 6 6"]:
    """Deviation caused by a rigid motion (t, ω) of the workpiece frame: R_wᵀ(t + ω × f), and R_wᵀ ω; shape (m, 6, 6).

    f: nominal functional point, workpiece frame; R_w: nominal rotation of the workpiece-side rotary axes (CONVENTIONS 5).
    `positions` (m, n_axes) [mm, °], `tool` (m, 3) or (3,) [mm].
    """
    rows = np.zeros((len(positions), 6, 6))
    rows[:, :3, :3] = np.eye(3)
    rows[:, :, 3:] = _rotation_rows(nominal_point(machine, positions, tool))
    return _turned(side_rotation(machine, positions, True).transpose(0, 2, 1), rows)


def tool_rotation_rows(
    machine: Machine, positions: Float[np.ndarray, "m axes"], tool: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, "m 6 3"]:
    """Deviation caused by a constant tool rotation ω: R_h(ω × tool), and R_h ω; shape (m, 6, 3).

    R_h: nominal rotation of the rotary axes of the head. `positions` (m, n_axes) [mm, °], `tool` (m, 3) [mm].
    """
    return _turned(side_rotation(machine, positions, False), _rotation_rows(tool))


def _rotation_rows(points: np.ndarray) -> np.ndarray:
    """What a rotation ω about the origin does at points x (m, 3): ω × x and ω, shape (m, 6, 3)."""
    rows = np.zeros((len(points), 6, 3))
    rows[:, :3] = skew(-points)
    rows[:, 3:] = np.eye(3)
    return rows


def _turned(rotation: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Both halves of six-component rows (m, 6, k) turned by `rotation` (m, 3, 3)."""
    return np.concatenate([rotation @ rows[:, :3], rotation @ rows[:, 3:]], axis=1)
