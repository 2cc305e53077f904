"""Where the lines of rotary axes stand, from the poses of the exact chain alone: what ISO 230-1 means by EX0C, EA0C, ...."""

from __future__ import annotations

import numpy as np
from exact_chain import ExactMachine, Truth
from scipy.spatial.transform import Rotation


def axis_line(exact, truth, letter):
    """Physical line of a rotary axis in the machine frame, other axes at 0: direction and a point, from exact poses alone.

    For a table axis the workpiece is watched from the bed, for a head axis the tool: the other side is made perfect, so that its
    frame is the bed's. The motion between two positions is a rotation about the line (Mozzi-Chasles).
    """
    own_side = [a for a in exact.axes if exact.primed[a] == exact.primed[letter]]
    truth = Truth({}, {n: v for n, v in truth.constants.items() if n[3] in own_side})
    positions = {a: 0.0 for a in exact.axes}
    poses = [exact.pose(exact.in_axis_order(positions | {letter: x}), truth)[0] for x in (-60.0, 30.0)]
    if exact.primed[letter]:
        motion = (
            np.linalg.inv(poses[1]) @ poses[0]
        )  # carries workpiece-fixed points, tool frame; positive command turns by -q
    else:
        motion = poses[1] @ np.linalg.inv(poses[0])
    vector = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    vector *= -1.0 if exact.primed[letter] else 1.0
    direction = vector / np.linalg.norm(vector)
    point = np.linalg.lstsq(np.eye(3) - motion[:3, :3], motion[:3, 3], rcond=1e-8)[0]
    return direction, point


def line_error(exact, truth, letter):
    """Displacement of the line at the axis's nominal point, across it, and its rotation across it: six numbers."""
    nominal, at = exact.direction[letter], exact.point[letter]
    direction, point = axis_line(exact, truth, letter)
    foot = point + direction * ((at - point) @ nominal) / (direction @ nominal)
    turn = exact.frame[letter].T  # components of an inclined axis stand in its own frame
    return np.concatenate([turn @ (foot - at), turn @ np.cross(nominal, direction)])


def zero_error(exact: ExactMachine, truth: Truth, letter: str) -> float:
    """Rotation about its line of what an axis carries, machine frame, when all axes are at 0: EC0C and the like [rad].

    What stands between the axis and the bed takes part, what the axis carries does not.
    """
    side = [a for a in exact.axes if exact.primed[a] == exact.primed[letter]]
    nearer = side[side.index(letter) :] if exact.primed[letter] else side[: side.index(letter) + 1]
    truth = Truth({}, {n: v for n, v in truth.constants.items() if n[3] in nearer})
    pose = exact.pose(np.zeros((1, len(exact.axes))), truth)[0]
    carried = np.linalg.inv(pose) if exact.primed[letter] else pose  # the workpiece, or the tool, seen from the bed
    own = exact.frame[letter][:, "ABC".index(letter)]
    return float(own @ Rotation.from_matrix(carried[:3, :3]).as_rotvec())
