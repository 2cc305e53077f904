"""Closed loops of every compensation type on three machines: computed, written, read by a simulated control, judged by the
exact chain.

Each type meets a machine with nothing but the errors that it corrects, and one with nothing but those it must not touch
(REQUIREMENTS A2). Positions are nodes of tables and grids, so that what is left is of second order: products of two errors, a few
nanometres for 20 µm and 60 µrad, and about |turn| × |error| where rotary axes turn.
"""

import numpy as np
import pytest
from exact_chain import gauge_free
from support.compensated import MACHINES, TOOL, control_of, machine_and_solution, node_positions, only, remaining
from support.made_up import truth_of

from volid.compensation.base import base_of
from volid.compensation.orientation import distance_from_pole, side_rotation
from volid.compensation.residual.fields import Places
from volid.compensation.residual.forecast import forecast
from volid.compensation.tables.sampling import Sampling

SECOND_ORDER = 2e-4  # mm: 0.2 µm, (100 µrad)² × 1 m and 100 µrad × 50 µm are below 0.02 µm; rotary chains add several
ANGLE = 2e-7  # rad
LINEAR, ROTARY = "XYZ", "ABC"
PAIRS = ("EXC", "EYC", "EBA", "ECA", "EX0C")  # members of a pair share parameters


def positioning(e):
    return not e.location and e.direction == e.axis and e.axis in LINEAR


def straightness(e):
    return not e.location and not e.is_rotation and e.axis in LINEAR and e.direction != e.axis


def squareness(e):
    return e.location and e.axis in LINEAR


def linear_angular(e):
    return not e.location and e.is_rotation and e.axis in LINEAR


def linear(e):
    return e.axis in LINEAR


def angular_positioning(e):
    return e.axis in ROTARY and e.direction == e.axis


def radial_axial(e):
    return not e.location and not e.is_rotation and e.axis in ROTARY


def tilt(e):
    return not e.location and e.is_rotation and e.axis in ROTARY and e.direction != e.axis


def location(e):
    return e.location and e.axis in ROTARY and e.direction != e.axis


def rotary(e):
    return e.axis in ROTARY


def specified(e):
    return str(e) in ("EXX", "EBX", "EYZ")


def specified_rotary(e):
    return str(e) in PAIRS


# type: what it removes wherever it is alone, and what it must leave exactly alone
TYPES = {
    "L-POS": (positioning, lambda e: straightness(e) or squareness(e) or rotary(e)),
    "L-STR": (straightness, lambda e: positioning(e) or squareness(e) or rotary(e)),
    "L-SQU": (squareness, lambda e: positioning(e) or straightness(e) or rotary(e)),
    "L-VOL": (linear, rotary),
    "R-POS": (angular_positioning, lambda e: radial_axial(e) or tilt(e) or location(e) or linear(e)),
    "R-RAX": (radial_axial, lambda e: angular_positioning(e) or location(e) or linear(e)),
    "R-POR": (location, lambda e: angular_positioning(e) or radial_axial(e) or tilt(e) or linear(e)),
    "R-VOL": (rotary, linear),
    "L-SPEC": (specified, lambda e: not specified(e)),
    "R-SPEC": (specified_rotary, lambda e: not specified_rotary(e)),
}
CASES = [(m, t) for m in MACHINES for t in TYPES if m != "three-axis" or t.startswith("L-")]
FUNCTIONS = {"L-SPEC": ("EXX", "EBX", "EYZ"), "R-SPEC": PAIRS}


@pytest.mark.parametrize(("layout", "name"), CASES)
def test_type_removes_what_it_is_for_and_leaves_the_rest(layout, name, tmp_path):
    exact, solution = machine_and_solution(layout, seed=3)
    removes, leaves = TYPES[name]
    q, tool = node_positions(exact, 200), np.array([40.0, -30.0, -210.0])
    functions = FUNCTIONS.get(name, ())

    own = only(solution, removes)
    altered = control_of(own, [name], tmp_path / "own", functions=functions).command(q, tool)
    before = exact.deviation(q, tool, truth_of(own))
    after = remaining(exact, truth_of(own), q, altered, tool)
    assert np.linalg.norm(before[:, :3], axis=1).max() > 0.002
    assert np.linalg.norm(after[:, :3], axis=1).max() < SECOND_ORDER
    few = Places(q[:24], np.zeros((24, q.shape[1])))
    base, few_nodes = base_of(own, TOOL, functions=functions), Sampling(max_points=5)
    (_, column) = forecast(own, [[name]], base, tool, places=few, points=5, tables=few_nodes).columns
    free, _ = gauge_free(after[:24, :3], q[:24], tool, tool_rotation=False, machine=exact)
    assert np.linalg.norm(free, axis=1).max() < column.predictions[0].low[0]
    if name == "R-POS":  # the axis itself is moved: its rotation goes too
        assert np.abs(after[:, 3:]).max() < ANGLE
    else:  # a direct angular measurement still sees the physical rotation
        np.testing.assert_allclose(after[:, 3:], before[:, 3:], atol=ANGLE)

    other = only(solution, leaves)
    if name in ("R-POS", "R-RAX", "R-POR", "R-SPEC", "L-SPEC") or name.startswith("L-"):
        made = _quiet(other, name, tmp_path / "other", functions)
        untouched = q if made is None else made.command(q, tool)
        np.testing.assert_allclose(untouched, q, atol=1e-9)


def _quiet(solution, name, folder, functions):
    """The control for a machine that has nothing for this type: no table at all, or zeros."""
    return control_of(solution, [name], folder, functions=functions)


@pytest.mark.parametrize("layout", ["three-axis", "tilting table", "fork head"])
def test_lines_of_a_whole_machine(layout, tmp_path):
    """On the specific lines with the base tool L-POS, L-STR and L-SQU each remove their own part of the curve, and only that."""
    exact, solution = machine_and_solution(layout, seed=4)
    solution = only(solution, lambda e: e.axis in LINEAR)
    truth = truth_of(solution)
    at = {"X": 200.0, "Y": -175.0, "Z": 325.0}  # nodes, off the datum's origin
    measured = {}
    for name in (None, "L-POS", "L-STR", "L-SQU"):
        control = control_of(solution, [name] if name else [], tmp_path / str(name), at=at)
        measured[name] = {a: _curves(exact, truth, control, at, a) for a in LINEAR}
    for k, a in enumerate(LINEAR):
        across = [j for j in range(3) if j != k]
        before = measured[None][a]
        positioning_after = measured["L-POS"][a].deviation[:, k]
        assert np.ptp(before.deviation[:, k]) > 0.002
        assert np.ptp(positioning_after) < 1e-5
        np.testing.assert_allclose(measured["L-POS"][a].deviation[:, across], before.deviation[:, across], atol=1e-5)
        bent, straight = (measured[n][a].bent[:, across] for n in (None, "L-STR"))
        assert np.abs(bent).max() > 0.0005
        assert np.abs(straight).max() < 1e-5  # a straight line is left, with its slope
        np.testing.assert_allclose(measured["L-STR"][a].deviation[:, k], before.deviation[:, k], atol=1e-5)
        np.testing.assert_allclose(measured["L-SQU"][a].bent, before.bent, atol=2e-5)
    every = control_of(solution, ["L-POS", "L-STR", "L-SQU"], tmp_path / "all", at=at)
    for a in LINEAR:
        assert np.abs(np.ptp(_curves(exact, truth, every, at, a).deviation, axis=0)).max() < 1e-5


class _curves:
    """Deviation of the functional point along a line, and its bent part: less the least-squares line."""

    def __init__(self, exact, truth, control, at, letter):
        x = np.linspace(*exact.travel[letter], 5)
        q = np.zeros((5, len(exact.axes)))
        for a in LINEAR:
            q[:, exact.column(a)] = x if a == letter else at[a]
        found = remaining(exact, truth, q, control.command(q, TOOL), TOOL)[:, :3]
        self.deviation = found - found[np.argmin(np.abs(x - at[letter]))]
        self.bent = found - np.stack([np.polyval(np.polyfit(x, c, 1), x) for c in found.T], axis=1)


@pytest.mark.parametrize("layout", MACHINES)
def test_l_ang_leaves_what_the_lines_have(layout, tmp_path):
    """Angular errors alone: afterwards the point moves anywhere, with any tool, as along the specific lines with the base
    tool."""
    exact, solution = machine_and_solution(layout, seed=5)
    solution = only(solution, linear_angular)
    truth = truth_of(solution)
    q, tool = node_positions(exact, 200), np.array([60.0, 20.0, -260.0])
    q[:, [exact.column(a) for a in exact.axes if a in ROTARY]] = 0.0
    after = remaining(exact, truth, q, control_of(solution, ["L-ANG"], tmp_path / "c").command(q, tool), tool)
    origin = np.array([[np.mean(exact.travel[a]) if a in LINEAR else 0.0 for a in exact.axes]])
    start = exact.deviation(origin, TOOL, truth)[0, :3]
    lines = np.tile(start, (len(q), 1))
    for a in LINEAR:
        along = np.tile(origin, (len(q), 1))
        along[:, exact.column(a)] = q[:, exact.column(a)]
        lines += exact.deviation(along, TOOL, truth)[:, :3] - start
    before = exact.deviation(q, tool, truth)
    assert np.linalg.norm(before[:, :3] - lines, axis=1).max() > 0.01
    np.testing.assert_allclose(after[:, :3], lines, atol=SECOND_ORDER)
    np.testing.assert_allclose(after[:, 3:], before[:, 3:], atol=ANGLE)


@pytest.mark.parametrize("layout", ["tilting table", "fork head"])
def test_r_ang_leaves_what_one_elevation_has_and_r_rax_removes_it(layout, tmp_path):
    """Tilts alone: R-ANG makes the point move as at the elevation, R-RAX takes that away, both together leave nothing."""
    exact, solution = machine_and_solution(layout, seed=6)
    solution = only(solution, tilt)
    truth = truth_of(solution)
    q, tool = node_positions(exact, 300), np.array([30.0, 50.0, -230.0])
    left = {}
    for names in (("R-ANG",), ("R-RAX",), ("R-RAX", "R-ANG")):
        control = control_of(solution, list(names), tmp_path / "-".join(names), elevation=80.0)
        left[names] = remaining(exact, truth, q, control.command(q, tool), tool)
    before = exact.deviation(q, tool, truth)
    assert np.linalg.norm(left["R-RAX", "R-ANG"][:, :3], axis=1).max() < SECOND_ORDER
    np.testing.assert_allclose(left["R-ANG",][:, :3] + left["R-RAX",][:, :3], before[:, :3], atol=SECOND_ORDER)
    for found in left.values():
        np.testing.assert_allclose(found[:, 3:], before[:, 3:], atol=ANGLE)
    if layout == "tilting table":  # on C's line, 80 mm above its point, A at 0: R-RAX alone leaves nothing of C's tilt
        only_c = only(solution, lambda e: e.axis == "C")
        place = np.add(exact.point["C"], [0.0, 0.0, 80.0])
        q = np.zeros((9, len(exact.axes)))
        q[:, exact.column("C")] = np.linspace(-180.0, 180.0, 9)
        for k, a in enumerate("XYZ"):
            q[:, exact.column(a)] = place[k] - np.array(TOOL)[k]
        control = control_of(only_c, ["R-RAX"], tmp_path / "c", elevation=80.0)
        found = remaining(exact, truth_of(only_c), q, control.command(q, TOOL), TOOL)
        assert np.abs(exact.deviation(q, TOOL, truth_of(only_c))[:, :3]).max() > 0.0005
        assert np.abs(found[:, :3]).max() < 1e-5


@pytest.mark.parametrize("layout", ["tilting table", "fork head"])
def test_rotary_axes_turn_the_tool_axis_and_nothing_else_is_lost(layout, tmp_path):
    """FOR, L-VOL+ and R-VOL+: away from the pole the tool axis stands as commanded; the turn about the tool axis stays, and
    shows."""
    exact, solution = machine_and_solution(layout, seed=7)
    truth = truth_of(solution)
    q, tool = node_positions(exact, 300), np.array([30.0, 50.0, -230.0])
    away = distance_from_pole(solution.machine, q) > 20.0
    assert 50 < away.sum() < 300
    before = exact.deviation(q, tool, truth)
    k = side_rotation(solution.machine, q, False)[:, :, 2]
    for names in (["FOR"], ["L-VOL+", "R-VOL+"], ["L-VOL+"], ["R-VOL+"]):
        control = control_of(solution, names, tmp_path / "".join(names))
        altered = control.command(q, tool)
        after = remaining(exact, truth, q, altered, tool)
        tilted = np.linalg.norm(np.cross(k, after[:, 3:]), axis=1)
        assert np.linalg.norm(np.cross(k, before[:, 3:]), axis=1)[away].max() > 4e-5
        assert tilted[away].max() < 1e-6
        assert np.abs(np.einsum("mi,mi->m", k, after[:, 3:]))[away].max() > 4e-5
        assert tilted.max() < 2e-4  # near the pole it is limited, not multiplied
        point = np.linalg.norm(after[:, :3], axis=1)
        if names == ["FOR"]:  # X, Y, Z do not help: what the turns do to the point is what is reported
            moved = after[:, :3] - before[:, :3]
            np.testing.assert_allclose(moved, control.unintended_motion(q, tool), atol=2 * SECOND_ORDER)
            assert np.linalg.norm(moved, axis=1).max() > 0.005
        elif len(names) == 2:
            assert point.max() < 2 * SECOND_ORDER
        else:  # the unintended motion is corrected: the point stands as after L-VOL or R-VOL
            plain = control_of(solution, [names[0].removesuffix("+")], tmp_path / ("plain" + names[0]))
            expected = remaining(exact, truth, q, plain.command(q, tool), tool)
            np.testing.assert_allclose(after[:, :3], expected[:, :3], atol=2 * SECOND_ORDER)


def test_user_rule_is_applied(tmp_path):
    """L-SPEC by a rule: half the positioning of X, whatever the model says."""
    exact, solution = machine_and_solution("three-axis", seed=8)

    def half_of_x(given, positions, tool):
        values = np.zeros((len(positions), 6))
        rows = given.motion_rows("EXX", positions[:, given.machine.index("X")], 0)
        values[:, 0] = 0.5 * rows @ np.asarray(given.parameters)
        return values

    q = node_positions(exact, 50)
    control = control_of(solution, ["L-SPEC"], tmp_path / "rule", rule=half_of_x)
    step = control.command(q, TOOL) - q
    exx = truth_of(solution).functions["EXX"](q[:, exact.column("X")])
    expected = np.zeros_like(q)
    expected[:, exact.column("X")] = -0.5 * exx
    np.testing.assert_allclose(step, expected, atol=1e-8)
