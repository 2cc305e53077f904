"""How the frames of all bodies move at a change of datum, and how the unknowns of a campaign answer.

Two datums describe one machine: every factor F_i of its chain becomes (1 - g_i) F_i (1 + g_(i+1)), with one small rigid
motion g of the frame of every body; g_0 is that of the workpiece. The error motion of axis i therefore changes by
f_i = -g_i + Ad(N_i) g_(i+1), N_i its nominal motion, which gives the frames one after another from the workpiece to the tool.
The last of them, behind the tool frame, is the rotation of the tool vectors. It is 0 unless a tool rotation is left out or held
at 0.
Not modelled: products of two errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.model.error_model import ErrorModel
from volid.model.geometry import skew
from volid.model.kinematics import ROWS, error_first, transform
from volid.model.linear_maps import error_value_rows
from volid.model.machine import BED, TOOL, Machine
from volid.observations.base import Nuisance
from volid.observations.response import MOTIONS, TOOL_VECTORS

POINTS = 8  # positions at which the change of an error motion is compared
RIGID = 1e-5  # mm, and rad at 1 m: how far a frame may move otherwise from one position to another
ARM = 1000.0  # mm
NOTICED = 0.1  # of u: what all readings may change by, root mean square, before a transformation counts as not exact


class Frames(NamedTuple):
    """Motions (t, ω) of the frames of all bodies, linear in θ: `of` (n_bodies, 6, n), workpiece first; `tool` (6, n).

    `spread` (n_bodies, points, 6, n): what they differ by from position to position.
    """

    of: np.ndarray
    tool: np.ndarray
    spread: np.ndarray

    def motion(self, machine: Machine, body: str) -> np.ndarray:
        """(t, ω) of a body and the rotation h of the tool vectors, (9, n)."""
        moved = self.tool if body == TOOL_VECTORS else self.of[machine.body_index(body)]
        return np.concatenate([moved, self.tool[3:]])


def frames(old: ErrorModel, new: ErrorModel, mapping: np.ndarray, workpiece: np.ndarray) -> Frames:
    """Motions of all frames when θ' = `mapping` θ (n', n) and the workpiece frame moves by `workpiece` (6, n) θ."""
    machine, g = old.machine, workpiece
    found, spread = [g], [np.zeros((POINTS, *g.shape))]
    for i in range(len(machine.axes) + 1):
        positions, nominal = _positions(machine, i)
        change = _twists(new, i, positions) @ mapping - _twists(old, i, positions)
        back = np.linalg.inv(_adjoint(nominal))
        everywhere = back @ (change + g)
        g = np.mean(everywhere, axis=0)
        found.append(g)
        spread.append(everywhere - g)
    return Frames(np.array(found[:-1]), found[-1], np.array(spread[:-1]))


def _positions(machine: Machine, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions (m, n_axes) all over the travels, and the nominal motion of axis i there, (m, 4, 4)."""
    low, high = np.array([axis.travel for axis in machine.axes]).T
    steps = np.arange(1, len(low) + 1) * np.sqrt(2.0)
    q = low + np.modf(0.5 + np.outer(np.arange(POINTS), steps))[0] * (high - low)
    if i == len(machine.axes):
        return q, np.tile(np.eye(4), (POINTS, 1, 1))
    columns = []
    for x, is_vector in [*((e, True) for e in np.eye(3)), (np.zeros(3), False)]:
        given = tuple(np.full(POINTS, c) for c in x)
        moved = transform(machine, q.T, None, given, start=i + 1, stop=i, is_vector=is_vector)  # type: ignore[arg-type]
        columns.append([np.broadcast_to(c, POINTS) for c in moved])
    pose = np.tile(np.eye(4), (POINTS, 1, 1))
    pose[:, :3] = np.array(columns).transpose(2, 1, 0)
    return q, pose


def _adjoint(pose: np.ndarray) -> np.ndarray:
    """Ad (m, 6, 6) of poses (m, 4, 4): (t, ω) of x -> t + ω × x, seen from the frame that the pose leads to."""
    turn = pose[:, :3, :3]
    result = np.zeros((len(pose), 6, 6))
    result[:, :3, :3] = result[:, 3:, 3:] = turn
    result[:, :3, 3:] = skew(pose[:, :3, 3]) @ turn
    return result


def _twists(model: ErrorModel, i: int, positions: np.ndarray) -> np.ndarray:
    """Error motion of body i as (t, ω) about the origin, as seen from the workpiece side of its axis, (m, 6, n)."""
    machine = model.machine
    rows = error_value_rows(model, positions.T, np.zeros_like(positions.T))
    twist = rows[:, ROWS * i : ROWS * (i + 1)]
    if i == len(machine.axes):
        return twist
    axis = machine.axes[i]
    turned = np.concatenate([axis.frame @ twist[:, :3], axis.frame @ twist[:, 3:]], axis=1)
    turned[:, :3] += np.cross(np.reshape(axis.error_point, (1, 3, 1)), turned[:, 3:], axis=1)  # -ω × p
    if error_first(axis):  # N·D: the nominal motion carries the error
        return _adjoint(_positions(machine, i)[1]) @ turned
    return turned


def unknown_rows(machine: Machine, table: Sequence[Nuisance], values: np.ndarray, moved: Frames) -> np.ndarray:
    """What is subtracted from every unknown at the change of datum, linear in θ, (k, n), at the unknowns' `values` (k,)."""
    number = {entry.key: i for i, entry in enumerate(table)}
    result = np.zeros((len(table), moved.tool.shape[1]))
    for i, entry in enumerate(table):
        row = entry.response.row(lambda key: float(values[number[key]]))
        if row.any():
            result[i] = row @ moved.motion(machine, entry.response.body)
    return result


def check_exact(
    machine: Machine, table: Sequence[Nuisance], moved: Frames, theta: np.ndarray, covariance: np.ndarray
) -> None:
    """Raises `InputError`, with the reason, when predicted readings would change noticeably compared with their u.

    `theta` (n,) and its `covariance`: the change itself, and by how much samples of θ scatter about it.
    """
    size = np.array([1.0, 1.0, 1.0, ARM, ARM, ARM])
    for body in dict.fromkeys(e.response.body for e in table if e.response.body in (BED, TOOL, *machine.letters)):
        if np.abs(size * (moved.spread[machine.body_index(body)] @ theta)).max() > RIGID:
            raise InputError(
                f"datum: there is no exact transformation into it: something stands on the body '{body}', which the new datum "
                "moves otherwise at other positions, because of an error function of two axes. Fit in that datum: [datum] of "
                "the machine file"
            )
    pairs = [(e.response.body, e.response.not_followed) for e in table]
    for body, remainder in dict.fromkeys(pairs):
        if remainder is None:
            continue
        rows = np.array(remainder.rows).reshape(-1, MOTIONS) @ moved.motion(machine, body)
        spread = np.einsum("ij,jk,ik->", rows, covariance, rows)
        if np.linalg.norm(rows @ theta) > NOTICED or spread > NOTICED**2:
            raise InputError(f"datum: there is no exact transformation into it: {remainder.reason}")
