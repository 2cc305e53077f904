"""Surveys over time: drift, steps, and until when a compensation holds; truth and readings from the exact chain."""

import copy
import json

import numpy as np
import pytest
from support.surveys import EXACT, changed, survey, surveyed, truth_of_tests

from volid.exceptions import InputError
from volid.fitting.fit import fit
from volid.report.plot.comparison import series_figure
from volid.report.text.comparison import series_attention, series_data, series_lines, series_rows
from volid.report.text.summary import plain
from volid.validation.solutions.dates import Times, recorded_times, stated_times
from volid.validation.solutions.series import series

DAYS = (0.0, 40.0, 70.0, 120.0)
RATE = 0.25e-6  # rad per day: 30 µrad over the series, 13 µm over the travel of Y


@pytest.fixture(scope="module")
def drifting():
    truth = truth_of_tests()
    return [fit(survey(changed(truth, "EC0Y", RATE * day), 30 + i)) for i, day in enumerate(DAYS)]


def test_a_drift_is_found_alone_with_its_rate(drifting):
    found = series(drifting, DAYS)
    (only,) = found.significant
    assert only.drift.name == "EC0Y" and only.drift.significant and only.steady
    assert abs(only.drift.largest_change - RATE * DAYS[-1]) < 3 * only.drift.u
    # four surveys tell more than the two at the ends, and these alone tell the change with sqrt(2) times u of one
    assert only.drift.u < only.since_first_u[-1, 0] < 1.6 * drifting[0].location("EC0Y").u
    assert only.since_first[0, 0] == only.since_first_u[0, 0] == 0.0


def test_the_order_of_the_files_does_not_matter(drifting):
    order = [2, 0, 3, 1]
    found = series(drifting, DAYS, names=list("abcd"))
    other = series([drifting[i] for i in order], [DAYS[i] for i in order], names=["c", "a", "d", "b"])
    assert found.names == other.names == ("a", "b", "c", "d")
    for a, b in zip(found.functions, other.functions, strict=True):
        assert a.drift.chi_square == pytest.approx(b.drift.chi_square, rel=1e-6)


def test_the_date_from_which_a_compensation_no_longer_holds(drifting):
    """A shear RATE of X over Y: the best rotation takes RATE · b²/(a² + b²) of it (sides a, b), and the corners move farthest."""
    found = series(drifting, DAYS, limit=0.012)
    hold = found.holding
    a, b = (float(np.ptp(EXACT.travel[axis])) for axis in "XY")
    turned = b**2 / (a**2 + b**2)
    assert abs(hold.rate - RATE * np.hypot((1.0 - turned) * b / 2.0, turned * a / 2.0)) < 3 * hold.u
    assert hold.u < hold.rate / 5.0
    assert hold.exceeded == -1 and hold.until == pytest.approx(0.012 / hold.rate) and hold.until > DAYS[-1]
    assert hold.earliest < hold.until < hold.latest
    times = Times(tuple(738000.0 + d for d in DAYS), True)
    text = "\n".join(series_lines(found, times))
    assert "not exceeded within the series" in text and times.words(hold.until) in text.replace("\n", " ")
    near = series(drifting, DAYS, limit=0.002)
    assert near.holding.exceeded > 0 and any("no longer holds" in t for t in series_attention(near, times))
    assert series_data(found, times)["holds"]["exceeded_by"] is None
    json.dumps(plain(series_data(near, times)))
    assert len(list(series_rows(found, times))) == 4 * sum(len(f.drift.positions) for f in found.functions)


def test_a_step_is_no_drift():
    before, after = [surveyed(s) for s in (41, 42, 43)], [surveyed(s, ("EB0Z", 60e-6)) for s in (44, 45)]
    found = series([*before, *after], (0.0, 10.0, 20.0, 30.0, 40.0), names=list("abcde"))
    step = next(f for f in found.functions if f.drift.name == "EB0Z")
    assert not step.steady and step.step == 3 and abs(step.step_change.largest_change - 60e-6) < 4 * step.step_change.u
    assert any("most between c and d" in t for t in series_attention(found, Times((0.0,), False)))


def test_nothing_drifts_on_a_machine_that_stays():
    found = series([surveyed(s) for s in (51, 52, 53)], (0.0, 1.0, 2.0))
    assert found.significant == () and found.holding.until == np.inf
    times = Times((0.0, 1.0, 2.0), False)
    figure = series_figure(found, times)
    assert len(figure.axes) > 3
    # the largest of many noisy lengths is above U of one survey although nothing has changed
    assert max(c.largest for c in found.volume) > found.holding.limit and found.holding.exceeded == -1
    assert series_attention(found, times) == []
    assert "not told from what noise alone makes" in " ".join(" ".join(series_lines(found, times)).split())


def test_dates_come_from_the_record_or_are_stated():
    truth = truth_of_tests()
    dated = [surveyed(1), fit(survey(truth, 2, date="2026-03-01"))]
    with pytest.raises(InputError, match=r"a.h5: \[conditions\] date is missing; expected the day of the survey"):
        recorded_times(dated, ["a.h5", "b.h5"])
    assert recorded_times(dated[1:], ["b.h5"]).words(30.0) == "2026-03-31"
    assert (
        stated_times("2026-01-31,2026-02-01", 2).values[1] - stated_times("2026-01-31,2026-02-01", 2).values[0] == 1.0
    )
    assert stated_times("0, 2.5", 2) == Times((0.0, 2.5), False)
    for text, words in (
        ("1", "1 dates for 2 solutions"),
        ("1,x", "or numbers throughout"),
        ("1,2026-01-01", "throughout"),
    ):
        with pytest.raises(InputError, match=words):
            stated_times(text, 2)
    assert Times((1.0,), True).words(1e6) == "more than 100 years after the first"
    assert Times((1.0,), True).words(np.inf) == "never"


def test_surveys_of_one_day_have_times():
    times = stated_times("2026-07-13T08:00,2026-07-13 12:30,2026-07-13T22:00+02:00", 3)
    assert np.diff(times.values) == pytest.approx([4.5 / 24, 7.5 / 24], abs=1e-9)
    assert times.words(1.25) == "2026-07-14 14:00"
    assert stated_times("2026-07-13,2026-07-14,2026-07-15", 3).words(2.0) == "2026-07-15"


def test_too_few_surveys_and_equal_dates_are_refused(drifting):
    with pytest.raises(InputError, match="a series needs 3 solutions"):
        series(drifting[:2], DAYS[:2])
    with pytest.raises(InputError, match="the same time"):
        series(copy.copy(drifting[:3]), (0.0, 1.0, 1.0))
