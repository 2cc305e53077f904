"""The count apart from the package, on the cases whose answer is known."""

import numpy as np
import pytest

from exact_chain import ExactMachine, default_stations, spread_positions
from exact_chain.ranks import differences, offsets, rank, sensitivities, without

BED_XYZ = ExactMachine("w b X Y Z t", {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)})
ONE = [[0.0, 0.0, -150.0]]
ON_AXIS = [[0.0, 0.0, -150.0], [0.0, 0.0, -250.0]]
THREE = [[0.0, 0.0, -150.0], [80.0, 0.0, -250.0], [0.0, 90.0, -200.0]]


@pytest.mark.parametrize("tools, expected", [(ONE, 53), (ON_AXIS, 61), (THREE, 69)])
def test_three_dimensional_positions(tools, expected):
    """Positions in a frame that is unknown, with one, two collinear, three tool vectors, modulo a rotation of the tool."""
    q = np.concatenate([spread_positions(BED_XYZ, 120, np.random.default_rng(i)) for i in range(len(tools))])
    tool = np.repeat(tools, 120, axis=0)

    def points(truth):
        return BED_XYZ.functional_point(q, tool, truth)

    def placed(p):  # translation and rotation of the frame, and a rotation of the tool
        moved = points_nominal + p[:3] + np.cross(p[3:6], points_nominal)
        return moved + np.cross(p[6:9], tool)

    points_nominal = BED_XYZ.functional_point(q, tool)
    nuisance = differences(placed, np.zeros(9), np.full(9, 1e-3))
    found, gap = rank(without(nuisance, sensitivities(BED_XYZ, points)))
    assert found == expected and gap > 1e3


def test_a_station_with_dead_paths_adds_nothing_that_positions_do_not_have():
    q, tool = spread_positions(BED_XYZ, 600, np.random.default_rng(3)), np.tile(ONE[0], (600, 1))
    places = np.array(list(default_stations(BED_XYZ).values()))
    station = np.arange(600) % len(places)

    def lengths(truth=None, moved=0.0):
        return np.linalg.norm(BED_XYZ.functional_point(q, tool, truth) - (places + moved)[station], axis=1)

    def of_places(p):
        return lengths(moved=p.reshape(-1, 3))

    steps = np.full(places.size, 1e-2)
    nuisance = np.hstack([differences(of_places, np.zeros(places.size), steps), offsets(station)])
    found, gap = rank(without(nuisance, sensitivities(BED_XYZ, lengths)))
    assert found == 53 and gap > 1e3
