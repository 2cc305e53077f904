"""Sphere centres found by a touch probe: a control with its tool-centre-point function on, played by the exact chain."""

import numpy as np
import pytest
from exact_chain import Truth
from support.machines import STRUCTURES, exact_machine
from support.probe_centres import ORIGIN, SPHERE, TCP, TRUE, probed, write

from volid.exceptions import InputError
from volid.fitting.fit import fit
from volid.fitting.location_errors import location_parameter
from volid.io import read_manifest, write_manifest
from volid.plausibility.checks import check_campaign, closures


@pytest.fixture(scope="module")
def head():
    """Fork head C, B and the axis positions that a control finds with location errors of some 0.1 mm."""
    exact = exact_machine(STRUCTURES["fork head CB"])
    return exact, probed(exact, Truth({}, TRUE))


def test_tool_tip_coordinates_become_axis_positions(head, tmp_path):
    exact, q = head
    campaign = read_manifest(write(tmp_path, exact, q))
    (readings,) = campaign.sets
    np.testing.assert_allclose(readings.positions, q, atol=1e-9)
    assert not readings.readings.any() and readings.readings.shape == (45, 3)
    np.testing.assert_allclose(readings.options["sphere"]["1"], SPHERE, atol=0.2)  # mean of what the control shows
    again = read_manifest(write_manifest(campaign, tmp_path / "copy"))
    np.testing.assert_array_equal(again.sets[0].positions, readings.positions)
    assert check_campaign(campaign) == ()


def test_origin_of_the_control_counts_with_a_table(tmp_path):
    """With the workpiece turning, tool-tip coordinates turn about the machine's origin, wherever the control has its zero."""
    exact = exact_machine(STRUCTURES["tilting table C'A'"])
    q = probed(exact, Truth({}, {"EX0C": 0.02, "EB0A": 50e-6}))
    keys = TCP.replace("B = ", "A = ").replace("B_deg", "A_deg") + f"\norigin = {ORIGIN.tolist()}"
    campaign = read_manifest(write(tmp_path, exact, q, keys, origin=ORIGIN))
    np.testing.assert_allclose(campaign.sets[0].positions, q, atol=1e-9)


def test_axis_positions_are_taken_as_they_stand(head, tmp_path):
    exact, q = head
    path = write(tmp_path, exact, q, "centres = true\nsphere = [41.0, -61.0, 89.0]", exact.axes, cells=q)
    (readings,) = read_manifest(path).sets
    np.testing.assert_array_equal(readings.positions, q)
    assert not readings.readings.any() and readings.options["sphere"] == [41.0, -61.0, 89.0]


def test_fit_finds_the_location_errors(head, tmp_path):
    """Errors that one sphere and one tool length tell; exact data, so second order of 0.1 mm in 300 mm is left: 0.1 µm."""
    exact, q = head
    solution = fit(read_manifest(write(tmp_path, exact, q)))
    assert not solution.adequacy.rejected
    for name, true in TRUE.items():
        found = location_parameter(solution, name)
        assert abs(found.value - true) < (1e-3 if name == "EX0B" else 3e-6), name
        assert found.u > 0.0
    assert {"EX0C", "EY0C", "EZ0B"} <= set(solution.undetermined)


def test_repeated_centres_are_compared_by_their_places(head, tmp_path):
    exact, q = head
    q = np.concatenate([q, q[:6]])
    q[45:, exact.column("X")] += 0.010  # the same rotary positions found 10 µm further in X
    found = {c.reading: c for c in closures(read_manifest(write(tmp_path, exact, q)))}
    assert [found[c].n for c in "xyz"] == [6, 6, 6]
    assert found["x"].rms == pytest.approx(0.010, abs=1e-9)
    assert found["y"].rms == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (TCP.replace("seq", "number"), r"set 'probe': ignore names 'number', which is no column of .*centres.csv"),
        (TCP.replace("x_mm", "x_mn"), r"columns names 'x_mn', which is no column of .*; did you mean 'x_mm'\?"),
        (TCP.replace('x = "x_mm"', 'y = "x_mm"').replace(', y = "y_mm"', ""), r"two columns|column 'x' is missing"),
        (TCP.replace('\nignore = ["seq"]', ""), r"unknown column 'seq'.*`ignore` leaves them out"),
        (TCP.replace('["seq"]', '"seq"'), r"ignore is \"seq\"; expected a list of column names"),
        (
            TCP.replace("centres = true", "origin = [0, 0, 0]"),
            r"origin is for tool-tip coordinates; add centres = true",
        ),
        (TCP.replace("centres = true", "centres = 1"), r"centres is 1; expected true or false"),
        (TCP.replace('z = "z_mm"', 'Z = "z_mm"'), r"centres are given twice, by axis positions Z and by .* x, y"),
    ],
)
def test_mistakes_are_named(head, tmp_path, keys, message):
    exact, q = head
    with pytest.raises(InputError, match=message):
        read_manifest(write(tmp_path, exact, q, keys))


def test_a_plan_holds_no_centres(head, tmp_path):
    exact, q = head
    with pytest.raises(InputError, match="centres = true is for centres that were found"):
        read_manifest(write(tmp_path, exact, q), plan=True)
