"""Changes between two surveys of one machine are found where they are, and nowhere else; truth and readings: exact chain."""

import json
from dataclasses import replace

import numpy as np
import pytest
from exact_chain import random_truth
from scipy.special import chdtrc
from scipy.stats import binom, kstest
from support.machines import GANTRY
from support.surveys import EXACT, STATED, changed, stretched, survey, surveyed, truth_of_tests
from support.trackers import simulated

from volid.exceptions import InputError
from volid.fitting.datum import parse_datum
from volid.fitting.fit import fit
from volid.report.text.comparison import comparison_data
from volid.report.text.summary import plain
from volid.uncertainty.budget import budget
from volid.validation.solutions.comparison import compare
from volid.validation.solutions.function_changes import LEVEL, Combination, by_holm, whitened
from volid.validation.solutions.outputs import outputs_of
from volid.validation.solutions.shared import Said, what_is_shared
from volid.validation.solutions.states import in_one_model

PAIR = np.array([-1.0, 1.0])
MODELS = [STATED, pytest.param("", marks=pytest.mark.slow)]  # segments as stated, and smoothness as the fit finds it
CRASH = 25e-6  # rad, 10.7 µm over the travel of Y


def combination(first, second, said=Said()):  # noqa: B008
    """Second less first, as `compare` has it."""
    states = in_one_model((first, second), ("A", "B"))
    return Combination(what_is_shared(states, said), PAIR, np.array([0.0, 1.0]))


def by_name(found):
    return {f.name: f for f in found.functions}


@pytest.mark.parametrize("extra", MODELS)
def test_nothing_is_called_changed_where_nothing_changed(extra):
    found = compare(surveyed(1, extra=extra), surveyed(2, extra=extra))
    assert found.significant == () and found.attention == ()
    # chi-square of about 100 degrees of freedom over the volume's few: within a factor of 2
    assert 0.5 < found.volume.rms / found.volume.expected_rms < 2.0
    data = json.loads(json.dumps(plain(comparison_data(found))))
    assert set(data["EXX"]) >= {"largest_change", "u", "significant", "at"} and data["changed"] == []


@pytest.mark.parametrize("extra", MODELS)
def test_a_squareness_that_changed_is_found_alone_and_right(extra):
    found = compare(surveyed(1, extra=extra), surveyed(3, ("EC0Y", CRASH), extra))
    (only,) = found.significant
    assert only.name == "EC0Y" and abs(only.largest_change - CRASH) < 3 * only.u
    assert only.u < CRASH / 5 and np.isnan(only.at)


@pytest.mark.slow
def test_a_bump_is_found_where_it_is():
    """The datum has EXX 0 at 380 mm; a bump of 10 µm there is a fall of 10 µm on both sides, beyond a quarter of the travel."""
    found = by_name(compare(surveyed(1, extra=""), surveyed(4, ("EXX", 0.010), "")))["EXX"]
    assert found.significant and abs(found.at - 380.0) > 150.0
    away = np.abs(found.positions - 380.0) > 190.0
    assert np.all(np.abs(found.values[away] + 0.010) < 4 * found.values_u[away])


@pytest.mark.slow
def test_the_datum_moves_what_changed_between_functions_and_not_in_the_volume():
    first, second = surveyed(1), surveyed(3, ("EC0Y", CRASH))
    datum = parse_datum(first.machine, "primary=Y,secondary=X")
    found, other = compare(first, second), compare(first, second, datum=datum)
    # along Y, X is turned the other way round, and the spindle, which did not move with Y, about as much
    assert [f.name for f in other.significant] == ["EC0X", "EC0S"]
    turned = by_name(found)["EC0Y"].largest_change
    assert by_name(other)["EC0X"].largest_change == pytest.approx(-turned, rel=1e-6)
    assert abs(by_name(other)["EC0S"].largest_change + turned) < 3 * by_name(other)["EC0S"].u
    assert other.volume.rms == pytest.approx(found.volume.rms, rel=1e-6)
    assert other.volume.u == pytest.approx(found.volume.u, rel=1e-4)
    again = compare(first, second.in_datum(parse_datum(second.machine, "primary=Y,secondary=X")))  # as it was saved
    for a, b in zip(found.functions, again.functions, strict=True):
        np.testing.assert_allclose(a.values, b.values, atol=1e-9)
        np.testing.assert_allclose(a.values_u, b.values_u, atol=1e-9)
        assert a.chi_square == pytest.approx(b.chi_square, rel=1e-4)


def draws(pair, rng, count):
    """Differences (n', count) by noise of the readings alone, of a machine drawn from the smoothness of the first solution."""
    first, second = (s.solution for s in pair.shared.of.states)
    size = first.model.n_parameters
    rows = first.smooth_rows
    _, values, vt = np.linalg.svd(rows, full_matrices=False) if len(rows) else (0, np.zeros(0), np.zeros((0, size)))
    kept = values > 1e-7 * np.max(values, initial=0.0)
    machine = (vt[kept].T / values[kept]) @ rng.standard_normal((int(kept.sum()), count))
    found = np.zeros((size, count))
    for sign, solution in ((-1.0, first), (1.0, second)):
        covariance = solution.bare_covariance[:size, :size]
        prior = solution.smooth_rows.T @ solution.smooth_rows
        noise = covariance - covariance @ prior @ covariance  # C JᵀJ C
        values, vectors = np.linalg.eigh(noise)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        estimate = machine - covariance @ (prior @ machine) + root @ rng.standard_normal((size, count))
        found += sign * estimate
    return found


@pytest.mark.parametrize("extra", MODELS)
def test_false_alarms_are_5_percent_over_all_functions_and_powers_as_stated(extra):
    """2000 draws of what both fits would have found; for smooth functions the u of the smoothness is left out of truth and test
    alike, since the draws know it."""
    count, rng = 2000, np.random.default_rng(5)
    first, second = (known_smoothness(surveyed(seed, extra=extra), surveyed(1, extra=extra)) for seed in (1, 2))
    pair = combination(first, second)
    outputs = outputs_of(pair.shared.of.model)
    tests = [whitened(pair, o) for o in outputs]
    d = draws(pair, rng, count)
    chances = np.stack([chdtrc(len(t.rows), np.sum((t.rows @ d) ** 2, axis=0)) for t in tests])
    for row in chances:
        assert kstest(row, "uniform").pvalue > 1e-4
    alarms = sum(by_holm(column).any() for column in chances.T)
    assert binom.ppf(1e-3, count, 0.85 * LEVEL) <= alarms <= binom.ppf(1 - 1e-3, count, LEVEL)
    for f, o, t in zip(compare(first, second).functions, outputs, tests, strict=True):
        if len(o.rows) == 1:  # the stated size of change of a constant, at the level of one of all functions
            moved = d + (pair.response @ (o.rows[0] * f.smallest_found))[:, None]
            found = np.mean(chdtrc(len(t.rows), np.sum((t.rows @ moved) ** 2, axis=0)) < LEVEL / len(outputs))
            assert abs(found - 0.9) < 4 * np.sqrt(0.09 / count)


def known_smoothness(solution, like):
    """The solution with the smoothness of another one taken as known exactly."""
    if solution.smooth is None:
        return solution
    n = solution.model.n_parameters
    bare = solution.bare_covariance
    information = np.linalg.inv(bare[:n, :n]) - solution.smooth_rows.T @ solution.smooth_rows
    covariance = np.zeros_like(bare)
    covariance[:n, :n] = np.linalg.inv(information + like.smooth_rows.T @ like.smooth_rows)
    rows = np.asarray(like.smooth_rows)
    smooth = replace(solution.smooth, root=rows, noise=np.zeros((len(rows), 0)), spread=np.zeros((len(covariance), 0)))
    return replace(solution, covariance=covariance, smooth=smooth)


def test_a_scale_of_the_tracker_that_was_the_same_cancels():
    """The scale is nearly one with those of the axes. The same tracker was 1.5 µm/m off both times."""
    campaigns = [survey(truth_of_tests(), seed, scale=1.5e-6) for seed in (11, 12)]
    first, second = (fit(c) for c in campaigns)
    together = compare(first, second)
    assert any("tracker scale" in n and "same each time" in n for n in together.notes)
    apart = compare(first, second, independent=["tracker scale"])
    end = {n: f["EXX"].values_u[0] for n, f in (("together", by_name(together)), ("apart", by_name(apart)))}
    # 0.38 µm each time, half of the travel from the reference, less what the known tool offsets tell of the scale
    shares = [contribution(solution, "effect 'tracker scale'") for solution in (first, second)]
    assert all(0.25e-3 < share < 0.38e-3 for share in shares)
    assert end["apart"] ** 2 - end["together"] ** 2 == pytest.approx(2 * shares[0] * shares[1], rel=1e-3)
    drifted = stretched(truth_of_tests(), "X", 4e-6)
    third = fit(survey(drifted, 13, scale=1.5e-6))
    seen, hidden = by_name(compare(first, third))["EXX"], compare(first, third, independent=["tracker scale"])
    assert seen.smallest_found < by_name(hidden)["EXX"].smallest_found


def contribution(solution, source):
    """What a source of the budget brings to u of EXX at the low end."""
    rows = np.pad(solution.motion_rows("EXX", np.array([0.0]), 0), ((0, 0), (0, len(solution.nuisance))))
    found = budget(solution)
    return found.contributions(rows)[found.sources.index(source), 0]


def test_names_of_effects_are_checked():
    first, second = (fit(survey(truth_of_tests(), seed, scale=0.0)) for seed in (11, 12))
    with pytest.raises(InputError, match=r"`common=laser`: not every solution has an effect .* tracker scale"):
        compare(first, second, common=["laser"])
    with pytest.raises(InputError, match=r"`independent=laser`"):
        compare(first, second, independent=["laser"])


def test_a_solution_that_has_the_other_as_prior_holds_its_readings():
    """For a linear fit cov(B - A) = Σ_A - Σ_B: what B knows more."""
    first = surveyed(1)
    second = fit(survey(truth_of_tests(), 2), prior=first)
    pair = combination(first, second)
    n = first.model.n_parameters
    expected = first.covariance[:n, :n] - second.covariance[:n, :n]
    scale = np.sqrt(np.diagonal(first.covariance)[:n])
    np.testing.assert_allclose(pair.covariance / np.outer(scale, scale), expected / np.outer(scale, scale), atol=2e-4)
    assert compare(first, second).significant == ()


@pytest.mark.slow
def test_ranges_that_differ_are_compared_where_both_measured():
    """X up to 80 %: squareness and reference lines of both refer to that part."""
    truth = truth_of_tests()
    whole, part = surveyed(1), fit(survey(truth, 2, reach=0.8))
    found = compare(whole, part)
    assert found.significant == () and "X 0 … " in found.notes[0]
    crashed = fit(survey(changed(truth, "EC0Y", CRASH), 3, reach=0.8))
    assert [f.name for f in compare(whole, crashed).significant] == ["EC0Y"]
    x = by_name(found)["EXX"].positions
    assert x[-1] < 0.82 * EXACT.travel["X"][1]


def test_what_one_solution_does_not_determine_is_not_compared(single_tool_solution, solution):
    found = compare(single_tool_solution, single_tool_solution)
    assert found.not_tested and not found.volume.largest > 1e-9
    for f in found.functions:
        assert not f.degrees_of_freedom or f.chi_square == pytest.approx(0.0, abs=1e-9)
    mixed = compare(solution, single_tool_solution)
    assert set(mixed.not_tested) >= {n for n in found.not_tested if n != "EXX"}


def test_a_rejected_solution_is_named(solution, rejected_solution):
    found = compare(solution, rejected_solution)
    assert any(text.startswith("B: the model is rejected") for text in found.attention)


@pytest.mark.slow
def test_other_machines_and_other_models_are_refused(solution):
    other, *_ = simulated(GANTRY, 3, extra=STATED, n_per_station=50, every_station_sees_every_tool=True)
    with pytest.raises(InputError, match=r"B: its machine is .*expected solutions of one machine"):
        compare(solution, fit(other))
    truth = random_truth(EXACT, np.random.default_rng(1), waviness=0.3, scale=0.4, reversal=["EXX"])
    rich = fit(survey(truth, 1, STATED + "[model.functions]\nEXX = { segments = 3, reversal = true }\n"))
    with pytest.raises(InputError, match=r"EXX has reversal"):
        compare(surveyed(1), rich)
    fewer = fit(survey(truth_of_tests(), 1, STATED + "[model.functions]\nEC0S = false\n"))
    with pytest.raises(InputError, match=r"only A has EC0S; expected the same \[model.functions\]"):
        compare(surveyed(1), fewer)
    with pytest.raises(InputError, match="extrapolated"):
        compare(surveyed(1), _extrapolated())


def _extrapolated():
    return fit(survey(truth_of_tests(), 2, reach=0.8)).extrapolated()


def test_a_function_of_two_axes_is_compared_over_both(rich_solution):
    """EZZ over Z and X changes away from the reference of X alone: along the line there, nothing would be seen."""
    n = rich_solution.model.n_parameters
    outputs = next(o for o in outputs_of(rich_solution.model) if o.name == "EZZ")
    at_reference = outputs.beside == outputs.beside[0]
    assert outputs.beside[0] == rich_solution.machine.axis("X").reference and len(np.unique(outputs.beside)) >= 6
    own = rich_solution.model.by_name["EZZ", "mean"].parameters
    _, sizes, vt = np.linalg.svd(outputs.rows[at_reference][:, own])
    step = np.zeros(n)
    step[own] = vt[-1]  # changes nothing along the line
    assert sizes[-1] < 1e-9 or len(sizes) < vt.shape[0]
    step *= 0.010 / np.max(np.abs(outputs.rows @ step))
    found = by_name(compare(rich_solution, replace(rich_solution, parameters=rich_solution.parameters + step)))["EZZ"]
    assert found.significant and abs(found.largest_change) == pytest.approx(0.010, rel=1e-6)
    assert np.nanmax(np.abs(found.values[at_reference])) < 1e-9


def test_compensations_that_were_active_once_are_named():
    other = fit(replace(survey(truth_of_tests(), 2), conditions={"active_compensations": ["L-POS: table of EXX"]}))
    (text,) = compare(surveyed(1), other).attention
    assert text == (
        "B was measured with other compensations active (L-POS: table of EXX) than A (none): the change contains what they do"
    )
    assert compare(other, other).attention == ()


def test_another_load_is_named_and_an_unstated_one_is_not():
    def under(**conditions):
        solution = surveyed(1)
        return replace(solution, campaign=replace(solution.campaign, conditions=conditions))

    note = "B was measured with another load (200 kg) than A (none): the change contains what it does"
    assert note in compare(under(load="none"), under(load="200 kg")).notes
    for one, other in ((under(load="none"), under(load="none")), (under(), under(load="200 kg"))):
        assert not any("load" in text for text in compare(one, other).notes)
