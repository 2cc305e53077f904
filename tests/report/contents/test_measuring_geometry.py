"""The measuring geometry: stations where they truly stand, points where the exact chain has them, in the frame that is named."""

import re

import numpy as np
import pytest
from support.small_campaign import fitted, make_campaign

from volid.io import load_campaign
from volid.report.contents.geometry import frame_of, geometry_of, points_of, spheres_of


@pytest.fixture(scope="module")
def found(solution):
    return geometry_of(solution)


def test_stations_stand_where_they_truly_do(found, virtual):
    truth = virtual.campaign.station_positions
    assert {s.name for s in found.stations} == set(truth)
    for (
        station
    ) in found.stations:  # stated places are wrong by 5 mm; the datum moves the frame by the machine's errors, 0.1 mm
        assert station.place == pytest.approx(truth[station.name], abs=0.5)
        assert station.estimated


def test_stations_that_know_each_other_are_carried_to_where_they_stand(tmp_path):
    """Their places are stated in a frame of their own, a quarter turn and a metre away."""
    virtual = make_campaign(tmp_path)
    text = virtual.manifest.read_text(encoding="utf-8")
    turn, shift = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([1000.0, -200.0, 50.0])
    truth = virtual.campaign.station_positions
    for name, place in truth.items():
        own = [float(c) for c in turn @ place + shift]
        text = re.sub(
            rf'(name = "{name}".*?position = )\[[^]]*\]', rf"\g<1>{own}\nknown = true", text, count=1, flags=re.DOTALL
        )
    virtual.manifest.write_text(text, encoding="utf-8")
    solution = fitted(virtual)
    assert all(station.is_placed for station in solution.campaign.stations)
    found = geometry_of(solution)
    assert len(found.stations) == len(truth)
    for station in found.stations:
        assert station.place == pytest.approx(truth[station.name], abs=0.5)


def test_points_are_those_of_the_exact_chain(found, virtual, solution):
    (readings,) = solution.campaign.sets
    expected = virtual.machine.functional_point(readings.positions, readings.tool)
    assert found.points == pytest.approx(np.unique(np.round(expected, 3), axis=0), abs=2e-3)
    assert found.body == "workpiece"


def test_volume_is_the_travel_moved_by_the_tool(found, solution):
    tool = np.array(solution.most_used_tool())
    travel = np.array([solution.campaign.machine.axis(a).travel for a in "XYZ"])
    assert found.corners.min(axis=0) == pytest.approx(travel[:, 0] + tool)
    assert found.corners.max(axis=0) == pytest.approx(travel[:, 1] + tool)


def test_points_turn_with_the_table_that_the_stations_stand_on(rotary_solution):
    found = geometry_of(rotary_solution)
    (readings,) = rotary_solution.campaign.sets
    c, *linear = (readings.positions[:, rotary_solution.machine.index(a)] for a in "CXYZ")
    pivot, turn = np.array([500.0, 300.0]), np.deg2rad(c)
    x, y = (np.stack(linear[:2]) + readings.tool.T[:2]) - pivot[:, None]
    turned = np.stack(
        [np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y]
    )  # ISO 841: C' turns the
    expected = turned + pivot[:, None]  # workpiece backwards, so that the tool goes on about it
    distances = np.linalg.norm(found.points[:, None, :2] - expected.T[None], axis=2).min(axis=1)
    assert found.body == "workpiece"
    assert distances.max() < 2e-3


def test_spheres_are_seen_in_the_frame_under_the_rotary_axes():
    campaign = load_campaign("datasets/five_axis_rtest/campaign.toml")
    assert frame_of(campaign) == "Y"
    assert [s.name for s in spheres_of(campaign)] == ["P1", "P2", "P3"]
    (readings,) = campaign.sets
    linear = readings.positions[:, [campaign.machine.index(a) for a in "XYZ"]]  # all between that frame and the tool
    expected = np.unique(np.round(linear + readings.tool, 3), axis=0)
    assert points_of(campaign, "Y") == pytest.approx(expected, abs=2e-3)
