"""A compensated machine under instruments, against the exact chain driven by an exact control, and against closed forms.

ISO/TR 16907 11.3 (after ANG and VOL types, direct angular measurements still see the rotation, indirect ones its effect at the
functional point; the spindle against the compensated Z), 4 e, 9.2 and 11.2 d (resting axes, least increment, clamped axes, wrong
tool length).
"""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactControl, Truth
from support.compensated import control_of, machine_and_solution, remaining
from support.drives import a_set, at, bar, both_truths, components, read, write_table
from support.machines import VERTICAL, volid_machine
from support.made_up import truth_of
from support.rtests import displacement, following

from volid.campaign import Campaign, End
from volid.compensation.control import Control
from volid.exceptions import InputError
from volid.io.compensations import load_control
from volid.virtual.drives import driven_ends
from volid.virtual.simulate import simulate

EXACT = VERTICAL  # w X' Y' b Z (C) t; X 0 … 760, Y 0 … 430, Z -460 … 0
MACHINE = volid_machine(EXACT)
TOOL = np.array([0.0, 0.0, -150.0])
NANOMETRE = 1e-6  # mm
SECOND_ORDER = 2e-6  # mm: the error changes by 5e-5 of a correction of up to 20 µm
ROTATION = 1e-9  # rad
LENGTHS = np.linspace(0.0, 760.0, 5)
LAYOUTS = [
    ("three-axis", ["L-VOL"]),
    ("three-axis", ["L-POS", "L-STR", "L-SQU"]),
    ("tilting table", ["L-VOL", "R-VOL"]),
    ("tilting table", ["L-VOL+", "R-VOL+"]),
    ("tilting table", ["R-POS", "R-POR"]),
    ("tilting table", ["FOR"]),
    ("fork head", ["L-VOL", "R-VOL"]),
    ("fork head", ["L-VOL+", "R-VOL+"]),
]


def places(exact, m, seed=1):
    """Places over all travels, tilted by 20° to 90°, away from the poles."""
    rng = np.random.default_rng(seed)
    q = np.stack([rng.uniform(*exact.travel[a], m) for a in exact.axes], axis=1)
    if "A" in exact.axes:
        q[:, exact.column("A")] = rng.uniform(20.0, 90.0, m)
    return q, rng.choice([-1.0, 1.0], q.shape)


@pytest.mark.parametrize(("layout", "names"), LAYOUTS)
def test_instruments_read_the_pose_that_the_drives_reach(layout, names, tmp_path):
    exact, solution = machine_and_solution(layout, seed=3)
    machine = solution.machine
    truth = truth_of(solution)
    truth = Truth(truth.functions, truth.constants, {"EXX": lambda x: 0.004 + 0 * x, "EYZ": lambda z: 0.003 + 1e-6 * z})
    control = control_of(solution, names, tmp_path / "files")
    (q, way), tool = places(exact, 60), np.array([40.0, -30.0, -210.0])
    driven = ExactControl.of(exact, [tmp_path / "files"]).command(q, tool, way)
    assert np.abs(driven - q).max() > 1e-3

    tracker, station = bar(q, tool, (-300.0, -200.0, 500.0), way)
    six = [components(q, tool, c, way) for c in "XYZABC"]
    nest = following(exact, q, np.tile(tool, (60, 1)), np.array([10.0, 20.0, 30.0]))
    options = {"sensor_on": "tool", "sphere": (10.0, 20.0, 30.0), "nest_u": 0.0, "rotation_u": 0.0, "scale_u": 0.0}
    rtest = a_set("displacement", nest, tool, way, labels={"sphere": "1"}, options=options, name="rtest")
    found, *others = read(machine, [tracker, *six, rtest], both_truths(machine, truth), control, [station])

    point = exact.functional_point(driven, tool, truth, way)
    np.testing.assert_allclose(found[:, 0], np.linalg.norm(point - station.position, axis=1), rtol=0, atol=NANOMETRE)
    left = remaining(exact, truth, q, driven, tool, way)
    for k, values in enumerate(others[:6]):  # each with an unknown offset of its own
        np.testing.assert_allclose(
            np.diff(values[:, 0]), np.diff(left[:, k]), rtol=0, atol=NANOMETRE if k < 3 else ROTATION
        )
    reached = ExactControl.of(exact, [tmp_path / "files"]).command(nest, tool, way)
    pose = exact.pose(reached, truth, way)
    expected = np.einsum("mji,mj->mi", pose[:, :3, :3], np.array([10.0, 20.0, 30.0]) - pose[:, :3, 3]) - tool
    np.testing.assert_allclose(others[6], expected, rtol=0, atol=NANOMETRE)
    bare = displacement(exact, nest, tool, np.array([10.0, 20.0, 30.0]), truth)
    if names != ["FOR"]:  # turns alone move the point where they like
        assert np.abs(expected).max() != pytest.approx(np.abs(bare).max(), rel=0.05)


# --------------------------------------------------------------------------- rotations: who sees them after L-ANG, and who not


def angular(folder, **slopes):
    """A machine with rotations in proportion to X about its middle, and the L-ANG tables that hold them exactly."""
    functions = {name: (lambda x, s=s: s * (x - 380.0)) for name, s in slopes.items()}
    for name, f in functions.items():
        write_table(folder, name, LENGTHS, f(LENGTHS))
    return Truth(functions), load_control(MACHINE, [folder])


def test_levels_still_see_the_rotation_after_l_ang_and_a_tracker_sees_nothing(tmp_path):
    truth, control = angular(tmp_path, EAX=4e-8, EBX=-6e-8)
    q, true = at(EXACT, X=LENGTHS, Y=100.0, Z=-50.0), both_truths(MACHINE, truth)
    options = {"vertical": "Z", "moving_on": "workpiece", "reference_on": "tool"}
    levels = [
        a_set("level", q, TOOL, labels={"component": c, "line": "1", "run": "1", "placement": "machine"}, options=options,
              name=f"levels {c}")
        for c in "AB"
    ]  # fmt: skip
    tracker, station = bar(q, (60.0, -40.0, -250.0), (-300.0, -200.0, 500.0))
    before, after = (read(MACHINE, [*levels, tracker], true, c, [station]) for c in (None, control))
    for values in (before, after):
        for k, name in enumerate(("EAX", "EBX")):  # the table turns by minus the error: tool relative to workpiece
            seen = -np.diff(truth.functions[name](LENGTHS))
            np.testing.assert_allclose(np.diff(values[k][:, 0]), seen, rtol=0, atol=ROTATION)
    nominal = np.linalg.norm(EXACT.functional_point(q, (60.0, -40.0, -250.0)) - station.position, axis=1)
    assert np.abs(before[2][:, 0] - nominal).max() > 0.004  # mm: the arms are there
    np.testing.assert_allclose(after[2][:, 0], nominal, rtol=0, atol=NANOMETRE)


def test_a_ball_bar_with_an_offset_that_the_control_does_not_know_sees_rotation_times_offset(tmp_path):
    truth, control = angular(tmp_path, EAX=4e-8, EBX=-6e-8, ECX=5e-8)
    unknown = np.array([70.0, -20.0, -90.0])
    q = at(EXACT, X=np.linspace(100.0, 700.0, 13), Y=200.0, Z=-200.0)
    told = replace(control, tool=tuple(TOOL))
    centre = np.array([380.0, 60.0, -300.0])
    reading, station = bar(q, TOOL + unknown, centre)
    (found,) = read(MACHINE, [reading], both_truths(MACHINE, truth), told, [station])
    point = EXACT.functional_point(q, TOOL + unknown)
    along = (point - centre) / np.linalg.norm(point - centre, axis=1)[:, None]
    rotation = np.stack([truth.functions[n](q[:, 0]) for n in ("EAX", "EBX", "ECX")], axis=1)
    seen = np.einsum("mi,mi->m", along, np.cross(rotation, unknown))
    assert np.abs(seen).max() > 0.0008
    np.testing.assert_allclose(found[:, 0] - np.linalg.norm(point - centre, axis=1), seen, rtol=0, atol=NANOMETRE)
    known, station = bar(q, TOOL + unknown, centre)  # told the offset, nothing is left
    (found,) = read(MACHINE, [known], both_truths(MACHINE, truth), control, [station])
    np.testing.assert_allclose(found[:, 0], np.linalg.norm(point - centre, axis=1), rtol=0, atol=NANOMETRE)


def test_a_mandrel_sees_the_spindle_against_the_compensated_z(tmp_path):
    """An indicator on the table touches the mandrel at one height; Z carries the mandrel past it, so the tool vector changes."""
    z, a, b = np.linspace(-460.0, 0.0, 24), 45e-6, -70e-6

    def along_x(z):
        return 0.006 * np.sin(z / 90.0)

    def along_y(z):
        return -0.004 * np.cos(z / 120.0)

    truth = Truth({"EXZ": along_x, "EYZ": along_y}, {"EA0S": a, "EB0S": b})
    nodes = np.linspace(-460.0, 0.0, 24)
    for name, f in (("EXZ", along_x), ("EYZ", along_y)):
        write_table(tmp_path, name, nodes, f(nodes))
    control = load_control(MACHINE, [tmp_path], tool=tuple(TOOL))
    q, height = at(EXACT, X=300.0, Y=200.0, Z=z), -500.0
    tool = np.stack([0 * z, 0 * z, height - z], axis=1)
    sets = [components(q, tool, c) for c in "XY"]
    before, after = (read(MACHINE, sets, both_truths(MACHINE, truth), c) for c in (None, control))
    tilt = {"X": b * tool[:, 2], "Y": -a * tool[:, 2]}  # rotation × (0, 0, t)
    for k, (component, f) in enumerate((("X", along_x), ("Y", along_y))):
        np.testing.assert_allclose(np.diff(after[k][:, 0]), np.diff(tilt[component]), rtol=0, atol=NANOMETRE)
        whole = f(z) + tilt[component]
        np.testing.assert_allclose(np.diff(before[k][:, 0]), np.diff(whole), rtol=0, atol=NANOMETRE)
    slope = np.polyfit(z, after[0][:, 0], 1)[0]
    assert slope == pytest.approx(-b, abs=1e-9)


# ------------------------------------------------------------------------------------- what is wrong with a compensation


def scale(x):
    return 5e-5 * (x - 380.0)


def positioning(folder, sign=-1.0, **options):
    write_table(folder, "EXX", LENGTHS, scale(LENGTHS), sign=sign)
    return Truth({"EXX": scale}), load_control(MACHINE, [folder], **options)


def left_along_x(truth, control, x):
    """Deviation in X along a line, from its middle on [mm]."""
    q = at(EXACT, X=np.append(x, 380.0), Y=100.0, Z=-100.0)
    (found,) = read(MACHINE, [components(q, TOOL, "X")], both_truths(MACHINE, truth), control)
    return found[:-1, 0] - found[-1, 0]


def test_a_table_with_the_wrong_sign_doubles_the_error(tmp_path):
    x = np.linspace(0.0, 760.0, 77)
    truth, control = positioning(tmp_path / "right")
    np.testing.assert_allclose(left_along_x(truth, control, x), 0.0, atol=SECOND_ORDER)
    truth, control = positioning(tmp_path / "wrong", sign=1.0)
    np.testing.assert_allclose(left_along_x(truth, control, x), 2.0 * scale(x), rtol=0, atol=SECOND_ORDER)


def test_least_increment_leaves_up_to_half_of_it_and_clamped_axes_all_of_theirs(tmp_path):
    x, step = np.linspace(0.0, 760.0, 2003), 0.0017
    truth, control = positioning(tmp_path / "a", increment={"X": step})
    left = left_along_x(truth, control, x)
    np.testing.assert_allclose(left, scale(x) - step * np.round(scale(x) / step), rtol=0, atol=SECOND_ORDER)
    assert 0.95 * step / 2 < np.abs(left).max() < step / 2 + SECOND_ORDER
    truth, control = positioning(tmp_path / "b", clamped=("X",))
    np.testing.assert_allclose(left_along_x(truth, control, x), scale(x), rtol=0, atol=SECOND_ORDER)


def test_a_wrong_tool_length_leaves_rotation_times_the_difference(tmp_path):
    truth, control = angular(tmp_path, EAX=4e-8, EBX=-6e-8)
    wrong = replace(control, tool=(0.0, 0.0, -130.0))  # the true one is 20 mm longer
    q = at(EXACT, X=np.append(LENGTHS, 380.0), Y=100.0, Z=-100.0)
    found = read(MACHINE, [components(q, TOOL, c) for c in "XYZ"], both_truths(MACHINE, truth), wrong)
    rotation = np.stack([truth.functions["EAX"](q[:, 0]), truth.functions["EBX"](q[:, 0]), 0 * q[:, 0]], axis=1)
    expected = np.cross(rotation, [0.0, 0.0, -20.0])
    for k in range(3):
        values = found[k][:, 0]
        np.testing.assert_allclose(values - values[-1], expected[:, k], rtol=0, atol=NANOMETRE)
    assert np.abs(expected).max() > 4e-4


# ------------------------------------------------------------------------------------------------------------- reversal


def test_reversal_in_both_styles_and_as_one_value_is_taken_off_the_programmed_direction(tmp_path):
    def reversal(x):
        return 0.003 + 4e-6 * x

    truth = Truth({"EXX": scale}, reversal={"EXX": reversal})
    x = np.tile(LENGTHS, 2)
    way = np.zeros((10, 3))
    way[:, EXACT.column("X")] = np.repeat([1.0, -1.0], 5)
    q = at(EXACT, X=x, Y=100.0, Z=-100.0)
    up, down = (scale(LENGTHS) + d * reversal(LENGTHS) / 2 for d in (1, -1))
    left = {}
    for style in ("columns", "difference", "value"):
        write_table(tmp_path / style, "EXX", LENGTHS, up, down, style=style)
        control = load_control(MACHINE, [tmp_path / style])
        (found,) = read(MACHINE, [components(q, TOOL, "X", way)], both_truths(MACHINE, truth), control)
        left[style] = found[:, 0] - found[:, 0].mean()
        exact = ExactControl.of(EXACT, [tmp_path / style])
        expected = remaining(EXACT, truth, q, exact.command(q, TOOL, way), TOOL, way)[:, 0]
        np.testing.assert_allclose(left[style], expected - expected.mean(), rtol=0, atol=NANOMETRE)
    for style in ("columns", "difference"):
        np.testing.assert_allclose(left[style], 0.0, atol=SECOND_ORDER)
    variable = reversal(LENGTHS) - reversal(LENGTHS).mean()
    np.testing.assert_allclose(left["value"], np.append(variable, -variable) / 2, rtol=0, atol=SECOND_ORDER)


def resting(tmp_path):
    """X moves to and fro while Y rests at a programmed position and is moved by the straightness compensation alone."""
    straightness = np.array([0.0, 0.004, 0.004, 0.001])
    nodes, play = np.array([0.0, 100.0, 200.0, 300.0]), 0.0035
    write_table(tmp_path, "EYX", nodes, straightness)
    truth = Truth({"EYX": lambda x: np.interp(x, nodes, straightness)}, reversal={"EYY": lambda y: play + 0 * y})
    q = at(EXACT, X=[0.0, 100.0, 200.0, 300.0, 200.0, 100.0, 0.0], Y=150.0, Z=-100.0)
    way = np.zeros((7, 3))
    way[:, EXACT.column("X")] = [1, 1, 1, 1, -1, -1, -1]
    way[:, EXACT.column("Y")] = 1.0
    # corrections of Y: 0, -4, -4, -1, -4, -4, 0 µm; where it does not change, the drive keeps its direction
    arrives = np.array([1, -1, -1, 1, -1, -1, 1])
    return truth, q, way, play / 2 * arrives, load_control(MACHINE, [tmp_path])


def test_a_resting_axis_arrives_in_the_direction_of_its_last_correction(tmp_path):
    truth, q, way, expected, control = resting(tmp_path)
    before, after = (
        read(MACHINE, [components(q, TOOL, "Y", way)], both_truths(MACHINE, truth), c)[0][:, 0] for c in (None, control)
    )
    np.testing.assert_allclose(before - before[0], truth.functions["EYX"](q[:, 0]), rtol=0, atol=NANOMETRE)
    np.testing.assert_allclose(after - after[0], expected - expected[0], rtol=0, atol=NANOMETRE)


def test_rows_count_in_the_order_of_their_times(tmp_path):
    truth, q, way, expected, control = resting(tmp_path)
    shuffled = np.random.default_rng(3).permutation(7)
    rows = components(q[shuffled], TOOL, "Y", way[shuffled], time=10.0 * shuffled)
    (found,) = read(MACHINE, [rows], both_truths(MACHINE, truth), control)
    first = int(np.argmin(shuffled))
    np.testing.assert_allclose(
        found[:, 0] - found[first, 0], (expected - expected[0])[shuffled], rtol=0, atol=NANOMETRE
    )


def test_the_two_ends_of_a_length_are_driven_to_one_after_the_other(tmp_path):
    """Along the same path, 0 to 100 and 200 to 300 mm: Y arrives at the two ends of each from either side."""
    truth, q, way, expected, control = resting(tmp_path)
    other = TOOL + np.array([0.0, 100.0, 0.0])  # the second point lies at (100, 100, 0) from the first
    first, second = ([0, 2], [1, 3])
    labels = {"artefact": "bar"}
    rows = a_set("length", q[first], TOOL, way[first], labels=labels, options={"calibrated_u": 0.0}, name="bar")
    rows = replace(rows, to=End(q[second], way[second], np.tile(other, (2, 1))))
    (found,) = read(MACHINE, [rows], both_truths(MACHINE, truth), control)
    apart = np.array([100.0, 100.0, 0.0])[None] + (expected[second] - expected[first])[:, None] * [0.0, 1.0, 0.0]
    np.testing.assert_allclose(found[:, 0], np.linalg.norm(apart, axis=1), rtol=0, atol=NANOMETRE)
    assert np.abs(expected[second] - expected[first]).tolist() == [0.0035, 0.0035]


def test_an_axis_that_was_approached_anew_has_the_direction_that_is_recorded(tmp_path):
    """At a turning point the same position follows itself in the other direction: that is no rest."""
    _, q, way, _, control = resting(tmp_path)
    way[3:, EXACT.column("Y")] = -1.0
    driven = driven_ends(control, components(q, TOOL, "Y", way))[0]
    assert driven.directions[:, EXACT.column("Y")].tolist() == [1, -1, -1, -1, -1, -1, 1]
    np.testing.assert_array_equal(driven.directions[:, EXACT.column("X")], way[:, EXACT.column("X")])


# ------------------------------------------------------------------------------------------------------------- messages


def test_a_control_of_other_axes_is_refused():
    machine = volid_machine(machine_and_solution("tilting table")[0])
    with pytest.raises(InputError, match=r"`control`: it moves the axes C, A, Y, X, Z .* but .* has X, Y, Z"):
        simulate(
            Campaign(MACHINE, (), (components(at(EXACT, X=[0.0, 1.0], Y=0.0, Z=0.0), TOOL, "X"),)),
            control=Control(machine),
        )


def test_a_turn_too_large_for_the_chain_is_named(tmp_path):
    exact, solution = machine_and_solution("tilting table", seed=3)
    write_table(tmp_path, "ECC", [-180.0, 180.0], [0.01, 0.01])
    text = (tmp_path / "ECC.csv").read_text(encoding="utf-8").replace("kinematic model", "the axis itself")
    (tmp_path / "ECC.csv").write_text(text, encoding="utf-8")
    control = load_control(solution.machine, [tmp_path])
    rows = components(at(exact, X=0.0, Y=0.0, Z=0.0, A=0.0, C=[0.0, 90.0]), TOOL, "X")
    with pytest.raises(
        InputError, match=r"component X, row 1: the compensation turns axis C by -0.573°; expected at most 0.25°"
    ):
        read(solution.machine, [rows], both_truths(solution.machine, truth_of(solution)), control)


def test_the_campaign_records_what_was_active_beside_what_the_plan_names(tmp_path):
    truth, control = positioning(tmp_path, increment={"X": 0.001}, clamped=("Z",), tool=(0.0, 0.0, -150.0))
    plan = Campaign(
        MACHINE, (), (components(at(EXACT, X=[0.0, 1.0], Y=0.0, Z=0.0), TOOL, "X"),),
        conditions={"active_compensations": ["thermal"]},
    )  # fmt: skip
    campaign, same = simulate(plan, both_truths(MACHINE, truth), control=control)
    assert campaign.conditions["active_compensations"] == [
        "thermal",
        "L-POS: table of EXX",
        "tool vector that the control uses: 0, 0, -150 mm",
        "least increment: X 0.001 mm",
        "clamped for compensations: Z",
    ]
    np.testing.assert_array_equal(campaign.sets[0].positions, plan.sets[0].positions)
    bare, _ = simulate(campaign, both_truths(MACHINE, truth))  # as a plan: nothing is active any more
    assert bare.conditions["active_compensations"] == []
    assert (
        "active_compensations" not in simulate(replace(plan, conditions={}), both_truths(MACHINE, truth))[0].conditions
    )
    assert same.functions["EXX"] is truth.functions["EXX"]
