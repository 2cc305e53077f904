"""Standard paths as plans: the exact chain finds the sphere in the nest at every position, inside the travels."""

import numpy as np
import pytest
from support.machines import exact_of
from support.places import MODELS
from support.plans import CASES, FIVE, grid

from volid.exceptions import InputError
from volid.io import load_campaign, read_machine, write_manifest
from volid.planning import cone_frustum, iso10791_path, rtest_static_grid
from volid.planning.following import follow, one_turn
from volid.plausibility.checks import check_campaign
from volid.virtual.simulate import simulate

ROUNDING = 1e-10  # mm, over metres
ROUNDED = 1e-6  # mm: planned positions are rounded to 1e-6, half of it on each of three axes


def assert_inside(machine, plan) -> None:
    for readings in plan.sets:
        for i, axis in enumerate(machine.axes):
            q = readings.positions[:, i]
            assert axis.travel[0] - 1e-6 <= q.min() and q.max() <= axis.travel[1] + 1e-6, axis.letter


def test_every_machine_with_rotary_axes_is_planned_for():
    assert sorted(CASES) == sorted(f.stem for f in MODELS.glob("*.toml") if len(read_machine(f).letters) > 3)


@pytest.mark.parametrize("name", CASES)
def test_the_sphere_stays_in_the_nest_of_the_exact_chain(name):
    machine, plan = grid(name)
    readings = plan.sets[0]
    assert_inside(machine, plan)
    place = np.array([readings.options["sphere"][s] for s in readings.labels["sphere"]])
    point = exact_of(machine).functional_point(readings.positions, readings.tool)
    np.testing.assert_allclose(point, place, rtol=0, atol=ROUNDED)
    rotary = [i for i, a in enumerate(machine.axes) if not a.is_linear]
    asked = 7 * (5 if len(rotary) == 2 else 1) * 3
    assert len(readings) == asked - sum(int(w.split(": ")[1].split()[0]) for w in plan.warnings)
    assert len(readings) > 0.7 * asked
    assert all(len(np.unique(np.round(readings.positions[:, i], 9))) == n for i, n in zip(rotary, (7, 5), strict=False))
    assert np.isnan(readings.readings).all()


@pytest.mark.parametrize("name", FIVE)
@pytest.mark.parametrize("test", ["K1", "K2", "K4"])
def test_iso_paths_move_the_right_axes(name, test):
    machine = read_machine(MODELS / f"{name}.toml")
    places, tools, letter = CASES[name]
    plan = iso10791_path(machine, letter + test, places[0], tools[0], 25)
    readings = plan.sets[0]
    assert_inside(machine, plan)
    first, second = (i for i, a in enumerate(machine.axes) if not a.is_linear)
    moved = {i for i in (first, second) if np.ptp(readings.positions[:, i]) > 0}
    assert moved == {"K1": {second}, "K2": {first}, "K4": {first, second}}[test]
    for i in moved:
        step, way = np.diff(readings.positions[:, i]), readings.directions[:, i]
        assert set(way) == {1.0, -1.0}
        assert (step[way[1:] == way[:-1]] * way[1:][way[1:] == way[:-1]] > 0).all()
    point = exact_of(machine).functional_point(readings.positions, readings.tool)
    np.testing.assert_allclose(point, np.broadcast_to(places[0], point.shape), rtol=0, atol=ROUNDED)


@pytest.mark.parametrize(
    ("name", "centre", "tool", "options"),
    [
        ("wCAYXbZt_trunnion", (30, 40, 60), (0, 0, -150), {"inclination": 30.0}),
        ("wCXbYZBt_swivel_head", (30, 40, 100), (0, 0, -60), {}),
        ("wbXYZCAt_fork_head", (1500, 1000, -600), (0, 0, -100), {"half_angle": 30.0, "inclination": 0.0}),
        ("wCBYbXZt_nutating_table", (30, 40, 60), (0, 0, -150), {"inclination": 30.0}),
    ],
)
def test_the_bar_keeps_its_length_and_stands_square_to_the_tool(name, centre, tool, options):
    machine = read_machine(MODELS / f"{name}.toml")
    plan = cone_frustum(machine, centre, tool, length=80.0, n=37, **options)
    readings, exact = plan.sets[0], exact_of(machine)
    assert_inside(machine, plan)
    assert len(readings) > 25
    bar = exact.functional_point(readings.positions, readings.tool) - plan.stations[0].position
    np.testing.assert_allclose(np.linalg.norm(bar, axis=1), 80.0, rtol=0, atol=ROUNDED)
    axis = exact.nominal_pose(readings.positions)[:, :3, 2]
    np.testing.assert_allclose(np.einsum("ij,ij->i", axis, bar), 0.0, atol=1e-6)
    cone = np.array(
        [np.sin(np.deg2rad(plan_angle := options.get("inclination", 10.0))), 0, np.cos(np.deg2rad(plan_angle))]
    )
    np.testing.assert_allclose(axis @ cone, np.cos(np.deg2rad(options.get("half_angle", 15.0))), atol=1e-8)


def test_plans_are_simulated_and_written(tmp_path):
    _, plan = grid("wCAYXbZt_trunnion", 5, 3)
    campaign, truth = simulate(plan, seed=2)
    assert check_campaign(campaign) == ()
    assert 0.001 < np.abs(campaign.sets[0].readings).max() < 0.5
    assert truth.instruments["sphere P1 X"] == 60.0
    assert abs(campaign.sets[0].options["sphere"]["P1"][0] - 60.0) > 0.1
    again = load_campaign(write_manifest(plan, tmp_path / "plan"), plan=True)
    np.testing.assert_array_equal(again.sets[0].positions, plan.sets[0].positions)
    again, _ = simulate(again, seed=2)
    np.testing.assert_array_equal(again.sets[0].readings, campaign.sets[0].readings)


def test_a_long_travel_is_planned_over_one_turn_that_holds_zero():
    machine = read_machine(MODELS / "wbXYZCAt_fork_head.toml")
    assert one_turn(machine.axis("C")) == (-180.0, 180.0)
    assert one_turn(machine.axis("A")) == (-110.0, 110.0)


def test_positions_outside_the_travel_are_left_out_and_named():
    machine = read_machine(MODELS / "wCAYXbZt_trunnion.toml")
    plan = rtest_static_grid(machine, {"P1": (290, 0, 30)}, (0, 0, -120), 5, 13)
    (warning,) = plan.warnings
    assert warning.startswith("static grid, sphere 'P1': ")
    assert "of 65 positions left out: " in warning and "Z would need" in warning and "travel 0 … 550" in warning
    assert_inside(machine, plan)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda m: rtest_static_grid(m, {"P": (2000, 0, 0)}, (0, 0, 0), 3, 3),
            r"no position lies within the travels: .*X would",
        ),
        (
            lambda m: rtest_static_grid(m, {"P": (0, 0, 0)}, (0, 0, 0), 1, 3),
            "1 positions of axis C; expected at least 2",
        ),
        (
            lambda m: rtest_static_grid(m, {"P": (0, 0)}, (0, 0, 0)),
            r"`sphere`: an array of shape \(2,\); expected vectors of three numbers in mm",
        ),
        (
            lambda m: rtest_static_grid(m, dict.fromkeys("PQR", (0, 0, 0)), [(0, 0, 0), (100, 0, 0)]),
            "3 spheres and 2 tool vectors; expected as many, or one of either",
        ),
        (lambda m: iso10791_path(m, "AK1", (0, 0, 0), (0, 0, 0)), "'AK1' is not for machine .* expected BK1, BK2, BK4"),
        (lambda m: iso10791_path(m, "BK3", (0, 0, 0), (0, 0, 0)), "'BK3' is not for machine"),
    ],
)
def test_what_is_wrong_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call(read_machine(MODELS / "wCAYXbZt_trunnion.toml"))


def test_machines_that_cannot_follow():
    three = read_machine(MODELS / "wYXbZt_vertical.toml")
    with pytest.raises(InputError, match="has no rotary axis; expected one or two"):
        rtest_static_grid(three, {"P": (0, 0, 0)}, (0, 0, 0))
    four = read_machine(MODELS / "wAXYbZt_rotary_table.toml")
    with pytest.raises(InputError, match="has 1 rotary axes; K1 of ISO 10791-6 needs two"):
        iso10791_path(four, "K1", (0, 0, 0), (0, 0, 0))
    q = np.array([[30.0, 1.0, 2.0, 3.0]])
    there = follow(four, q, (0, 0, -50), (10, 20, 30))
    assert there[0, 0] == 30.0
    np.testing.assert_allclose(exact_of(four).functional_point(there, (0, 0, -50)), [[10, 20, 30]], atol=ROUNDING)
