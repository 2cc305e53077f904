"""The deviation field that a page shows, against the exact chain driven by an exact control, and the library's numbers."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactControl
from support.compensated import machine_and_solution, only, remaining
from support.made_up import truth_of

from volid.compensation.base import base_of
from volid.compensation.package import compensate
from volid.compensation.residual.forecast import forecast
from volid.fitting.prediction.largest import Places
from volid.fitting.prediction.working_volume import spread_positions
from volid.io.compensations import save_compensation
from volid.model.iso230 import LINEAR_AXES
from volid.report.contents.deviation_field import SPREAD, deviation_fields

TOOL = (40.0, -30.0, -210.0)
NANOMETRE = 1e-6  # mm: files hold values to a tenth of that


@pytest.mark.parametrize(
    ("layout", "names"),
    [
        ("three-axis", ["L-POS", "L-STR", "L-SQU"]),
        ("three-axis", ["L-VOL"]),
        ("tilting table", ["R-POR"]),
        ("tilting table", ["R-POS", "R-ANG"]),
        ("fork head", ["R-VOL"]),
        ("fork head", ["FOR"]),
    ],
)
def test_every_value_is_what_the_exact_chain_leaves(layout, names, tmp_path):
    """With errors twenty times the usual ones, 0.7 mm, so that a shortcut by first order would be micrometres wrong."""
    exact, solution = machine_and_solution(layout, seed=5, scale=20.0)
    truth = truth_of(solution)
    found = deviation_fields(solution, TOOL, [names], most=3)
    assert found.states == ((), tuple(names))
    save_compensation(compensate(solution, names, base_of(solution, TOOL), uncertainty=False), solution, tmp_path / "f")
    control = ExactControl.of(exact, [tmp_path / "f"])
    assert len(found.places) == (1 if layout == "three-axis" else 6)
    for i, place in enumerate(found.places[:3]):
        q = found.lattice.positions(place)
        without = exact.deviation(q, TOOL, truth)[:, :3]
        np.testing.assert_allclose(found.values[0, i, 0], without, rtol=0, atol=NANOMETRE)
        after = remaining(exact, truth, q, control.command(q, TOOL), TOOL)[:, :3]
        np.testing.assert_allclose(found.values[0, i, 1], after, rtol=0, atol=NANOMETRE)
        assert np.abs(after - without).max() > 0.01  # the compensation does something


def test_positions_stand_in_the_order_of_the_nodes():
    _, solution = machine_and_solution("fork head")
    lattice = deviation_fields(solution, TOOL, [], most=4).lattice
    q = lattice.positions({"C": 12.0, "A": -7.0})
    for k, letter in enumerate(LINEAR_AXES):
        np.testing.assert_array_equal(q[:, solution.machine.index(letter)], lattice.points[:, k])
    assert set(q[:, solution.machine.index("C")]) == {12.0}
    number = np.arange(len(q)).reshape(lattice.shape)
    assert len(lattice.lines) == sum(number.size // n for n in lattice.shape)
    for line in lattice.lines:  # straight, along one axis
        assert (np.ptp(lattice.points[line], axis=0) > 0).sum() == 1


def test_u_is_that_of_the_solution():
    _, solution = machine_and_solution("three-axis")
    found = deviation_fields(solution, TOOL, [], most=3)
    q = found.lattice.positions({})
    np.testing.assert_allclose(found.u[0, 0], solution.evaluate(q, TOOL).u[:, :3], rtol=1e-12)


def test_without_rigid_motion_the_values_are_those_that_the_forecast_finds():
    """The forecast looks at places of its own; at the lattice's nodes its "exact" largest value is that of this field."""
    _, solution = machine_and_solution("three-axis", scale=0.5)
    found = deviation_fields(solution, TOOL, [["L-POS"]], most=5)
    points = np.column_stack([found.lattice.points, np.ones(len(found.lattice.points))])
    left = found.values[0, 0] - np.einsum("sij,mj->smi", found.motions[0, 0], points)
    q = found.lattice.positions({})
    volume = spread_positions(solution.machine, SPREAD)
    places = Places(volume, np.zeros_like(volume)).and_also(Places(q, np.zeros_like(q)))
    columns = forecast(solution, [["L-POS"]], base_of(solution, TOOL), places=places, repeatability=0.0).columns
    for values, column in zip(left, columns, strict=True):
        largest = np.linalg.norm(values, axis=1).max()
        assert largest == pytest.approx(column.predictions[0].exact[0], rel=0.02)  # corners are the largest of all


def test_types_that_change_nothing_are_named_and_not_offered():
    _, solution = machine_and_solution("three-axis")
    straight = only(solution, lambda name: str(name) in ("EXX", "EYY", "EZZ"))
    found = deviation_fields(straight, TOOL, most=3)
    assert ("L-POS",) in found.states
    assert {("L-STR",), ("L-SQU",), ("L-ANG",)} <= set(found.idle)


def test_nothing_is_drawn_where_nothing_is_determined():
    _, solution = machine_and_solution("three-axis")
    open_solution = replace(solution, null_space=np.eye(solution.model.n_parameters))
    found = deviation_fields(open_solution, TOOL, most=3)
    assert not found.is_known
    assert not np.isfinite(found.values).any()
    assert found.largest(0, 0, 0) == -1
    assert {names for names, _ in found.lost} >= {("L-VOL",)}


def test_a_machine_in_part_determined_keeps_blank_what_is_not():
    """The roll of X about Y is open: it acts through height alone."""
    _, solution = machine_and_solution("three-axis")
    f = next(f for f in solution.model.functions if f.name == "EBX")
    open_ = np.zeros((solution.model.n_parameters, 1))
    open_[f.parameters.start] = 1.0
    found = deviation_fields(replace(solution, null_space=open_), TOOL, [["L-POS"]], most=5)
    known = np.isfinite(found.values[0, 0, 0]).all(axis=1)
    expected = replace(solution, null_space=open_).evaluate(found.lattice.positions({}), TOOL).determined[:, :3]
    np.testing.assert_array_equal(known, expected.all(axis=1))
    assert not known.all()


def test_a_grid_that_holds_for_its_own_tool_leaves_the_field_of_other_tools_blank(solution):
    """Roll of Z is open, which a tool on the spindle axis does not show, and tools beside it do."""
    roll = next(f for f in solution.model.functions if f.name == "ECZ")
    null = np.eye(solution.model.n_parameters)[:, roll.parameters]
    found = deviation_fields(replace(solution, null_space=null), (0.0, 0.0, -150.0), [["L-VOL"]], most=3)
    beside = np.hypot(found.tools[:, 0], found.tools[:, 1]) > 0.0
    assert beside.any() and not beside[0]
    np.testing.assert_array_equal(np.isnan(found.values[:, 0, 1]).all(axis=(1, 2)), beside)
    assert np.isfinite(found.values[~beside]).all() and np.isfinite(found.values[:, 0, 0]).any(axis=(1, 2)).all()
    assert np.isfinite(found.motions).all(), "a page holds no numbers that are none"
