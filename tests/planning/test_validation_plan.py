"""A second set-up: other stations, positions between the fit's, other tools and spheres; within what was measured."""

from dataclasses import replace

import numpy as np
import pytest
from support.places import DATASETS, MODELS

from volid.exceptions import InputError
from volid.io import load_campaign, read_machine
from volid.model.kinematics import nominal_point
from volid.planning.circles import circles
from volid.planning.validation import validation_plan


@pytest.fixture(scope="module")
def fitted():
    return load_campaign(DATASETS / "vertical_multilateration" / "campaign.toml")


def test_stations_tools_and_levels_are_others(fitted):
    plan = validation_plan(fitted.machine, fitted, n=50)
    assert plan.n_readings == 200 and len(plan.stations) == 4
    old = np.array([s.position for s in fitted.stations])
    new = np.array([s.position for s in plan.stations])
    # the machine is 1000 × 600 × 500 mm: well away from every station, and from each other
    assert np.linalg.norm(new[:, None] - old, axis=2).min() > 250.0
    assert np.linalg.norm(new[:, None] - new, axis=2)[~np.eye(4, dtype=bool)].min() > 300.0
    assert not set(map(tuple, plan.tool_vectors().tolist())) & set(map(tuple, fitted.tool_vectors().tolist()))
    assert np.linalg.matrix_rank(plan.tool_vectors() - plan.tool_vectors()[0], tol=1.0) == 2
    for own, theirs, (low, high) in zip(
        plan.sets[0].positions.T, fitted.sets[0].positions.T, fitted.measured_range(), strict=True
    ):
        assert not np.isin(own, np.unique(theirs)).any()
        assert own.min() >= low and own.max() <= high and np.ptp(own) > 0.8 * (high - low)


def test_no_station_stands_in_the_way_of_the_tool(fitted):
    plan = validation_plan(fitted.machine, fitted)
    swept = nominal_point(fitted.machine, plan.sets[0].positions, plan.sets[0].tool)
    low, high = swept.min(axis=0), swept.max(axis=0)
    for station in plan.stations:
        assert np.any((np.array(station.position) < low - 50.0) | (np.array(station.position) > high + 50.0))
        assert not np.all((np.array(station.position)[:2] > low[:2]) & (np.array(station.position)[:2] < high[:2]))


def test_an_r_test_is_planned_for_an_r_test():
    fitted = load_campaign(DATASETS / "five_axis_rtest" / "campaign.toml")
    plan = validation_plan(fitted.machine, fitted)
    (own,), (theirs,) = plan.sets, fitted.sets
    assert own.kind == theirs.kind and len(own) > 100 and not plan.warnings
    rotary = [i for i, a in enumerate(fitted.machine.axes) if not a.is_linear]
    for i in rotary:
        assert not np.isin(own.positions[:, i], np.round(theirs.positions[:, i], 6)).any()
    spheres = [np.array(list(s.options["sphere"].values())) for s in (own, theirs)]
    assert np.linalg.norm(spheres[0][:, None] - spheres[1], axis=2).min() > 20.0
    assert not set(map(tuple, plan.tool_vectors().tolist())) & set(map(tuple, fitted.tool_vectors().tolist()))


def test_circles_are_planned_for_a_ball_bar():
    machine = read_machine(MODELS / "wYXbZt_vertical.toml")
    bar = circles(machine, ("XY", "ZX"))
    fitted = replace(bar, sets=tuple(replace(s, readings=np.full(s.readings.shape, 150.001)) for s in bar.sets))
    plan = validation_plan(machine, fitted, n=37)
    assert len(plan.sets) == 3 and not plan.sets[0].options["relative"]
    middles = [np.array(c.stations[0].position) for c in (plan, fitted)]
    assert np.linalg.norm(middles[0] - middles[1]) > 10.0
    radius = np.linalg.norm(nominal_point(machine, plan.sets[0].positions, plan.sets[0].tool) - middles[0], axis=1)
    np.testing.assert_allclose(radius, 120.0, atol=1e-5)


def test_what_makes_no_plan_is_refused(fitted):
    with pytest.raises(InputError, match="n"):
        validation_plan(fitted.machine, fitted, n=1)
    with pytest.raises(InputError, match="seed"):
        validation_plan(fitted.machine, fitted, seed=-1)
    with pytest.raises(InputError, match="u"):
        validation_plan(fitted.machine, fitted, u=-0.001)
    other = read_machine(MODELS / "wXYbZt_vertical.toml")  # the same axes in another order
    with pytest.raises(InputError, match="expected the machine that was measured"):
        validation_plan(other, fitted)
