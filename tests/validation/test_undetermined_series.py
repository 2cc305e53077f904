"""Surveys of which one leaves something undetermined: what is not known is said, what is known is judged. Truth: exact chain."""

import json

import numpy as np
import pytest
from exact_chain import random_truth
from support.surveys import EXACT, changed, few_distances, survey, truth_of_tests

from volid.fitting.fit import fit
from volid.report.plot.comparison import changes_figure, series_figure
from volid.report.text.comparison import comparison_lines, series_attention, series_data, series_lines
from volid.report.text.summary import plain
from volid.validation.solutions.comparison import compare
from volid.validation.solutions.dates import Times
from volid.validation.solutions.series import series

DAYS = (0.0, 91.0, 182.0)
DRIFT = 40e-6  # rad of EC0Y over the series, 17 µm over the travel of Y


@pytest.fixture(scope="module")
def whole():
    """First and last survey of a drifting machine, with three tools."""
    return [fit(survey(changed(truth_of_tests(), "EC0Y", size), seed, "")) for seed, size in ((61, 0.0), (63, DRIFT))]


@pytest.fixture(scope="module")
def one_tool():
    """One in between, half of the drift gone, with a single tool: angles are not told from straightness, and nothing of ECZ."""
    return fit(few_distances(changed(truth_of_tests(), "EC0Y", 0.5 * DRIFT), 62, "", stations=6, n=50))


def words(found):
    times = Times(tuple(738000.0 + d for d in DAYS), True)
    series_figure(found, times)
    json.dumps(plain(series_data(found, times)), allow_nan=False)
    text = " ".join([*series_lines(found, times), *series_attention(found, times)])
    assert "nan" not in text and "on never" not in text
    return " ".join(text.split())


def test_what_one_of_two_leaves_undetermined_is_not_called_changed(whole, one_tool):
    """A tool along Z does not feel ECZ at all, so that no contrast of it is left to be tested."""
    found = compare(whole[0], one_tool)
    assert "ECZ" in found.not_tested and found.significant == ()
    for f in found.functions:
        assert np.isnan(f.largest_change) == np.isnan(f.at) or len(f.positions) == 1
        assert not f.degrees_of_freedom or np.isnan(f.u) or f.u > 1e-8  # not the reference, where the datum has 0
    assert "nan" not in " ".join(comparison_lines(found))
    changes_figure(found)


def test_one_open_combination_makes_no_false_alarm_of_the_functions_that_it_is_part_of():
    """An unchanged machine, of which the second survey reaches over a part of X and misses one combination: that is held at 0,
    which the smoothness hands on to what the readings tell of the same functions."""
    truth = random_truth(EXACT, np.random.default_rng(3001), waviness=0.8)
    first, second = fit(survey(truth, 6, "")), fit(survey(truth, 7, "", reach=0.6))
    assert first.fully_determined and second.null_space.shape[1] == 1
    found = compare(first, second)
    assert found.significant == () and {"EXX", "EAX"} <= set(found.not_tested)
    assert {"EYY", "EZZ"}.isdisjoint(found.not_tested)


def test_a_survey_that_leaves_something_open_takes_no_part_in_its_line(whole, one_tool):
    surveys = [whole[0], one_tool, whole[1]]
    found = series(surveys, DAYS, names=list("abc"), limit=0.004)
    (only,) = found.significant
    assert only.drift.name == "EC0Y" and only.steady and only.surveys == (0, 2)
    assert abs(only.drift.largest_change - DRIFT) < 3 * only.drift.u
    ends = compare(*whole)
    same = {f.name: f for f in ends.functions}["EC0Y"]
    assert only.drift.largest_change == pytest.approx(same.largest_change, rel=0.1)
    assert np.isnan(found.volume[0].largest) and found.volume[1].largest > 0.004
    assert found.holding.exceeded == 2 and found.holding.before == 0
    text = words(found)
    assert "the change of the field since the first survey is not determined; b" in text
    assert "b does not determine the whole deviation field" in text


def test_a_first_survey_that_leaves_the_field_open_has_no_compensation_to_judge(whole, one_tool):
    found = series([one_tool, *whole], DAYS, names=list("abc"))
    only = next(f for f in found.functions if f.drift.name == "EC0Y")
    assert only.surveys == (1, 2) and only.drift.significant and np.isnan(only.since_first[0]).all()
    assert abs(only.drift.largest_change - DRIFT) < 3 * only.drift.u
    assert np.isnan(found.holding.limit) and found.holding.exceeded == -1 and np.isnan(found.holding.until)
    assert "not determined: the first survey" in words(found)


def test_surveys_that_all_leave_the_field_open(one_tool):
    found = series([one_tool] * 3, DAYS, names=list("abc"), limit=0.004)
    assert found.significant == () and np.isnan(found.holding.rate)
    assert "no two surveys determine the whole deviation field" in words(found)
