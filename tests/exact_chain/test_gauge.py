"""What is taken out of a difference of fields is a rigid motion and a tool rotation, and nothing else."""

import numpy as np
import pytest

from exact_chain import (
    LINEAR,
    ExactMachine,
    default_tools,
    gauge_free,
    machine_grid,
    random_truth,
    rigid,
    spread_positions,
)
from exact_chain.checks import MACHINE, TRAVEL


def field(n=4):
    """Grid points, X, Y, Z order and machine order, and one of three tools for each."""
    q = machine_grid(MACHINE, n)
    xyz = q[:, [MACHINE.column(a) for a in LINEAR]]
    return xyz, q, default_tools()[np.arange(len(q)) % 3]


def test_grid_has_its_ends_at_the_ends_of_travel():
    q = machine_grid(MACHINE, (2, 3, 4))
    assert q.shape == (24, 3)
    np.testing.assert_array_equal(q.min(axis=0), [0, 0, -500])
    np.testing.assert_array_equal(q.max(axis=0), [600, 1000, 0])


def test_gauge_free_removes_rigid_motion_and_tool_rotation_and_nothing_else():
    xyz, q, tool = field()
    rng = np.random.default_rng(0)
    t, w, s = rng.normal(0, 0.1, 3), rng.normal(0, 1e-4, 3), rng.normal(0, 1e-4, 3)
    rigid_motion, tool_motion = t + np.cross(w, xyz + tool), np.cross(s, tool)
    other = random_deviation = MACHINE.deviation(q, tool, random_truth(MACHINE, rng))[:, :3]
    kept, _ = gauge_free(other, xyz, tool)
    assert np.abs(random_deviation).max() > np.abs(kept).max() > 0.003
    np.testing.assert_allclose(gauge_free(rigid_motion + tool_motion, xyz, tool)[0], 0, atol=1e-13)
    np.testing.assert_allclose(gauge_free(other + rigid_motion + tool_motion, xyz, tool)[0], kept, atol=1e-13)
    np.testing.assert_allclose(gauge_free(kept, xyz, tool)[0], kept, atol=1e-14)
    assert np.abs(gauge_free(tool_motion, xyz, tool, tool_rotation=False)[0]).max() > 0.001
    np.testing.assert_allclose(gauge_free(rigid_motion, xyz, tool, tool_rotation=False)[0], 0, atol=1e-13)
    np.testing.assert_allclose(gauge_free(other, q, tool, machine=MACHINE)[0], kept, atol=1e-14)


def test_gauge_free_dimension_is_9_with_several_tools_and_6_with_one():
    xyz, _, tool = field(2)
    for tools, removed in ((tool, 9), (tool[0], 6)):  # one tool vector: its rotation is a translation
        _, P = gauge_free(np.zeros((8, 3)), xyz, tools, covariance=np.eye(24))
        np.testing.assert_allclose(P @ P, P, atol=1e-14)
        assert np.trace(P) == pytest.approx(24 - removed)


def test_gauge_free_covariance_is_that_of_projected_samples():
    xyz, _, tool = field(2)
    rng = np.random.default_rng(1)
    root = rng.normal(size=(24, 24))
    _, projected = gauge_free(np.zeros((8, 3)), xyz, tool, covariance=root @ root.T)
    columns = np.array([gauge_free(column.reshape(8, 3), xyz, tool)[0].ravel() for column in root.T]).T
    np.testing.assert_allclose(projected, columns @ columns.T, atol=1e-11)


def test_gauge_free_of_a_five_axis_machine_removes_exact_small_motions_of_both_frames():
    machine = ExactMachine("w C' X' b Y Z A t", TRAVEL, point={"C": (500, 300, -700)})
    q, tool = spread_positions(machine, 60, np.random.default_rng(0)), np.array([[0, 0, -150.0], [40, 10, -90.0]] * 30)
    small = 1e-7  # rad: second order at 1 m is 1e-11 mm
    workpiece, nest = rigid([small, 2 * small, -small], [1e-4, 0, 2e-4]), rigid([-small, small, small], [0, 1e-4, 1e-4])
    moved = workpiece @ machine.nominal_pose(q) @ nest
    d = np.einsum("mij,mj->mi", moved[:, :3, :3], tool) + moved[:, :3, 3] - machine.functional_point(q, tool)
    d = np.einsum("mji,mj->mi", machine.table_rotation(q), d)
    free = gauge_free(d, q, tool, tool_translation=True, machine=machine)[0]
    np.testing.assert_allclose(free, 0, atol=1e-9)
    assert np.abs(gauge_free(d, q, tool, machine=machine)[0]).max() > 1e-5  # the nest's translation is left
