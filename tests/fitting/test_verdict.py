"""Grade and factor: what a misfit can do to the result decides, not how many readings there are."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import default_tools
from support.mistakes import campaign_of, case_of, crossed, drift, sound, worse

import volid
from volid.fitting.fit import fit
from volid.io.solutions import read_solution
from volid.report.text.summary import summary_data
from volid.uncertainty.budget import LACK, budget, budget_lines, headline_rows
from volid.uncertainty.outputs import headline_outputs

FEW = {"n": 150}
PLACE = np.array([[200.0, 100.0, -100.0]])


@pytest.fixture(scope="module")
def enlarged():
    """An instrument 1.35 times worse than stated, and the same readings with that u."""
    made = worse("vertical", 3, 9e-4, **FEW)
    (s,) = made.campaign.sets
    right = replace(made.campaign, sets=(replace(s, u=s.u * np.sqrt(1.0 + 0.9**2)),))
    return fit(made.campaign), fit(right)


def test_u_that_is_too_small_as_a_whole_is_enlarged_by_what_is_missing(enlarged):
    found, right = enlarged
    assert found.adequacy.grade == "accepted, u enlarged" and not found.adequacy.rejected
    assert right.adequacy.grade == "accepted"
    assert found.factor == pytest.approx(
        np.sqrt(1.0 + 0.9**2), rel=0.12
    )  # 800 degrees of freedom: 2.5 %, hold-outs more
    ratio = found.evaluate(PLACE, default_tools()[0]).u / right.evaluate(PLACE, default_tools()[0]).u
    assert ratio == pytest.approx(np.full((1, 6), found.factor / right.factor / np.sqrt(1.81)), rel=0.15)
    assert "enlarged by the factor" in found.adequacy.verdict


def test_the_factor_is_part_of_every_u(enlarged, tmp_path):
    """Covariance, functions, budget, Monte Carlo and the file hold it; values stay."""
    found, _ = enlarged
    bare = found.bare_covariance + found.smooth_spread @ found.smooth_spread.T
    assert found.covariance == pytest.approx(found.factor**2 * bare, rel=1e-9, abs=1e-30)
    lines = list(budget_lines(budget(found), headline_rows(found, headline_outputs(found))))
    one = [line for line in lines if line.output == "EC0Y"]
    assert one[0].u == pytest.approx(found.location("EC0Y").u, rel=1e-6)
    (lack,) = [line for line in one if line.source == LACK]
    assert lack.contribution == pytest.approx(one[0].u * np.sqrt(1.0 - 1.0 / found.factor**2), rel=1e-6)
    assert sum(line.share for line in one) == pytest.approx(1.0)
    found.save(tmp_path / "S.h5")
    again = read_solution(tmp_path / "S.h5")
    assert again.factor == found.factor and again.adequacy.causes == found.adequacy.causes
    assert again.adequacy.grade == "accepted, u enlarged"


@pytest.mark.slow
def test_monte_carlo_spreads_by_the_factor(enlarged):
    found, _ = enlarged
    samples = found.monte_carlo(400, seed=1).samples
    x = np.concatenate(list(samples.batches()))[:, : len(found.parameters)]
    spread, u = x.std(axis=0, ddof=1), np.sqrt(np.diagonal(found.parameter_covariance))
    assert np.median(spread / u) == pytest.approx(1.0, abs=0.05)  # 400 trials: 3.5 % each


def test_a_small_misfit_in_many_readings_is_not_rejected():
    """u understated by 2 %: significant with 12,000 readings, and nothing to a result."""
    made = sound("vertical", 5, 0.0, n=2000)
    (s,) = made.campaign.sets
    found = fit(replace(made.campaign, sets=(replace(s, u=s.u / 1.03),))).adequacy
    assert found.probability < 1e-3, "the test sees it"
    assert found.grade == "accepted, u enlarged" and found.factor < 1.3


def test_more_readings_of_one_misfit_do_not_make_the_factor_smaller():
    """A cross effect of one size, with four times as many readings: u halves, and the factor rather doubles."""
    few, many = (fit(crossed("vertical", 0, 0.004, n=n).campaign) for n in (150, 600))
    enlarged_u = [s.factor * np.sqrt(np.mean(_bare_u(s) ** 2)) for s in (few, many)]
    assert many.factor > few.factor
    assert enlarged_u[1] > 0.6 * enlarged_u[0], "u does not vanish with the readings where the model is wrong"


def _bare_u(solution):
    q = np.random.default_rng(0).uniform(*np.array([a.travel for a in solution.machine.axes]).T, (64, 3))
    return solution.evaluate(q, default_tools()[0]).u[:, :3] / solution.factor


def test_a_misfit_in_one_place_is_rejected():
    """One station three times as noisy as it says: all others hold."""
    case = case_of("vertical", 4, **FEW)
    rows = case.tracker.station == "S2"
    noise = 3.0 * case.tracker.u * np.random.default_rng(1).standard_normal(len(rows)) * rows
    found = fit(campaign_of(case, case.tracker.distance + noise).campaign).adequacy
    assert found.rejected and "station S2" in found.verdict


def test_not_testable_without_redundancy():
    solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    assert solution.adequacy.grade == "not testable" and not solution.adequacy.rejected
    assert "not testable" in volid.summary(solution).splitlines()[0].lower()
    assert "nan" not in volid.summary(solution).lower()


def test_summary_lists_causes_with_cures():
    solution = fit(drift("vertical", 0, 0.06, **FEW).campaign)
    text, data = volid.summary(solution), summary_data(solution)
    assert text.index("likely causes of the misfit") < text.index("\nmachine ")
    assert data["grade"] == "rejected" and data["causes"][0]["cause"] == "drift of a station"
    assert "What to do: campaign: give the readings of S1 other names in column 'station'" in text.replace("\n  ", " ")
