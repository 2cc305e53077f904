"""Where a campaign's stations, points and tools are drawn, against the exact chain and the truth of the bundled campaigns."""

import numpy as np
import pytest
from support.machines import exact_machine, volid_machine
from support.places import ROOT

import volid
from volid.report.contents.scene import _box, scene_of, seen_from_table

TOOL = np.array([30.0, -20.0, -150.0])


@pytest.mark.parametrize("layout", ["w X' Y' b Z t", "w C' A' Y' X' b Z t", "w Y' b X Z C A t"])
def test_the_box_and_points_are_those_of_the_exact_chain(layout):
    exact = exact_machine(layout)
    machine, rng = volid_machine(exact), np.random.default_rng(2)
    q = np.stack([rng.uniform(*exact.travel[a], 9) for a in exact.axes], axis=1)
    still = q.copy()
    for letter in exact.axes:
        if letter in "ABC" and exact.primed[letter]:
            still[:, exact.column(letter)] = 0.0
    expected = np.einsum("mij,j->mi", exact.nominal_pose(still), np.append(TOOL, 1.0))[:, :3]
    np.testing.assert_allclose(seen_from_table(machine, q, TOOL), expected, rtol=0, atol=1e-9)
    corners = _box(machine, TOOL)
    low, high = (np.array([exact.travel[a][k] for a in "XYZ"]) for k in (0, 1))
    rest = np.zeros((1, len(exact.axes)))
    shift = (exact.nominal_pose(rest)[0] @ np.append(TOOL, 1.0))[:3]
    np.testing.assert_allclose(corners.min(axis=0), low + shift, atol=1e-9)
    np.testing.assert_allclose(corners.max(axis=0), high + shift, atol=1e-9)


def test_stations_stand_where_the_truth_of_the_campaign_has_them(fitted_vertical):
    scene = scene_of(fitted_vertical, (0.0, 0.0, -150.0))
    lines = (ROOT / "datasets/vertical_multilateration/truth_instruments.csv").read_text(encoding="utf-8").splitlines()
    truth = {}
    for line in lines:
        cells = line.split(",")
        if cells[0].startswith("station ") and len(cells[0].split()) == 3:
            _, name, c = cells[0].split()
            truth.setdefault(name, {})[c] = float(cells[2])
    assert truth
    for stand in scene.stations:
        there = np.array([truth[stand.name][c] for c in "XYZ"])
        np.testing.assert_allclose(stand.place, there, atol=0.05)  # mm; the fit is good to some µm in its own frame
        assert len(scene.beams[stand.name]) <= 40
    assert scene.not_placed == ()


@pytest.fixture(scope="module")
def fitted_vertical():
    return volid.fit(volid.load_campaign(ROOT / "datasets/vertical_multilateration/campaign.toml"))


def test_points_are_thinned_evenly_and_keep_their_residuals(fitted_vertical):
    scene = scene_of(fitted_vertical, (0.0, 0.0, -150.0))
    (points,) = scene.points
    assert scene.n_points == 2400
    assert len(points.places) == len(points.normalised) == 1200
    np.testing.assert_allclose(points.normalised, np.abs(fitted_vertical.readings.normalised[0][::2, 0]))
    own = fitted_vertical.campaign.sets[0]
    machine = fitted_vertical.machine
    x, y, z = (own.positions[2, machine.index(a)] + own.tool[2, k] for k, a in enumerate("XYZ"))
    np.testing.assert_allclose(points.places[1], [x, y, z], atol=1e-9)  # workpiece frame of a cross table: X + tool, …


def test_lines_and_spheres_of_other_kinds():
    positioning = volid.fit(volid.load_campaign(ROOT / "datasets/published_positioning/campaign.toml"))
    scene = scene_of(positioning, (0.0, 0.0, 0.0))
    assert [np.ptp(line, axis=0).tolist() for line in scene.lines] == [[500.0, 0.0, 0.0], [0.0, 0.0, 325.0]]
    assert scene.tools == ()  # of no length
    rtest = volid.load_campaign(ROOT / "datasets/five_axis_rtest/campaign.toml")
    stated = rtest.sets[0].options["sphere"]
    found = scene_of(volid.fit(rtest), (0.0, 0.0, -180.0))
    assert {s.name: s.place.tolist() for s in found.spheres} == {k: list(v) for k, v in stated.items()}
