"""A touch probe that touches spheres, played by the exact chain: axis positions at which the ball really touches."""

from dataclasses import dataclass

import numpy as np

from support.probe_centres import TOOL
from support.rtests import following, index_grid

SPHERES = {"P1": np.array([40.0, -60.0, 90.0]), "P2": np.array([-70.0, 30.0, 60.0])}
SPHERE, BALL = 12.7, 3.0  # mm, radii
NOISE = 0.0015  # mm, of a touch along the normal
_RING = np.deg2rad(np.arange(0, 360, 60))
PATTERN = np.concatenate(  # eight touches in the tool frame: six near the equator, one half-way, the pole on the spindle's side
    [np.column_stack([np.cos(_RING), np.sin(_RING), np.full(6, 0.1)]), [[0.0, 0.7, 0.7], [0.0, 0.0, 1.0]]]
)
PATTERN /= np.linalg.norm(PATTERN, axis=1)[:, None]


@dataclass
class Probed:
    """Touches in their order: axis positions (n, n_axes), number of the group, name of the sphere, direction (n, 3)."""

    q: np.ndarray
    group: np.ndarray
    sphere: np.ndarray
    normal: np.ndarray


def reached(exact, truth, q, points, tool=TOOL):
    """Linear positions moved so that the actual functional point is in `points` (n, 3) with the rotary positions of `q`."""
    q = following(exact, q, tool, points)
    columns = [exact.column(a) for a in "XYZ"]
    for _ in range(4):  # the nominal step leaves a 1e-4 part of the distance
        missing = points - exact.functional_point(q, tool, truth)
        q[:, columns] = following(exact, q, tool, exact.functional_point(q, tool) + missing)[:, columns]
    assert np.abs(exact.functional_point(q, tool, truth) - points).max() < 1e-10
    return q


def touch(exact, truth, rng, counts, spheres=SPHERES, noise=NOISE, pattern=PATTERN, tool=TOOL):
    """Every sphere touched in every pair of rotary positions, the pattern in the tool frame of the pose."""
    poses = index_grid(exact, counts) if any(a in "ABC" for a in exact.axes) else np.zeros((1, len(exact.axes)))
    q, group, names, normals, points = [], [], [], [], []
    for name, place in spheres.items():
        for pose in poses:
            normal = pattern @ exact.nominal_pose(pose[None])[0, :3, :3].T
            q.append(np.tile(pose, (len(pattern), 1)))
            group.append(np.full(len(pattern), len(group)))
            names += [name] * len(pattern)
            normals.append(normal)
            points.append(place + (SPHERE + BALL + noise * rng.standard_normal(len(pattern)))[:, None] * normal)
    q = reached(exact, truth, np.concatenate(q), np.concatenate(points), tool)
    return Probed(q, np.concatenate(group), np.array(names), np.concatenate(normals))
