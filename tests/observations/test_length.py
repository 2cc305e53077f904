"""Lengths between two functional points: against exact chains, in recovery, and what their messages say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import random_truth
from support.kinds import TOOLS, exact_truth, machine_of, plan_set, positions_of
from support.machines import LAYOUTS, VERTICAL, exact_machine, volid_machine

from volid.campaign import Campaign, Effect, End, ObservationSet
from volid.exceptions import InputError
from volid.fitting.diagnosis.sensitivities import of_readings
from volid.fitting.equations.interpreted import Interpreted
from volid.fitting.equations.problem import build_problem, random_effects
from volid.fitting.fit import fit
from volid.fitting.streamed import fit_streamed
from volid.io import load_campaign, write_campaign, write_manifest
from volid.io.campaign.stream import CampaignStream
from volid.model.error_functions import motion_names, spline_axes
from volid.model.error_model import build_model
from volid.model.splines import evaluate
from volid.observations.artefact_lengths import nominal_lengths
from volid.observations.base import NuisanceTable
from volid.observations.length import LENGTH, LengthSettings
from volid.plausibility.checks import check_campaign
from volid.virtual.simulate import simulate

PLANE = """format = "volid-machine/1"
name = "plotter"
structure = "w b X Y t"
[axis.X]
travel = [0.0, 500.0]
[axis.Y]
travel = [0.0, 400.0]
[model]
segments = 2
[model.functions]
"E?X" = false
"E?Y" = false
EXX = true
EYX = true
EXY = true
EYY = true
"""
THREE = """format = "volid-machine/1"
name = "coordinate measuring machine"
structure = "w b Y X Z t"
[axis.X]
travel = [0.0, 600.0]
[axis.Y]
travel = [0.0, 400.0]
[axis.Z]
travel = [-300.0, 0.0]
[model]
segments = 2
"""


def lengths(machine, first, second, tool=(0.0, 0.0, 0.0), to_tool=None, **changes) -> ObservationSet:
    """A set of lengths without readings; positions (m, n_axes) in the machine's order."""
    u = changes.pop("u", 5e-4)
    labels = changes.pop("labels", None)
    own = plan_set("lengths", "length", first, tool, labels, u=u, **changes)
    second_tool = own.tool if to_tool is None else np.broadcast_to(to_tool, own.tool.shape).copy()
    return replace(own, to=End(second, np.zeros_like(second), second_tool))


# ----------------------------------------------------------------------------------------------- independent truth


@pytest.mark.parametrize("exact", [VERTICAL, *(exact_machine(s) for s in LAYOUTS.values())], ids=["vertical", *LAYOUTS])
def test_predictions_are_distances_of_an_exact_chain(exact):
    """4x4 matrices of full rotations, in another program; 30 µrad about arms of 1 m leave 1e-9 mm to second order."""
    rng = np.random.default_rng(4)
    truth = random_truth(exact, rng, reversal=True)
    machine = volid_machine(exact)
    low, high = np.array([exact.travel[a] for a in exact.axes]).T
    q, p = (low + rng.random((40, len(low))) * (high - low) for _ in range(2))
    way, back = rng.choice([-1.0, 1.0], (2, 40, len(low)))
    tool, to_tool = TOOLS[np.arange(40) % 3], TOOLS[(np.arange(40) + 1) % 3]
    first, second = exact.functional_point(q, tool, truth, way), exact.functional_point(p, to_tool, truth, back)
    expected = np.sqrt(np.sum((second - first) ** 2, axis=1))
    constants = [truth.constants.get(f"E{c}0S", 0.0) * np.ones((40, 1)) for c in "XYZABC"]
    errors = [
        np.hstack([*(exact.errors(a, at, truth, w) for a in exact.axes), *constants]).T
        for at, w in ((q, way), (p, back))
    ]
    seen = np.vstack([q.T, p.T]), tuple(np.vstack([tool.T, to_tool.T])), np.vstack(errors)
    found = LENGTH.predict(machine, LengthSettings(False, False), *seen, (), ())[0]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7)
    offset, scale = np.full(40, 0.3), np.full(40, 1e-4)
    relative = LENGTH.predict(machine, LengthSettings(True, True), *seen, (offset, scale), ())[0]
    np.testing.assert_allclose(relative, 1.0001 * expected + 0.3, rtol=0.0, atol=1e-7)
    own = lengths(machine, q, p, tool, to_tool)
    nominal = exact.functional_point(p, to_tool) - exact.functional_point(q, tool)
    np.testing.assert_allclose(nominal_lengths(own, machine), np.linalg.norm(nominal, axis=1), atol=1e-9)


# --------------------------------------------------------------------------------------------------------- recovery


def judged(plan: Campaign, seed: int):
    """The truth of a simulated plan, and the fit to its readings."""
    campaign, truth = simulate(plan, exact_truth(plan.machine), seed=seed)
    return truth, fit(campaign)


def test_sides_and_diagonals_determine_a_plane():
    """All lengths between the points of a grid, in µm: the figure without its motion, within U at 95 % and more of its sides."""
    machine = machine_of(PLANE)
    grid = np.array([(x, y) for x in np.linspace(0.0, 500.0, 5) for y in np.linspace(0.0, 400.0, 5)])
    a, b = np.triu_indices(len(grid), 1)
    first, second = (grid[i][:, [machine.letters.index("X"), machine.letters.index("Y")].copy()] for i in (a, b))
    plan = Campaign(machine, (), (lengths(machine, first, second, u=5e-4),))
    truth, solution = judged(plan, 3)
    assert not solution.statements and not solution.adequacy.rejected, solution.adequacy.verdict
    assert solution.adequacy.unit_weight == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * len(a)))  # four of its own u
    own = ("EXX", "EYX", "EXY", "EYY", "EC0Y")
    assert (
        all(np.isfinite(f.u) for f in solution.functions() if f.name in own)
        and 0.0 < solution.location("EC0Y").u < 1e-6
    )
    true = truth.deviation(grid, np.zeros(3))[:, :2] + grid
    found = np.asarray(solution.deviation(grid, np.zeros(3)))[:, :2] + grid
    apart = np.linalg.norm(found[a] - found[b], axis=1) - np.linalg.norm(true[a] - true[b], axis=1)
    assert np.sqrt(np.mean(apart**2)) < 2e-4  # 300 readings of 0.5 µm for some 20 parameters: 0.13 µm
    assert np.abs(apart).max() < 4 * 2e-4


def test_lengths_alone_determine_a_machine_with_three_tool_vectors():
    """Everything but what no length can tell, the motion of the workpiece, which the datum takes."""
    machine = machine_of(THREE)
    m = 900
    q, p = positions_of(machine, m, seed=1), positions_of(machine, m, seed=2)
    tool = TOOLS[np.arange(m) % 3]
    to_tool = TOOLS[(np.arange(m) // 3) % 3]
    plan = Campaign(machine, (), (lengths(machine, q, p, tool, to_tool, relative=False),))
    truth, solution = judged(plan, 5)
    assert not solution.statements, solution.statements
    assert solution.adequacy.unit_weight == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * m))
    other, far = positions_of(machine, 300, seed=8), positions_of(machine, 300, seed=9)
    new = lengths(machine, other, far, TOOLS[0])
    points = [[np.asarray(f.deviation(e.positions, e.tool))[:, :3] for e in new.ends] for f in (truth, solution)]
    nominal = new.ends[1].positions - new.ends[0].positions
    order = [machine.index(c) for c in "XYZ"]
    true, found = (np.linalg.norm(nominal[:, order] + b - a, axis=1) for a, b in points)
    assert np.sqrt(np.mean((found - true) ** 2)) < 3e-4  # readings of 0.5 µm, ten for each of some 90 parameters


def gauge_plan(machine, places, steps, **options) -> Campaign:
    """A step gauge along X at several places (y, z): every step from its first face."""
    first, second, names = [], [], []
    for number, (start, y, z) in enumerate(places):
        for step in steps:
            for ends, at in ((first, start), (second, start + step)):
                q = np.zeros(3)
                for letter, value in zip("XYZ", (at, y, z), strict=True):
                    q[machine.index(letter)] = value
                ends.append(q)
            names.append(f"place {number}")
    own = lengths(machine, np.array(first), np.array(second), labels={"artefact": np.array(names)}, **options)
    return Campaign(machine, (), (own,))


ONLY_EXX = '[model.functions]\n"*" = false\nEXX = true\n'


def test_a_step_gauge_gives_positioning_over_the_part_of_the_travel_that_it_spans():
    machine = machine_of(THREE + ONLY_EXX)
    places = [(100.0, 200.0, -150.0), (100.0, 100.0, -150.0), (100.0, 200.0, -50.0)]
    plan = gauge_plan(machine, places, np.arange(20.0, 301.0, 20.0))
    truth, solution = judged(plan, 2)
    assert solution.measured_range()[machine.index("X")].tolist() == [100.0, 400.0]
    assert any("X 100 … 400 of 0 … 600 mm" in note for note in solution.notes)
    largest = max(f.u for f in solution.functions() if f.name == "EXX")
    q = np.zeros((31, 3))
    q[:, machine.index("X")] = np.linspace(100.0, 400.0, 31)
    found, true = (np.asarray(f.deviation(q, np.zeros(3)))[:, 0] for f in (solution, truth))
    difference = (found - found[0]) - (true - true[0])  # EXX of both, zero at other references
    assert np.abs(difference).max() < 4.0 * np.sqrt(2.0) * largest
    assert np.sqrt(np.mean(difference**2)) < 5e-4


def test_an_unknown_offset_of_a_gauge_is_found_from_its_differences():
    """Each placement has an offset of its own (the first face was probed with a force of its own)."""
    machine = machine_of(THREE + ONLY_EXX)
    plan = gauge_plan(
        machine, [(100.0, 200.0, -150.0), (300.0, 100.0, -150.0)], np.arange(20.0, 301.0, 20.0), relative=True
    )
    truth, solution = judged(plan, 6)
    n = solution.model.n_parameters
    for i, entry in enumerate(solution.nuisance_table):
        u = float(np.sqrt(solution.covariance[n + i, n + i]))
        assert entry.name in truth.instruments and 0.0 < u < 2e-3
        assert abs(float(solution.nuisance[i]) - truth.instruments[entry.name]) < 4.0 * u
    assert {e.name for e in solution.nuisance_table} == {"offset of length place 0", "offset of length place 1"}


@pytest.mark.slow
def test_monte_carlo_scatters_as_the_covariance_says():
    from volid.uncertainty.trials.monte_carlo import monte_carlo

    machine = machine_of(PLANE)
    q, p = positions_of(machine, 150, seed=1), positions_of(machine, 150, seed=2)
    plan = Campaign(machine, (), (lengths(machine, q, p, relative=True),))
    campaign, _ = simulate(plan, exact_truth(machine), seed=1)
    solution = monte_carlo(fit(campaign), 2000, seed=1)
    x = np.concatenate(list(solution.samples.batches()))
    expected = np.sqrt(np.diagonal(solution.covariance))
    np.testing.assert_allclose(x.std(axis=0), expected, rtol=0.1)  # 2000 trials: 1.6 %, four of that and more


def test_lengths_that_are_read_part_by_part_give_the_same_machine(tmp_path):
    machine = machine_of(PLANE)
    q, p = positions_of(machine, 200, seed=1), positions_of(machine, 200, seed=2)
    plan = Campaign(
        machine, (), (lengths(machine, q, p, labels={"artefact": np.resize(["bar", "gauge"], 200)}, relative=True),)
    )
    campaign, _ = simulate(plan, exact_truth(machine), seed=1)
    write_campaign(campaign, tmp_path / "c.h5")
    assert [len(part.sets[0]) for part in CampaignStream(tmp_path / "c.h5").parts(rows=150)] == [150, 50]
    whole, parts = fit(campaign), fit_streamed(CampaignStream(tmp_path / "c.h5"), sample=200)
    np.testing.assert_allclose(np.asarray(parts.parameters), np.asarray(whole.parameters), rtol=0.0, atol=1e-9)


# ------------------------------------------------------------------------------------------------ what acts on both ends


def test_tests_of_other_causes_see_both_ends():
    """Sensitivities to EXX at both ends times its basis there, summed, are columns of the Jacobian; sets of one end beside."""
    machine = machine_of(PLANE)
    q, p = positions_of(machine, 30, seed=1), positions_of(machine, 30, seed=2)
    own = lengths(machine, q, p)
    single = plan_set("single", "component", q, (0.0, 0.0, 0.0), {"component": "X"})
    plan = Campaign(machine, (), tuple(replace(s, name=n) for s, n in ((own, "a"), (single, "b"), (own, "c"))))
    campaign, _ = simulate(plan, exact_truth(machine), seed=1)
    segments = {n: (2,) * len(spline_axes(machine, n)) for n in motion_names(machine)}
    problem = build_problem(campaign, build_model(machine, segments), engine=Interpreted())
    seen = of_readings(problem, campaign, problem.start)
    assert seen.errors.shape[1] == 150 and len(seen.summed(seen.errors.T)) == 90
    (term,) = [t for t in problem.model.layout.terms if t.name == "EXX" and t.part == "mean"]
    columns = seen.summed((seen.errors[term.row] * evaluate(term.basis, seen.positions.T, seen.directions.T)).T)
    blocks = problem.equations.jacobian(problem.start)
    whole = np.concatenate([block[0].T[:30] for block in blocks])[:, term.start : term.start + term.basis.size]
    np.testing.assert_allclose(columns, whole, rtol=1e-9, atol=1e-9)
    assert np.abs(seen.of_each(np.arange(90.0))[90:] - np.r_[np.arange(30.0), np.arange(60.0, 90.0)]).max() == 0.0


def test_positions_of_both_ends_scatter():
    """A length along X: u² grows by 2 u_X²; a length at 45° in X and Y by u_X² + u_Y² (directions squared, both ends)."""
    machine = machine_of(THREE)
    q, p = np.zeros((2, 3)), np.zeros((2, 3))
    p[0, machine.index("X")] = p[1, machine.index("X")] = p[1, machine.index("Y")] = 300.0
    effect = Effect("scatter", "repeatability", 1e-3, "point", {"axes": {"X": 1e-3, "Y": 2e-3}})
    plan = lengths(machine, q, p)
    own = replace(plan, effects=(effect,), readings=nominal_lengths(plan, machine)[:, None])
    ((_, variance),) = random_effects(Campaign(machine, (), (own,)))[0]
    np.testing.assert_allclose(variance[:, 0], [2e-6, 0.5 * 2.0 * (1e-6 + 4e-6)], rtol=1e-9)


def test_a_tool_that_both_ends_share_changes_no_length_between_them():
    machine = machine_of(THREE)
    q, p = positions_of(machine, 5, seed=1), positions_of(machine, 5, seed=2)
    effect = Effect("tip", "tool_length", 1e-3, "point", {"components": "XYZ"})
    for to_tool in (None, TOOLS[1]):
        plan = lengths(machine, q, p, TOOLS[0], to_tool)
        own = replace(plan, effects=(effect,), readings=nominal_lengths(plan, machine)[:, None])
        ((_, variance),) = random_effects(Campaign(machine, (), (own,)))[0]
        np.testing.assert_allclose(variance, 0.0, atol=1e-20)  # one error of the tool, drawn anew for each length
    own = replace(own, effects=(replace(effect, per="tool"),))
    campaign = Campaign(machine, (), (own,))
    from volid.effects.prediction import groups_of

    table = NuisanceTable()
    (group,) = groups_of(own, campaign, table)
    assert group.form.tool == (0, 1, 2, 3, 4, 5) and len({*group.slots[0]} & {*group.slots[3]}) == 0


# --------------------------------------------------------------------------------------------------------- messages


def measured(**options) -> Campaign:
    machine = machine_of(THREE)
    q, p = positions_of(machine, 20, seed=1), positions_of(machine, 20, seed=2)
    plan = lengths(machine, q, p, labels={"artefact": np.array(["bar", "gauge"])[np.arange(20) % 2]}, **options)
    return simulate(Campaign(machine, (), (plan,)), exact_truth(machine), seed=1)[0]


def changed(campaign: Campaign, **fields) -> Campaign:
    return replace(campaign, sets=(replace(campaign.sets[0], **fields),))


@pytest.mark.parametrize(("factor", "unit"), [(1e-3, "metres"), (1e3, "micrometres"), (1.0 / 25.4, "inches")])
@pytest.mark.parametrize("relative", [False, True])
def test_lengths_in_another_unit_are_named(factor, unit, relative):
    campaign = measured(relative=relative)
    check_campaign(campaign)
    wrong = changed(campaign, readings=factor * campaign.sets[0].readings)
    with pytest.raises(InputError, match=f"set 'lengths': lengths seem to be in {unit}"):
        check_campaign(wrong)


def test_ends_at_one_place_and_lengths_below_0_are_named():
    campaign = measured()
    own = campaign.sets[0]
    with pytest.raises(InputError, match="lengths, row 1 and 19 more such rows: both ends are one place"):
        check_campaign(changed(campaign, to=own.ends[0]))
    with pytest.raises(InputError, match="length is not positive; expected a length > 0"):
        check_campaign(changed(campaign, readings=-own.readings))


def test_a_missing_end_is_named_by_its_column(tmp_path):
    path = write_manifest(measured(), tmp_path / "c")
    table = tmp_path / "c" / "lengths.csv"
    table.write_text(table.read_text().replace("to_Z", "too_Z"))
    with pytest.raises(InputError, match=r"lengths\.csv.*column 'to_Z' is missing"):
        load_campaign(path)


def test_an_artefact_is_known_or_unknown_and_the_same_in_all_sets():
    campaign = measured(relative=True)
    with pytest.raises(InputError, match=r"relative = true .* beside calibrated_u"):
        LENGTH.check(replace(campaign.sets[0], options={"relative": True, "calibrated_u": 1e-3, "scale_u": 0.0}))
    stated = {"relative": False, "calibrated_u": 1e-3, "scale_u": 0.0}
    other = replace(campaign.sets[0], name="again", options=stated, readings=campaign.sets[0].readings + 1e-4)
    with pytest.raises(InputError, match="set 'again', artefact 'bar': relative or calibrated_u is stated otherwise"):
        fit(replace(campaign, sets=(*campaign.sets, other)))


@pytest.mark.parametrize("segments", ["segments = 2", ""], ids=["stated", "from the data"])
def test_sides_alone_leave_the_squareness_open_and_say_why(segments):
    """Where splines are chosen from the data, positions are moved to decide on rank: what stands still must do so there."""
    machine = machine_of(PLANE.replace("segments = 2", segments))
    x, y = machine.index("X"), machine.index("Y")
    first, second = [], []
    for at in np.linspace(0.0, 400.0, 6):
        for step in np.linspace(50.0, 400.0, 8):
            for moving, still in ((x, y), (y, x)):
                q = np.zeros(2)
                q[still] = at
                first.append(q)
                second.append(q + step * (np.arange(2) == moving))
    plan = Campaign(machine, (), (lengths(machine, np.array(first), np.array(second)),))
    solution = fit(simulate(plan, exact_truth(machine), seed=1)[0])
    assert "EC0Y" in solution.undetermined
    assert any(
        "no length is inclined in the plane of X and Y; measure both diagonals" in s for s in solution.statements
    )
    assert not any(name in solution.undetermined for name in ("EXX", "EYY"))
    assert set(motion_names(machine)) >= {"EXX", "EYY"}
