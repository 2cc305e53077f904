"""The verdict on each set: against refits without the set, dense algebra, chance, and campaigns with one set that is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest
from support.mixed_sets import COARSE, CUBIC, FINE, campaign_of, design, drawn, instruments, line_set

import volid
from volid.fitting.mixed.sums import OneSet, prediction, sums_of


def by_set(solution):
    return {test.set: test for test in solution.adequacy.sets}


def without(campaign, name):
    return replace(campaign, sets=tuple(s for s in campaign.sets if s.name != name))


def three(rng, bend=None, sizes=((3e-4, 3e-4), (5e-4, 5e-4), (1e-3, 1e-3))):
    """Three sets of one axis; the first sees `bend` besides."""
    return (
        drawn("laser", FINE, rng, sizes[0], bend),
        drawn("gauge", COARSE, rng, sizes[1]),
        drawn("probe", COARSE, rng, sizes[2]),
    )


@pytest.mark.slow
def test_leaving_a_set_out_is_as_good_as_a_fit_without_it():
    """On three axes, with stations, angles and a shared station: chi-squares and degrees of freedom of real refits."""
    campaign = instruments(1, {})
    whole = volid.fit(campaign)
    for name, test in by_set(whole).items():
        rest = volid.fit(without(campaign, name)).adequacy
        square = whole.adequacy.chi_square - rest.chi_square
        freedom = whole.adequacy.degrees_of_freedom - rest.degrees_of_freedom
        assert test.prediction_freedom == freedom
        assert test.prediction_weight == pytest.approx(np.sqrt(square / freedom), rel=2e-3)
        assert test.rest_weight == pytest.approx(rest.unit_weight, rel=2e-3)


def test_single_readings_are_predicted_as_dense_algebra_says():
    """E_n of the gauge's readings: fit to the two others by a separate linear model, the gauge's offset fitted to it."""
    sets = three(np.random.default_rng(2))
    test = by_set(volid.fit(campaign_of(CUBIC, *sets)))["gauge"]
    columns, y = design(sets), np.concatenate([s.readings[:, 0] for s in sets])
    u = np.concatenate([s.u[:, 0] for s in sets])
    own = np.repeat([False, True, False], [len(s) for s in sets])
    rest = columns[~own][:, [0, 1, 2, 3, 5]] / u[~own, None]
    covariance = np.linalg.inv(rest.T @ rest)[:3, :3]
    function = (np.linalg.pinv(rest) @ (y[~own] / u[~own]))[:3]
    error = y[own] - columns[own, :3] @ function
    spread = np.diag(u[own] ** 2) + columns[own, :3] @ covariance @ columns[own, :3].T
    centring = np.eye(24) - np.full((24, 24), 1.0 / 24.0)  # the gauge's own offset
    left, variance = centring @ error, np.diagonal(centring @ spread @ centring.T)
    weight = np.linalg.inv(spread)
    best = error - weight.sum(axis=0) @ error / weight.sum()
    assert test.alone == 1
    assert test.largest_en == pytest.approx(np.max(np.abs(left) / (2.0 * np.sqrt(variance))), rel=1e-4)
    assert test.prediction_weight == pytest.approx(np.sqrt(best @ weight @ best / 23.0), rel=1e-4)


@pytest.fixture(scope="module")
def chance():
    """Sums of 2000 campaigns of a linear model with prior knowledge: two sets that see all, one that sees little."""
    rng = np.random.default_rng(12)
    parts = [rng.standard_normal((n, 8)) * scale for n, scale in ((40, 1.0), (25, 0.3), (12, [2.0, *[0.0] * 7]))]
    known = np.vstack([np.zeros((3, 8)), 3.0 * np.eye(8)[4:]])
    whole = np.vstack([*parts, known])
    root = np.linalg.cholesky(np.linalg.inv(whole.T @ whole))
    number = np.repeat(np.arange(3), [len(p) for p in parts])
    n = len(number)
    hat = whole @ root @ root.T @ whole.T
    noise = rng.standard_normal((2000, len(whole)))
    return [sums_of(whole[:n] @ root, (e - hat @ e)[:n], number, np.ones(n, dtype=bool)) for e in noise]


@pytest.mark.parametrize("g", [0, 1, 2])
@pytest.mark.parametrize("test", ["whole", "scatter", "disagreement", "prediction"])
def test_by_chance_every_test_has_the_mean_variance_and_probability_that_it_claims(chance, g, test):
    of = {
        "whole": lambda s: OneSet(s, g).whole(),
        "scatter": lambda s: OneSet(s, g).scatter(),
        "disagreement": lambda s: OneSet(s, g).disagreement(1.0, 1.0),
        "prediction": lambda s: prediction(s, g),
    }[test]
    found = [of(s) for s in chance]
    values, claimed = np.array([q.value for q in found]), found[0]
    assert values.mean() == pytest.approx(claimed.mean, abs=4.0 * np.sqrt(claimed.variance / len(values)))
    assert values.var() == pytest.approx(claimed.variance, rel=0.25)
    if claimed.exists:
        probabilities = [q.probability() for q in found]
        assert (
            kstest(probabilities, "uniform").pvalue > 1e-3 or claimed.freedom < 4.0
        )  # of few, Satterthwaite's is rough
        assert np.mean(np.array(probabilities) < 0.01) < 0.025


def test_where_sets_scatter_otherwise_disagreement_allows_for_it():
    """Covariance κ² (1 - H)² + κ₀² (1 - H) H of a set that scatters by κ, others by κ₀, without prior knowledge."""
    rng = np.random.default_rng(13)
    parts = [rng.standard_normal((n, 5)) for n in (30, 20)]
    whole = np.vstack(parts)
    root = np.linalg.cholesky(np.linalg.inv(whole.T @ whole))
    number, hat = np.repeat([0, 1], [30, 20]), whole @ root @ root.T @ whole.T
    scale = np.where(number == 0, 3.0, 0.5)
    every = np.ones(50, dtype=bool)
    values = []
    for _ in range(1500):
        noise = scale * rng.standard_normal(50)
        one = OneSet(sums_of(whole @ root, noise - hat @ noise, number, every), 0)
        values.append(one.disagreement(9.0, 0.25))
    found = np.array([q.value for q in values])
    assert found.mean() == pytest.approx(values[0].mean, rel=0.06)
    assert found.var() == pytest.approx(values[0].variance, rel=0.2)


def test_a_set_that_sees_another_machine_is_named_and_no_other():
    """One part in 10⁵ of length more, as of a wrong wavelength, in one of three sets; all scatter as stated."""
    solution = volid.fit(campaign_of(CUBIC, *three(np.random.default_rng(14), lambda x: 1e-5 * x)))
    found = by_set(solution)
    assert {name: test.contradicts for name, test in found.items() if test.contradicts} == {"laser": "the other sets"}
    assert found["laser"].verdict.startswith("contradicts the other sets; systematic residuals")
    assert "; set 'laser' contradicts the other sets, which have unit weight 0." in solution.adequacy.verdict
    assert found["laser"].rest_weight < 1.3 < found["gauge"].rest_weight
    assert not any("seems too" in test.verdict for test in found.values())


def test_a_wrong_u_is_no_contradiction():
    sizes = ((9e-4, 3e-4), (1e-4, 5e-4), (1e-3, 1e-3))
    for seed in range(3):
        found = by_set(volid.fit(campaign_of(CUBIC, *three(np.random.default_rng(seed), sizes=sizes))))
        assert not any(test.contradicts for test in found.values())
        assert "its u seems too small by the factor" in found["laser"].verdict
        assert "its u seems too large by the factor" in found["gauge"].verdict
        assert found["probe"].verdict == "agrees with its u and with the other sets"


def test_of_two_sets_that_contradict_each_other_nothing_tells_which():
    rng = np.random.default_rng(15)
    sets = three(rng, lambda x: 1e-5 * x)[:2]
    found = by_set(volid.fit(campaign_of(CUBIC, *sets)))
    assert "contradicts set 'gauge', and nothing tells which is right" in found["laser"].verdict
    assert "contradicts set 'laser', and nothing tells which is right" in found["gauge"].verdict


def test_estimated_u_do_not_hide_a_contradiction():
    """The likelihood believes the best set, though it is wrong, and enlarges both other u; still these agree without it."""
    sets = three(np.random.default_rng(16), lambda x: 2e-5 * x)
    found = by_set(volid.fit(campaign_of(CUBIC, *sets), estimate_u=True))
    assert {name: test.contradicts for name, test in found.items() if test.contradicts} == {"laser": "the other sets"}


def test_a_set_that_has_a_pattern_of_its_own_shows_it():
    """A step of three u behind the middle, which a cubic function does not follow."""
    x, rng = np.tile(np.linspace(0.0, 500.0, 21), 3), np.random.default_rng(17)
    stepped = line_set("stepped", x, 1e-3 * (x > 400.0) + 3e-4 * rng.standard_normal(len(x)), 3e-4)
    smooth = line_set("smooth", x, 3e-4 * rng.standard_normal(len(x)), 3e-4)
    found = by_set(volid.fit(campaign_of(CUBIC, stepped, smooth)))
    assert found["stepped"].pattern != "" and found["stepped"].pattern_probability < 1e-4
    assert "systematic residuals, most in " in found["stepped"].verdict


def test_nothing_is_found_where_nothing_is_wrong():
    for seed in range(6):
        found = by_set(volid.fit(campaign_of(CUBIC, *three(np.random.default_rng(100 + seed)))))
        assert {test.verdict for test in found.values()} == {"agrees with its u and with the other sets"}


def test_a_set_that_only_itself_checks_says_so():
    """Two readings of a line determine nothing but its offset and one difference."""
    rng = np.random.default_rng(18)
    single = drawn("single", np.array([250.0]), rng, (1e-3, 1e-3))
    test = by_set(volid.fit(campaign_of(CUBIC, drawn("laser", FINE, rng, (3e-4, 3e-4)), single)))["single"]
    assert (test.alone, test.verdict) == (1, "nothing of it is checked by other readings")
    assert np.isnan(test.own_weight) and np.isnan(test.largest_en)
