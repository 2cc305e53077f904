"""One contract for every observation kind: files, simulation, derivatives, recovery, change of datum, units."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.hdf5_files import changed
from support.kinds import (
    EXAMPLES,
    THREE,
    TOOLS,
    distances,
    exact_readings,
    exact_truth,
    machine_of,
    plan_set,
    positions_of,
    predictions,
)
from support.sets import assert_same_set

from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.fitting.equations.interpreted import Interpreted
from volid.fitting.equations.problem import build_problem, scatter
from volid.fitting.fit import fit
from volid.fitting.solution import Solution
from volid.fitting.starts import find_starts
from volid.io import load_campaign, write_campaign, write_manifest
from volid.io.solutions import read_solution, write_solution
from volid.model.jacobian import rigid_motion_rows
from volid.model.machine import Datum, Machine
from volid.observations import KINDS
from volid.plausibility.checks import check_campaign
from volid.uncertainty.trials.samples import Samples
from volid.virtual.simulate import simulate

EXACT = (
    2e-6  # mm: products of two errors again, since the fit's workpiece frame may lie elsewhere than that of the truth
)
MOVED = 5e-6  # mm: a change of datum leaves out products of two errors, (70 µrad)² · 1 m
TURNED = 5e-9  # rad: and in an angle (70 µrad)²
BY_UNIT = {"mm": MOVED, "rad": TURNED, "degrees": np.degrees(TURNED)}
DATUM = Datum("Z", "X", "end_point", (("Y", 100.0),))
FIRST = {kind: next(n for n, e in EXAMPLES.items() if e.kind == kind) for kind in KINDS}
EACH_KIND = pytest.mark.parametrize("name", FIRST.values())


def every(quick):
    """All examples, those that are not `quick` (name) marked slow."""
    return pytest.mark.parametrize(
        "name", [pytest.param(n, marks=() if quick(n) else pytest.mark.slow) for n in EXAMPLES]
    )


EVERY = every(lambda name: name in FIRST.values())
EVERY_BODY = every(lambda name: name in FIRST.values() or EXAMPLES[name].machine == THREE)


@cache
def measured(name: str) -> Campaign:
    """Exact readings of an example on a machine whose errors its own model can express; simulated for the first of each kind."""
    plan = EXAMPLES[name].plan()
    if name not in FIRST.values():
        return exact_readings(plan)
    return simulate(plan, exact_truth(plan.machine), seed=2, noise=False, station_error=2.0)[0]


@cache
def fitted(name: str) -> Solution:
    """The fit to `measured`."""
    return fit(measured(name))


def assert_same_predictions(campaign: Campaign, before: list, after: list, times: int = 1) -> None:
    """Readings per set, and again per sample, are the same but for `times` what a change of datum leaves out, in their units."""
    allowed = []
    for s in campaign.sets:
        m, k = s.readings.shape
        allowed.append(np.array([[BY_UNIT[KINDS[s.kind].unit_at(s, row, i)] for i in range(k)] for row in range(m)]))
    for number, (one, other) in enumerate(zip(before, after, strict=True)):
        worst = np.abs(other - one) / allowed[number % len(allowed)]
        assert worst.max() <= times, (
            f"{campaign.sets[number % len(allowed)].name}: {worst.max():.2f} of what is allowed"
        )


def test_every_kind_has_an_example():
    assert {e.kind for e in EXAMPLES.values()} == set(KINDS)


@EVERY
def test_the_fit_to_simulated_readings_leaves_nothing_and_finds_the_machine(name):
    campaign, solution, example = measured(name), fitted(name), EXAMPLES[name]
    for readings, left in zip(campaign.sets, solution.readings.residuals, strict=True):
        assert np.abs(left / readings.u).max() < example.loose, readings.name
    q, tool = positions_of(campaign.machine, 60, seed=9), TOOLS[np.arange(60) % 3]
    if example.single:
        tool = np.tile(TOOLS[0], (60, 1))
    truth = exact_truth(campaign.machine).deviation(q, tool)
    difference = (np.asarray(solution.deviation(q, tool)) - truth)[:, :3].reshape(-1)
    rigid = rigid_motion_rows(campaign.machine, q, tool)[:, :3].reshape(-1, 6)
    left = difference - rigid @ np.linalg.lstsq(rigid, difference, rcond=None)[0]
    # splines of degree 3 are the truth itself; what a stated u draws back from the truth is some hundredths of u
    assert np.abs(left).max() < (EXACT if example.loose < 0.01 else 1e-4)


@EVERY
def test_derivatives_are_finite_differences(name):
    campaign = measured(name)
    solution = fitted(name)
    problem = build_problem(campaign, solution.model, find_starts(campaign), engine=Interpreted())
    n = problem.model.layout.n_coefficients
    rng = np.random.default_rng(0)
    scale = np.concatenate([np.full(n, 1e-4), [1e-2 if e.unit == "mm" else 1e-5 for e in problem.nuisance]])
    scale[:n][[t.name[1] in "ABC" for t in problem.model.layout.terms for _ in range(t.basis.size)]] = 1e-7
    z = problem.start + scale * rng.normal(size=len(scale))

    def predicted(at):
        return scatter(problem, campaign, problem.equations.predictions(at))

    for _ in range(3):
        step = scale * rng.normal(size=len(scale))
        forward = [(a - b) / 2.0 for a, b in zip(predicted(z + step), predicted(z - step), strict=True)]
        blocks = problem.equations.jacobian(z)
        found = [_along(chunks, step) for chunks in blocks]
        for (number, rows), values in zip(problem.places, found, strict=True):
            u, k = campaign.sets[number].u[rows], campaign.sets[number].readings.shape[1]
            expected = forward[number][rows] / u
            # third derivatives: step³/6 d², and a metre rounded to 2e-13 mm
            np.testing.assert_allclose(values.reshape(k, -1).T[: len(rows)], expected, rtol=1e-6, atol=1e-8)


def _along(chunks, step):
    """J · step of one block, (k, readings)."""
    parts = [np.asarray(chunk).T @ step for chunk in chunks]
    return np.concatenate(parts)


@EACH_KIND
def test_files_lose_nothing(name, tmp_path):
    campaign = measured(name)
    write_campaign(campaign, tmp_path / "c.h5")
    for again in (load_campaign(write_manifest(campaign, tmp_path / "text")), load_campaign(tmp_path / "c.h5")):
        for one, other in zip(again.sets, campaign.sets, strict=True):
            assert_same_set(replace(one, source="", rows=None), replace(other, source="", rows=None))
    plan = EXAMPLES[name].plan()
    again = load_campaign(write_manifest(plan, tmp_path / "plan"), plan=True)
    assert all(np.isnan(s.readings).all() for s in again.sets)


@EVERY_BODY
def test_no_prediction_changes_with_the_datum(name):
    """Before Monte Carlo and, with samples scattered as the covariance says, after it."""
    solution = with_samples(fitted(name))
    moved = solution.in_datum(DATUM)
    assert moved.datum == DATUM
    assert np.abs(np.asarray(moved.nuisance) - np.asarray(solution.nuisance)).max() > 1e-5, "nothing to follow"
    before = predictions(solution, next(solution.samples.batches()))
    after = predictions(moved, next(moved.samples.batches()))
    assert_same_predictions(solution.campaign, before, after)


@EVERY
def test_the_solution_in_a_datum_is_the_fit_in_that_datum(name):
    solution, campaign = fitted(name), measured(name)
    there = fit(_in_machine_datum(campaign))
    moved = solution.in_datum(DATUM)
    assert_same_predictions(campaign, predictions(there), predictions(moved), times=2)
    if not solution.statements and not solution.held_tool_rotation:  # what is open may be chosen otherwise
        np.testing.assert_allclose(np.asarray(moved.parameters), np.asarray(there.parameters), rtol=0, atol=MOVED)
        # a station and a reflector on two carriages can go the same way together
        if not any("station or instrument parameters not determined" in note for note in solution.notes):
            # a turn of an artefact that no line sees is held at 0 there, and turns with the frame here
            free = [e.prior_u > 0.0 for e in solution.nuisance_table]
            one, other = (np.asarray(s.nuisance)[free] for s in (moved, there))
            np.testing.assert_allclose(one, other, rtol=0, atol=2 * MOVED)


@EACH_KIND
def test_key_and_response_stand_in_the_file_of_a_solution(name, tmp_path):
    solution = fitted(name)
    write_solution(solution, tmp_path / "s.h5")
    assert read_solution(tmp_path / "s.h5").nuisance_table == solution.nuisance_table
    keys = [e.key for e in solution.nuisance_table]
    assert len(set(keys)) == len(keys) and all(keys)


@EACH_KIND
def test_files_of_earlier_versions_get_key_and_response_from_their_campaign(name, tmp_path):

    solution = fitted(name)
    write_solution(solution, tmp_path / "s.h5")
    with changed(tmp_path / "s.h5") as file:
        for column in ("key", "response", "recorded"):
            del file["nuisance"][column]
        for group in ("outliers", "adequacy/suspects"):
            del file[group]["unit"]
    again = read_solution(tmp_path / "s.h5")
    assert [e.key for e in again.nuisance_table] == [e.key for e in solution.nuisance_table]
    moved = np.asarray(again.in_datum(DATUM).nuisance)
    np.testing.assert_array_equal(moved, np.asarray(solution.in_datum(DATUM).nuisance))


UNITS = [(n, f, said) for n, e in EXAMPLES.items() for f, said in e.wrong]


def test_every_kind_names_readings_in_another_unit():
    assert {EXAMPLES[n].kind for n, _, _ in UNITS} == set(KINDS)


@pytest.mark.parametrize(("name", "factor", "said"), UNITS)
def test_readings_in_another_unit_are_refused_by_name(name, factor, said):
    campaign = measured(name)
    check_campaign(campaign)
    own = campaign.sets[-1]
    lengths = [KINDS[own.kind].unit_of(i) != "degrees" for i in range(own.readings.shape[1])]
    wrong = replace(own, readings=np.where(lengths, factor * own.readings, own.readings))
    with pytest.raises(InputError, match=f"(?s){own.name}.*{said}|row .*{said}"):
        check_campaign(replace(campaign, sets=(*campaign.sets[:-1], wrong)))


def with_samples(solution: Solution, trials: int = 2) -> Solution:
    """The solution with samples of its parameters, as Monte Carlo would have left them."""
    values, vectors = np.linalg.eigh(np.asarray(solution.covariance))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    centre = np.concatenate([np.asarray(solution.parameters), np.asarray(solution.nuisance)])
    x = centre + np.random.default_rng(5).normal(size=(trials, len(centre))) @ root.T
    nothing = np.zeros(trials)
    return replace(solution, samples=Samples(trials, lambda: iter([x]), nothing, nothing, nothing, nothing, 5))


# ------------------------------------------------------------------------------------- where no transformation is exact


def straightedges(slope: bool) -> Campaign:
    """Straightness of X in Y and Z along one line, read with a straightedge, beside the distances of every example."""
    machine = machine_of(THREE)
    stations, volume = distances(machine, 60)
    q = np.tile([0.5 * sum(a.travel) for a in machine.axes], (22, 1))
    q[:, machine.index("X")] = np.tile(np.linspace(0.0, 600.0, 11), 2)
    labels = {"component": np.repeat(["Y", "Z"], 11)}
    own = plan_set("straightedge", "component", q, TOOLS[0], labels, slope=slope)
    return exact_readings(Campaign(machine, stations, (volume, own)))


def test_the_slope_of_a_straightedge_answers_or_the_change_is_refused():
    with pytest.raises(InputError, match=r"no exact transformation.*set 'straightedge' \((Y|Z)\).*Set slope = true"):
        fit(straightedges(False)).in_datum(DATUM)
    solution = fit(straightedges(True))
    moved = solution.in_datum(DATUM)
    number = [e.key for e in solution.nuisance_table].index(("slope", "straightedge", "1", "Y"))
    change = float(moved.nuisance[number] - solution.nuisance[number])
    # what the frame turns by about Z, seen in the field: what a fit in that datum finds, too
    there = fit(_in_machine_datum(straightedges(True)))
    assert abs(change) > 5e-6 and float(there.nuisance[number]) == pytest.approx(
        float(moved.nuisance[number]), abs=1e-9
    )


def test_a_datum_that_turns_nothing_needs_no_slope():
    other = Datum(reference=(("X", 100.0), ("Z", -50.0)))
    solution = fit(straightedges(False))
    moved = solution.in_datum(other)
    assert_same_predictions(solution.campaign, predictions(solution), predictions(moved))


def test_known_stations_on_two_bodies_that_move_against_each_other_are_refused():
    plan = EXAMPLES["distance of a network"].plan()
    stations = [replace(s, body="bed") if s.name == "N1" else s for s in plan.stations]
    campaign = exact_readings(replace(plan, stations=tuple(stations)))
    with pytest.raises(InputError, match="known stations share one frame, but stand on workpiece, bed"):
        fit(campaign).in_datum(DATUM)


def test_a_tool_rotation_that_the_model_leaves_out_is_refused_with_several_tool_vectors():
    plan = EXAMPLES["distance"].plan()
    model = machine_of(THREE + '[model.functions]\n"E?0S" = false\n')
    campaign = replace(exact_readings(plan), machine=model)
    with pytest.raises(InputError, match=r'the readings see several tool vectors. Set "E\?0S" = true'):
        fit(campaign).in_datum(DATUM)


def _in_machine_datum(campaign: Campaign) -> Campaign:
    m = campaign.machine
    return replace(campaign, machine=Machine(m.name, m.structure, m.axes, DATUM, m.model))
