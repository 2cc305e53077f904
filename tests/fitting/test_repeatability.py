"""Repeatability from readings that come back to a place: ISO 230-2 by plain formulas, known scatter under a known instrument,
drift between visits, who it is attributed to, and what predictions make of it."""

import csv
import shutil
from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth
from support.machines import volid_machine
from support.made_up import made_up
from support.places import DATASETS, reference_file

from volid.campaign import Campaign, Effect, ObservationSet, Station
from volid.compensation.base import base_of
from volid.compensation.residual.fields import volume_places
from volid.compensation.residual.forecast import forecast
from volid.compensation.residual.repeats import repeats_of
from volid.exceptions import InputError
from volid.fitting.repeatability import repeatability, stated_repeatability
from volid.io import load_campaign
from volid.plausibility.checks import check_campaign
from volid.report.text.repeats import repeatability_data, repeatability_lines, repeats_lines
from volid.virtual.random_truth import random_truth
from volid.virtual.simulate import simulate

EXACT = ExactMachine("w Y' X' b Z t", {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)})
MACHINE = volid_machine(EXACT)
X = MACHINE.index("X")
MIDDLE = np.array([300.0, 500.0, -250.0])  # Y, X, Z


def line(values, places, directions, u, component="X", **changes) -> ObservationSet:
    """Readings of one component along X; arrays of one number per row."""
    n = len(values)
    q = np.tile(MIDDLE, (n, 1))
    q[:, X] = places
    way = np.zeros((n, 3))
    way[:, X] = directions
    labels = {"component": np.full(n, component), "line": np.full(n, "1")}
    given = dict(
        name="laser", kind="component", positions=q, directions=way, tool=np.tile([0.0, 0.0, -150.0], (n, 1)),
        readings=np.reshape(values, (n, 1)), u=np.full((n, 1), float(u)), labels=labels,
    )  # fmt: skip
    return ObservationSet(**(given | changes))


def runs(rng, scatter, u, targets=8, visits=6, drift=0.0, **changes) -> ObservationSet:
    """Bidirectional runs with the scatter of (up, down), a drift that grows by `drift` from run to run, and a form of the
    axis."""
    where = np.linspace(0.0, 1000.0, targets)
    run, target, way = (a.ravel() for a in np.meshgrid(np.arange(visits), np.arange(targets), [1, -1], indexing="ij"))
    s = np.where(way > 0, *scatter)
    values = 0.01 * np.sin(where[target] / 200.0) + 0.002 * way + drift * run
    values = values + s * rng.standard_normal(len(run)) + u * rng.standard_normal(len(run))
    return line(values, where[target], way, u, **changes)


def test_pooled_scatter_is_that_of_iso_230_2_by_plain_formulas():
    """Real runs of a linear axis, 5 targets, 5 runs, both directions: RMS of s_i; and of what is left of a two-way table."""
    with reference_file("iso230_2_runs.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    target, actual = (np.array([float(r[k]) for r in rows]) for k in ("target", "actual"))
    way, run = np.array([int(r["direction"]) for r in rows]), np.array([r["run"] for r in rows])
    u = 1e-4
    found = {r.direction: r for r in repeatability(Campaign(MACHINE, (), (line(actual - target, target, way, u),)))}
    assert {r.label for r in found.values()} == {"X up", "X down"}
    for direction, r in found.items():
        mine = way == direction
        table = np.array([
            [float((actual - target)[mine & (target == t) & (run == k)][0]) for k in sorted(set(run))]
            for t in np.unique(target)
        ])  # fmt: skip
        assert r.observed == pytest.approx(np.sqrt(np.mean(np.std(table, axis=1, ddof=1) ** 2)), rel=1e-9)
        left = table - table.mean(axis=0) - table.mean(axis=1)[:, None] + table.mean()
        assert r.degrees_of_freedom == 16
        assert r.s == pytest.approx(np.sqrt((left**2).sum() / 16 - u**2), rel=1e-9)
        assert r.long_term == pytest.approx(np.sqrt(r.observed**2 - u**2), rel=1e-9)


def test_scatter_under_a_larger_instrument_is_found_without_bias():
    """s of 0.4 µm up and 0.8 µm down under u = 0.5 µm: mean of s² over 200 campaigns within its own standard error (3 σ), and
    the 95 % limits hold as often as they say (Binomial)."""
    rng, truth = np.random.default_rng(2), {1: 4e-4, -1: 8e-4}
    squares, beyond = {1: [], -1: []}, {1: [0, 0], -1: [0, 0]}
    for _ in range(200):
        for r in repeatability(Campaign(MACHINE, (), (runs(rng, (4e-4, 8e-4), 5e-4),))):
            squares[r.direction].append(r.s**2)
            beyond[r.direction][0] += r.lower > truth[r.direction]
            beyond[r.direction][1] += r.upper < truth[r.direction]
    for way, s in truth.items():
        values = np.array(squares[way])
        assert abs(values.mean() - s**2) < 3.0 * values.std() / np.sqrt(len(values))
        assert all(2 <= n <= 20 for n in beyond[way])  # 10 expected; outside with probability 0.2 %


def test_drift_between_visits_is_no_repeatability():
    """3 µm of drift over six runs beside 0.4 µm: taken out of s, part of the long term, RMS of 0 … 3 µm about their mean."""
    rng = np.random.default_rng(3)
    for label in ({}, {"run": True}):
        s = runs(rng, (4e-4, 4e-4), 1e-4, drift=6e-4, targets=12)
        if label:
            s = replace(s, labels={**s.labels, "run": np.repeat([str(i) for i in range(6)], 24)})
        for r in repeatability(Campaign(MACHINE, (), (s,))):
            assert r.drift_apart and r.s == pytest.approx(4e-4, rel=0.35)
            assert r.long_term == pytest.approx(np.hypot(4e-4, 6e-4 * np.sqrt(35.0 / 12.0 * 6.0 / 5.0)), rel=0.1)


def test_other_components_and_rotations_have_names_of_their_own():
    rng = np.random.default_rng(4)
    straight = runs(rng, (2e-4, 2e-4), 1e-4, component="Y", name="edge")
    pitch = runs(rng, (2e-6, 2e-6), 5e-7, component="B", name="angle")
    found = {r.label: r for r in repeatability(Campaign(MACHINE, (), (straight, pitch)))}
    assert found.keys() == {"EYX up", "EYX down", "EBX up", "EBX down"}
    assert found["EBX up"].unit == "rad" and found["EBX up"].s == pytest.approx(2e-6, rel=0.4)


def distances(rng, s, u) -> Campaign:
    """40 places that three stations see four times each; every visit scatters by s in X, Y and Z."""
    q = EXACT.in_axis_order({a: rng.uniform(*EXACT.travel[a], 40) for a in "XYZ"})
    stations = {"A": (-300.0, -200.0, 0.0), "B": (1300.0, 100.0, -300.0), "C": (400.0, 900.0, -100.0)}
    place, name = np.tile(np.repeat(np.arange(40), 4), 3), np.repeat(list(stations), 160)
    tool = np.tile([0.0, 0.0, -150.0], (480, 1))
    point = EXACT.functional_point(q[place], tool, Truth({}, {})) + s * rng.standard_normal((480, 3))
    length = np.linalg.norm(point - np.array([stations[n] for n in name]), axis=1) + u * rng.standard_normal(480)
    readings = ObservationSet(
        "tracker", "distance", q[place], np.zeros((480, 3)), tool, length[:, None], np.full((480, 1), u),
        {"station": name, "segment": np.full(480, "1")}, options={"relative": True, "calibrated_u": 0.0},
    )  # fmt: skip
    return Campaign(MACHINE, tuple(Station(n, position=p) for n, p in stations.items()), (readings,))


def test_lengths_from_stations_show_that_of_the_functional_point():
    [found] = repeatability(distances(np.random.default_rng(5), 1e-3, 5e-4))
    assert (found.label, found.degrees_of_freedom) == ("functional point", 3 * (39 * 3))
    assert abs(found.s - 1e-3) < 3.0 * found.u < 2e-4
    [none] = repeatability(distances(np.random.default_rng(6), 0.0, 5e-4))
    assert not none.seen and none.upper < 3e-4


def test_readings_set_aside_say_nothing():
    campaign = distances(np.random.default_rng(7), 1e-3, 5e-4)
    wrong = campaign.sets[0].readings.copy()
    wrong[7] += 0.1
    spoiled = replace(campaign, sets=(replace(campaign.sets[0], readings=wrong),))
    aside = np.zeros_like(wrong, dtype=bool)
    aside[7] = True
    assert repeatability(spoiled)[0].s > 3e-3
    assert repeatability(spoiled, (aside,))[0].s == pytest.approx(repeatability(campaign)[0].s, rel=0.02)


def solution_of(campaign):
    made = made_up(MACHINE, u=1e-4)
    return replace(made, campaign=campaign)


def test_what_the_prediction_adds_is_the_scatter_that_was_put_in():
    """With hardly any other uncertainty, three axes of 2 µm leave √3 · 2 µm RMS after a compensation, in every draw; a
    functional point of 2 µm leaves the same; 0 leaves nothing."""
    solution = solution_of(Campaign(MACHINE, (), made_up(MACHINE).campaign.sets))
    base, places = base_of(solution, (0.0, 0.0, -150.0)), volume_places(solution.machine, 256)

    def rms_after(stated):
        found = forecast(solution, [["L-VOL"]], base, places=places, points=21, repeatability=stated)
        p = found.columns[1].predictions[0]
        return np.sqrt(p.value[2] ** 2 - p.exact[2] ** 2), found

    for stated in (2e-3, {"X": 2e-3, "Y": 2e-3, "Z": 2e-3}):
        rms, found = rms_after(stated)
        assert rms == pytest.approx(np.sqrt(3.0) * 2e-3, rel=0.02)
        assert found.repeats_rms[0] == pytest.approx(np.sqrt(3.0) * 2e-3, rel=1e-9)
    rms, found = rms_after(0.0)
    assert rms < 5e-5 and found.repeats_rms[0] == 0.0
    with pytest.raises(InputError, match="no axis W; expected one of Y, X, Z"):
        rms_after({"W": 1e-3})


def test_directions_and_lever_arms_act_where_they_are():
    """EBX scatters by 2 µrad: at a tool 150 mm below, and Z itself above it, the arm along Z gives X; up alone where X rises."""
    rng = np.random.default_rng(8)
    solution = solution_of(Campaign(MACHINE, (), (runs(rng, (2e-6, 2e-6), 1e-8, component="B", targets=30),)))
    repeats = repeats_of(solution)
    places = volume_places(solution.machine, 8)
    tool = np.array([0.0, 0.0, -150.0])
    found = repeats.columns(solution.machine, places, tool)
    # a table axis carries its error to the workpiece: arm from the functional point, Z of the head - 150 mm, to the machine's
    # origin
    arm = np.abs(places.positions[:, MACHINE.index("Z")] - 150.0)
    s = [next(r.s for r in repeats.found if r.direction == d) for d in np.sign(places.directions[:, X])]
    np.testing.assert_allclose(np.abs(found[:, 0, 0]), arm * s, rtol=1e-6)
    np.testing.assert_allclose(np.abs(found[:, 4, 0]), s, rtol=1e-6)
    assert repeats.not_included == ("repeatability of Y, X, Z: not known",)


def test_words_state_what_is_in_and_what_is_not():
    rng = np.random.default_rng(9)
    campaign = Campaign(MACHINE, (), (runs(rng, (4e-4, 8e-4), 2e-4),), conditions={"thermal_limit": 0.003})
    found = repeatability(campaign)
    text = " ".join(repeatability_lines(repeatability_data(found)))
    assert f"X up {1e3 * found[0].s:.2f} µm (35 degrees of freedom)" in text
    repeats = repeats_of(solution_of(campaign))
    text = " ".join(repeats_lines(repeats, MACHINE, 1e-3))
    assert "alone it leaves 1.00 µm RMS" in text and "repeatability of Y, Z: not known" in text
    assert "up to 3.00 µm on top of every row" in text
    for wrong in ("much", 3, -0.001):
        with pytest.raises(InputError, match=f"thermal_limit is '{wrong}'; expected a length in mm"):
            repeats_of(solution_of(replace(campaign, conditions={"thermal_limit": wrong})))
    nothing = repeats_of(solution_of(Campaign(MACHINE, (), made_up(MACHINE).campaign.sets)))
    assert "no reading came back to a place" in nothing.not_included[0] and not nothing.is_known


def test_a_campaign_that_states_its_repeatability_is_believed_where_readings_show_none():
    effect = Effect("axes", "repeatability", 1e-3, "point", {"axes": {"X": 4e-4}})
    made = made_up(MACHINE).campaign.sets[0]
    campaign = Campaign(MACHINE, (), (replace(made, effects=(effect,)),))
    assert stated_repeatability(campaign) == {"X": 4e-4}
    assert repeats_of(solution_of(campaign)).positions == {"X": 4e-4}


def test_sphere_centres_of_a_real_machine_repeat_as_plain_formulas_say(tmp_path):
    """25 closures of a five-axis router: pooled variance about the rotary positions, over x, y and z; u is stated as the
    machine's own repeatability, so nothing is seen above it, and no more than all of the scatter may hide below."""
    file = reference_file("five_axis_sphere_centres.csv")
    with file.open(encoding="utf-8") as stream:
        rows = [r for r in csv.DictReader(line for line in stream if not line.startswith("#"))]
    pose = np.unique(np.array([[float(r["B_deg"]), float(r["C_deg"])] for r in rows]), axis=0, return_inverse=True)[
        1
    ].ravel()
    centres = np.array([[float(r[k]) for k in ("x_mm", "y_mm", "z_mm")] for r in rows])
    squares = sum(((centres[pose == p] - centres[pose == p].mean(axis=0)) ** 2).sum() for p in np.unique(pose))
    expected = np.sqrt(squares / (3 * (len(rows) - pose.max() - 1)))
    for name in ("machine.toml", "router.toml"):
        shutil.copy(DATASETS / "five_axis_router" / name, tmp_path / name)
    shutil.copyfile(file, tmp_path / file.name)
    [found] = repeatability(load_campaign(tmp_path / "router.toml"))
    assert found.observed == pytest.approx(expected, rel=1e-6)
    assert not found.seen and found.upper < 1.3 * expected


def test_virtual_instruments_show_the_repeatability_that_a_plan_states():
    """A laser along X with the effect `repeatability`: 1 µm of X beside an instrument of 0.3 µm comes back by the estimate; the
    straightness indicator, which X's position does not move, sees none of it."""
    rng = np.random.default_rng(10)
    effect = Effect("axes", "repeatability", 1e-3, "point", {"axes": {"X": 1e-3}})
    sets = [runs(rng, (0, 0), 3e-4, 30, component=c, name=c) for c in "XY"]
    plan = Campaign(MACHINE, (), tuple(replace(s, effects=(effect,), readings=s.readings * np.nan) for s in sets))
    seen, _ = simulate(plan, random_truth(MACHINE, seed=1), seed=2)
    found = {r.label: r for r in repeatability(seen)}
    for label in ("X up", "X down"):
        assert abs(found[label].s - 1e-3) < 3.0 * found[label].u < 3e-4
    assert not found["EYX up"].seen and not found["EYX down"].seen


def test_a_thermal_limit_that_is_none_is_refused_before_the_fit():
    own = runs(np.random.default_rng(9), (4e-4, 8e-4), 2e-4)
    with pytest.raises(InputError, match="thermal_limit is '3'; expected a length in mm, 0 or above and below 1"):
        check_campaign(Campaign(MACHINE, (), (own,), conditions={"thermal_limit": 3}))
