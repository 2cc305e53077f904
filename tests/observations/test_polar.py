"""Points as range, azimuth and elevation: readings of the exact chain in any pose, recovery, simulation, files, bad input."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.judging import judge
from support.machines import VERTICAL, fixed
from support.points import PLACE, TURN, points
from support.quick_fit import quick_fit
from support.sets import assert_same_set

from volid.campaign import Campaign, ObservationSet, Station
from volid.exceptions import InputError
from volid.io import load_campaign, write_campaign, write_manifest
from volid.observations import KINDS
from volid.observations.base import NuisanceTable
from volid.observations.point import coordinates
from volid.plausibility.checks import check_campaign
from volid.virtual.simulate import simulate

U = {"u_range": 0.001, "u_azimuth": 1e-4, "u_elevation": 1.5e-4}  # mm, degrees: 2 to 4 µm at 1.5 m


def as_angles(xyz) -> np.ndarray:
    """Range, azimuth in -180 … 180 and elevation of points, by SciPy's rotations: x is turned by -el about y, then az about z."""
    found = []
    for p in np.asarray(xyz):
        r = np.linalg.norm(p)
        elevation = np.rad2deg(np.arcsin(p[2] / r))
        azimuth = np.rad2deg(np.angle(p[0] + 1j * p[1]))
        back = Rotation.from_euler("yz", [-elevation, azimuth], degrees=True).apply([r, 0.0, 0.0])
        np.testing.assert_allclose(back, p, atol=1e-9)
        found.append([r, azimuth, elevation])
    return np.array(found)


def polar(n: int = 60, noise: bool = True, model: str = "") -> tuple[Campaign, object]:
    """The campaign of `points` as a tracker gives it, azimuths from 0 to 360."""
    campaign, truth = points(VERTICAL, n, model=model)
    (one,) = campaign.sets
    u = np.tile(list(U.values()), (n, 1))
    read = as_angles(one.readings) + noise * u * np.random.default_rng(5).standard_normal((n, 3))
    read[:, 1] %= 360.0
    given = ObservationSet(
        "tracker", "polar", one.positions, one.directions, one.tool, read, u, dict(one.labels), options=dict(U)
    )
    return replace(campaign, sets=(given,)), truth


def test_readings_are_those_of_the_exact_chain():
    campaign, _ = polar(40, noise=False)
    readings, table = campaign.sets[0], NuisanceTable()
    np.testing.assert_allclose(coordinates(readings), points(VERTICAL, 40)[0].sets[0].readings, atol=1e-9)
    (group,) = KINDS["polar"].groups(readings, campaign, table)
    rotation = np.array(group.settings.rotation).reshape(3, 3)
    small = Rotation.from_matrix(TURN @ rotation.T).as_rotvec()
    values = np.concatenate([PLACE, small])
    arrays = (jnp.asarray(readings.positions.T), tuple(jnp.asarray(readings.tool.T)), jnp.zeros((24, 40)))
    found = KINDS["polar"].predict(
        campaign.machine, group.settings, *arrays, jnp.asarray(values[group.slots]), jnp.asarray(group.constants)
    )
    nominal = (VERTICAL.functional_point(readings.positions, readings.tool) - PLACE) @ TURN.T
    expected = as_angles(nominal)
    expected[:, 1] += 360.0 * np.round((readings.readings[:, 1] - expected[:, 1]) / 360.0)
    np.testing.assert_allclose(np.asarray(found).T, expected, atol=1e-8)
    assert np.ptp(readings.readings[:, 1]) > 5.0


def test_azimuths_on_both_sides_of_zero_are_neighbours():
    """A station that looks along +X: azimuths jump from 360 to 0 in the middle of the volume."""
    campaign, _ = polar(30, noise=False)
    one = campaign.sets[0]
    nominal = VERTICAL.functional_point(one.positions, one.tool) - np.array([-900.0, 200.0, -300.0])
    read = as_angles(nominal)
    read[:, 1] %= 360.0
    assert (read[:, 1] > 300).any() and (read[:, 1] < 60).any()
    here = replace(campaign, sets=(replace(one, readings=read),))
    (group,) = KINDS["polar"].groups(here.sets[0], here, table := NuisanceTable())
    values = np.array([e.start for e in table.entries])
    arrays = (jnp.asarray(one.positions.T), tuple(jnp.asarray(one.tool.T)), jnp.zeros((24, 30)))
    found = KINDS["polar"].predict(
        here.machine, group.settings, *arrays, jnp.asarray(values[group.slots]), jnp.asarray(group.constants)
    )
    np.testing.assert_allclose(np.asarray(found).T, read, atol=1e-8)


def test_one_tracker_of_unknown_pose_gives_the_volume():
    campaign, truth = polar(200, model=fixed(6))
    solution = quick_fit(campaign)
    assert solution.statements == ()
    weight = np.sqrt(solution.adequacy.chi_square / solution.adequacy.degrees_of_freedom)
    assert 0.85 < weight < 1.2
    found = judge(solution, VERTICAL, truth)
    assert found.rms < 0.006 and 0.6 < found.normalised_rms < 1.5


def test_a_plan_is_simulated_and_files_lose_nothing(tmp_path):
    campaign, _ = polar(30)
    empty = replace(campaign.sets[0], readings=np.full((30, 3), np.nan))
    station = Station("T", position=tuple(PLACE.tolist()))
    plan = replace(campaign, stations=(station,), sets=(empty,))
    again = load_campaign(write_manifest(plan, tmp_path / "plan"), plan=True)
    assert again.sets[0].kind == "polar" and np.isnan(again.sets[0].readings).all()
    measured, _ = simulate(again, seed=3)
    spread = np.std(measured.sets[0].readings - simulate(again, seed=3, noise=False)[0].sets[0].readings, axis=0)
    assert np.all((spread / list(U.values()) > 0.5) & (spread / list(U.values()) < 1.6))
    folder = write_manifest(measured, tmp_path / "c")
    text = folder.read_text()
    header = (folder.parent / "tracker.csv").read_text().splitlines()[0]
    assert 'kind = "point"' in text and "polar" not in text
    assert header.endswith("station,range,azimuth,elevation,u_range,u_azimuth,u_elevation")
    write_campaign(measured, tmp_path / "c.h5")
    for back in (load_campaign(folder), load_campaign(tmp_path / "c.h5")):
        assert_same_set(replace(back.sets[0], source="", rows=None), replace(measured.sets[0], source="", rows=None))
    assert check_campaign(measured) == ()


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda r: r * [1, np.pi / 180, np.pi / 180], "azimuth and elevation seem to be in radians; expected degrees"),
        (lambda r: r * [1, 1 / 0.9, 1 / 0.9], "azimuth and elevation seem to be in gon; expected degrees"),
        (lambda r: r * [1e-3, 1, 1], "range seems to be in metres; expected mm"),
        (lambda r: [0, 0, 90] + r * [1, 1, -1], "elevation seems to be the zenith angle"),
        (lambda r: r * [1, -1, 1], "azimuth seems to count the other way"),
        (lambda r: r * [-1, 1, 1], r"row 1: range is -[0-9.]+ mm; expected a distance > 0"),
    ],
)
def test_slips_of_units_are_named(change, message):
    campaign, _ = polar(40)
    assert check_campaign(campaign) == ()
    wrong = replace(campaign.sets[0], readings=change(campaign.sets[0].readings))
    with pytest.raises(InputError, match=message):
        check_campaign(replace(campaign, sets=(wrong,)))


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("u_azimuth = 0.0001\n", "", r"there is no standard uncertainty; add u_azimuth = … \(degrees\)"),
        ("u_range = 0.001", "u = 0.001", r"one u for readings of different units; expected u_range \(mm\), u_azimuth"),
        ("u_azimuth = 0.0001", "u_azimut = 0.0001", "unknown key 'u_azimut'; did you mean 'u_azimuth'"),
        ("u_elevation = 0.00015", "u_elevation = 0.0", "u_elevation is 0.0; expected"),
    ],
)
def test_mistakes_in_a_manifest_are_named(old, new, message, tmp_path):
    path = write_manifest(polar(10)[0], tmp_path / "c")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=message):
        load_campaign(path)


def test_the_two_forms_do_not_mix(tmp_path):
    path = write_manifest(polar(10)[0], tmp_path / "c")
    csv = path.parent / "tracker.csv"
    csv.write_text(csv.read_text().replace(",range,", ",x,", 1))
    with pytest.raises(
        InputError, match="x beside range, azimuth, elevation; expected one of the two forms of a 'point' set"
    ):
        load_campaign(path)
