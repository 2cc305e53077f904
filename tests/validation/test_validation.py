"""A right solution is confirmed, every fault is found and named; truth and readings from the exact chain."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from exact_chain import random_truth
from exact_chain.control import ExactControl
from exact_chain.tracker import tracker_campaign
from scipy.stats import binom, norm
from support.machines import MACHINES, STRUCTURES, exact_machine, volid_machine
from support.rtests import NO_LINEAR, r_test, r_test_campaign, rotary_only
from support.trackers import distance_campaign
from support.validations import OTHER_TOOLS, changed, other_stations

from volid.campaign import Campaign, Effect, ObservationSet, Station
from volid.compensation.base import base_of
from volid.compensation.control import Control
from volid.compensation.grids.linear import linear_grid
from volid.compensation.package import compensate
from volid.exceptions import InputError
from volid.fitting.datum import parse_datum
from volid.fitting.fit import fit
from volid.io.compensations import load_control, save_compensation
from volid.validation.readings.causes import ALL, CONTROL_TOOL, SIGN, TABLE
from volid.validation.readings.independence import same_readings
from volid.validation.readings.shares import usual_share
from volid.validation.readings.validation import validate
from volid.validation.readings.whitened import Whitened

EXACT = MACHINES["vertical"]
MACHINE = volid_machine(EXACT)
BASE_TOOL = (0.0, 0.0, -150.0)


def first_campaign(truth, rng, n: int = 60, **plan) -> Campaign:
    tracker = tracker_campaign(EXACT, truth, rng, n_per_station=n, every_station_sees_every_tool=True, **plan)
    return distance_campaign(MACHINE, tracker, 5.0, 1)


def second_campaign(truth, seed: int = 5, n: int = 40, drive=None) -> Campaign:
    """Three other stations, two other tools. `drive`: positions to which a control moves instead of those programmed."""
    tracker = tracker_campaign(
        EXACT,
        truth,
        np.random.default_rng(seed),
        stations=other_stations(EXACT),
        tools=OTHER_TOOLS,
        n_per_station=n,
        every_station_sees_every_tool=True,
    )
    if drive is not None:
        places = np.array([tracker.station_positions[s] for s in tracker.station])
        lengths = [
            np.linalg.norm(EXACT.functional_point(q, tracker.tool, truth, None) - places, axis=1)
            for q in (drive(tracker.q), tracker.q)
        ]
        tracker = replace(tracker, distance=tracker.distance + lengths[0] - lengths[1])
    return distance_campaign(MACHINE, tracker, 5.0, 2)


@pytest.fixture(scope="module")
def known():
    """A truth and the solution of a first campaign on it."""
    rng = np.random.default_rng(31_001)
    truth = random_truth(EXACT, rng)
    return SimpleNamespace(truth=truth, solution=fit(first_campaign(truth, rng)))


def test_a_right_solution_is_confirmed(known):
    found = validate(known.solution, second_campaign(known.truth))
    assert found.confirmed and found.is_independent and not found.attention and not found.causes
    assert found.verdict.startswith("confirmed") and found.probability > 0.05
    # about 4.6 % of 120 normal numbers lie beyond two standard deviations; more than 12 % in 1 of 2000 cases
    assert found.e_n_above_1 < 0.12 and len(found.e_n) == 120
    (one,) = found.sets
    np.testing.assert_allclose(one.reading - one.predicted, one.residual, atol=1e-12)
    np.testing.assert_allclose(one.e_n, np.abs(one.residual) / (2 * one.u))
    assert np.all(one.u > 0.0) and np.all(one.u < 0.01)


@pytest.mark.parametrize(
    "fault, size, words",
    [
        ("squareness", 10e-6, "EC0Y"),
        ("scale", 10e-6, "scale of X"),
        ("cross effect", 0.010, "EYX changes with Y"),
        ("sign", 1.0, "EXX acts with the opposite sign"),
        ("bump", 0.020, "EYY"),
    ],
)
def test_a_machine_that_has_changed_is_found_and_named(known, fault, size, words):
    found = validate(known.solution, second_campaign(changed(EXACT, known.truth, fault, size)))
    assert not found.confirmed and words in found.causes[0].what and words in found.verdict
    assert found.verdict in found.attention[0] and found.e_n_above_1 > 0.05


def test_the_size_of_a_change_is_stated_within_its_uncertainty(known):
    found = validate(known.solution, second_campaign(changed(EXACT, known.truth, "squareness", 20e-6)))
    value, u = (float(text) for text in found.causes[0].what.split("by ")[1].split(" µrad")[0].split(" ± "))
    assert 0.0 < u < 5.0 and abs(value - 20.0) < 2.0 * u


def test_a_wrong_tool_length_is_found_and_named(known):
    campaign = second_campaign(known.truth)
    readings = campaign.sets[0]
    longer = readings.tool.copy()
    longer[np.all(readings.tool == OTHER_TOOLS[0], axis=1), 2] -= 0.010
    found = validate(known.solution, replace(campaign, sets=(replace(readings, tool=longer),)))
    assert not found.confirmed and found.causes[0].cause == "tool length"
    assert "(0, 0, -190.01) mm" in found.causes[0].what


def test_a_gross_reading_is_named(known):
    campaign = second_campaign(known.truth)
    readings = campaign.sets[0].readings.copy()
    readings[17] += 0.050
    found = validate(known.solution, replace(campaign, sets=(replace(campaign.sets[0], readings=readings),)))
    assert not found.confirmed and found.causes[0].what == "the reading of volume.csv, row 18 does not fit the others"
    assert np.argmax(found.sets[0].e_n) == 17


# ------------------------------------------------------------------------------------------------------ after compensation


@pytest.fixture(scope="module")
def tables(known):
    """Positioning tables of X, Y and Z from the solution, and how a control drives by them: q - E(q), by linear interpolation."""
    made = compensate(known.solution, ["L-POS"], base_of(known.solution, BASE_TOOL), points=21)

    def drive(signs):
        def driven(q):
            moved = q.copy()
            for t in made.tables:
                i = EXACT.column(t.axis)
                if t.function == f"E{t.axis}{t.axis}":
                    moved[:, i] -= signs.get(t.axis, 1.0) * np.interp(q[:, i], t.positions, t.forward)
            return moved

        return driven

    own = tuple(t for t in made.tables if t.function[1] == t.axis)
    return SimpleNamespace(control=Control(MACHINE, own), drive=drive)


def test_a_compensated_machine_is_confirmed_with_its_tables(known, tables):
    campaign = second_campaign(known.truth, drive=tables.drive({}))
    assert validate(known.solution, campaign, control=tables.control).confirmed
    assert not validate(known.solution, campaign).confirmed


def test_a_table_of_the_wrong_sign_and_one_that_does_not_act_are_named(known, tables):
    negated = second_campaign(known.truth, drive=tables.drive({"X": -1.0}))
    found = validate(known.solution, negated, control=tables.control)
    assert not found.confirmed and found.causes[0].cause == TABLE
    assert found.causes[0].what == "table EXX acts with the opposite sign"
    found = validate(
        known.solution, second_campaign(known.truth, drive=tables.drive({"Y": 0.0})), control=tables.control
    )
    assert found.causes[0].what == "table EYY does not act"


def test_a_control_that_uses_another_tool_vector_is_named(known, tmp_path):
    """L-ANG by the exact control, with a tool 150 mm shorter than stated."""
    made = compensate(known.solution, ["L-ANG"], base_of(known.solution, BASE_TOOL), points=21)
    save_compensation(made, known.solution, tmp_path / "tables")
    at_work = ExactControl.of(EXACT, [tmp_path / "tables"], tool=np.zeros(3))
    campaign = second_campaign(known.truth, drive=lambda q: at_work.command(q, None))
    stated = load_control(MACHINE, [tmp_path / "tables"], tool=BASE_TOOL)
    found = validate(known.solution, campaign, control=stated)
    assert not found.confirmed and found.causes[0].cause == CONTROL_TOOL
    assert abs(float(found.causes[0].what.split(" mm in Z")[0].split()[-1]) - 150.0) < 15.0
    assert validate(known.solution, campaign, control=replace(stated, tool=(0.0, 0.0, 0.0))).confirmed


def test_a_stale_compensation_is_found(known, tables):
    """The tables act as they should, but the machine has been knocked since."""
    since = changed(EXACT, known.truth, "squareness", 10e-6)
    found = validate(known.solution, second_campaign(since, drive=tables.drive({})), control=tables.control)
    assert not found.confirmed and "EC0Y" in found.causes[0].what


def test_a_compensation_other_than_the_recorded_one_is_noticed(known, tables):
    campaign = second_campaign(known.truth, drive=tables.drive({}))
    own = replace(campaign, conditions={"active_compensations": [*tables.control.active, "thermal growth of Z"]})
    assert not any("what is stated is" in note for note in validate(known.solution, own, control=tables.control).notes)
    grid = linear_grid(known.solution, step=200.0, tool=BASE_TOOL)
    twice = replace(tables.control, grids=(replace(grid, type="L-POS"),))
    assert any("applies the sum of both" in note for note in validate(known.solution, own, control=twice).notes)
    other = replace(campaign, conditions={"active_compensations": ["L-VOL: grid over X, Y, Z"]})
    notes = validate(known.solution, other, control=tables.control).notes
    assert any("what is stated is: L-POS: tables of EXX, EYY, EZZ" in note and "L-VOL" in note for note in notes)


def test_a_compensation_that_nobody_states_is_noticed(known, tables):
    campaign = second_campaign(known.truth, drive=tables.drive({}))
    stated = replace(campaign, conditions={"active_compensations": ["L-POS"]})
    found = validate(known.solution, stated)
    assert any("L-POS" in note and "`compensation`" in note for note in found.notes)
    assert not any("L-POS" in note for note in validate(known.solution, campaign).notes)
    whole = second_campaign(changed(EXACT, known.truth, "none", 0.0), drive=lambda q: q)
    perfect = replace(whole, sets=(replace(whole.sets[0], readings=_of_a_perfect_machine(whole)),))
    assert validate(known.solution, perfect).causes[0].cause in (ALL, SIGN)


def _of_a_perfect_machine(campaign):
    s = campaign.sets[0]
    places = other_stations(EXACT)
    there = np.array([places[n] for n in s.labels["station"]])
    noise = np.random.default_rng(9).standard_normal(len(s)) * s.u[:, 0]
    return (np.linalg.norm(EXACT.functional_point(s.positions, s.tool) - there, axis=1) + noise)[:, None]


# ----------------------------------------------------------------------------------------- what it is told, and what it refuses


def test_common_effects_of_an_instrument_are_one_unknown(known):
    """A scale of the second campaign alone is no error of the instrument that both name; with one of its own it may be."""
    rng = np.random.default_rng(3)
    truth = random_truth(EXACT, rng)

    def with_scale(campaign, name):
        effect = Effect(name, "scale", 1e-5, "campaign")
        return replace(campaign, sets=(replace(campaign.sets[0], effects=(effect,)),))

    solution = fit(with_scale(first_campaign(truth, rng), "laser"))
    second = second_campaign(truth)
    readings = second.sets[0].readings * (1.0 + 1.2e-5)
    second = replace(second, sets=(replace(second.sets[0], readings=readings),))
    assert validate(solution, with_scale(second, "other laser")).confirmed
    assert not validate(solution, with_scale(second, "laser")).confirmed
    assert validate(solution, with_scale(second_campaign(truth), "laser")).confirmed


def test_the_verdict_depends_neither_on_the_datum_nor_on_the_order_of_rows(known):
    campaign = second_campaign(changed(EXACT, known.truth, "squareness", 3e-6))
    whole = [sum(t.chi_square for t in validate(s, campaign).tests) for s in _in_other_datums(known.solution)]
    np.testing.assert_allclose(whole, whole[0], rtol=1e-3)  # of second order: errors of 30 µrad times their changes
    mixed = np.random.default_rng(2).permutation(120)
    found = validate(known.solution, replace(campaign, sets=(campaign.sets[0].rows_of(mixed),)))
    assert sum(t.chi_square for t in found.tests) == pytest.approx(whole[0], rel=1e-6)
    np.testing.assert_allclose(
        found.sets[0].e_n, validate(known.solution, campaign).sets[0].e_n[mixed], rtol=1e-5, atol=1e-6
    )


def _in_other_datums(solution):
    return [
        solution,
        *(solution.in_datum(parse_datum(solution.campaign.machine, t)) for t in ("primary=Z,secondary=Y",)),
    ]


def test_what_the_solution_does_not_determine_is_not_tested_and_the_rest_is():
    """One tool vector leaves rotations open; other tools see them, and neither confirm nor contradict what is not known."""
    rng = np.random.default_rng(501)
    truth = random_truth(EXACT, rng)
    tracker = tracker_campaign(EXACT, truth, rng, tools=[BASE_TOOL], n_per_station=80)
    solution = fit(distance_campaign(MACHINE, tracker, 5.0, 1))
    assert not solution.fully_determined
    found = validate(solution, second_campaign(truth))
    assert found.confirmed and any("not determine everything" in note for note in found.notes)
    found = validate(solution, second_campaign(changed(EXACT, truth, "squareness", 20e-6)))
    assert not found.confirmed and "EC0Y" in found.causes[0].what


def test_u_that_the_fit_found_too_small_counts_for_new_readings_too(known):
    rng = np.random.default_rng(12)
    truth = random_truth(EXACT, rng)
    noisy = {"u_constant": 0.0012, "u_proportional": 1.2e-6}

    def understated(campaign):
        return replace(campaign, sets=(replace(campaign.sets[0], u=campaign.sets[0].u / 2.0),))

    solution = fit(understated(first_campaign(truth, rng, **noisy)))
    assert 1.6 < solution.factor < 2.5
    tracker = tracker_campaign(
        EXACT, truth, rng, stations=other_stations(EXACT), tools=OTHER_TOOLS, n_per_station=40, **noisy
    )
    found = validate(solution, understated(distance_campaign(MACHINE, tracker, 5.0, 2)))
    assert found.confirmed and any("times as large here too" in note for note in found.notes)


def test_readings_beyond_the_measured_range_are_left_out_or_extrapolated(known):
    rng = np.random.default_rng(6)
    campaign = first_campaign(known.truth, rng)
    inside = campaign.sets[0].positions[:, EXACT.column("X")] < 500.0
    solution = fit(replace(campaign, sets=(campaign.sets[0].rows_of(np.flatnonzero(inside)),)))
    second = second_campaign(known.truth)
    beyond = int((second.sets[0].positions[:, EXACT.column("X")] > 508.0).sum())
    found = validate(solution, second)
    assert beyond > 20 and found.left_out["volume"] == pytest.approx(beyond, abs=3)
    assert any("not predicted" in note and "X " in note for note in found.notes)
    rows = set(found.sets[0].rows.tolist())
    further = validate(solution, second, extrapolate=True)
    assert not further.left_out and len(further.e_n) == 120
    u = further.sets[0].u[:, 0]
    outside = np.array([i not in rows for i in range(120)])
    assert np.median(u[outside]) > 3.0 * np.median(u[~outside])


def test_a_set_up_like_that_of_the_fit_is_no_independent_test(known):
    rng = np.random.default_rng(31_001)
    again = validate(known.solution, known.solution.campaign)
    assert not again.is_independent and "has seen the readings" in again.attention[0]
    same = validate(known.solution, first_campaign(random_truth(EXACT, rng), np.random.default_rng(77)))
    assert any("all stations" in text for text in same.dependences)
    assert any("tool vectors are those of the fit" in text for text in same.weak)


def test_readings_that_the_fit_has_seen_are_known_however_they_are_written(known):
    """With digits cut off, as part of what a fit has read; and rounded readings of other places are not taken for them."""
    first = known.solution.campaign
    cut = replace(first, sets=(replace(first.sets[0], readings=np.round(first.sets[0].readings, 4)),))
    assert "has seen" in validate(known.solution, cut).attention[0]
    half = replace(cut, sets=(cut.sets[0].rows_of(np.arange(0, len(cut.sets[0]), 2)[::-1]),))
    assert "has seen" in validate(known.solution, half).attention[0]
    other = second_campaign(known.truth)
    numbers = np.concatenate([s.readings.ravel() for s in (first.sets[0], other.sets[0])])
    coarse = np.unique(np.round(numbers, 0))  # every number of the second campaign stands in the first as well

    def alike(campaign, seed):
        readings = np.random.default_rng(seed).permutation(np.resize(coarse, len(campaign.sets[0])))
        return replace(campaign, sets=(replace(campaign.sets[0], readings=readings[:, None]),))

    fitted = SimpleNamespace(campaign=alike(first, 1), options={})
    assert same_readings(fitted, alike(other, 2)) == []
    assert same_readings(fitted, fitted.campaign) == [first.sets[0].name]
    few = replace(first, sets=(first.sets[0].rows_of(np.arange(0, len(first.sets[0]), 5)),))
    sample = SimpleNamespace(campaign=few, options={"streamed": len(first.sets[0])})
    assert same_readings(sample, first) == [first.sets[0].name] and same_readings(sample, other) == []
    assert same_readings(SimpleNamespace(campaign=few, options={}), first) == []


def test_a_drift_begins_anew_with_every_campaign(known):
    """The same name in both campaigns; in the second it goes the other way."""
    rng = np.random.default_rng(14)
    truth = random_truth(EXACT, rng)
    first = first_campaign(truth, rng)
    for form in ("linear", "random walk"):

        def drifting(campaign, rate, form=form):
            s = campaign.sets[0]
            hours = np.arange(len(s)) / 30.0
            effect = Effect("laser drift", "drift", 0.005, "campaign", options={"form": form})
            readings = s.readings + (rate * hours)[:, None]
            return replace(campaign, sets=(replace(s, readings=readings, time=3600.0 * hours, effects=(effect,)),))

        solution = fit(drifting(first, 0.003))
        assert validate(solution, drifting(second_campaign(truth, 14), -0.003)).confirmed
        moved = second_campaign(changed(EXACT, truth, "squareness", 20e-6), 14)
        assert not validate(solution, drifting(moved, -0.003)).confirmed


@pytest.mark.parametrize("times, is_tested", [(1.0, True), (4.0, True), (3000.0, False)])
def test_readings_too_coarse_to_tell_anything_are_no_test(known, times, is_tested):
    campaign = second_campaign(changed(EXACT, known.truth, "squareness", 3e-6 if is_tested else 12e-6))
    campaign = replace(campaign, sets=(replace(campaign.sets[0], u=campaign.sets[0].u * times),))
    found = validate(known.solution, campaign)
    assert any("times what their u lets expect" in note for note in found.notes) == (times > 1.0)
    if not is_tested:
        assert (
            found.verdict.startswith("confirmed, but nothing is tested") and "nothing is tested" in found.attention[0]
        )
    elif times > 1.0:
        assert found.confirmed and not found.attention


def test_a_solution_that_its_own_readings_reject_is_not_confirmed_in_silence(known):
    rng = np.random.default_rng(31_001)
    bent = changed(EXACT, random_truth(EXACT, rng), "cross effect", 0.030)
    solution = fit(first_campaign(bent, rng))
    assert solution.adequacy.rejected
    found = validate(solution, second_campaign(known.truth))
    assert any("rejected by its own readings" in text for text in found.attention)
    again = replace(known.solution, prior_root=np.zeros((1, known.solution.model.n_parameters)))
    notes = validate(again, second_campaign(known.truth)).notes
    assert any("an earlier solution is part of this one" in note for note in notes)


def test_what_share_of_e_n_above_1_is_usual():
    """Independent readings: binomial. One error that all have in common, ten times their u: all of them or none."""

    def of(known):
        linear = SimpleNamespace(r=np.zeros(400), known=known, open=np.zeros((400, 0)))
        return usual_share(Whitened.of(linear), 2.0, 1e-9)

    alone = [binom.ppf(p, 400, 2 * norm.sf(2.0)) / 400 for p in (0.025, 0.975)]
    np.testing.assert_allclose(of(np.zeros((400, 1))), alone, atol=0.004)
    low, high = of(np.full((400, 1), 10.0))
    assert low == 0.0 and high > 0.95


def test_a_weak_campaign_says_what_it_cannot_tell(known):
    campaign = second_campaign(known.truth)
    one = np.flatnonzero(campaign.sets[0].labels["station"] == "V1")
    found = validate(known.solution, replace(campaign, sets=(campaign.sets[0].rows_of(one),)))
    three = validate(known.solution, campaign)
    for few, many in zip(found.smallest, three.smallest, strict=True):
        assert few.name == many.name and few.value > many.value
    assert len(found.weak) >= 1 and "large changes" in " ".join(found.weak)


def test_what_is_no_campaign_of_this_machine_is_refused(known):
    other = MACHINES["gantry"]
    tracker = tracker_campaign(other, random_truth(other, np.random.default_rng(1)), np.random.default_rng(2))
    with pytest.raises(InputError, match="expected the same machine"):
        validate(known.solution, distance_campaign(volid_machine(other), tracker, 5.0, 1))
    campaign = second_campaign(known.truth)
    plan = replace(campaign, sets=(replace(campaign.sets[0], readings=np.full((120, 1), np.nan)),))
    with pytest.raises(InputError, match=r"volume\.csv, row 1: there is no reading"):
        validate(known.solution, plan)
    with pytest.raises(InputError, match="expected a probability"):
        validate(known.solution, campaign, level=95)
    with pytest.raises(InputError, match="takes a Campaign; got str"):
        validate(known.solution, "campaign.toml")
    few = replace(campaign, sets=(campaign.sets[0].rows_of(np.arange(0, 120, 12)),))
    with pytest.raises(InputError, match="take more readings"):
        validate(known.solution, few)


# ------------------------------------------------------------------------------------------------------- other instruments


def test_a_ball_bar_tests_a_solution_of_a_tracker(known):
    """Circles in XY about a pivot at an unknown place, length known to 0.5 µm."""

    def readings(truth):
        rng, angle = np.random.default_rng(8), np.linspace(0.0, 2 * np.pi, 73)
        tool, pivot = np.array([0.0, 0.0, -120.0]), np.array([380.0, 215.0, -320.0])
        circle = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1) * 150.0
        q = EXACT.in_axis_order(dict(zip("XYZ", (pivot + circle - tool).T, strict=True)))
        tools = np.tile(tool, (len(q), 1))
        pivot_truly = np.add(pivot, (0.004, -0.003, 0.002))
        length = np.linalg.norm(EXACT.functional_point(q, tools, truth) - pivot_truly, axis=1) + 0.0003
        s = ObservationSet(
            "bar",
            "distance",
            q,
            np.zeros_like(q),
            tools,
            (length + 0.0002 * rng.standard_normal(len(q)))[:, None],
            np.full((len(q), 1), 0.0002),
            {"station": np.full(len(q), "pivot"), "segment": np.full(len(q), "1")},
            options={"relative": False, "calibrated_u": 0.0005},
        )
        return Campaign(MACHINE, (Station("pivot", position=tuple(pivot)),), (s,))

    assert validate(known.solution, readings(known.truth)).confirmed
    found = validate(known.solution, readings(changed(EXACT, known.truth, "squareness", 15e-6)))
    assert not found.confirmed and "EC0Y" in found.causes[0].what
    assert any("EA0Z" in text for text in found.weak), "one plane cannot tell the other squareness errors"


def test_an_r_test_is_validated_by_another_one():
    exact = exact_machine(STRUCTURES["tilting table C'A'"])
    rng = np.random.default_rng(21)
    truth = rotary_only(random_truth(exact, rng, waviness=0.6))
    machine = volid_machine(exact, NO_LINEAR)
    solution = fit(r_test_campaign(machine, r_test(exact, truth, rng, counts={"A": 9, "C": 19})))
    others = {"V1": (60.0, -70.0, 30.0), "V2": (-90.0, -40.0, 90.0)}
    tools = ((0.0, 0.0, -120.0), (-50.0, 20.0, -170.0))

    def second(truth):
        data = r_test(exact, truth, np.random.default_rng(3), counts={"A": 6, "C": 10}, spheres=others, tools=tools)
        return r_test_campaign(machine, data, spheres=others)

    right = validate(solution, second(truth))
    assert right.confirmed and len(right.e_n) == 360
    constants = {**truth.constants, "EX0C": truth.constants.get("EX0C", 0.0) + 0.005}
    found = validate(solution, second(replace(truth, constants=constants)))
    assert not found.confirmed and "EX0C" in found.verdict


@pytest.mark.slow
def test_a_right_solution_passes_in_95_of_100():
    """24 machines, each fitted and validated; `benchmarks/validation.py` does so for 500."""
    confirmed = []
    for seed in range(24):
        rng = np.random.default_rng(52_000 + seed)
        truth = random_truth(EXACT, rng)
        confirmed.append(validate(fit(first_campaign(truth, rng, n=48)), second_campaign(truth, seed)).confirmed)
    assert len(confirmed) - sum(confirmed) <= binom.ppf(0.999, len(confirmed), 0.05)
