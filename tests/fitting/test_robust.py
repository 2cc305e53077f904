"""Gross outliers: closed forms, cases by hand, and whole campaigns."""

from functools import cache

import numpy as np
import pytest
from exact_chain import random_truth, tracker_campaign
from support.judging import judge
from support.machines import VERTICAL, fixed, volid_machine
from support.trackers import distance_campaign

from volid.fitting.diagnosis.robust import (
    HUBER,
    Weighted,
    critical_value,
    down_weight,
    huber_factors,
    name_outliers,
    set_aside,
    spread,
)
from volid.fitting.fit import fit


class RepeatedReadings:
    """Readings of one quantity with u = 1: the weighted mean, its residuals and leverages by hand."""

    def __init__(self, readings):
        self.y = np.array(readings, float)[:, None]

    def residuals(self, factors):
        w = factors[0] ** 2
        return [self.y - np.sum(w * self.y) / np.sum(w)]

    def weighted(self, factors):
        w = factors[0] ** 2
        return Weighted(self.residuals(factors), [w / np.sum(w)])


@pytest.mark.parametrize("n, expected", [(1, 1.960), (10, 2.807), (100, 3.481), (1000, 4.056)])
def test_critical_value_is_the_two_sided_quantile_of_the_largest_of_n(n, expected):
    """Tables of the normal distribution at 1 - 0.025 / n."""
    assert critical_value(n) == pytest.approx(expected, abs=1e-3)


def test_spread_is_the_median_deviation_and_at_least_one():
    values = np.random.default_rng(0).normal(scale=3.0, size=(20001, 1))
    values[:1000] = 1e6
    assert spread([values]) == pytest.approx(3.0, rel=0.1)  # 5 % outliers raise the median by 7 %
    assert spread([0.01 * values]) == 1.0


def test_residuals_are_judged_by_what_their_leverage_leaves_of_them():
    """u_r = u sqrt(1 - h): of two residuals of 2.5 u, that with h = 0.5 is 3.5 standard deviations, critical 3.02 for 20."""
    residuals, leverages = np.full((20, 1), 0.1), np.zeros((20, 1))
    residuals[[3, 4]], leverages[4] = 2.5, 0.5
    (found,) = set_aside(Weighted([residuals], [leverages]))
    assert np.flatnonzero(found).tolist() == [4]


def test_huber_factors_bound_the_influence():
    residuals = np.array([[0.0], [0.1], [-0.2], [0.5], [-1.5], [3.0], [-150.0]])  # spread below 1: taken as 1
    factors = huber_factors([residuals])[0]
    np.testing.assert_allclose(factors**2, [[1], [1], [1], [1], [1], [0.5], [0.01]])
    influence = np.abs(factors**2 * residuals)
    assert influence.max() <= HUBER * (1 + 1e-12)


def test_one_blunder_among_ten_readings_is_named_and_the_mean_is_that_of_the_others():
    """w = r / sqrt(1 - 1/n): with ten readings of u = 1 and one 30 off, w = 27 / 0.949 = 28.5; the critical value 2.807."""
    good = [0.3, -0.9, 0.6, 0.1, -0.4, 1.1, -0.2, 0.5, -1.0]
    problem = RepeatedReadings([*good, 30.0])
    factors = down_weight(problem.residuals, [np.ones((10, 1))])
    outliers = name_outliers(problem.weighted, set_aside(problem.weighted(factors)))
    assert np.flatnonzero(outliers[0]).tolist() == [9]
    residual = problem.residuals([np.where(outliers[0], 0.0, 1.0)])[0]
    assert residual[9, 0] == pytest.approx(30.0 - np.mean(good))


def test_two_blunders_on_one_side_do_not_hide_each_other():
    good = np.random.default_rng(1).normal(size=18)
    problem = RepeatedReadings([*good, 9.0, 9.5])
    factors = down_weight(problem.residuals, [np.ones((20, 1))])
    outliers = name_outliers(problem.weighted, set_aside(problem.weighted(factors)))
    assert np.flatnonzero(outliers[0]).tolist() == [18, 19]


def test_good_readings_that_were_set_aside_come_back():
    """Starting from a wrong suspicion, the generations end at the right one."""
    good = np.random.default_rng(2).normal(size=20)
    problem = RepeatedReadings([*good, 40.0])
    suspicion = [np.zeros((21, 1), bool)]
    suspicion[0][:5] = True
    outliers = name_outliers(problem.weighted, suspicion)
    assert np.flatnonzero(outliers[0]).tolist() == [20]


# ------------------------------------------------------------------------------------------------- whole campaigns


@cache
def pair(seed, fraction=0.01):
    """Robust solution of a campaign with outliers and plain solution of the same without, truth and tracker."""
    solutions, trackers = [], []
    for share in (fraction, 0.0):
        rng = np.random.default_rng(seed)
        truth = random_truth(VERTICAL, rng, waviness=0.3)  # within reach of 4 segments
        trackers.append(tracker_campaign(VERTICAL, truth, rng, n_per_station=100, outlier_fraction=share))
        campaign = distance_campaign(volid_machine(VERTICAL, fixed(4)), trackers[-1], seed=seed)
        solutions.append(fit(campaign, robust=share > 0))
    return (*solutions, truth, trackers[0], trackers[1])


@pytest.mark.parametrize("seed", [1, *(pytest.param(s, marks=pytest.mark.slow) for s in (2, 3))])
def test_one_per_cent_outliers_are_named_and_do_no_harm(seed):
    robust, clean, truth, dirty, same = pair(seed)
    gross = dirty.distance - same.distance
    np.testing.assert_array_equal(gross != 0, dirty.outlier)
    named = robust.readings.outliers[0][:, 0]
    assert named[np.abs(gross) > 0.020].all(), "all above 20 µm"
    # 5 % chance of one false alarm, and small outliers within the noise need not be named
    assert (named & ~dirty.outlier).sum() <= 1
    assert judge(robust, VERTICAL, truth).rms < 1.3 * judge(clean, VERTICAL, truth).rms
    assert not robust.adequacy.rejected


def test_outliers_are_reported_by_file_row_station_and_size():
    robust, _, _, dirty, same = pair(1)
    gross = dirty.distance - same.distance
    largest = robust.readings.outlier_readings[0]
    i = int(np.argmax(np.abs(gross) / dirty.u * np.isin(np.arange(len(gross)), np.flatnonzero(dirty.outlier))))
    assert largest.where == f"volume.csv, row {i + 1}"
    assert f"station {dirty.station[i]}" in largest.label
    assert largest.residual == pytest.approx(gross[i], abs=0.005)
    assert len(robust.readings.outlier_readings) == robust.readings.outliers[0].sum()
    assert robust.statistics.n_readings == 600 - robust.readings.outliers[0].sum()


def test_without_robust_loss_the_model_is_rejected_and_the_reading_suspected():
    _, _, _, dirty, _ = pair(1)
    plain = fit(distance_campaign(volid_machine(VERTICAL, fixed(4)), dirty, seed=1))
    assert plain.adequacy.rejected
    suspects = {s.where for s in plain.adequacy.suspects}
    assert suspects & {f"volume.csv, row {i + 1}" for i in np.flatnonzero(dirty.outlier)}
    assert not plain.readings.outliers[0].any()


def test_clean_campaign_is_left_as_it_is():
    rng = np.random.default_rng(4)
    truth = random_truth(VERTICAL, rng, waviness=0.3)
    campaign = distance_campaign(
        volid_machine(VERTICAL, fixed(4)), tracker_campaign(VERTICAL, truth, rng, n_per_station=100)
    )
    plain, robust = fit(campaign), fit(campaign, robust=True)
    assert not robust.readings.outliers[0].any()
    np.testing.assert_allclose(robust.parameters, plain.parameters, atol=1e-8)
