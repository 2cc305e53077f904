"""u of sets from their residuals: against closed forms, a dense likelihood apart from the package, and simulated campaigns."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from support.mixed_sets import (
    COARSE,
    CUBIC,
    FINE,
    LINE,
    SMOOTH,
    TWO,
    campaign_of,
    design,
    drawn,
    error,
    instruments,
    line_set,
)

import volid
from volid.backend.threads import one_blas_thread
from volid.campaign import Effect
from volid.exceptions import InputError
from volid.fitting.diagnosis.adequacy import QUESTIONED
from volid.observations import KINDS


def by_part(solution):
    return {(c.set, c.part): c for c in solution.variance_components}


def test_sets_that_share_nothing_have_the_variance_of_textbooks():
    """σ² = residual sum of squares over n - p of each set alone, and u(σ) = σ/√(2 (n - p))."""
    rng = np.random.default_rng(3)
    first, second = (1e-3 * rng.standard_normal(len(x)) for x in (FINE, COARSE))
    straight = line_set("y", COARSE, second, 4e-3, "Y")
    sets = line_set("x", FINE, first, 3e-4), replace(straight, options={"slope": True})
    found = {c.set: c for c in volid.fit(campaign_of(TWO, *sets), estimate_u=True).variance_components}
    for s in sets:
        columns = np.vander((s.positions[:, 0] - 250.0) / 250.0, 4)  # a cubic function, and the offset
        left = s.readings[:, 0] - columns @ np.linalg.lstsq(columns, s.readings[:, 0], rcond=None)[0]
        freedom, own = len(left) - 4, found[s.name]
        assert own.factor == pytest.approx(np.sqrt(left @ left / freedom) / s.u[0, 0], rel=1e-6)
        assert own.u == pytest.approx(own.factor / np.sqrt(2.0 * freedom), rel=1e-6)
        assert own.redundancy == pytest.approx(freedom, rel=1e-9)


def test_two_sets_of_one_mean():
    """n pairs of readings at both ends of X by each of two sets; one common slope, an offset of each set.

    Where both sets scatter alike, -2 ln L = Σ_g [(2n - 1) ln σ_g² + S_g/σ_g²] + ln(1/σ_1² + 1/σ_2²) + d²/(σ_1² + σ_2²) is
    smallest at σ² = (S + d²/4)/(2n - 3/2), with S the scatter about a set's own line and d the difference of slopes, weighted.
    """
    n, u, rng = 12, 1e-3, np.random.default_rng(4)
    x, noise = np.tile([0.0, 500.0], n), rng.standard_normal(2 * n)
    slope = 1e-6 * (x - 250.0)
    sets = [line_set(name, x, sign * slope + 2e-3 * noise, u) for name, sign in (("one", 1.0), ("two", -1.0))]
    t = np.sign(x - 250.0)
    own = [s.readings[:, 0] - s.readings[:, 0].mean() for s in sets]
    means = [float(t @ y) / (2 * n) for y in own]
    scatter = float(np.sum((own[0] - means[0] * t) ** 2))
    expected = np.sqrt((scatter + 2 * n * (means[0] - means[1]) ** 2 / 4.0) / (2 * n - 1.5)) / u
    information = 0.5 * np.array([[2 * n - 2 * 1.5 + 1.25, 0.25], [0.25, 2 * n - 2 * 1.5 + 1.25]])  # of ln σ²
    deviation = 0.5 * expected * np.sqrt(np.linalg.inv(information)[0, 0])
    for c in volid.fit(campaign_of(LINE, *sets), estimate_u=True).variance_components:
        assert c.factor == pytest.approx(expected, rel=1e-6)
        assert c.u == pytest.approx(deviation, rel=1e-6)


def t(x):
    """Position from -1 to 1."""
    return (x - 250.0) / 250.0


@one_blas_thread()
def likeliest(sets, columns, known):
    """Factors of largest restricted likelihood, from the dense covariance of the readings, by SciPy.

    `columns`: of what is unknown; `known` (n, n): covariance that calibrated unknowns make.
    """
    y = np.concatenate([s.readings[:, 0] for s in sets])
    u, number = np.concatenate([s.u[:, 0] for s in sets]), np.repeat(np.arange(len(sets)), [len(s) for s in sets])
    across = np.linalg.qr(columns, mode="complete")[0][:, np.linalg.matrix_rank(columns) :]

    def value(tau):
        covariance = across.T @ (np.diag(u**2 * np.exp(tau[number])) + known) @ across
        contrasts = across.T @ y
        return 0.5 * (np.linalg.slogdet(covariance)[1] + contrasts @ np.linalg.solve(covariance, contrasts))

    options = {"xatol": 1e-8, "fatol": 1e-11, "maxiter": 10_000, "maxfev": 10_000}
    return np.exp(0.5 * minimize(value, np.zeros(len(sets)), method="Nelder-Mead", options=options).x)


@pytest.mark.parametrize("seed", [1, 2])
def test_factors_maximise_the_restricted_likelihood(seed):
    """One set three times worse than stated, one five times better, one right; contrasts of the readings, not a fit."""
    rng = np.random.default_rng(seed)
    sets = (
        drawn("laser", FINE, rng, (3e-4, 1e-4)),
        drawn("gauge", COARSE, rng, (5e-4, 25e-4)),
        drawn("probe", COARSE, rng, (1e-3, 1e-3)),
    )
    found = volid.fit(campaign_of(CUBIC, *sets), estimate_u=True)
    np.testing.assert_allclose(
        [c.factor for c in found.variance_components], likeliest(sets, design(sets), 0.0), rtol=1e-4
    )


def test_what_is_calibrated_keeps_its_u():
    """Two artefacts of calibrated length, whose offsets are no unknowns of their own but a covariance of the readings."""
    rng, x = np.random.default_rng(21), np.tile(np.linspace(0.0, 250.0, 9), 4)
    laser, calibrated = drawn("laser", FINE, rng, (3e-4, 1e-4)), 8e-4
    one = np.arange(len(x)) % 2 == 0
    place, true = (line_set("length", x + reach, 0.0 * x, 1e-3) for reach in (0.0, 250.0))
    offsets = np.where(one, 6e-4, -9e-4)
    readings = 250.0 + error(x + 250.0) - error(x) + offsets + 4e-4 * rng.standard_normal(len(x))
    labels = {"artefact": np.where(one, "A", "B")}
    options = {**KINDS["length"].options, "calibrated_u": calibrated}
    bar = replace(place, kind="length", readings=readings[:, None], labels=labels, options=options, to=true.ends[0])
    found = volid.fit(campaign_of(CUBIC, laser, replace(bar, name="bar")), estimate_u=True)
    powers = [np.concatenate([t(FINE) ** k, t(x + 250.0) ** k - t(x) ** k]) for k in (1, 2, 3)]
    number = np.repeat([0, 1], [len(FINE), len(x)])
    same = np.concatenate([np.zeros(len(FINE)), np.where(one, 1.0, 2.0)])
    known = calibrated**2 * ((same[:, None] == same) & (number[:, None] + number == 2))
    less = replace(bar, readings=bar.readings - 250.0)
    expected = likeliest((laser, less), np.column_stack([*powers, number == 0]).astype(float), known)
    np.testing.assert_allclose([c.factor for c in found.variance_components], expected, rtol=1e-4)


def test_the_solution_is_that_of_a_campaign_which_states_these_u():
    rng = np.random.default_rng(5)
    campaign = campaign_of(SMOOTH, drawn("laser", FINE, rng, (3e-4, 1e-4)), drawn("gauge", COARSE, rng, (5e-4, 5e-4)))
    found = volid.fit(campaign, estimate_u="laser")
    (component,) = found.variance_components
    stated = replace(campaign.sets[0], u=component.factor * campaign.sets[0].u)
    other = volid.fit(replace(campaign, sets=(stated, campaign.sets[1])))
    np.testing.assert_array_equal(found.parameters, other.parameters)
    np.testing.assert_array_equal(found.covariance, other.covariance)
    for kept, before in zip(found.stated_u, campaign.sets, strict=True):
        np.testing.assert_allclose(kept, before.u, rtol=1e-12)


def test_effects_drawn_for_each_reading_are_no_part_of_the_factor():
    """Where they explain most of the scatter, the factor scales what is left of it, and is less certain."""
    rng = np.random.default_rng(6)
    sets = drawn("laser", FINE, rng, (np.hypot(4e-4, 3e-4), 1e-4)), drawn("gauge", COARSE, rng, (5e-4, 5e-4))
    jitter = Effect("jitter", "offset", 4e-4, "point")
    alone, with_it = (
        volid.fit(campaign_of(CUBIC, replace(sets[0], effects=e), sets[1]), estimate_u=["laser"]).variance_components[0]
        for e in ((), (jitter,))
    )
    total = alone.factor**2 * 1e-8
    assert with_it.factor == pytest.approx(np.sqrt(total - 1.6e-7) / 1e-4, rel=2e-3)
    assert with_it.u / with_it.factor > 2.0 * alone.u / alone.factor


def test_a_set_that_nothing_checks_keeps_its_u():
    rng = np.random.default_rng(7)
    few = drawn("few", np.array([0.0, 250.0, 500.0]), rng, (1e-3, 2e-4))
    found = by_part(volid.fit(campaign_of(CUBIC, drawn("laser", FINE, rng, (3e-4, 1e-4)), few), estimate_u="all"))
    kept = found["few", "component X"]
    assert (kept.factor, kept.is_estimated) == (1.0, False)
    assert kept.state.startswith("kept as stated: 1.") and np.isnan(kept.u)  # of 2, beside its own offset
    assert found["laser", "component X"].factor == pytest.approx(3.0, rel=0.3)


def test_a_factor_that_no_instrument_explains_is_questioned():
    rng = np.random.default_rng(8)
    sets = drawn("laser", FINE, rng, (5e-4, 2e-5)), drawn("gauge", COARSE, rng, (5e-4, 5e-4))
    found = volid.fit(campaign_of(CUBIC, *sets), estimate_u=True)
    assert found.adequacy.grade == QUESTIONED
    assert "set 'laser' (component X): its residuals are 2" in found.adequacy.verdict
    beyond = volid.fit(campaign_of(CUBIC, replace(sets[0], u=sets[0].u / 100.0), sets[1]), estimate_u=True)
    assert by_part(beyond)["laser", "component X"].factor == pytest.approx(100.0)


def test_gross_readings_are_set_aside_before_u_is_estimated():
    """With u three times too small a third of the good readings would pass for gross ones."""
    rng = np.random.default_rng(9)
    laser, gauge = drawn("laser", FINE, rng, (3e-4, 1e-4)), drawn("gauge", COARSE, rng, (5e-4, 25e-4))
    clean = by_part(volid.fit(campaign_of(CUBIC, laser, gauge), estimate_u=True))
    readings = laser.readings.copy()
    readings[[4, 17, 40], 0] += [0.02, -0.03, 0.05]
    found = volid.fit(campaign_of(CUBIC, replace(laser, readings=readings), gauge), robust=True, estimate_u=True)
    assert np.flatnonzero(found.readings.outliers[0][:, 0]).tolist() == [4, 17, 40]
    for key, component in by_part(found).items():
        assert component.factor == pytest.approx(clean[key].factor, abs=clean[key].u)


@pytest.mark.slow
def test_each_unit_has_its_own_factor():
    """A tracker whose angles are five times better than stated, its range right; a network of lengths three times worse."""
    sizes = {"volume": 3.0, "tracker": [1.0, 0.2, 0.2], "bar": 2.0}
    campaign = instruments(11, {name: lambda u, size=size: 0.0 * u + size for name, size in sizes.items()})
    found = by_part(volid.fit(campaign, estimate_u=True))
    expected = {
        "volume": 3.0,
        "again": 1.0,
        "range": 1.0,
        "azimuth, elevation": 0.2,
        "level": 1.0,
        "bar": 2.0,
        "piece": 1.0,
    }
    for (name, part), component in found.items():
        true = next(v for key, v in expected.items() if key in (name, part.split(", ", 1)[-1]))
        assert abs(np.log(component.factor / true)) < 3.0 * component.u / component.factor, (name, part)
    assert len(found) == len(expected)


def test_an_unknown_set_is_named():
    campaign = campaign_of(CUBIC, drawn("laser", FINE, np.random.default_rng(1), (1e-4, 1e-4)))
    with pytest.raises(
        InputError, match=r"`estimate_u`: the campaign has no set 'lasr'; expected 'all', or some of laser"
    ):
        volid.fit(campaign, estimate_u=["lasr"])


def test_factors_and_stated_u_are_kept_in_the_file(tmp_path):
    rng = np.random.default_rng(10)
    campaign = campaign_of(CUBIC, drawn("laser", FINE, rng, (3e-4, 1e-4)), drawn("few", COARSE[:4], rng, (1e-3, 1e-3)))
    before = volid.fit(campaign, estimate_u=True)
    before.save(tmp_path / "s.h5")
    after = volid.load_solution(tmp_path / "s.h5")
    assert after.variance_components == before.variance_components
    assert after.adequacy.sets == before.adequacy.sets
    np.testing.assert_allclose(after.stated_u[0], campaign.sets[0].u, rtol=1e-12)
    text = " ".join(volid.summary(after).split())
    factor = before.variance_components[0].factor
    assert f"set laser, component X: estimated, {factor:.3g} ±" in text
    assert "set few, component X: kept as stated" in text


@pytest.mark.slow
def test_factors_scatter_as_their_u_says():
    """Thirty campaigns of one axis with a smooth function of unknown shape: ln(factor/true) over its u has variance 1.

    The mean may lie below 0 by about 1/√(2ν), since the logarithm of a variance with ν degrees of freedom is biased by -1/ν.
    """
    found = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        sets = drawn("laser", FINE, rng, (3e-4, 1e-4)), drawn("gauge", COARSE, rng, (5e-4, 25e-4))
        components = volid.fit(campaign_of(SMOOTH, *sets), estimate_u=True).variance_components
        found.append([np.log(c.factor / t) * c.factor / c.u for c, t in zip(components, (3.0, 0.2), strict=True)])
    found = np.array(found)
    assert np.all(np.abs(found.mean(axis=0) + 0.15) < 3.0 / np.sqrt(30))
    assert np.all(np.abs(found.std(axis=0) - 1.0) < 3.0 / np.sqrt(60))
