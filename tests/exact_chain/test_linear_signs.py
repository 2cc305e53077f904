"""Signs of the errors of linear axes, by hand, as CONVENTIONS 3 and 4 say them."""

import numpy as np
import pytest

from exact_chain import (
    Truth,
)
from exact_chain.checks import ROUNDING, constant, one_deviation


def test_abbe_arm():
    beta, arm = 1e-3, 150.0
    deviation = one_deviation("w b X t", {"X": 400.0}, (0, 0, -arm), Truth({"EBX": constant(beta)}))
    expected = [-arm * np.sin(beta), 0, arm * (1 - np.cos(beta)), 0, beta, 0]  # rotation about +Y takes -Z to -X
    np.testing.assert_allclose(deviation, expected, atol=ROUNDING)


@pytest.mark.parametrize("structure", ["w b X Y Z t", "w Z' Y' X' b t", "w Y' X' b Z t"])
@pytest.mark.parametrize(
    ("name", "secondary", "component", "sign"),
    [
        ("EC0Y", "Y", 0, -1),  # EXY gains -EC0Y (y - y_ref)
        ("EB0Z", "Z", 0, +1),  # EXZ gains +EB0Z (z - z_ref)
        ("EA0Z", "Z", 1, -1),  # EYZ gains -EA0Z (z - z_ref)
        ("EC0X", "X", 1, +1),  # other datums, rotation x direction: C x X = Y
        ("EB0X", "X", 2, -1),  # B x X = -Z
        ("EA0Y", "Y", 2, +1),  # A x Y = Z
        ("EA0X", "X", 0, 0),  # about the axis itself: nothing
    ],
)
def test_squareness_signs(structure, name, secondary, component, sign):
    positions = {"X": 800.0, "Y": 100.0, "Z": -50.0}
    reference = {"X": 500.0, "Y": 300.0, "Z": -250.0}[secondary]
    deviation = one_deviation(structure, positions, (0, 0, -150), Truth(constants={name: 30e-6}))
    expected = np.zeros(6)  # a direction, not a motion: the body does not turn
    expected[component] = sign * 30e-6 * (positions[secondary] - reference)
    np.testing.assert_allclose(deviation, expected, atol=ROUNDING)


def test_lever_arm_contains_q_only_for_a_primed_axis():
    gamma, x, tool_x = 1e-4, 700.0, 80.0
    truth = Truth({"ECX": constant(gamma)})
    for structure, arm in (("w b X t", tool_x), ("w X' b t", x + tool_x)):
        deviation = one_deviation(structure, {"X": x}, (tool_x, 0, 0), truth)
        np.testing.assert_allclose(deviation[:2], [arm * (np.cos(gamma) - 1), arm * np.sin(gamma)], atol=ROUNDING)


@pytest.mark.parametrize(("structure", "arm"), [("w b X t", 80.0 - 100.0), ("w X' b t", 700.0 + 80.0 - 100.0)])
def test_error_point_shortens_the_lever_arm(structure, arm):
    truth = Truth({"ECX": constant(1e-4)})
    deviation = one_deviation(structure, {"X": 700.0}, (80, 0, 0), truth, error_point={"X": (100, 0, 0)})
    np.testing.assert_allclose(deviation[1], arm * np.sin(1e-4), atol=ROUNDING)


def test_axes_nearer_the_tool_lengthen_the_lever_arm():
    positions = {"X": 700.0, "Y": 200.0}
    inner = one_deviation("w b X Y t", positions, (0, 0, 0), Truth({"ECX": constant(1e-4)}))
    outer = one_deviation("w b X Y t", positions, (0, 0, 0), Truth({"ECY": constant(1e-4)}))
    np.testing.assert_allclose(inner[0], -200.0 * np.sin(1e-4), atol=ROUNDING)  # C x Y = -X
    np.testing.assert_allclose(outer, [0, 0, 0, 0, 0, 1e-4], atol=ROUNDING)


@pytest.mark.parametrize("structure", ["w b X t", "w X' b t"])
def test_translation_errors_are_tool_relative_to_workpiece_on_both_sides(structure):
    truth = Truth({"EXX": constant(0.010), "EYX": constant(-0.020), "EZX": constant(0.030)})
    deviation = one_deviation(structure, {"X": 700.0}, (0, 0, -150), truth)
    np.testing.assert_allclose(deviation, [0.010, -0.020, 0.030, 0, 0, 0], atol=ROUNDING)


def test_reversal_is_plus_minus_minus_and_half_on_each_side():
    truth = Truth({"EXX": constant(0.001)}, reversal={"EXX": constant(0.006), "EYY": constant(0.5)})
    readings = [
        one_deviation("w Y' b X t", {"X": 10.0, "Y": 20.0}, (0, 0, 0), truth, direction)[0]
        for direction in ([[0, 1]], [[0, -1]], [[0, 0]], None)  # axis order Y, X
    ]
    np.testing.assert_allclose(readings, [0.004, -0.002, 0.001, 0.001], atol=ROUNDING)


def test_cross_effect_depends_on_the_second_axis():
    truth = Truth({"EZY": lambda y: 1e-5 * y}, cross={"EZY": ("X", lambda y, x: 1e-8 * y * (x - 500))})
    for x in (500.0, 900.0):
        deviation = one_deviation("w X' b Y t", {"X": x, "Y": 200.0}, (0, 0, 0), truth)
        np.testing.assert_allclose(deviation[2], 1e-5 * 200 + 1e-8 * 200 * (x - 500), atol=ROUNDING)


def test_tool_frame_rotation_turns_the_tool_vector_only():
    w, tool = np.array([50e-6, -40e-6, 30e-6]), np.array([80.0, 20.0, -250.0])
    truth = Truth(constants=dict(zip(("EA0S", "EB0S", "EC0S"), w, strict=True)))
    for x in (0.0, 1000.0):
        deviation = one_deviation("w b X t", {"X": x}, tool, truth)
        np.testing.assert_allclose(deviation[:3], np.cross(w, tool), atol=1e-6)  # second order: 0.25 m (70 µrad)^2
        np.testing.assert_allclose(deviation[3:], w, atol=1e-15)


def test_tool_frame_follows_a_tool_side_rotary_axis():
    truth = Truth(constants={"EX0S": 0.010})
    deviation = one_deviation("w b C t", {"C": 90.0}, (0, 0, -150), truth)
    np.testing.assert_allclose(deviation[:3], [0, 0.010, 0], atol=ROUNDING)


@pytest.mark.parametrize("name", ["EXQ", "EX0Y", "EXB"])
def test_names_the_machine_does_not_have_are_refused(name):
    truth = Truth(constants={name: 1.0}) if "0" in name else Truth({name: constant(1.0)})
    with pytest.raises(ValueError, match=name):
        one_deviation("w Y' b X t", {"X": 0.0, "Y": 0.0}, (0, 0, 0), truth)
