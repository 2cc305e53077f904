"""Spline resolution: never more than the positions carry, finer where the truth waves, and the same for any order of rows."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from exact_chain import Smooth, Truth, random_truth, tracker_campaign
from support.machines import VERTICAL, exact_machine, fixed, volid_machine
from support.rtests import r_test, r_test_campaign
from support.trackers import distance_campaign, simulated

from volid.exceptions import InputError
from volid.fitting.diagnosis import resolution
from volid.fitting.diagnosis.identifiability import WEAKEST
from volid.fitting.equations.problem import build_problem, scatter
from volid.fitting.fit import fit
from volid.fitting.starts import find_starts
from volid.model.error_functions import motion_names
from volid.model.error_model import build_model

AXES = VERTICAL.axes


def grid_campaign(n_grid, extra="", **plan):
    """Positions on so many places per axis (X, Y, Z)."""
    return simulated(VERTICAL, 1, extra=extra, n_grid=n_grid, **({"n_per_station": 60} | plan))[0]


def wave(axis, n_periods, amplitude):
    """Sine over the travel, zero at the reference."""
    low, high = VERTICAL.travel[axis]
    a = np.array([amplitude])
    return Smooth(a, np.array([n_periods / (high - low)]), np.zeros(1), np.zeros(2), VERTICAL.reference[axis], 1.0)


# ---------------------------------------------------------------------------------------- what the positions carry


@pytest.mark.parametrize("n_grid, finest", [(9, 6), (4, 1), (2, 1), (13, 10), (11, 8), (40, 24)])
def test_never_more_than_the_positions_carry(n_grid, finest):
    """n segments of degree 3 have n + 3 coefficients: 9 positions carry 6 segments, not 8."""
    campaign = grid_campaign(n_grid)
    counts = campaign.distinct_positions()
    assert counts == dict.fromkeys("XYZ", n_grid)
    carrier, automatic = resolution.limits(campaign)
    assert automatic == set(motion_names(campaign.machine))
    assert set(carrier.values()) == {(finest,)}
    assert finest + 3 <= n_grid or finest == 1


@pytest.mark.parametrize(("n_a", "finest"), [(13, 8), (11, 6), (5, 1)])
def test_a_tilting_axis_keeps_two_positions_to_spare(n_a, finest):
    """13 positions of a static R-test grid carry 8 segments (11 coefficients), not 10 or 12; a full turn of 37 carries 24."""
    exact = exact_machine("w C' A' Y' X' b Z t")
    data = r_test(exact, Truth(), np.random.default_rng(0), counts={"A": n_a, "C": 37}, noise=0.0)
    carrier, _ = resolution.limits(r_test_campaign(volid_machine(exact, '[model]\nsegments = "auto"\n'), data))
    assert {carrier[f"E{d}A"] for d in "XYZABC"} == {(finest,)}
    assert {carrier[f"E{d}C"] for d in "XYZABC"} == {(24,)}


def test_every_axis_has_its_own_limit_and_degree_counts():
    order = [{"X": 9, "Y": 30, "Z": 5}[a] for a in AXES]
    campaign = grid_campaign(order, '[model.functions]\n"E?X" = { degree = 1 }\nEAZ = { over = ["Z", "X"] }')
    carrier, _ = resolution.limits(campaign)
    assert carrier["EXX"] == (8,) and carrier["EYY"] == (24,) and carrier["EZZ"] == (2,)
    assert carrier["EAZ"] == (2, 6), "a cross effect: its own axis first, no more than 8 on either"


def test_fit_of_nine_positions_keeps_to_the_limit():
    solution = fit(grid_campaign(9, n_per_station=120))
    assert all(s.segments + s.degree <= 9 for f in solution.model.functions for s in f.splines)
    assert solution.fully_determined


def test_stated_segments_are_kept():
    campaign = grid_campaign(9, fixed(4, '[model.functions]\nEXX = { segments = 6 }\nEYX = { segments = "auto" }'))
    carrier, automatic = resolution.limits(campaign)
    assert automatic == {"EYX"} and carrier["EXX"] == (6,) and carrier["EBX"] == (4,)


def test_stated_segments_of_a_cross_effect_need_a_number_for_each_axis():
    campaign = grid_campaign(9)
    settings = replace(campaign.machine.model.functions.get("EAZ", _default()), segments=(4,), over=("Z", "X"))
    model = replace(campaign.machine.model, functions={"EAZ": settings})
    machine = type(campaign.machine)("m", "", campaign.machine.axes, campaign.machine.datum, model)
    with pytest.raises(InputError, match=r"EAZ: segments = \[4\] needs one number for each of \('Z', 'X'\)"):
        resolution.limits(replace(campaign, machine=machine))


def _default():
    from volid.model.machine import FunctionSettings

    return FunctionSettings()


def test_candidates_refine_to_the_carrier():
    assert resolution.candidates((24,)) == [(n,) for n in (1, 2, 3, 4, 6, 8, 12, 24)]
    assert resolution.candidates((4, 2)) == [(1, 1), (1, 2), (2, 1), (2, 2), (4, 1), (4, 2)]


# ------------------------------------------------------------------------------------------------- held-out scores


def brute_force(problem, campaign, z, folds, columns):
    """Held-out chi-square per fold by least squares on the rows themselves; `columns` scaled as the search scales them."""
    (rows,) = problem.equations.jacobian(z)
    J = np.asarray(rows).transpose(0, 2, 1).reshape(-1, problem.system.size)[: len(campaign.sets[0])]
    s = campaign.sets[0]
    predicted = scatter(problem, campaign, problem.equations.predictions(z))[0]
    machine_part = np.where(np.arange(len(z)) < problem.model.layout.n_coefficients, z, 0.0)
    y = ((s.readings - predicted) / s.u)[:, 0] + J @ machine_part
    A = J @ columns
    result = []
    for k in range(resolution.N_FOLDS):
        held = folds == k
        train = np.vstack([A[~held], WEAKEST * np.eye(A.shape[1])])
        x = np.linalg.lstsq(train, np.append(y[~held], np.zeros(A.shape[1])), rcond=None)[0]
        result.append(np.sum((y[held] - A[held] @ x) ** 2))
    return np.array(result)


def test_scores_are_those_of_refitting_without_the_fold():
    campaign = simulated(VERTICAL, 1, n_per_station=60)[0]
    carrier = {n: (4,) for n in motion_names(campaign.machine)}
    problem = build_problem(campaign, build_model(campaign.machine, carrier), find_starts(campaign))
    rng = np.random.default_rng(0)
    z = problem.start.copy()
    z[: problem.model.layout.n_coefficients] = 1e-6 * rng.normal(size=problem.model.layout.n_coefficients)
    ones = [np.ones(s.readings.shape) for s in campaign.sets]
    search = resolution._Search(
        problem, resolution._fold_equations(problem, campaign, z, ones), carrier, carrier, set(carrier)
    )
    (folds,) = resolution._folds(campaign, np.random.default_rng(0))
    options = resolution.candidates((4,))
    for name, option in (("EXX", (2,)), ("ECY", (1,)), ("EXX", (1,))):  # in the midst of a search
        search.chosen[name] = option
        search.equations.put(name, search._part(name))
    scores = search.scores("EBX", options)
    assert scores.shape == (3, resolution.N_FOLDS)
    for option, ours in zip(options, scores, strict=True):
        others = [part for name, part in search.equations.parts.items() if name != "EBX"]
        parts = [(search.columns["EBX"], search.block("EBX", option)), *others]
        columns = np.hstack([np.zeros((problem.system.size, block.shape[1])) for _, block in parts])
        edges = np.cumsum([0, *(block.shape[1] for _, block in parts)])
        for (rows, block), start, stop in zip(parts, edges[:-1], edges[1:], strict=True):
            columns[rows, start:stop] = block
        np.testing.assert_allclose(ours, brute_force(problem, campaign, z, folds, columns), rtol=1e-6)


def test_a_search_that_stops_early_chooses_what_full_sweeps_choose():
    """Full sweeps ask every function again; what they ask is then the state that a new search would begin with."""
    campaign, _ = wavy_and_straight()
    carrier = {n: (12,) for n in motion_names(campaign.machine)}
    problem = build_problem(campaign, build_model(campaign.machine, carrier), find_starts(campaign))
    z = problem.start.copy()
    folds = resolution._fold_equations(problem, campaign, z, [np.ones(s.readings.shape) for s in campaign.sets])
    asked: dict[bool, int] = {}
    searches = {}
    for full in (False, True):
        search = searches[full] = resolution._Search(
            problem, folds, carrier, dict.fromkeys(carrier, (6,)), set(carrier)
        )
        best, asked[full] = search.best, 0

        def counted(name, best=best, full=full):
            asked[full] += 1
            return best(name)

        search.best = counted
        while search.sweep():
            search.unchanged = -1000 if full else search.unchanged
    assert searches[False].chosen == searches[True].chosen != dict.fromkeys(carrier, (6,))
    assert asked[False] < asked[True]
    anew = resolution._Search(problem, folds, carrier, searches[False].chosen, set(carrier))
    options = resolution.candidates((12,))
    for name in ("EXX", "EAZ"):
        np.testing.assert_allclose(searches[False].scores(name, options), anew.scores(name, options), rtol=1e-6)


def test_folds_are_whole_positions_of_similar_size():
    campaign = grid_campaign(4)
    (fold,) = resolution._folds(campaign, np.random.default_rng(0))
    _, point = np.unique(campaign.sets[0].positions, axis=0, return_inverse=True)
    assert all(len(set(fold[point == p])) == 1 for p in range(point.max() + 1))
    assert set(fold) == set(range(resolution.N_FOLDS))


# ------------------------------------------------------------------------------------------------------ the choice


@cache
def wavy_and_straight():
    """EXX and EBY wave with 5 periods per travel, EYY and EAX are straight; what the fit chooses."""
    rng = np.random.default_rng(3)
    truth = random_truth(VERTICAL, rng, waviness=0.5)
    truth.functions["EXX"] = wave("X", 5, 0.008)
    truth.functions["EBY"] = wave("Y", 5, 20e-6)
    truth.functions["EYY"] = Smooth(*np.zeros((3, 1)), np.array([0.0, 2e-5]), VERTICAL.reference["Y"], 1.0)
    truth.functions["EAX"] = Smooth(*np.zeros((3, 1)), np.zeros(2))
    assert isinstance(truth, Truth)
    tracker = tracker_campaign(VERTICAL, truth, rng, n_per_station=400)
    campaign = distance_campaign(volid_machine(VERTICAL), tracker)
    return campaign, fit(campaign)


def test_short_waves_get_more_segments_than_straight_lines():
    _, solution = wavy_and_straight()
    segments = {name: n[0] for name, n in solution.model.segments.items()}
    assert segments["EXX"] >= 12 and segments["EBY"] >= 12, "5 periods need more than 8 intervals"
    assert segments["EYY"] <= 8 and segments["EAX"] <= 8
    assert not solution.adequacy.rejected


def test_finest_resolution_on_offer_is_noted():
    _, solution = wavy_and_straight()
    finest = [n for n, s in solution.model.segments.items() if s == (24,)]
    noted = [n for n in solution.notes if n.startswith("finest resolution on offer taken for")]
    assert len(noted) == bool(finest) and all(name in noted[0] for name in finest)


@pytest.mark.slow
def test_choice_does_not_depend_on_the_order_of_rows():
    campaign, solution = wavy_and_straight()
    s = campaign.sets[0]
    order = np.random.default_rng(0).permutation(len(s))
    mixed = s.rows_of(order)
    assert fit(replace(campaign, sets=(mixed,))).model.segments == solution.model.segments
