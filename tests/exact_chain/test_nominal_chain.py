"""The nominal chain against closed forms: structural codes, exponentials of twists, arrangements."""

import numpy as np
import pytest
from scipy.linalg import expm

from exact_chain import (
    COMPONENTS,
    LINEAR,
    ExactMachine,
    Truth,
    rigid,
)
from exact_chain.checks import ARRANGEMENTS, ROUNDING, TRAVEL, constant, skew


@pytest.mark.parametrize("structure", ARRANGEMENTS)
def test_perfect_machine_has_the_functional_point_at_q_plus_tool(structure):
    machine = ExactMachine(structure, TRAVEL)
    xyz = np.random.default_rng(1).uniform(-500, 1000, (5, 3))
    q = machine.in_axis_order(dict(zip(LINEAR, xyz.T, strict=True)))
    tool = np.array([80.0, -30.0, -250.0])
    np.testing.assert_allclose(machine.functional_point(q, tool), xyz + tool, atol=ROUNDING)
    np.testing.assert_allclose(machine.deviation(q, tool, Truth()), 0, atol=0)


def test_there_are_24_arrangements():
    assert len(set(ARRANGEMENTS)) == 24


def test_structural_code_with_and_without_brackets_and_blanks():
    for code in ("[w Y' X' b Z (C) t]", "w Y' X' b Z t", "[wY'X'bZ(C)t]"):
        machine = ExactMachine(code, TRAVEL)
        assert machine.axes == ("Y", "X", "Z")
        assert machine.primed == {"Y": True, "X": True, "Z": False}


@pytest.mark.parametrize(
    "code", ["w Y X' b Z t", "w b X' t", "w X' Y' t", "w X' b X t", "b X t", "w b X-Y t", "w b Q t"]
)
def test_wrong_structural_code_is_refused(code):
    with pytest.raises(ValueError, match="structural code"):
        ExactMachine(code, TRAVEL)


def test_reference_is_mid_travel_for_linear_and_zero_for_rotary():
    machine = ExactMachine("w C' X' b Z A t", TRAVEL, reference={"Z": -100.0})
    assert machine.reference == {"C": 0.0, "X": 500.0, "Z": -100.0, "A": 0.0}


def test_rigid_motion_is_the_matrix_exponential_of_its_twist():
    w, centre, e = np.array([0.3, -0.2, 0.5]), np.array([10.0, 20.0, -5.0]), np.array([1.0, 2.0, 3.0])
    twist = np.zeros((4, 4))
    twist[:3, :3] = skew(w)
    twist[:3, 3] = -np.cross(w, centre)  # rotation about the centre leaves it where it is
    expected = expm(twist)
    expected[:3, 3] += e
    np.testing.assert_allclose(rigid(w, e, centre)[0], expected, atol=1e-13)


def test_pose_equals_a_hand_written_product_of_exponentials():
    def slide(axis, q):
        matrix = np.eye(4)
        matrix[LINEAR.index(axis), 3] = q
        return matrix

    def error(six):
        matrix = np.eye(4)
        matrix[:3, :3] = expm(skew(six[3:]))
        matrix[:3, 3] = six[:3]
        return matrix

    rng = np.random.default_rng(2)
    E = {a: np.concatenate([rng.normal(0, 0.01, 3), rng.normal(0, 1e-4, 3)]) for a in "XYZS"}
    truth = Truth({c + a: constant(E[a][k]) for a in LINEAR for k, c in enumerate(COMPONENTS)})
    truth.constants = {f"{c}0S": E["S"][k] for k, c in enumerate(COMPONENTS)}
    expected = (
        error(E["Y"]) @ slide("Y", 250.0) @ error(E["X"]) @ slide("X", 700.0)  # primed: D N
        @ slide("Z", -120.0) @ error(E["Z"])  # tool side: N D
        @ error(E["S"])
    )  # fmt: skip
    machine = ExactMachine("w Y' X' b Z (C) t", TRAVEL)
    np.testing.assert_allclose(machine.pose([250.0, 700.0, -120.0], truth)[0], expected, atol=1e-12)
