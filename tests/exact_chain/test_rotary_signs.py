"""Signs of the errors of rotary axes, by hand, as CONVENTIONS 3 and 4 say them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from exact_chain import (
    COMPONENTS,
    ExactMachine,
    Truth,
)
from exact_chain.checks import ROUNDING, TRAVEL, constant, one_deviation


@pytest.mark.parametrize(("structure", "letter"), [("w C' b t", "C"), ("w b C t", "C"), ("w A' b t", "A")])
def test_positive_rotation_moves_the_tool_in_the_positive_sense_on_both_sides(structure, letter):
    machine = ExactMachine(structure, TRAVEL)
    start = {"C": [100.0, 0, 0], "A": [0, 100.0, 0]}[letter]
    end = {"C": [0, 100.0, 0], "A": [0, 0, 100.0]}[letter]  # right-handed quarter turn of the tool seen from the work
    np.testing.assert_allclose(machine.functional_point([[90.0]], start)[0], end, atol=ROUNDING)


def test_rotation_is_about_the_line_through_the_point_and_along_the_direction():
    at = ExactMachine("w C' b t", TRAVEL, point={"C": (300, 0, 0)})
    np.testing.assert_allclose(at.functional_point([[90.0]], (400.0, 0, 0))[0], [300, 100, 0], atol=ROUNDING)
    other_way = ExactMachine("w C' b t", TRAVEL, direction={"C": (0, 0, -1)})
    np.testing.assert_allclose(other_way.functional_point([[90.0]], (100.0, 0, 0))[0], [0, -100, 0], atol=ROUNDING)


def test_two_rotary_axes_are_applied_from_workpiece_to_tool():
    machine = ExactMachine("w C' A' b t", TRAVEL)
    expected = Rotation.from_euler("Z", 30, degrees=True) * Rotation.from_euler("X", -70, degrees=True)
    np.testing.assert_allclose(machine.nominal_pose([[30.0, -70.0]])[0, :3, :3], expected.as_matrix(), atol=1e-15)


@pytest.mark.parametrize("structure", ["w b C t", "w C' b t"])
@pytest.mark.parametrize("angle", [0.0, 90.0, 200.0])
def test_rotary_errors_keep_the_stator_directions(structure, angle):
    six = [0.010, -0.020, 0.030, 1e-5, 2e-5, -3e-5]
    truth = Truth({c + "C": constant(v) for c, v in zip(COMPONENTS, six, strict=True)})
    deviation = one_deviation(structure, {"C": angle}, (0, 0, 0), truth)  # machine frame
    np.testing.assert_allclose(deviation, six, atol=ROUNDING)


def test_machine_frame_is_the_workpiece_frame_turned_back_by_the_table():
    machine = ExactMachine("w C' b t", TRAVEL)
    truth = Truth({"EXC": constant(0.010)})
    in_workpiece = machine.functional_point([[90.0]], (0, 0, 0), truth) - machine.functional_point([[90.0]], (0, 0, 0))
    np.testing.assert_allclose(in_workpiece[0], [0, 0.010, 0], atol=ROUNDING)


def test_position_error_of_a_table_puts_its_centre_on_the_other_side():
    machine = ExactMachine("w C' b t", TRAVEL, point={"C": (300, 0, 0)})
    truth = Truth(constants={"EX0C": 0.010})
    q = np.array([[0.0], [90.0], [180.0], [270.0]])
    centre = np.array([300 - 0.010, 0, 0])  # the point of the stator that does not move over the workpiece
    seen = machine.functional_point(q, centre, truth)
    np.testing.assert_allclose(seen, np.tile(seen[0], (4, 1)), atol=ROUNDING)
    assert np.ptp(machine.functional_point(q, (300, 0, 0), truth), axis=0).max() == pytest.approx(0.020)


def test_tilt_error_of_a_table_tilts_its_line_by_minus_it():
    machine = ExactMachine("w C' b t", TRAVEL)
    truth = Truth(constants={"EB0C": 50e-6})
    q = np.array([[0.0], [90.0], [180.0], [270.0]])
    high_on_the_line = np.array([-50e-6 * 400, 0, 400.0])  # B = -50 µrad takes +Z towards -X
    seen = machine.functional_point(q, high_on_the_line, truth)
    np.testing.assert_allclose(seen, np.tile(seen[0], (4, 1)), atol=1e-6)  # second order: 0.4 m (50 µrad)^2 = 1e-6 mm


def test_position_error_of_a_head_puts_its_centre_on_the_same_side():
    machine = ExactMachine("w b C t", TRAVEL)
    q = np.array([[0.0], [120.0]])
    seen = machine.functional_point(q, (0, 0, 0), Truth(constants={"EX0C": 0.010}))
    np.testing.assert_allclose(seen, [[0.010, 0, 0], [0.010, 0, 0]], atol=ROUNDING)


@pytest.mark.parametrize(("structure", "turn"), [("w C' X' b t", -1), ("w X' b C t", +1)])
def test_co_rotating_error_is_a_motion_of_the_neighbouring_frame(structure, turn):
    def cosine(c):
        return 0.010 * np.cos(np.deg2rad(c))

    def sine(c):
        return turn * 0.010 * np.sin(np.deg2rad(c))

    machine = ExactMachine(structure, TRAVEL)
    q = machine.in_axis_order({"X": 100.0, "C": np.arange(0.0, 360.0, 40.0)})
    error = np.linalg.inv(machine.nominal_pose(q)) @ machine.pose(q, Truth({"EXC": cosine, "EYC": sine}))  # tool frame
    if turn < 0:  # the workpiece moves: compare in its frame
        error = machine.pose(q, Truth({"EXC": cosine, "EYC": sine})) @ np.linalg.inv(machine.nominal_pose(q))
    np.testing.assert_allclose(error[:, :3, 3], np.tile([0.010, 0, 0], (len(q), 1)), atol=ROUNDING)
