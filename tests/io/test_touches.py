"""Touches of a probe on spheres: what a set makes of them; location errors from touches that the exact chain plays."""

import numpy as np
import pytest
from exact_chain import Truth, machine_toml
from support.machines import STRUCTURES, VERTICAL, exact_machine
from support.probe_centres import ONLY_LOCATIONS, TOOL, TRUE
from support.touch_probe import BALL, NOISE, PATTERN, SPHERE, SPHERES, touch

from volid.exceptions import InputError
from volid.fitting.fit import fit
from volid.fitting.location_errors import location_parameter
from volid.io import read_manifest, write_manifest

COUNTS = {"A": 5, "B": 5, "C": 8}
ORIGIN = np.array([15.0, -5.0, 100.0])
MANIFEST = """\
format = "volid-campaign/1"
machine = "machine.toml"
[[set]]
name = "probe"
kind = "displacement"
file = "touches.csv"
touches = true
tool = [0.0, 0.0, -230.0]
"""
ROTARY = "ABC"


def write(folder, exact, columns, keys=""):
    """Files of a campaign with one row for each touch."""
    rows = [",".join(str(c) for c in row) for row in zip(*columns.values(), strict=True)]
    (folder / "touches.csv").write_text("\n".join([",".join(columns), *rows]) + "\n")
    (folder / "machine.toml").write_text(machine_toml(exact, extra=ONLY_LOCATIONS))
    (folder / "campaign.toml").write_text(MANIFEST + keys)
    return folder / "campaign.toml"


def axes_form(exact, data, **more):
    return {a: data.q[:, i].tolist() for i, a in enumerate(exact.axes)} | more


def tip_form(exact, data, **more):
    """What a control with its tool-centre-point function shows, from its own zero."""
    tip = exact.functional_point(data.q, TOOL) - ORIGIN
    rotary = {a: data.q[:, exact.column(a)].tolist() for a in exact.axes if a in ROTARY}
    return rotary | {c: tip[:, i].tolist() for i, c in enumerate("xyz")} | more


@pytest.fixture(scope="module")
def head():
    exact = exact_machine(STRUCTURES["fork head CB"])
    return exact, touch(exact, Truth({}, TRUE), np.random.default_rng(3), COUNTS)


@pytest.mark.parametrize("form", [axes_form, tip_form])
def test_location_errors_from_touches_within_u(head, form, tmp_path):
    """80 centres of two spheres, 8 touches each with 1.5 µm; names by places, groups by rotary positions and gaps."""
    exact, data = head
    keys = f"gap = 40.0\n{f'origin = {ORIGIN.tolist()}' if form is tip_form else ''}"
    campaign = read_manifest(write(tmp_path, exact, form(exact, data), keys))
    (readings,) = campaign.sets
    assert len(readings) == 80 and sorted(set(readings.labels["sphere"])) == ["P1", "P2"]
    solution = fit(campaign)
    assert not solution.adequacy.rejected
    chi_square = solution.adequacy.chi_square / solution.adequacy.degrees_of_freedom
    assert abs(chi_square - 1.0) < 4.0 * np.sqrt(2.0 / solution.adequacy.degrees_of_freedom)
    for name, true in TRUE.items():
        found = location_parameter(solution, name)
        second_order = 5e-8 if "X0" not in name else 2e-5  # products of location errors of some 100 µrad
        assert abs(found.value - true) < 3.5 * found.u + second_order, name
        assert found.u < (2e-6 if "X0" not in name else 1e-3), name


def test_u_of_a_centre_in_the_tool_frame(head, tmp_path):
    """The pattern is the same in the tool frame of every pose: so is u, (AᵀA)⁻¹ of the pattern times the stated u of a touch."""
    exact, data = head
    keys = "touch_u = 0.002\nu = 0.004\n"
    campaign = read_manifest(write(tmp_path, exact, axes_form(exact, data, sphere=data.sphere), keys))
    design = np.column_stack([PATTERN, np.ones(len(PATTERN))])
    variances = np.diag(np.linalg.inv(design.T @ design))[:3]
    expected = np.sqrt(0.002**2 * variances + 0.004**2)
    np.testing.assert_allclose(campaign.sets[0].u, np.tile(expected, (80, 1)), rtol=2e-3)  # normals with noise of 1e-4


def test_centres_are_where_the_exact_chain_has_them(head, tmp_path):
    """Without noise: the axis positions at which the ball's centre would be in the sphere's."""
    exact, _ = head
    truth = Truth({}, TRUE)
    data = touch(exact, truth, np.random.default_rng(0), {"B": 3, "C": 4}, noise=0.0)
    (readings,) = read_manifest(write(tmp_path, exact, axes_form(exact, data, path=data.group), "touch_u = 0.002")).sets
    found = exact.functional_point(readings.positions, TOOL, truth)
    places = np.repeat([SPHERES["P1"], SPHERES["P2"]], 12, axis=0)
    # errors of the machine change by 100 µrad times 16 mm around a sphere, alike on all sides: to second order
    assert np.abs(found - places).max() < 2e-6


def test_a_record_of_what_was_done(head, tmp_path):
    exact, data = head
    data.q[100, exact.column("X")] += 0.06 * np.sign(data.normal[100, 0])  # a chip under one touch
    try:
        campaign = read_manifest(
            write(tmp_path, exact, axes_form(exact, data, path=data.group), "sphere_diameter = 25.4\nball_diameter = 6")
        )
    finally:
        data.q[100, exact.column("X")] -= 0.06 * np.sign(data.normal[100, 0])
    note, left_out = campaign.warnings
    assert (
        "639 touches as 80 sphere centres, radius 15.69" in note
        and "scatter of a touch 1.5 µm with 319 degrees" in note
    )
    assert "touches.csv: the touch in row 102 left out, +" in left_out  # line 1 is the header
    again = read_manifest(write_manifest(campaign, tmp_path / "copy"))
    np.testing.assert_array_equal(again.sets[0].positions, campaign.sets[0].positions)
    np.testing.assert_array_equal(again.sets[0].u, campaign.sets[0].u)
    assert again.warnings == campaign.warnings


def test_groups_by_count(tmp_path):
    data = touch(
        VERTICAL,
        Truth(),
        np.random.default_rng(5),
        {},
        spheres={"a": np.array([100.0, 200.0, -400.0]), "b": np.array([130.0, 200.0, -400.0])},
    )
    columns = axes_form(VERTICAL, data)
    (readings,) = read_manifest(write(tmp_path, VERTICAL, columns, "count = 8")).sets
    assert readings.labels["sphere"].tolist() == ["P1", "P2"]
    with pytest.raises(
        InputError, match=r"touches.csv, rows 2 to 17: 16 touches with one label, pose and tool; .* of count = 7"
    ):
        read_manifest(write(tmp_path, VERTICAL, columns, "count = 7"))
    with pytest.raises(
        InputError,
        match=r"lie .* mm \(rms\) beside the spheres that fit them best; do groups hold touches of several spheres",
    ):
        read_manifest(write(tmp_path, VERTICAL, columns))


def test_time_and_temperature_are_means(tmp_path):
    data = touch(VERTICAL, Truth(), np.random.default_rng(5), {}, spheres={"a": np.array([100.0, 200.0, -400.0])})
    more = {"time": [f"10:00:{i:02d}" for i in range(8)], "temperature": [20.0] * 4 + [21.0] * 4}
    (readings,) = read_manifest(write(tmp_path, VERTICAL, axes_form(VERTICAL, data) | more)).sets
    assert readings.time.tolist() == [36003.5] and readings.temperature.tolist() == [20.5]


WRONG = {
    "radius": (
        "gap = 40\nsphere_diameter = 20.0\nball_diameter = 6.0",
        None,
        r"the fitted radius is 15\.7.. mm; expected 13\.000 mm",
    ),
    "half a radius": ("gap = 40\nsphere_diameter = 20.0", None, r"sphere_diameter without ball_diameter"),
    "nothing to fix": ("gap = 40\nfix_radius = true", None, r"fix_radius = true but no sphere_diameter"),
    "count": ("count = 3", None, r"count is 3; expected the number of touches of each sphere, at least 4"),
    "unknown": ("gap = 40\nspheres = 3", None, r"unknown key 'spheres'"),
    "flag": ("touches = 1", "touches = true\n", r"touches is 1; expected true or false"),
    "no tool": ("gap = 40", "tool = [0.0, 0.0, -230.0]\n", r"there is no tool vector; add tool = \[x, y, z\]"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_said(head, what, tmp_path):
    exact, data = head
    keys, without, message = WRONG[what]
    path = write(tmp_path, exact, axes_form(exact, data), keys)
    if without:
        path.write_text(path.read_text().replace(without, ""))
    with pytest.raises(InputError, match=message):
        read_manifest(path)


def test_touches_of_one_circle_only(tmp_path):
    data = touch(
        VERTICAL,
        Truth(),
        np.random.default_rng(5),
        {},
        spheres={"a": np.array([100.0, 200.0, -400.0])},
        pattern=PATTERN[:6],
    )
    with pytest.raises(InputError, match=r"touches.csv, rows 2 to 7: .*the pole"):
        read_manifest(write(tmp_path, VERTICAL, axes_form(VERTICAL, data), "touch_u = 0.002"))


def test_the_radius_of_the_probe(head, tmp_path):
    """A known radius makes the height more certain."""
    exact, data = head
    keys = f"sphere_diameter = {2 * SPHERE}\nball_diameter = {2 * BALL}\ntouch_u = {NOISE}\n"
    free, fixed = (
        read_manifest(write(tmp_path, exact, axes_form(exact, data), keys + more)).sets[0]
        for more in ("", "fix_radius = true")
    )
    assert (fixed.u[:, 2] < 0.8 * free.u[:, 2]).all()
    assert np.abs(fixed.positions - free.positions).max() < 5 * free.u.max()


def test_places_that_never_agree_are_no_spheres(tmp_path):
    """Rotary axes of another sign, a tool vector of another length: the centres turn about something else."""
    exact = exact_machine(STRUCTURES["fork head CB"])
    data = touch(exact, Truth(), np.random.default_rng(3), {"B": 5, "C": 1}, spheres={"P1": SPHERES["P1"]})
    columns = axes_form(exact, data) | {"B": (-data.q[:, exact.column("B")]).tolist()}
    with pytest.raises(InputError, match=r"the 5 spheres in 5 poses of the rotary axes all stand at different places"):
        read_manifest(write(tmp_path, exact, columns, "touch_u = 0.002"))


def test_touches_are_for_kinds_that_take_centres(tmp_path):
    data = touch(VERTICAL, Truth(), np.random.default_rng(5), {}, spheres={"a": np.array([100.0, 200.0, -400.0])})
    path = write(tmp_path, VERTICAL, axes_form(VERTICAL, data))
    path.write_text(path.read_text().replace('"displacement"', '"distance"'))
    with pytest.raises(InputError, match=r"touches = true in a set of kind 'distance'; expected one of displacement"):
        read_manifest(path)


def test_many_outliers_are_counted_and_too_many_refused(head, tmp_path):
    """One touch of every fourth sphere is 50 µm off along its normal: ten are named, ten counted. A third of all are refused."""
    exact, data = head

    def shifted(share):
        off = 0.05 * np.asarray(share)[:, None] * data.normal
        moved = {a: (data.q[:, exact.column(a)] + off[:, i]).tolist() for i, a in enumerate("XYZ")}
        return axes_form(exact, data, path=data.group) | moved

    campaign = read_manifest(write(tmp_path, exact, shifted(np.arange(len(data.q)) % 32 == 1)))
    said = [w for w in campaign.warnings if "left out" in w]
    assert len(said) == 11 and "10 more touches left out" in said[-1]
    many = shifted(np.random.default_rng(0).random(len(data.q)) < 0.3)
    with pytest.raises(
        InputError, match=r"of 640 touches contradict the others, and \d+ of 80 spheres are contradicted"
    ):
        read_manifest(write(tmp_path, exact, many, "touch_u = 0.002"))
