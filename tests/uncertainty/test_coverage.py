"""Coverage intervals and the validity of propagation against the worked examples of JCGM 101:2008, clause 9."""

import numpy as np
import pytest

from volid.effects.distributions import DISTRIBUTIONS, HALF_WIDTH, standardised
from volid.exceptions import InputError
from volid.uncertainty.coverage import coverage_intervals, gum_validity, numerical_tolerance

M = 1_000_000


def additive(rng, distribution, u):
    """Y = X1 + X2 + X3 + X4, JCGM 101 9.2.1."""
    return sum(s * standardised(distribution, rng, M) for s in u)[:, None]


# JCGM 101, tables 2 to 4: standard deviation and 95 % interval; its own numbers are rounded to three digits
@pytest.mark.parametrize(
    ("distribution", "u", "spread", "high", "enough"),
    [
        ("normal", (1, 1, 1, 1), 2.00, 3.92, True),
        ("rectangular", (1, 1, 1, 1), 2.00, 3.88, True),
        ("rectangular", (1, 1, 1, 10), 10.1, 17.0, False),
    ],
)
def test_additive_model(distribution, u, spread, high, enough):
    y = additive(np.random.default_rng(1), distribution, u)
    found = coverage_intervals(y)
    assert y.std() == pytest.approx(spread, abs=0.6e-2 * spread)
    for low_end, high_end in ((found.low, found.high), (found.shortest_low, found.shortest_high)):
        # M = 1e6: end points scatter by about 0.003 u; the shortest interval's place by some 0.05 u
        assert high_end - low_end == pytest.approx(2 * high, rel=4e-3)
    assert found.high[0] == pytest.approx(high, rel=4e-3) and found.low[0] == pytest.approx(-high, rel=4e-3)
    propagated = np.array([np.sqrt(np.sum(np.square(u)))])
    checked = gum_validity(np.zeros(1), propagated, found, M, digits=2)
    # 9.2.3 finds d = 0.04 ≤ δ = 0.05; 9.2.4 finds d = 2.9 (19.9 against 17.0) > δ = 0.5
    assert bool(checked.valid[0]) is enough


def test_mass_calibration():
    """JCGM 101 9.3, table 6: Monte Carlo gives u = 0.0754 mg and [1.0834, 1.3825] mg, propagation 0.0539: not valid."""
    rng = np.random.default_rng(2)
    m_r = 100_000.000 + 0.050 * rng.standard_normal(M)  # mg
    extra = 1.234 + 0.020 * rng.standard_normal(M)
    air = 1.20 + 0.10 / HALF_WIDTH["rectangular"] * standardised("rectangular", rng, M)  # kg/m³, ± 0.10
    weight = 8e3 + 1e3 / HALF_WIDTH["rectangular"] * standardised("rectangular", rng, M)
    reference = 8e3 + 50.0 / HALF_WIDTH["rectangular"] * standardised("rectangular", rng, M)
    y = ((m_r + extra) * (1 + (air - 1.2) * (1 / weight - 1 / reference)) - 100_000.0)[:, None]
    found = coverage_intervals(y)
    assert y.mean() == pytest.approx(1.2341, abs=3e-4)
    assert y.std() == pytest.approx(0.0754, abs=2e-4)
    assert found.shortest_low[0] == pytest.approx(1.0834, abs=5e-3)
    assert found.shortest_high[0] == pytest.approx(1.3825, abs=5e-3)
    assert found.shortest_high[0] - found.shortest_low[0] == pytest.approx(1.3825 - 1.0834, abs=1e-3)
    checked = gum_validity(np.array([1.2340]), np.array([0.0539]), found, M, digits=1)
    assert not checked.valid[0] and checked.decided[0]


def test_shortest_interval_of_an_exponential_begins_at_zero():
    y = np.random.default_rng(3).exponential(size=(200_000, 1))
    found = coverage_intervals(y)
    assert found.shortest_low[0] < 0.002
    assert found.shortest_high[0] == pytest.approx(-np.log(0.05), abs=0.03)
    assert found.low[0] == pytest.approx(-np.log(0.975), abs=0.002)
    assert found.high[0] == pytest.approx(-np.log(0.025), abs=0.05)


def test_too_few_samples():
    with pytest.raises(InputError, match="19 samples; a 95% interval needs at least 20"):
        coverage_intervals(np.zeros((19, 1)))


# JCGM 101 7.9.2, examples 1 and 2: 0.00035 with two digits: δ = 0.000005; 2 with one digit: 0.5
@pytest.mark.parametrize(
    ("u", "digits", "expected"), [(0.00035, 2, 0.5e-5), (2.0, 1, 0.5), (0.0996, 2, 0.5e-2), (0.0, 2, 0.0)]
)
def test_numerical_tolerance(u, digits, expected):
    assert numerical_tolerance(np.array([u]), digits)[0] == pytest.approx(expected)


def test_few_trials_do_not_decide():
    rng = np.random.default_rng(4)
    y = rng.standard_normal((200, 1))
    assert not gum_validity(np.zeros(1), np.ones(1), coverage_intervals(y), 200, digits=2).decided[0]


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_distributions_have_mean_0_and_standard_deviation_1(distribution):
    rng = np.random.default_rng(5)
    values = standardised(distribution, rng, 400_000, samples=(1.0, 1.0, 4.0, 6.0))
    assert abs(values.mean()) < 4 / np.sqrt(400_000)
    assert values.std() == pytest.approx(1.0, abs=5e-3)
    if distribution in HALF_WIDTH:
        assert np.abs(values).max() <= HALF_WIDTH[distribution] + 1e-12
        assert np.abs(values).max() > 0.98 * HALF_WIDTH[distribution]
    if distribution == "U-shaped":  # arc sine: half of the values lie beyond 1/sqrt(2) of the half width
        assert np.mean(np.abs(values) > 1.0) == pytest.approx(0.5, abs=4e-3)
    if distribution == "triangular":  # P(|x| < a/2) = 3/4
        assert np.mean(np.abs(values) < 0.5 * HALF_WIDTH["triangular"]) == pytest.approx(0.75, abs=4e-3)
