"""Harja and Candra: systematic deviations E of X and Z come back from the fit of their published tables.

Expected values are the published ones (µm, printed to 0.1), see datasets/published_positioning/README.md.
"""

from pathlib import Path

import numpy as np
import pytest

from volid.fitting.fit import fit
from volid.io import load_campaign

FOLDER = Path(__file__).parents[2] / "datasets/published_positioning"
STEP = 25.0  # mm
PUBLISHED = {"EXX": {"E": 31.8, "R": 4.2}, "EZZ": {"E": 33.3, "R": 6.3}}  # µm, bidirectional
U_OF_MEAN = {("EXX", 1): 4.2, ("EXX", -1): 2.6, ("EZZ", 1): 3.9, ("EZZ", -1): 4.0}  # R = 4 s, one direction, µm


@pytest.fixture(scope="module")
def solution():
    return fit(load_campaign(FOLDER / "campaign.toml"))


def rows(solution, name):
    return [row for row in solution.functions(step=STEP) if row.name == name]


@pytest.mark.parametrize("name", PUBLISHED)
def test_systematic_deviation_is_the_published_one(solution, name):
    values = np.array([row.value for row in rows(solution, name)])
    assert np.ptp(values) * 1e3 == pytest.approx(PUBLISHED[name]["E"], abs=0.05)  # half of the last printed digit


@pytest.mark.parametrize("name", PUBLISHED)
def test_reversal_is_smaller_than_the_published_repeatability(solution, name):
    """R is the largest of 2 s(+) + 2 s(-) + |B|, ISO 230-2."""
    value = {(row.position, row.direction): row.value for row in rows(solution, name)}
    reversal = [value[q, 1] - value[q, -1] for q, direction in value if direction == 1]
    assert 0.5 < np.abs(reversal).max() * 1e3 < PUBLISHED[name]["R"]


def test_uncertainty_is_that_of_a_mean_of_five(solution):
    """Far from the reference: u of the mean there, and of the zero at the reference, where both directions agree in u."""
    for name, axis in (("EXX", "X"), ("EZZ", "Z")):
        s = {way: U_OF_MEAN[name, way] / 4 / np.sqrt(5) * 1e-3 for way in (1, -1)}
        reference = solution.machine.axis(axis).reference
        at_zero = 1.0 if reference % STEP == 0 else 0.5  # midway between two positions: the mean of two values
        for row in rows(solution, name):
            if abs(row.position - reference) > STEP:
                zero = at_zero * (s[1] ** 2 + s[-1] ** 2) / 4
                assert row.u == pytest.approx(np.sqrt(s[row.direction] ** 2 + zero), rel=2e-3)  # u has three digits


def test_without_redundancy_the_fit_says_so_and_fits_exactly(solution):
    assert solution.adequacy.degrees_of_freedom == 0
    assert solution.adequacy.verdict.startswith("no redundancy")
    assert not solution.adequacy.rejected
    assert np.isnan(solution.adequacy.unit_weight)
    assert solution.fully_determined
    assert max(solution.statistics.residual_rms.values()) < 1e-9


def test_only_positioning_is_in_the_model(solution):
    assert solution.model.names == ("EXX", "EZZ")
