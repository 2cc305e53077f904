"""The nominal chain as a control computes it: points, directions of axes, and what small errors do to the functional point.

Plain NumPy: a control's arithmetic needs no derivatives by JAX, and a table of twenty points should not wait for a compiler.
Positions are (m, n_axes), machine axis order [mm, °]. CONVENTIONS 2, 3, 5.
"""

from __future__ import annotations

import numpy as np

from volid.model.error_model import ROWS
from volid.model.iso230 import LINEAR_AXES
from volid.model.machine import Axis, Machine


def _turn(axis: Axis, degrees: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation  # slow to import, and few need it

    return Rotation.from_rotvec(np.deg2rad(degrees)[:, None] * np.asarray(axis.unit_vector)).as_matrix()


def _direction(axis: Axis) -> np.ndarray:
    return np.eye(3)[LINEAR_AXES.index(axis.letter)] if axis.is_linear else np.asarray(axis.unit_vector)


def _factor(axis: Axis, q: np.ndarray, x: np.ndarray) -> np.ndarray:
    """N · x: translation along, or rotation about, the nominal axis, (m, 3)."""
    if axis.is_linear:
        return np.asarray(x + q[:, None] * _direction(axis))
    point = np.asarray(axis.point)
    return np.asarray(np.einsum("mij,mj->mi", _turn(axis, q), x - point) + point)


def carry(machine: Machine, positions: np.ndarray, x: np.ndarray, start: int, stop: int = 0) -> np.ndarray:
    """Points (m, 3) or (3,) from the frame of body number `start` to that of `stop`; bodies count from the workpiece. [mm]"""
    q = np.atleast_2d(positions)
    x = np.broadcast_to(np.asarray(x, dtype=float), (len(q), 3))
    if stop <= start:
        for i in range(start - 1, stop - 1, -1):
            x = _factor(machine.axes[i], q[:, i], x)
    else:
        for i in range(start, stop):
            x = _factor(machine.axes[i], -q[:, i], x)
    return x


def nominal_point(machine: Machine, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Nominal functional point in the workpiece frame, (m, 3) [mm]."""
    return carry(machine, positions, tool, len(machine.axes))


def side_rotation(machine: Machine, positions: np.ndarray, primed: bool) -> np.ndarray:
    """Nominal rotation of the table, R_w (to the workpiece frame), or of the head (to the machine frame), (m, 3, 3)."""
    turned = np.tile(np.eye(3), (len(positions), 1, 1))
    for i, axis in enumerate(machine.axes):
        if axis.primed == primed and not axis.is_linear:
            turned = turned @ _turn(axis, positions[:, i])
    return turned


def axis_frames(machine: Machine, positions: np.ndarray) -> list[np.ndarray]:
    """Rotation (m, 3, 3) to the machine frame from where each axis's errors act: carriage, table or stator (CONVENTIONS 3)."""
    frames: list[np.ndarray] = [np.zeros(0)] * len(machine.axes)
    primed = [i for i, a in enumerate(machine.axes) if a.primed][::-1]
    others = [i for i, a in enumerate(machine.axes) if not a.primed]
    for side, sense in ((primed, -1.0), (others, 1.0)):  # outwards from the bed: stators stand nearer to it
        turned = np.tile(np.eye(3), (len(positions), 1, 1))
        for i in side:
            frames[i] = turned
            if not machine.axes[i].is_linear:
                turned = turned @ _turn(machine.axes[i], sense * positions[:, i])
    return frames


def axis_directions(machine: Machine, positions: np.ndarray) -> np.ndarray:
    """Machine-frame direction of every axis: of its motion or of its rotation, (m, 3, n_axes)."""
    frames = axis_frames(machine, positions)
    return np.stack([f @ _direction(a) for f, a in zip(frames, machine.axes, strict=True)], axis=2)


def influence(machine: Machine, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """∂(deviation)/∂(error values) at the nominal machine, (m, 6, 6·(n_axes + 1)): lever arms and frames of all errors.

    An error (e, ω) about point p, at the functional point x of its frame R: R (e + ω × (x - p)), and R ω. Products of two
    errors are left out: below 0.02 µm per metre at 100 µrad.
    """
    q = np.atleast_2d(positions)
    n = len(machine.axes)
    out = np.zeros((len(q), 6, ROWS * (n + 1)))
    x = np.broadcast_to(np.asarray(tool, dtype=float), (len(q), 3))
    _place(out, n, side_rotation(machine, q, False), np.eye(3), x)
    frames = axis_frames(machine, q)
    for i in range(n - 1, -1, -1):
        axis = machine.axes[i]
        before = x
        x = _factor(axis, q[:, i], x)
        # N·D (lever arm in the carriage or rotor side): tool-side linear and primed rotary axes; else D·N
        own = before if axis.is_linear != axis.primed else x
        _place(out, i, frames[i], axis.frame, own - np.asarray(axis.error_point))
    return out


def _place(out: np.ndarray, i: int, to_machine: np.ndarray, frame: np.ndarray, lever: np.ndarray) -> None:
    columns = slice(ROWS * i, ROWS * i + 3), slice(ROWS * i + 3, ROWS * i + 6)
    turned = to_machine @ frame
    out[:, :3, columns[0]] = turned
    out[:, 3:, columns[1]] = turned
    cross = np.cross(frame.T[None, :, :], lever[:, None, :])  # row k: (k-th direction) × lever
    out[:, :3, columns[1]] = to_machine @ cross.transpose(0, 2, 1)
