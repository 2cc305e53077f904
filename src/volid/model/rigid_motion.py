"""What a small rigid motion of the workpiece frame, or a constant rotation of the tool, does to the deviation (CONVENTIONS 5)."""

from __future__ import annotations

import numpy as np

from volid.model.kinematics import nominal_point, transform
from volid.model.machine import BED, Machine


def rigid_motion_rows(machine: Machine, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Deviation caused by a rigid motion (t, ω) of the workpiece frame: R_wᵀ(t + ω × f), and R_wᵀ ω; shape (m, 6, 6).

    f: nominal functional point, workpiece frame; R_w: nominal rotation of the workpiece-side rotary axes (CONVENTIONS 5).
    """
    f = nominal_point(machine, positions, tool)
    rows = np.zeros((len(f), 6, 6))
    rows[:, :3, :3] = np.eye(3)
    for k in range(3):
        rows[:, :3, 3 + k] = np.cross(np.eye(3)[k], f)
    rows[:, 3:, 3:] = np.eye(3)
    return _turned(_table_rotation(machine, positions).transpose(0, 2, 1), rows)


def tool_rotation_rows(machine: Machine, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Deviation caused by a constant tool rotation ω: R_h(ω × tool), and R_h ω; shape (m, 6, 3).

    R_h: nominal rotation of the rotary axes of the head.
    """
    rows = np.zeros((len(tool), 6, 3))
    for k in range(3):
        rows[:, :3, k] = np.cross(np.eye(3)[k], tool)
        rows[:, 3 + k, k] = 1.0
    return _turned(_head_rotation(machine, positions), rows)


def nominal_rotation(machine: Machine, positions: np.ndarray, start: int, stop: int) -> np.ndarray:
    """Nominal rotation from the frame of body number `start` to that of `stop`, shape (m, 3, 3); `positions` (m, n_axes)."""
    q, m = np.asarray(positions, dtype=float).T, len(positions)
    columns = []
    for unit in np.eye(3):
        x = tuple(np.full(m, c) for c in unit)
        x = transform(machine, q, None, x, start=start, stop=stop, is_vector=True)  # type: ignore[arg-type,assignment]
        columns.append(np.stack([np.broadcast_to(np.asarray(c), (m,)) for c in x], axis=1))
    return np.stack(columns, axis=2)


def _turned(rotation: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Both halves of six-component rows (m, 6, k) turned by `rotation` (m, 3, 3)."""
    return np.concatenate([rotation @ rows[:, :3], rotation @ rows[:, 3:]], axis=1)


def _table_rotation(machine: Machine, positions: np.ndarray) -> np.ndarray:
    """R_w (m, 3, 3): nominal rotation from machine frame to workpiece frame."""
    return nominal_rotation(machine, positions, machine.body_index(BED), 0)


def _head_rotation(machine: Machine, positions: np.ndarray) -> np.ndarray:
    """R_h (m, 3, 3): nominal rotation from tool frame to machine frame."""
    return nominal_rotation(machine, positions, len(machine.axes), machine.body_index(BED))
