"""The independent virtual machine against closed forms and every sign sentence of CONVENTIONS 3 and 4."""

import csv
import itertools
import tomllib

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from exact_chain import (
    COMPONENTS,
    LINEAR,
    ROTARY,
    ExactMachine,
    Truth,
    approach_directions,
    default_stations,
    default_tools,
    gauge_free,
    machine_grid,
    machine_toml,
    random_truth,
    rigid,
    spread_positions,
    tracker_campaign,
    write_campaign,
)

TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0), "C": (0.0, 360.0), "A": (-120.0, 30.0)}
ARRANGEMENTS = [
    " ".join(["w", *[a + "'" for a in order[:split]], "b", *order[split:], "t"])
    for order in itertools.permutations(LINEAR)
    for split in range(4)
]
ROUNDING = 1e-12  # mm at coordinates up to 1 m: a few units in the last place, through eight matrix products


def constant(value):
    """The function f(q) = value."""
    return lambda q: np.full(np.shape(q), value)


def skew(w):
    """Matrix [w x]."""
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def one_deviation(structure, positions, tool, truth, direction=None, **machine_options):
    """Deviation (6,) of a machine with the test's travels at one position."""
    machine = ExactMachine(structure, TRAVEL, **machine_options)
    return machine.deviation(machine.in_axis_order(positions), tool, truth, direction)[0]


# ------------------------------------------------------------------------------------------------- nominal chain


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


# ----------------------------------------------------------------------------------------- signs of linear errors


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


# ------------------------------------------------------------------------------------------------- rotary axes


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


# ------------------------------------------------------------------------------------------------- random truth


@pytest.mark.parametrize("seed", range(5))
def test_random_truth_of_linear_axes_is_in_the_datum(seed):
    machine = ExactMachine("w Y' X' b Z t", TRAVEL, reference={"Z": -100.0})
    truth = random_truth(machine, np.random.default_rng(seed), reversal=True)
    assert set(truth.functions) == {c + a for c in COMPONENTS for a in LINEAR}
    assert set(truth.constants) == {"EC0Y", "EB0Z", "EA0Z", "EA0S", "EB0S", "EC0S"}
    assert set(truth.reversal) == {"EXX", "EYY", "EZZ"}
    for name, f in truth.functions.items():
        axis = name[2]
        low, high = machine.travel[axis]
        q = low + (high - low) * (np.arange(20000) + 0.5) / 20000  # midpoints: the mean is the integral to 1 / 20000^2
        assert abs(f(machine.reference[axis])) < 1e-15
        slope, largest = np.polyfit(q, f(q), 1)[0], np.abs(f(q)).max()
        if name[1] in ROTARY:
            assert 9.9e-6 < largest < 30.1e-6
        elif name[1] == axis:
            assert 1e-7 < abs(slope) < 31e-6
        else:
            assert abs(slope) * (high - low) < 1e-9  # mm
            assert 2.9e-3 < largest < 15.1e-3


def test_random_truth_amplitude_and_waviness():
    machine = ExactMachine("w b X t", {"X": (0.0, 1000.0)})
    plain, double, wavy = (
        random_truth(machine, np.random.default_rng(3), **options)
        for options in ({}, {"scale": 2.0}, {"waviness": 3.0})
    )
    q = np.linspace(0, 1000, 301)
    for name, f in plain.functions.items():
        np.testing.assert_allclose(double.functions[name](q), 2 * f(q), rtol=1e-12, atol=1e-18)
        assert f.frequency.max() * 1000 <= 1 / 0.45
        np.testing.assert_allclose(wavy.functions[name].frequency, 3 * f.frequency)
    assert double.constants["EA0S"] == pytest.approx(2 * plain.constants["EA0S"])


def test_random_truth_of_another_datum():
    machine = ExactMachine("w Y' X' b Z t", TRAVEL)
    truth = random_truth(machine, np.random.default_rng(0), primary="Z", secondary="X", tool_rotation=False)
    assert set(truth.constants) == {"EB0X", "EA0Y", "EC0Y"}
    assert all(20e-6 <= abs(v) <= 40e-6 for v in truth.constants.values())


def test_random_cross_effect_is_zero_at_both_references():
    machine = ExactMachine("w Y' X' b Z t", TRAVEL)
    truth = random_truth(machine, np.random.default_rng(0), cross={"EAZ": "X"})
    other, f = truth.cross["EAZ"]
    z, x = np.linspace(-500, 0, 11), np.linspace(0, 1000, 11)
    assert other == "X"
    np.testing.assert_allclose(f(np.full(11, -250.0), x), 0, atol=1e-18)
    np.testing.assert_allclose(f(z, np.full(11, 500.0)), 0, atol=1e-18)
    assert np.abs(f(z[:, None], x[None, :])).max() > 1e-6


@pytest.mark.parametrize(("structure", "turn"), [("w C' A' b t", -1), ("w b C A t", +1)])
def test_random_truth_of_rotary_axes_is_in_the_datum(structure, turn):
    machine = ExactMachine(structure, TRAVEL, direction={"C": (0, 0, -1)})
    truth = random_truth(machine, np.random.default_rng(4))
    assert {n for n in truth.constants if n[3] in "AC"} == {
        "EX0C", "EY0C", "EA0C", "EB0C", "EY0A", "EZ0A", "EB0A", "EC0A",
    }  # fmt: skip
    for axis, way, (first, second) in (("C", -1, "XY"), ("A", 1, "YZ")):
        q = np.linspace(*machine.travel[axis], 20001)
        angle = way * turn * np.deg2rad(q)
        for pair in (first + second, "".join(ROTARY[LINEAR.index(a)] for a in first + second)):
            f, g = (truth.functions[f"E{letter}{axis}"](q) for letter in pair)
            size = np.abs(np.concatenate([f, g])).max()
            low, high = (0.002, 0.008) if pair[0] in LINEAR else (10e-6, 30e-6)
            assert 0.99 * low < size < 1.01 * high
            co_rotating = [f * np.cos(angle) + g * np.sin(angle), -f * np.sin(angle) + g * np.cos(angle)]
            for moment in (f, g, *co_rotating):
                assert abs(np.trapezoid(moment, q)) / np.ptp(q) < 1e-4 * size
            counter = np.hypot(
                np.mean(f * np.cos(angle) - g * np.sin(angle)), np.mean(f * np.sin(angle) + g * np.cos(angle))
            )
            assert counter > 1e-2 * size  # these stay
        assert abs(truth.functions["E" + axis + axis](0.0)) < 1e-15


# -------------------------------------------------------------------------------------------- virtual campaign


MACHINE = ExactMachine("w Y' X' b Z t", TRAVEL)


def test_stations_are_outside_the_volume_and_tools_not_on_a_line():
    tools = default_tools()
    low, high = np.array([0, 0, -500]) + tools.min(axis=0), np.array([1000, 600, 0]) + tools.max(axis=0)
    stations = np.array(list(default_stations(MACHINE).values()))
    assert stations.shape == (6, 3)
    assert np.all(np.any((stations < low) | (stations > high), axis=1))
    assert np.linalg.svd(stations - stations.mean(axis=0))[1][-1] > 300  # mm: spread in height too
    assert np.linalg.norm(np.cross(tools[1] - tools[0], tools[2] - tools[0])) > 5000


def test_positions_reach_the_ends_of_travel_and_fill_the_volume():
    q = spread_positions(MACHINE, 100, np.random.default_rng(0))
    low, high = np.array([MACHINE.travel[a] for a in MACHINE.axes]).T
    x = (q - low) / (high - low)
    assert x.shape == (100, 3) and x.min() == 0 and x.max() == 1
    assert np.sum(np.all((x == 0) | (x == 1), axis=1)) == 8
    octants = (x > 0.5) @ [1, 2, 4]
    assert np.bincount(octants, minlength=8).min() >= 6
    snapped = spread_positions(MACHINE, 100, np.random.default_rng(0), n_grid=(5, 6, 11))
    assert [len(np.unique(column)) for column in snapped.T] == [5, 6, 11]


def test_approach_direction_is_the_last_move_of_the_repeated_program():
    q = np.array([[5.0, 1.0], [5.0, 1.0], [7.0, 1.0], [6.0, 1.0]])
    np.testing.assert_array_equal(approach_directions(q), [[-1, 1], [-1, 1], [1, 1], [-1, 1]])


def test_distances_are_exact_plus_dead_path_plus_noise_of_the_stated_size():
    truth = random_truth(MACHINE, np.random.default_rng(1), reversal=True)
    c = tracker_campaign(MACHINE, truth, np.random.default_rng(2), n_per_station=500, segments=2)
    assert c.q.shape == (3000, 3) and set(np.unique(c.segment)) == {1, 2} and c.direction is not None
    station = np.array([c.station_positions[s] for s in c.station])
    dead = np.array([c.dead_paths[s, k] for s, k in zip(c.station.tolist(), c.segment.tolist(), strict=True)])
    pose = MACHINE.pose(c.q, truth, c.direction)
    point = (pose @ np.column_stack([c.tool, np.ones(len(c.tool))])[:, :, None])[:, :3, 0]
    length = np.sqrt(np.sum((point - station) ** 2, axis=1))
    np.testing.assert_allclose(c.u**2, 0.0003**2 + (3e-7 * length) ** 2, rtol=1e-12)
    residual = (c.distance - length - dead) / c.u
    assert abs(residual.std() - 1) < 4 / np.sqrt(2 * 3000)  # four standard deviations
    assert abs(residual.mean()) < 4 / np.sqrt(3000)
    assert len(c.dead_paths) == 12 and np.ptp(list(c.dead_paths.values())) > 100


def test_tools_go_round_or_are_all_seen_by_every_station():
    truth = Truth()
    c = tracker_campaign(MACHINE, truth, np.random.default_rng(0), n_per_station=30)
    tools = {s: {tuple(t) for t in c.tool[c.station == s]} for s in c.station_positions}
    assert c.direction is None and all(len(t) == 1 for t in tools.values())
    assert sorted(sum(t in seen for seen in tools.values()) for t in map(tuple, default_tools())) == [2, 2, 2]
    c = tracker_campaign(MACHINE, truth, np.random.default_rng(0), n_per_station=30, every_station_sees_every_tool=True)
    seen = {(s, k, tuple(t)) for s, k, t in zip(c.station.tolist(), c.segment.tolist(), c.tool, strict=True)}
    assert len(seen) == len(c.dead_paths) == 18  # one segment per station and tool


def test_outliers_are_as_many_and_as_large_as_asked_and_change_nothing_else():
    truth = Truth()
    clean, dirty = (
        tracker_campaign(MACHINE, truth, np.random.default_rng(5), n_per_station=50, outlier_fraction=f)
        for f in (0, 0.1)
    )
    shift = np.abs(dirty.distance - clean.distance)
    assert clean.outlier.sum() == 0 and dirty.outlier.sum() == 30
    assert np.all(shift[~dirty.outlier] == 0)
    assert shift[dirty.outlier].min() > 0.0099 and shift[dirty.outlier].max() < 0.5001


@pytest.mark.parametrize("approximate_error", [None, 5.0])
def test_written_campaign_reads_back(tmp_path, approximate_error):
    truth = random_truth(MACHINE, np.random.default_rng(1), reversal=True)
    c = tracker_campaign(MACHINE, truth, np.random.default_rng(2), n_per_station=10)
    manifest = write_campaign(
        tmp_path, c, machine_toml(MACHINE, extra="[model]\ndegree = 3"), 'a "title" µ', approximate_error
    )
    data = tomllib.loads(manifest.read_text(encoding="utf-8"))
    assert data["format"] == "volid-campaign/1" and data["title"] == 'a "title" µ'
    assert [s["name"] for s in data["station"]] == list(c.station_positions)
    for station in data["station"]:
        assert station["body"] == "workpiece" and ("position" in station) == (approximate_error is not None)
        if approximate_error:
            assert 0.1 < np.linalg.norm(station["position"] - c.station_positions[station["name"]]) < 25
    (readings,) = data["set"]
    assert readings["kind"] == "distance" and readings["relative"] is True
    assert readings["u"] == {"constant": 0.0003, "proportional": 3e-7}
    machine = tomllib.loads((tmp_path / data["machine"]).read_text(encoding="utf-8"))
    assert machine["structure"] == "w Y' X' b Z t" and machine["axis"]["X"]["travel"] == [0.0, 1000.0]
    assert machine["model"] == {"degree": 3}
    with open(tmp_path / readings["file"], encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for letters, array in (
        ("YXZ", c.q),
        (("Y_dir", "X_dir", "Z_dir"), c.direction),
        (("tool_x", "tool_y", "tool_z"), c.tool),
    ):
        np.testing.assert_array_equal([[float(row[a]) for a in letters] for row in rows], array)
    np.testing.assert_array_equal([float(row["distance"]) for row in rows], c.distance)
    assert [(row["station"], int(row["segment"])) for row in rows] == list(
        zip(c.station.tolist(), c.segment.tolist(), strict=True)
    )


# -------------------------------------------------------------------------------------------- field comparison


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
