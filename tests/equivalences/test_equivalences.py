"""The same answer, within 1 nm in the volume, for the same readings told in another way."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from exact_chain import ExactMachine, gauge_basis, random_truth, tracker_campaign
from support.judging import evaluation_points
from support.machines import VERTICAL, fixed, volid_machine
from support.trackers import distance_campaign, distance_set

from volid.fitting.equations.problem import build_problem
from volid.fitting.equations.solver import solve
from volid.fitting.fit import fit
from volid.fitting.starts import find_starts
from volid.model.error_functions import motion_names
from volid.model.error_model import build_model

NANOMETRE = 1e-6
PICOMETRE = 1e-9


@cache
def measured():
    """Virtual readings of a machine with random errors, three tools at every station."""
    rng = np.random.default_rng(21)
    truth = random_truth(VERTICAL, rng, waviness=0.3)
    return tracker_campaign(VERTICAL, truth, rng, n_per_station=60, every_station_sees_every_tool=True, segments=2)


def campaign_of(off_by=5.0, seed=0):
    return distance_campaign(volid_machine(VERTICAL, fixed(4)), measured(), off_by, seed)


@cache
def reference():
    return fit(campaign_of())


def volume(solution):
    q, tool = evaluation_points(VERTICAL, 4)
    return np.asarray(solution.deviation(q, tool))


def assert_same(solution, atol, rtol_u=1e-6):
    """Deviations (rotations at 1 m), uncertainties and verdict agree."""
    metre = np.array([1, 1, 1, 1e3, 1e3, 1e3])
    np.testing.assert_allclose(volume(solution) * metre, volume(reference()) * metre, atol=atol, rtol=0)
    u, expected = (np.sqrt(np.diagonal(s.parameter_covariance)) for s in (solution, reference()))
    np.testing.assert_allclose(u, expected, rtol=rtol_u)
    assert solution.adequacy.chi_square == pytest.approx(reference().adequacy.chi_square, rel=1e-8)
    assert solution.adequacy.degrees_of_freedom == reference().adequacy.degrees_of_freedom


def test_the_reference_itself_is_no_trivial_answer():
    assert reference().statistics.converged and np.abs(volume(reference())[:, :3]).max() > 0.01


def test_rows_in_another_order():
    campaign = campaign_of()
    order = np.random.default_rng(0).permutation(campaign.n_readings)
    solution = fit(replace(campaign, sets=(campaign.sets[0].rows_of(order),)))
    assert_same(solution, 10 * PICOMETRE)
    np.testing.assert_allclose(
        solution.readings.residuals[0], reference().readings.residuals[0][order], atol=10 * PICOMETRE
    )


def test_set_split_in_two():
    """Two sets that share stations and beams share their unknowns."""
    campaign = campaign_of()
    even = np.arange(campaign.n_readings) % 2 == 0
    sets = (distance_set(measured(), even, "even"), distance_set(measured(), ~even, "odd"))
    solution = fit(replace(campaign, sets=sets))
    assert len(solution.nuisance) == len(reference().nuisance)
    assert_same(solution, 10 * PICOMETRE)


def test_stations_in_another_order_and_with_other_names():
    campaign = campaign_of()
    names = {f"S{i + 1}": f"tripod {6 - i}" for i in range(6)}
    s = campaign.sets[0]
    labels = {**s.labels, "station": np.array([names[n] for n in s.labels["station"]])}
    stations = tuple(replace(x, name=names[x.name]) for x in reversed(campaign.stations))
    assert_same(fit(replace(campaign, stations=stations, sets=(replace(s, labels=labels),))), 10 * PICOMETRE)


@pytest.mark.parametrize("off_by", [500.0, None], ids=["500 mm wrong", "absent"])
def test_approximate_stations_do_not_matter(off_by):
    """5 mm wrong is the reference. The datum stands on the machine's functions, not on the stations."""
    solution = fit(campaign_of(off_by, seed=3))
    assert_same(solution, NANOMETRE)
    np.testing.assert_allclose(solution.nuisance, reference().nuisance, atol=NANOMETRE)


def test_dead_paths_and_readings_shifted_together():
    campaign = campaign_of()
    s = campaign.sets[0]
    beams = np.unique(
        np.char.add(s.labels["station"].astype(str), s.labels["segment"].astype(str)), return_inverse=True
    )[1]
    shift = np.random.default_rng(1).uniform(-1000, 1000, beams.max() + 1)[beams]
    assert_same(fit(replace(campaign, sets=(replace(s, readings=s.readings + shift[:, None]),))), NANOMETRE)


def test_workpiece_frame_shifted():
    """Another machine zero: positions, travels and references count from elsewhere, lever arms from another origin.

    Error functions change (EXX takes up EBX · shift), the field does not, up to a rigid motion and the product of two
    errors: 40 µrad · 40 µrad · 300 mm = 5e-7 mm.
    """
    shift = {"X": 300.0, "Y": -200.0, "Z": 250.0}
    travel = {a: (low + shift[a], high + shift[a]) for a, (low, high) in VERTICAL.travel.items()}
    moved = ExactMachine(VERTICAL.structure, travel)
    offset = np.array([shift[a] for a in VERTICAL.axes])
    s = campaign_of().sets[0]
    campaign = replace(
        campaign_of(None), machine=volid_machine(moved, fixed(4)), sets=(replace(s, positions=s.positions + offset),)
    )
    solution = fit(campaign)
    q, tool = evaluation_points(VERTICAL, 4)
    difference = np.asarray(solution.deviation(q + offset, tool))[:, :3] - volume(reference())[:, :3]
    removed = gauge_basis(q, tool, VERTICAL, tool_rotation=False)
    left = difference.reshape(-1) - removed @ (removed.T @ difference.reshape(-1))
    assert np.abs(left).max() < NANOMETRE
    assert solution.adequacy.chi_square == pytest.approx(reference().adequacy.chi_square, abs=0.01)
    exx, before = (np.array([f.value for f in s.functions() if f.name == "EXX"]) for s in (solution, reference()))
    assert np.abs(exx - before).max() > 1e-4, "the functions do change"


def test_error_points_change_functions_not_the_field():
    """Rotations about another point: straightness takes up the difference, the field and chi-square do not see it.

    Points move by 500 mm and turn with two axes, 50 µrad each: products of two errors stay below 3 nm.
    """
    moved = ExactMachine(
        VERTICAL.structure, VERTICAL.travel, error_point={"X": (380, 215, -300), "Y": (0, 200, 0), "Z": (0, 0, -230)}
    )
    solution = fit(replace(campaign_of(), machine=volid_machine(moved, fixed(4))))
    q, tool = evaluation_points(VERTICAL, 4)
    difference = (volume(solution) - volume(reference()))[:, :3].reshape(-1)
    removed = gauge_basis(q, tool, VERTICAL, tool_rotation=False)
    assert np.abs(difference - removed @ (removed.T @ difference)).max() < 3 * NANOMETRE
    assert solution.adequacy.chi_square == pytest.approx(
        reference().adequacy.chi_square, abs=0.01
    )  # 3 nm in u = 0.3 µm


def test_coefficients_stored_finer_give_the_same_answer():
    """The same 4 segments in a carrier of 8: how coefficients are stored is invisible."""
    campaign = campaign_of()
    names = motion_names(campaign.machine)
    model = build_model(campaign.machine, {n: (4,) for n in names}, carrier={n: (8,) for n in names})
    optimum = solve(build_problem(campaign, model, find_starts(campaign)))
    assert 2 * float(optimum.normal.cost) == pytest.approx(reference().adequacy.chi_square, rel=1e-8)
    stations = optimum.z[model.layout.n_coefficients :]
    np.testing.assert_allclose(stations, reference().nuisance, atol=NANOMETRE)
