"""The virtual tracking interferometer: where it stands, what it reads, and its files."""

import csv
import tomllib

import numpy as np
import pytest

from exact_chain import (
    Truth,
    approach_directions,
    default_stations,
    default_tools,
    machine_toml,
    random_truth,
    spread_positions,
    tracker_campaign,
    write_campaign,
)
from exact_chain.checks import MACHINE


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
