"""One contract for every type of systematic effect: files, what it does to readings, what a fit and a simulation make of it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.kinds import EXAMPLES, exact_readings, exact_truth
from support.sets import assert_same_set

from volid.campaign import Campaign, Effect
from volid.effects import TYPES
from volid.effects.base import POINT, Choice, Letters, Number, PerAxis, labelled_scopes
from volid.effects.prediction import groups_of, is_random
from volid.exceptions import InputError
from volid.fitting.equations.interpreted import Interpreted
from volid.fitting.equations.problem import build_problem, random_effects, scatter, with_random_effects
from volid.fitting.fit import fit
from volid.io import load_campaign, write_campaign, write_manifest
from volid.model.error_functions import motion_names, spline_axes
from volid.model.error_model import build_model
from volid.observations.base import NuisanceTable
from volid.observations.response import UNMOVED
from volid.virtual.simulate import simulate

U = {"scale": 2e-6, "offset": 1e-3, "drift": 1e-3, "tool_length": 2e-3, "temperature": 0.5, "repeatability": 1e-3}
EVERY = pytest.mark.parametrize("name", TYPES)
SHARED = [n for n, t in TYPES.items() if not t.always_random]
BOTH = [n for n in SHARED if not TYPES[n].never_random]
KIND = ("distance", "displacement")  # one reading a row, and three


def options_of(name: str) -> list[dict]:
    """Every key of the type at some value; one case for each text of a choice."""
    numbers = {k: 1.1e-5 for k, spec in TYPES[name].keys.items() if isinstance(spec, Number)}
    if "temperature" in numbers:
        numbers["temperature"] = 22.0
    letters = {k: "Z" for k, spec in TYPES[name].keys.items() if isinstance(spec, Letters) and name != "scale"}
    axes = {k: {"X": 1e-3, "Z": 2e-3} for k, spec in TYPES[name].keys.items() if isinstance(spec, PerAxis)}
    choices = [(k, text) for k, spec in TYPES[name].keys.items() if isinstance(spec, Choice) for text in spec.texts]
    common = numbers | letters | axes
    return [common | {k: text} for k, text in choices] or [common]


def effect_of(name: str, per: str, options: dict | None = None) -> Effect:
    return Effect("e", name, U.get(name, 1e-3), per, options_of(name)[0] if options is None else options)


@cache
def measured(example: str = "distance") -> Campaign:
    """Exact readings without effects."""
    return exact_readings(EXAMPLES[example].plan())


def with_effect(campaign: Campaign, *effects: Effect) -> Campaign:
    """The campaign with effects on its last set."""
    return replace(campaign, sets=(*campaign.sets[:-1], replace(campaign.sets[-1], effects=effects)))


def problem_of(campaign: Campaign):
    machine = campaign.machine
    segments = {n: (2,) * len(spline_axes(machine, n)) for n in motion_names(machine)}
    return build_problem(campaign, build_model(machine, segments), engine=Interpreted())


def changes(campaign: Campaign) -> dict[str, np.ndarray]:
    """Change (m, k) of the last set's readings by one u of every unknown of effect `e`, by the unknown's name."""
    problem = problem_of(campaign)
    n, found = problem.model.layout.n_coefficients, {}
    before = scatter(problem, campaign, problem.equations.predictions(problem.start))[-1]
    for i, entry in enumerate(problem.nuisance):
        if entry.effect == "e":
            z = problem.start.copy()
            z[n + i] += entry.prior_u
            found[entry.name] = scatter(problem, campaign, problem.equations.predictions(z))[-1] - before
    return found


def scopes_in(name: str, example: str) -> list[str]:
    """Scopes that the type may have in a set of the example."""
    labels = set(measured(example).sets[-1].labels)
    return [s for s in TYPES[name].scopes(labelled_scopes()) if s not in labelled_scopes() or s in labels]


def test_every_type_has_an_example():
    assert set(U) == set(TYPES)


@EVERY
def test_files_lose_nothing(name, tmp_path):
    cases = [
        Effect(f"e{i}", name, U[name], per, options)
        for i, (per, options) in enumerate((p, o) for p in scopes_in(name, "distance") for o in options_of(name))
    ]
    own = measured().sets[-1]
    campaign = replace(measured(), sets=(*measured().sets[:-1], replace(own, effects=tuple(cases))))
    write_campaign(campaign, tmp_path / "c.h5")
    for again in (load_campaign(write_manifest(campaign, tmp_path / "text")), load_campaign(tmp_path / "c.h5")):
        assert_same_set(replace(again.sets[-1], source="", rows=None), replace(own, effects=tuple(cases)))


@EVERY
def test_unknown_keys_and_scopes_are_named(name, tmp_path):
    path = write_manifest(with_effect(measured(), effect_of(name, scopes_in(name, "distance")[0])), tmp_path / "c")
    text = path.read_text()
    for old, new, message in (
        ('name = "e"', 'name = "e"\nnonsense = 1', "effect 'e': unknown key 'nonsense'"),
        (f'type = "{name}"', 'type = "wobble"', "type is .*wobble.*expected one of"),
        ('per = "', 'per = "week', "per is .*week.*expected"),
    ):
        path.write_text(text.replace(old, new))
        with pytest.raises(InputError, match=message):
            load_campaign(path)


@pytest.mark.parametrize("example", KIND)
@pytest.mark.parametrize("name", SHARED)
def test_one_unknown_for_every_scope_moves_the_readings_of_its_scope(name, example):
    for options in options_of(name):
        for per in scopes_in(name, example):
            if per == POINT:
                continue
            campaign = with_effect(measured(example), effect_of(name, per, options))
            found = changes(campaign)
            assert found and all(np.abs(v).max() > 0.0 for v in found.values()), (per, options)
            moved = sum((np.abs(v) > 0.0).any(axis=1).astype(int) for v in found.values())
            assert (moved > 0).mean() > 0.9, "every reading but the first of a drift belongs to a scope"


@pytest.mark.parametrize("example", KIND)
@pytest.mark.parametrize("name", BOTH)
def test_drawn_anew_the_variance_is_what_the_shared_effect_would_do(name, example):
    """Σ (∂reading/∂ξ u)² over the unknowns of one set; the expansion of `temperature` and dead paths are for shared ones."""
    options = {k: v for k, v in options_of(name)[0].items() if k != "u_expansion"}
    shared = changes(with_effect(measured(example), effect_of(name, "set", options)))
    expected = sum(v**2 for v in shared.values())
    campaign = with_effect(measured(example), effect_of(name, POINT, options))
    (parts,) = random_effects(campaign)[-1:]
    np.testing.assert_allclose(parts[0][1], expected, rtol=1e-4, atol=1e-16)
    u = with_random_effects(campaign).sets[-1].u
    np.testing.assert_allclose(u**2, campaign.sets[-1].u ** 2 + parts[0][1], rtol=1e-12)


@EVERY
def test_unknowns_of_effects_do_not_answer_a_change_of_datum(name):
    per = "set" if name in SHARED else POINT
    campaign = with_effect(measured(), effect_of(name, per))
    table = NuisanceTable()
    for readings in campaign.sets:
        groups_of(readings, campaign, table)
    own = [e for e in table.entries if e.effect]
    assert bool(own) != is_random(campaign.sets[-1].effects[0])
    assert all(e.response == UNMOVED and e.key[0] == "effect" and np.isfinite(e.prior_u) for e in own)


@pytest.mark.parametrize("name", SHARED)
def test_a_simulation_draws_it_and_a_fit_without_noise_finds_most_of_it(name):
    """The station of the set sees it alone, so that nothing but the effect explains what its readings do."""
    plan = with_effect(EXAMPLES["distance"].plan(), effect_of(name, "set", options_of(name)[0] | {}))
    campaign, truth = simulate(plan, exact_truth(plan.machine), seed=4, noise=False, station_error=2.0)
    plain, _ = simulate(EXAMPLES["distance"].plan(), exact_truth(plan.machine), seed=4, noise=False, station_error=2.0)
    drawn = {n: v for n, v in truth.instruments.items() if n.startswith("e ")}
    assert drawn and all(abs(v) > 0.0 for v in drawn.values())
    change = campaign.sets[-1].readings - plain.sets[-1].readings
    assert np.abs(change).max() > 0.0
    solution = fit(campaign)
    n = solution.model.n_parameters
    for i, entry in enumerate(solution.nuisance_table):
        if entry.effect == "e":
            u = float(np.sqrt(solution.covariance[n + i, n + i]))
            assert 0.0 < u <= entry.prior_u * (1.0 + 1e-9)
            assert abs(float(solution.nuisance[i]) - drawn[entry.name]) < 4.0 * u


@pytest.mark.slow
@EVERY
def test_the_budget_names_it(name):
    from volid.uncertainty.budget import budget

    per = "set" if name in SHARED else POINT
    found = budget(fit(with_effect(measured(), effect_of(name, per))))
    assert ("effect 'e'" in found.sources) == (name in SHARED)
    assert sum(s.startswith("readings of") for s in found.sources) == 2
