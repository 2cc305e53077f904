"""Fits in which the smoothness is estimated: positions on few levels, parts of a travel, short waves, an earlier solution.

The truth is no spline and comes from the exact chain; that of a measured part of the travels follows by elementary formulas.
`python -m benchmarks.honesty` does the same for a hundred seeds of every case, and for a thousand random machines and plans.
"""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, default_tools, random_truth
from exact_chain.measured_range import truth_of_range
from support.judging import judge
from support.machines import VERTICAL, volid_machine
from support.recovery import volume
from support.short_waves import with_waves
from support.trackers import distance_campaign, simulated, tracker_campaign

from volid import load_solution, save_solution
from volid.exceptions import InputError
from volid.fitting.fit import fit
from volid.io.machines import format_machine, parse_machine
from volid.model.machine import Datum
from volid.uncertainty.budget import SCATTER, SMOOTHNESS, budget, budget_lines, headline_rows
from volid.uncertainty.outputs import headline_outputs
from volid.uncertainty.trials.monte_carlo import monte_carlo


def on_levels(levels, seed):
    campaign, truth, _ = simulated(VERTICAL, seed, waviness=1.2, n_per_station=400, n_grid=levels)
    return fit(campaign), truth


@pytest.mark.parametrize(
    ("levels", "least"), [(21, 0.93), (11, 0.93), (9, 0.93), pytest.param(6, 0.9, marks=pytest.mark.slow)]
)
def test_u_holds_between_the_levels(levels, least):
    """Two campaigns: coverage of the field of about 70 independent directions each; errors no larger than u says."""
    found = [judge(s, VERTICAL, t, *volume("vertical")) for s, t in (on_levels(levels, seed) for seed in (11, 12))]
    normalised = np.concatenate([f.normalised.ravel() for f in found])
    assert np.mean(np.abs(normalised) < 1.96) > least
    assert np.sqrt(np.mean(normalised**2)) > 0.4, "u is not so large that it says nothing"


def test_positions_too_far_apart_for_the_waves_are_named():
    """Three waves over the travel at six positions: no reading sees what lies between, and that is said."""
    campaign = simulated(VERTICAL, 5, waviness=2.5, n_per_station=300, n_grid=6)[0]
    solution = fit(campaign)
    assert any("axis X was measured at 6 positions, up to 152 mm apart" in text for text in solution.unseen)
    assert fit(simulated(VERTICAL, 5, waviness=1.0, n_per_station=300)[0]).unseen == ()


# ------------------------------------------------------------------------------------------- a part of the travel


def partly_measured(part, seed):
    """A campaign whose X went over a part of its travel only, in a machine file that has all of it."""
    rng = np.random.default_rng(seed)
    truth = random_truth(VERTICAL, rng, waviness=1.0)
    narrow = ExactMachine(VERTICAL.structure, {**VERTICAL.travel, "X": part}, reference=VERTICAL.reference)
    tracker = tracker_campaign(narrow, truth, rng, n_per_station=300, every_station_sees_every_tool=True)
    return distance_campaign(volid_machine(VERTICAL), tracker), truth


@pytest.fixture(scope="module")
def three_quarters():
    campaign, truth = partly_measured((0.0, 570.0), 6)
    return fit(campaign), truth


def test_functions_and_squareness_are_those_of_the_measured_part(three_quarters):
    solution, truth = three_quarters
    assert solution.machine.axis("X").travel == (0.0, 570.0) and solution.campaign.machine.axis("X").travel == (
        0.0,
        760.0,
    )
    ranges = {a.letter: a.travel for a in solution.machine.axes}
    functions, squareness = truth_of_range(truth, ranges, VERTICAL.reference)
    for name, value in squareness.items():
        row = solution.location(name)
        assert abs(row.value - value) < 3.5 * row.u < 3.5 * 2e-6, name
    # without the change of the reference line, the squareness of the whole travel lies many u away
    assert any(abs(truth.constants[n] - squareness[n]) > 10.0 * solution.location(n).u for n in squareness)
    away = []
    for name, function in functions.items():
        for row in solution.motion(name, np.linspace(*ranges[name[2]], 9)):
            away += [(row.value - float(function(np.array([row.position]))[0])) / row.u] if row.u > 1e-9 else []
    assert np.mean(np.abs(away) < 1.96) > 0.88 and np.abs(away).max() < 4.5


def test_outside_is_blank_and_extrapolated_on_request(three_quarters):
    """Beyond the measured part the extrapolation is continuous, its u grows, and the truth lies within it."""
    solution, truth = three_quarters
    x = np.array([560.0, 570.0, 580.0, 620.0, 700.0, 760.0])
    q = np.stack([x, np.full(6, 215.0), np.full(6, -230.0)], axis=1)
    found, further = solution.evaluate(q, (0.0, 0.0, -150.0)), solution.extrapolated().evaluate(q, (0.0, 0.0, -150.0))
    assert np.isnan(found.values[2:]).all() and found.outside.tolist() == [False, False, True, True, True, True]
    np.testing.assert_allclose(further.values[:2], found.values[:2], atol=1e-12)
    np.testing.assert_allclose(further.u[:2], found.u[:2], rtol=1e-6)
    assert further.outside.tolist() == found.outside.tolist()
    assert np.all(np.diff(further.u[1:, 0]) > 0.0) and further.u[-1, 0] > 5.0 * found.u[1, 0]
    functions, _ = truth_of_range(truth, {a.letter: a.travel for a in solution.machine.axes}, VERTICAL.reference)
    for name in ("EXX", "EYX", "EZX", "EAX", "EBX", "ECX"):
        for row in solution.extrapolated().motion(name, x):
            assert abs(row.value - float(functions[name](np.array([row.position]))[0])) < 4.0 * row.u + 1e-12, (
                name,
                row,
            )


def test_more_data_never_give_less(three_quarters):
    """What three quarters of a travel determine, nine tenths determine too."""
    campaign, _ = partly_measured((0.0, 684.0), 4)
    solution = fit(campaign)
    assert solution.fully_determined and three_quarters[0].fully_determined
    assert np.isfinite([row.u for row in solution.functions()]).all()


def test_extrapolation_needs_a_range_that_rises(three_quarters):
    with pytest.raises(InputError, match="expected one that rises"):
        three_quarters[0].extrapolated({"X": (500.0, 400.0)})


# ------------------------------------------------------------------------------------------------- an earlier solution


def test_an_earlier_solution_over_another_part_is_as_a_joint_fit():
    """The two halves of X one after the other, against both at once: same functions, ranges joined, no smoothness twice."""
    rng = np.random.default_rng(8)
    truth = random_truth(VERTICAL, rng, waviness=0.8)
    sets = []
    for part in ((0.0, 430.0), (330.0, 760.0)):
        reference = {**VERTICAL.reference, "X": 380.0}
        narrow = ExactMachine(VERTICAL.structure, {**VERTICAL.travel, "X": part}, reference=reference)
        tracker = tracker_campaign(narrow, truth, rng, n_per_station=250, every_station_sees_every_tool=True)
        sets.append(distance_campaign(volid_machine(VERTICAL), tracker))
    one, two = sets
    first = fit(one)
    second = fit(two, prior=first)
    others = tuple(replace(station, name=f"second {station.name}") for station in two.stations)
    labels = {**two.sets[0].labels, "station": np.char.add("second ", two.sets[0].labels["station"])}
    renamed = replace(two.sets[0], name="second", labels=labels)
    joint = fit(replace(one, stations=one.stations + others, sets=(one.sets[0], renamed)))
    assert second.machine.axis("X").travel == joint.machine.axis("X").travel == (0.0, 760.0)
    q = np.stack([np.linspace(5.0, 755.0, 16), np.full(16, 200.0), np.full(16, -300.0)], axis=1)
    a, b = (s.evaluate(q, default_tools()[1]) for s in (second, joint))
    assert np.all(a.outside == b.outside) and not a.outside.any()
    assert np.sqrt(np.mean(((a.values - b.values) / a.u)[:, :3] ** 2)) < 0.25
    np.testing.assert_allclose(a.u[:, :3], b.u[:, :3], rtol=0.15)


# ----------------------------------------------------------------------------------------------------- short waves


def test_waves_of_a_stated_pitch_are_found():
    campaign, truth = with_waves(1e-3, 10.0, pitch=10.0)
    solution = fit(campaign)
    assert not solution.adequacy.rejected and solution.scatter == {}
    x = np.linspace(300.0, 320.0, 41)
    found = np.array([row.value for row in solution.motion("EXX", x)])
    expected = truth.functions["EXX"](x) + 1e-3 * np.sin(2.0 * np.pi * x / 10.0 + 0.7)
    assert np.std(found - expected) < 0.12e-3


def test_short_waves_that_nobody_stated_are_part_of_every_u():
    """1 µm of amplitude, 0.71 µm RMS: stated, and the field with its waves lies within u as often as it should."""
    campaign, truth = with_waves(1e-3, 10.0)
    solution = fit(campaign)
    assert not solution.adequacy.rejected
    assert list(solution.scatter) == ["X"] and solution.scatter["X"] == pytest.approx(0.71e-3, rel=0.15)
    (note,) = [n for n in solution.notes if "waves too short" in n]
    assert "µm in X direction" in note and "`pitch`" in note
    q, tool = volume("vertical")
    plain = judge(solution, VERTICAL, truth, q, tool)
    x = q[:, VERTICAL.column("X")]
    difference = plain.difference[:, 0] - 1e-3 * np.sin(2.0 * np.pi * x / 10.0 + 0.7)
    u = solution.evaluate(q, tool).u[:, 0]
    assert np.mean(np.abs(difference) < 1.96 * u) > 0.92
    assert np.mean(np.abs(difference) < 1.96 * plain.u[:, 0]) < 0.6, "without it u would be far too small"


def test_u_that_is_too_small_as_a_whole_is_no_short_wave():
    campaign = simulated(VERTICAL, 6, n_per_station=300)[0]
    (s,) = campaign.sets
    solution = fit(replace(campaign, sets=(replace(s, u=0.5 * s.u),)))
    assert solution.scatter == {} and solution.adequacy.grade != "accepted"
    assert solution.adequacy.causes[0].cause == "u as a whole"
    assert solution.factor == pytest.approx(2.0, rel=0.1)  # 1761 degrees of freedom: 1.7 %, one group may have more


def test_scatter_reaches_budget_monte_carlo_and_file(tmp_path):
    campaign, _ = with_waves(1e-3, 10.0, every_station_sees_every_tool=True)
    solution = monte_carlo(fit(campaign), 400, seed=1)
    save_solution(solution, tmp_path / "s.h5")
    again = load_solution(tmp_path / "s.h5")
    assert again.scatter == solution.scatter
    rows = headline_rows(solution, headline_outputs(solution))
    lines = [line for line in budget_lines(budget(solution), rows) if line.output == "EXX"]
    assert {SCATTER, SMOOTHNESS} <= {line.source for line in lines}
    for position in {line.position for line in lines}:
        own = [line for line in lines if line.position == position]
        if own[0].u > 1e-9:
            assert np.sum([line.contribution**2 for line in own]) == pytest.approx(own[0].u ** 2)


def test_pitch_is_read_written_and_checked():
    text = format_machine(replace(volid_machine(VERTICAL), text=""))
    machine = parse_machine(text.replace("[axis.X]", "[axis.X]\npitch = 10.0"), "machine.toml")
    assert machine.axis("X").pitch == 10.0 and machine.axis("Y").pitch == 0.0
    assert parse_machine(format_machine(replace(machine, text="")), "again.toml").axis("X").pitch == 10.0
    for wrong in ("-1.0", "0.0", "1e-4", "400.0"):
        with pytest.raises(InputError, match=r"pitch.*expected a length in mm of at most 0\.1 of the travel"):
            parse_machine(text.replace("[axis.X]", f"[axis.X]\npitch = {wrong}"), "machine.toml")


# ------------------------------------------------------------------------------- reversal and functions of two axes


def test_reversal_and_cross_effects_are_estimated_alike():
    """Field and reversal within their u; how much a cross effect changes over its second axis is estimated too."""
    rng = np.random.default_rng(1)
    truth = random_truth(VERTICAL, rng, waviness=1.0, reversal=True, cross={"EAZ": "X"})
    settings = '[model.functions]\nEXX = { reversal = true }\nEYY = { reversal = true }\nEAZ = { over = ["Z", "X"] }\n'
    truth.reversal.pop("EZZ")
    tracker = tracker_campaign(VERTICAL, truth, rng, n_per_station=500, every_station_sees_every_tool=True)
    solution = fit(distance_campaign(volid_machine(VERTICAL, settings), tracker))
    assert not solution.adequacy.rejected
    found = judge(solution, VERTICAL, truth, *volume("vertical"), tool_rotation=False)
    assert np.mean(np.abs(found.normalised) < 1.96) > 0.92 and found.normalised_rms > 0.7
    away = []
    for name in ("EXX", "EYY"):
        for row in solution.motion(name, np.linspace(*VERTICAL.travel[name[2]], 9)):
            at = np.array([row.position])
            true = truth.functions[name](at)[0] + 0.5 * row.direction * truth.reversal[name](at)[0]
            away.append((row.value - true) / row.u)
    assert np.mean(np.abs(away) < 1.96) > 0.8 and np.abs(away).max() < 4.0
    assert {"EXX reversal size", "EAZ change"} <= set(solution.smooth.names)


# -------------------------------------------------------------------------------- the prior's rows are readings like others


@pytest.fixture(scope="module")
def few_levels():
    return fit(simulated(VERTICAL, 7, n_per_station=200, n_grid=9, every_station_sees_every_tool=True)[0])


def test_monte_carlo_draws_them(few_levels):
    """Spread of 1000 refits over u, every function between the levels: within chance of 1."""
    found = monte_carlo(few_levels, 1000, seed=2)
    outputs = headline_outputs(few_levels)
    x = found.samples.outputs(lambda v: v @ outputs.rows.T)
    u = np.sqrt(np.einsum("qi,ij,qj->q", outputs.rows, np.asarray(few_levels.covariance), outputs.rows))
    seen = u > 1e-9
    ratio = x.std(axis=0, ddof=1)[seen] / u[seen]
    assert abs(np.median(ratio) - 1.0) < 0.02 and ratio.min() > 0.9 and ratio.max() < 1.1


def test_budget_lists_them_and_adds_up(few_levels):
    found, outputs = budget(few_levels), headline_outputs(few_levels)
    assert SMOOTHNESS in found.sources
    total = np.sqrt(np.sum(found.contributions(outputs.rows) ** 2, axis=0))
    u = np.sqrt(np.einsum("qi,ij,qj->q", outputs.rows, np.asarray(few_levels.covariance), outputs.rows))
    np.testing.assert_allclose(total, u, rtol=1e-6, atol=1e-12)


def test_file_and_datum_keep_them(few_levels, tmp_path):
    save_solution(few_levels, tmp_path / "s.h5")
    again = load_solution(tmp_path / "s.h5")
    for name in ("values", "u", "root", "noise", "spread"):
        np.testing.assert_array_equal(getattr(again.smooth, name), getattr(few_levels.smooth, name))
    assert again.smooth.names == few_levels.smooth.names and again.machine == few_levels.machine
    moved = few_levels.in_datum(Datum("Z", "X"))
    before = few_levels.smooth.root @ np.asarray(few_levels.parameters)
    np.testing.assert_allclose(
        moved.smooth.root @ np.asarray(moved.parameters), before, atol=1e-3 * np.abs(before).max()
    )
    q, tool = volume("vertical")
    np.testing.assert_allclose(
        budget(moved).covariances.sum(axis=0), np.asarray(moved.covariance), rtol=1e-3, atol=1e-9
    )
    assert np.isfinite(moved.evaluate(q, tool).u[:, :3]).all()
