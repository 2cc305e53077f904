"""Changing the datum is a transformation: the same answer as a fit in that datum, there and back, covariance included."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from exact_chain import gauge_basis, random_truth, tracker_campaign
from support.machines import VERTICAL, fixed, volid_machine
from support.trackers import distance_campaign

from volid.exceptions import InputError
from volid.fitting.datum import parse_datum
from volid.fitting.fit import fit
from volid.fitting.prediction.deviations import gradient_matrix
from volid.model.machine import Datum, Machine

DATUMS = {
    "primary Z, secondary X": Datum("Z", "X"),
    "primary Y, secondary X": Datum("Y", "X"),
    "end points": Datum(line="end_point"),
    "other reference": Datum(reference=(("X", 100.0), ("Z", 0.0))),
    "everything": Datum("Y", "Z", "end_point", (("Y", 0.0),)),
}
REFITTED = ("primary Z, secondary X", "everything")  # compared with a fit of their own
# The transformation is linear. What it leaves out is the product of two errors: 50 µrad · 50 µrad · 500 mm = 1e-6 mm.
FIELD = 1e-6  # mm: 1 nm
ANGLE = 5e-9  # rad: (70 µrad)²


def in_machine_datum(campaign, datum):
    """The campaign with `datum` in the machine file."""
    m = campaign.machine
    return replace(campaign, machine=Machine(m.name, m.structure, m.axes, datum, m.model))


@cache
def campaign_of(every_tool=True, extra=""):
    rng = np.random.default_rng(8)
    truth = random_truth(VERTICAL, rng, waviness=0.3)
    tracker = tracker_campaign(VERTICAL, truth, rng, n_per_station=60, every_station_sees_every_tool=every_tool)
    return distance_campaign(volid_machine(VERTICAL, fixed(4, extra)), tracker)


@cache
def solution(every_tool=True):
    return fit(campaign_of(every_tool))


@cache
def fitted_in(name, every_tool=True):
    return fit(in_machine_datum(campaign_of(every_tool), DATUMS[name]))


def points(n=40):
    rng = np.random.default_rng(0)
    low, high = np.array([VERTICAL.travel[a] for a in VERTICAL.axes], float).T
    return low + rng.random((n, 3)) * (high - low), rng.uniform(-200, 200, (n, 3))


def fields(a, b):
    """Two deviation fields and the largest difference of points [mm] without a rigid motion of the workpiece frame."""
    q, tool = points()
    one, other = (np.asarray(s.deviation(q, tool)) for s in (a, b))
    removed = gauge_basis(q, tool, VERTICAL, tool_rotation=False)
    difference = (one - other)[:, :3].reshape(-1)
    left = difference - removed @ (removed.T @ difference)
    turn = (one - other)[:, 3:]
    return np.abs(one - other)[:, :3].max(), np.abs(left).max(), np.abs(turn - turn.mean(axis=0)).max()


@pytest.mark.parametrize("name", REFITTED)
def test_in_datum_is_the_fit_in_that_datum(name):
    moved, refitted = solution().in_datum(DATUMS[name]), fitted_in(name)
    assert moved.datum == refitted.datum == DATUMS[name]
    as_it_was, _, _ = fields(solution(), refitted)
    assert as_it_was > 1e-4, "the datum makes a difference"
    raw, without_motion, turn = fields(moved, refitted)
    assert without_motion < FIELD and turn < ANGLE
    assert raw < 3 * FIELD, "in one datum even the rigid motion agrees"


@pytest.mark.parametrize("name", REFITTED)
def test_functions_and_uncertainties_agree_with_the_fit_in_that_datum(name):
    moved, refitted = solution().in_datum(DATUMS[name]), fitted_in(name)
    ours, theirs = moved.functions(points=5), refitted.functions(points=5)
    assert [(f.name, f.position) for f in ours if f.position == f.position] == [
        (f.name, f.position) for f in theirs if f.position == f.position
    ]
    for a, b in zip(ours, theirs, strict=True):
        size = ANGLE if a.name[1] in "ABC" else 3 * FIELD
        assert abs(a.value - b.value) < size, a
        # both are linear propagations, at parameters that differ by 1e-4 of a radian: relative 1e-4; 0 at the reference
        assert a.u == pytest.approx(b.u, rel=1e-3, abs=1e-3 * size), a


@pytest.mark.parametrize("name", DATUMS)
def test_there_and_back(name):
    there = solution().in_datum(DATUMS[name])
    back = there.in_datum(solution().datum)
    np.testing.assert_allclose(back.parameters, solution().parameters, atol=1e-9)
    scale = np.sqrt(np.diagonal(solution().covariance))
    agree = (np.asarray(back.covariance) - np.asarray(solution().covariance)) / np.outer(scale, scale)
    # stations move by up to 0.1 mm in 1 m, and turn about where they then are
    assert np.abs(agree).max() < 2e-4
    assert np.abs(np.asarray(there.covariance) - np.asarray(there.covariance).T).max() < 1e-12


def test_rules_of_the_new_datum_hold():
    moved = solution().in_datum(Datum("Z", "X", "end_point", (("Y", 100.0),)))
    functions = {}
    for f in moved.functions(points=3):
        functions.setdefault(f.name, []).append(f.value)
    assert "EB0X" in functions and "EC0Y" in functions and "EB0Z" not in functions
    for name, values in functions.items():
        if len(values) == 3 and name[1] in "XYZ" and name[1] != name[2]:
            assert values[0] == pytest.approx(values[2], abs=1e-12), f"{name}: the line through the end points"
    at_reference = moved.motion("EAY", np.array([100.0]))[0]
    assert abs(at_reference.value) < 1e-15 and at_reference.u < 1e-12


@pytest.mark.parametrize("name", REFITTED)
def test_stations_move_along(name):
    """Distances are what was measured: stations of the transformed solution are those of the fit in that datum."""
    moved, refitted = solution().in_datum(DATUMS[name]), fitted_in(name)
    # a station 1 m off turns by second order too
    np.testing.assert_allclose(moved.nuisance, refitted.nuisance, atol=3 * FIELD)
    n, m = moved.model.n_parameters, refitted.model.n_parameters
    ours, theirs = (np.sqrt(np.diagonal(s.covariance))[k:] for s, k in ((moved, n), (refitted, m)))
    np.testing.assert_allclose(ours, theirs, rtol=1e-3)
    before = np.asarray(solution().nuisance)
    assert np.abs(before - np.asarray(moved.nuisance)).max() > 1e-4


def test_field_covariance_follows_the_field():
    """u of the deviation after removing the rigid motion is the same in both datums."""
    q, tool = points(20)
    removed = gauge_basis(q, tool, VERTICAL, tool_rotation=False)
    spread = []
    for s in (solution(), solution().in_datum(Datum("Z", "Y", "end_point"))):
        rows = gradient_matrix(s.model, np.asarray(s.parameters), q, tool, np.zeros_like(q))[:, :3].reshape(60, -1)
        rows = rows - removed @ (removed.T @ rows)
        spread.append(np.sqrt(np.einsum("ij,jk,ik->i", rows, s.parameter_covariance, rows)))
    np.testing.assert_allclose(spread[0], spread[1], rtol=1e-3)


def test_held_tool_rotation_stays_held():
    moved, refitted = solution(False).in_datum(Datum("Z", "X")), fitted_in("primary Z, secondary X", False)
    assert solution(False).held_tool_rotation == moved.held_tool_rotation == ("EA0S", "EB0S", "EC0S")
    for name in moved.held_tool_rotation:
        assert np.asarray(moved.parameters)[moved.model.by_name[name, "location"].parameters] == pytest.approx(
            0, abs=1e-15
        )
    q, _ = points()
    tool = np.zeros(3)
    ours, theirs = (np.asarray(s.deviation(q, tool))[:, :3] for s in (moved, refitted))
    removed = gauge_basis(q, np.tile(tool, (len(q), 1)), VERTICAL, tool_rotation=False)
    difference = (ours - theirs).reshape(-1)
    assert np.abs(difference - removed @ (removed.T @ difference)).max() < 3 * FIELD


def test_datum_of_fit_is_in_datum():
    direct = fit(campaign_of(), datum=Datum("Z", "X"))
    np.testing.assert_allclose(direct.parameters, solution().in_datum(Datum("Z", "X")).parameters, atol=1e-12)


def test_model_without_tool_rotation_changes_datum_too():
    """A tool rotation that the datum would ask for is left out with the rest of the tool's rotation."""
    plain = fit(campaign_of(False, '[model.functions]\n"E?0S" = false'))
    assert plain.fully_determined
    back = plain.in_datum(Datum("Z", "X")).in_datum(plain.datum)
    np.testing.assert_allclose(back.parameters, plain.parameters, atol=1e-9)


def test_model_that_cannot_be_expressed_is_refused():
    # EC0Y is a slope of EXY; with primary Y it would have to become EC0X, which the model leaves out
    lacking = fit(campaign_of(True, "[model.functions]\nEC0X = false"))
    with pytest.raises(InputError, match="the model cannot be expressed in this datum"):
        lacking.in_datum(Datum("Y", "X"))


def test_parse_datum():
    machine = campaign_of().machine
    assert parse_datum(machine, "primary=Z, secondary=X") == Datum("Z", "X")
    assert parse_datum(machine, "line=end_point,reference_Z=-10,reference_X=5") == Datum(
        line="end_point", reference=(("X", 5.0), ("Z", -10.0))
    )
    assert parse_datum(machine, "") == machine.datum


@pytest.mark.parametrize(
    "text, message",
    [
        ("first=Z", "unknown key 'first'; expected primary, secondary, line or reference_X"),
        ("primary=C", "primary = 'C' is no linear axis of this machine"),
        ("primary=Y", "primary and secondary axis are both Y; they must differ"),
        ("line=straight", "line = 'straight'; expected least_squares or end_point"),
        ("reference_X=left", "reference_X = 'left' is not a number"),
        ("reference_X=nan", "reference_X = 'nan' is not a number; expected a position"),
        ("reference_X=1,reference_X=2", "reference_X is given twice; expected every key once"),
        ("reference_B=0", "has no axis B; its axes are X, Y, Z"),
    ],
)
def test_parse_datum_refuses(text, message):
    with pytest.raises(InputError, match=message):
        parse_datum(campaign_of().machine, text)
