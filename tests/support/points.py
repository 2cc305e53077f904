"""Points that a station reads in its own frame, by the exact chain."""

from __future__ import annotations

import numpy as np
from exact_chain import LINEAR, ExactMachine, apply, random_truth, rigid, spread_positions
from scipy.spatial.transform import Rotation

from support.machines import volid_machine
from volid.campaign import Campaign, ObservationSet, Station

PLACE, TURN = (
    np.array([-900.0, 400.0, 300.0]),
    Rotation.from_euler("zyx", [130.0, 20.0, -50.0], degrees=True).as_matrix(),
)
TOOLS = np.array([(0.0, 0.0, -150.0), (80.0, 0.0, -250.0), (0.0, 90.0, -200.0)])


def points(exact: ExactMachine, n: int = 60, body: str = "workpiece", u: float = 0.0, seed: int = 1, model: str = ""):
    """A campaign of one station with a pose far from the machine's, and its truth."""
    rng = np.random.default_rng(seed)
    truth = random_truth(exact, rng)
    q = spread_positions(exact, n, rng)
    tool = TOOLS[np.arange(len(q)) % 3]
    target = exact.functional_point(q, tool, truth)
    if body == "bed":  # back through the factors of the axes that carry the workpiece
        pose = np.tile(np.eye(4), (len(q), 1, 1))
        for axis in [a for a in exact.axes if exact.primed[a]]:
            pose = pose @ factor(exact, axis, q, truth)
        target = apply(np.linalg.inv(pose), target)
    read = (target - PLACE) @ TURN.T + u * rng.standard_normal(target.shape)
    readings = ObservationSet(
        "tracker", "point", q, np.zeros_like(q), tool, read, np.full_like(read, u or 0.001),
        {"station": np.full(len(q), "T")}, options={},
    )  # fmt: skip
    return Campaign(volid_machine(exact, model), (Station("T", body=body),), (readings,)), truth


def factor(exact: ExactMachine, axis: str, q, truth) -> np.ndarray:
    """One factor of the chain, as matrices."""
    N, E = exact.nominal_factor(axis, q), exact.errors(axis, q, truth)
    D = rigid(E[:, 3:], E[:, :3], exact.error_point[axis])
    return D @ N if axis in LINEAR else N @ D
