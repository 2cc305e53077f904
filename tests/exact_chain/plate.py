"""A plate that is placed somewhere and probed: the axis positions at which the functional point really sits on its points."""

import numpy as np
from scipy.spatial.transform import Rotation

from exact_chain.machine import ExactMachine
from exact_chain.truth import Truth

STEPS = 6  # each leaves some 1e-4 of the distance


def turned(x, y) -> np.ndarray:
    """Rotation whose first columns are the directions x and y, (3, 3)."""
    x, y = (np.asarray(v, float) / np.linalg.norm(v) for v in (x, y))
    return np.stack([x, y, np.cross(x, y)], axis=1)


def plate_at(points, middle, x, y, rotation=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Places (m, 3) of points of a plate: their mean at `middle`, then turned by a rotation vector about it and shifted."""
    arms = np.asarray(points, float) - np.mean(points, axis=0)
    turn = Rotation.from_rotvec(rotation).as_matrix() @ turned(x, y)
    return np.asarray(middle, float) + np.asarray(shift, float) + arms @ turn.T


def found_positions(machine: ExactMachine, places, tool, truth: Truth, start=None) -> np.ndarray:
    """Positions (m, n_axes) at which the functional point is at places (m, 3), workpiece frame; rotary axes as in `start`."""
    places = np.asarray(places, float)
    q = np.zeros((len(places), len(machine.axes))) if start is None else np.array(start, float)
    columns = [machine.column(a) for a in "XYZ"]
    for _ in range(STEPS):
        missing = places - machine.functional_point(q, tool, truth)
        at = machine.functional_point(q, tool)
        unit = [machine.functional_point(q + np.eye(len(machine.axes))[c], tool) - at for c in columns]
        q[:, columns] += np.linalg.solve(np.stack(unit, axis=2), missing[:, :, None])[:, :, 0]
    assert np.abs(machine.functional_point(q, tool, truth) - places).max() < 1e-9
    return q
