"""Mistakes in what a campaign says, on every kind of reading and several layouts: named, or at least not accepted."""

from dataclasses import replace

import numpy as np
import pytest
from support.machines import HORIZONTAL, MACHINES, VERTICAL
from support.wrong_inputs import MISTAKES, ball_bar, components, distances, is_named, is_same, points, spheres

import volid
from volid.fitting.diagnosis.adequacy import ACCEPTED, ENLARGED, NOT_TESTABLE
from volid.fitting.nominal import check_nominal, explained, few, nominal_misfit
from volid.plausibility.checks import check_campaign
from volid.plausibility.slips import COLUMNS, HAND, READINGS, SENSE, TOOL, slips

GOOD = (ACCEPTED, ENLARGED, NOT_TESTABLE)
TABLE = "w C' A' Y' X' b Z t"
BEFORE_A_FIT = (  # on the nominal chain, or from sizes alone; the others take a fit
    "readings in metres", "readings in micrometres", "readings in inches", "positions in metres", "positions in inches",
    "positions in micrometres", "rotary positions in radians", "X counts the other way", "columns X and Z exchanged",
    "frame of the other hand", "readings negated", "dead paths taken for absolute lengths", "temperatures in kelvin",
    "tool vectors negated", "two stations exchanged with one tool", "beams broken at tool changes, one segment",
)  # fmt: skip


def mistakes(*names):
    return [m for m in MISTAKES if m.name in names]


def refusal(campaign):
    """What is said before a fit, "" when nothing is."""
    try:
        check_campaign(campaign)
        check_nominal(campaign)
    except volid.InputError as problem:
        return str(problem)
    return ""


@pytest.mark.parametrize("mistake", mistakes(*BEFORE_A_FIT), ids=lambda m: m.name)
def test_it_is_named_before_the_fit_in_distances(mistake):
    sound = distances(HORIZONTAL, 3, n=60)
    made = mistake.make(sound)
    if made is None or is_same(made, sound):
        pytest.skip("this mistake cannot be made here")
    assert is_named(mistake, refusal(made))


@pytest.mark.parametrize(
    "mistake",
    mistakes("frame of the other hand", "positions in metres", "Y counts the other way"),
    ids=lambda m: m.name,
)
def test_it_is_named_before_the_fit_in_points(mistake):
    made = mistake.make(points(HORIZONTAL, 4, n=80))
    assert is_named(mistake, refusal(made))


@pytest.mark.parametrize(
    "mistake",
    mistakes("C counts the other way", "columns C and A exchanged", "rotary positions in radians"),
    ids=lambda m: m.name,
)
def test_it_is_named_before_the_fit_in_r_tests(mistake):
    assert is_named(mistake, refusal(mistake.make(spheres(TABLE, 5))))


@pytest.mark.parametrize("layout", list(MACHINES))
@pytest.mark.parametrize("make", [distances, points, ball_bar, components], ids=lambda f: f.__name__)
@pytest.mark.parametrize(
    ("u", "scale"), [(1e-4, 0.03), (0.1, 1.0), (1e-3, 60.0)], ids=["small", "coarse", "large errors"]
)
def test_sound_campaigns_pass_the_door(layout, make, u, scale):
    """u 0.1 µm to 0.1 mm, errors of 1 µm to some millimetres."""
    campaign = make(MACHINES[layout], 6, u, scale if make is not components else min(scale, 8.0))
    assert refusal(campaign) == ""


@pytest.mark.parametrize("make", [distances, points], ids=lambda f: f.__name__)
def test_slips_that_are_their_own_opposite_restore_the_campaign(make):
    """Twice negated or exchanged is as it was; once, the readings disagree with the nominal machine."""
    sound, seen = make(VERTICAL, 7, n=60), set()
    before = nominal_misfit(sound)
    assert before < 0.1
    for slip in slips(sound):
        if slip.cause not in (SENSE, COLUMNS, TOOL, HAND, READINGS):
            continue
        again = next((s for s in slips(slip.campaign) if s.what == slip.what), None)
        if again is None:  # it put positions outside the travel, and is not tried there
            continue
        seen.add(slip.cause)
        assert nominal_misfit(slip.campaign) > 50.0 * before, slip.what
        assert nominal_misfit(again.campaign) == pytest.approx(before, rel=1e-3), slip.what
    assert {SENSE, TOOL} < seen


def test_a_slip_in_one_set_is_not_taken_for_the_unit_of_another():
    """What the readings of one set would count less for in another unit is no explanation of the others."""
    trackers, bar = distances(VERTICAL, 11), ball_bar(VERTICAL, 11)
    (mistake,) = mistakes("two stations exchanged with one tool")
    wrong = mistake.make(trackers)
    both = replace(wrong, stations=wrong.stations + bar.stations, sets=wrong.sets + bar.sets)
    assert "stations S1 and S2 are exchanged" in refusal(both)


def test_readings_one_row_off_are_named():
    """As after a cell that was put in at the head of a column."""
    sound = distances(HORIZONTAL, 12)
    (s,) = sound.sets
    shifted = replace(s, readings=np.roll(s.readings, 1, axis=0)).rows_of(np.arange(1, len(s)))
    assert "stand one row too low" in refusal(replace(sound, sets=(shifted,)))


def test_known_stations_are_not_blamed_for_what_cannot_be_adjusted():
    """Nothing nominal can be adjusted: no comparison with unknown positions says anything."""
    sound = distances(HORIZONTAL, 14)
    (s,) = sound.sets
    stations = tuple(replace(one, known=True, frame="machine") for one in sound.stations)
    overflowing = replace(s, readings=np.where(np.arange(len(s))[:, None] == 5, np.inf, s.readings))
    check_nominal(replace(sound, stations=stations, sets=(overflowing,)))


def test_lost_beams_are_named_and_a_zeroed_instrument_is_not():
    sound = distances(HORIZONTAL, 13)
    (s,) = sound.sets
    lost = s.readings.copy()
    lost[100:160] = 0.0
    assert "exactly 0 at 60 different positions" in refusal(replace(sound, sets=(replace(s, readings=lost),)))
    starts = {
        key: r for r, key in reversed(list(enumerate(zip(s.labels["station"], s.labels["segment"], strict=True))))
    }
    zeroed = s.readings - s.readings[[starts[k] for k in zip(s.labels["station"], s.labels["segment"], strict=True)]]
    assert refusal(replace(sound, sets=(replace(s, readings=zeroed),))) == ""


def test_positions_of_another_travel_are_named_and_over_travel_is_not():
    sound = points(HORIZONTAL, 8)
    i = sound.machine.index("Y")
    (s,) = sound.sets
    beyond = s.positions.copy()
    beyond[:5, i] = 700.0 + 30.0  # 4 % beyond
    assert refusal(replace(sound, sets=(replace(s, positions=beyond, readings=s.readings),))) == ""
    shifted = replace(sound, sets=(replace(s, positions=s.positions + np.where(np.arange(3) == i, 900.0, 0.0)),))
    assert "% of the positions of Y" in refusal(shifted) and "is the column right" in refusal(shifted)


def test_few_rows_of_a_campaign_hold_some_of_every_set():
    sound = distances(VERTICAL, 9, n=30)
    cut = few(sound, 50)
    assert 40 <= cut.n_readings <= 50 and explained(cut, 0.0) == []


@pytest.mark.slow
@pytest.mark.parametrize("make", [distances, ball_bar, components], ids=lambda f: f.__name__)
@pytest.mark.parametrize(
    "name", ["u in micrometres", "u in metres", "u ten times too large", "tool vectors in metres", "stations in metres"]
)
def test_what_takes_a_fit_is_not_accepted_and_is_named(make, name):
    (mistake,) = mistakes(name)
    sound = make(VERTICAL, 10)
    made = mistake.make(sound)
    if made is None or is_same(made, sound):
        pytest.skip("this mistake cannot be made here")
    try:
        adequacy = volid.fit(made).adequacy
    except volid.VolidError as problem:
        assert is_named(mistake, str(problem))
        return
    assert adequacy.grade not in GOOD
    said = " ".join([adequacy.verdict, *(q.text for q in adequacy.questions), *(c.what for c in adequacy.causes[:1])])
    assert is_named(mistake, said)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [92, 157, 112])
def test_sound_ball_bars_are_accepted(seed):
    """Lengths that differ by their errors and noise alone: an error along the range was found in the noise."""
    found = volid.fit(ball_bar(VERTICAL, seed, 0.01, 1.0)).adequacy
    assert found.grade in GOOD and not found.causes
