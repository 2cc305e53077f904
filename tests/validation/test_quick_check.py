"""Few new readings on an old solution: what changed is named and released; truth and readings from the exact chain."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import default_stations
from scipy.special import chdtrc
from scipy.stats import binom
from support.surveys import (
    EXACT,
    changed,
    circle,
    diagonals,
    few_distances,
    stretched,
    survey,
    surveyed,
    truth_of_tests,
)

from volid.exceptions import InputError
from volid.fitting.fit import fit
from volid.model.linear_maps import function_rows
from volid.report.text.check import check_attention, check_data, check_lines
from volid.validation.check import check
from volid.validation.readings.equations import linear
from volid.validation.readings.held_out import held_out
from volid.validation.readings.whitened import Whitened
from volid.validation.search import LEVEL, Search
from volid.validation.suspects import suspects_of

CRASH = 0.010  # mm over the travel
SQUARENESS = {"EC0Y": CRASH / 430.0, "EA0Z": CRASH / 460.0, "EB0Z": -CRASH / 460.0}


@pytest.mark.parametrize("readings", [few_distances, circle, diagonals])
def test_nothing_is_found_where_nothing_changed(readings):
    found = check(surveyed(1), readings(truth_of_tests(), 5))
    assert not found.changed and found.findings == () and found.probability > 0.025
    assert check_attention(found) == [] and check_lines(found)[0].startswith("no change found")
    assert found.updated.options["prior"]  # the old solution with the new readings


@pytest.mark.parametrize("name", SQUARENESS)
def test_a_crash_of_10_micrometres_in_a_squareness_is_found_with_forty_distances(name):
    old, truth = surveyed(1), changed(truth_of_tests(), name, SQUARENESS[name])
    campaign = few_distances(truth, 6)
    assert campaign.n_readings == 40
    found = check(old, campaign)
    (only,) = found.findings
    assert only.name == name and abs(only.size - SQUARENESS[name]) < 3 * only.u and found.rest > 0.01
    assert found.smallest_found[name] < abs(SQUARENESS[name])  # so it is found in nine of ten such crashes and more
    now, before = found.updated.location(name), old.location(name)
    assert (
        abs(now.value - truth.constants[name]) < 3 * now.u and abs(before.value - truth.constants[name]) > 4 * before.u
    )
    held = fit(campaign, prior=old).location(name)  # with the old value in, the new one is held back
    assert abs(held.value - truth.constants[name]) > 3 * before.u or held.u > 3 * before.u
    assert now.u < 2 * before.u or only.rivals == ("EAZ",)  # of which the readings hardly tell a squareness of Z
    assert any(f"{name} was released" in note for note in found.updated.notes)


@pytest.mark.parametrize("readings", [circle, diagonals])
def test_a_circle_and_diagonals_find_the_squareness_of_x_and_y(readings):
    truth = changed(truth_of_tests(), "EC0Y", SQUARENESS["EC0Y"])
    found = check(surveyed(1), readings(truth, 7))
    assert found.findings[0].name == "EC0Y"
    assert abs(found.findings[0].size - SQUARENESS["EC0Y"]) < 3 * found.findings[0].u


def test_what_a_circle_does_not_see_is_said():
    found = check(surveyed(1), circle(truth_of_tests(), 8))
    assert {n for n, size in found.smallest_found.items() if np.isinf(size)} >= {"EA0Z", "EB0Z", "scale of Z"}
    assert "not seen" in "\n".join(check_lines(found)) and check_data(found)["smallest_found"]["EA0Z"] is None
    bent = check(surveyed(1), circle(changed(truth_of_tests(), "EYX", 0.010), 8))
    assert bent.changed and bent.findings[0].rivals  # which function bent it, one circle cannot tell
    assert "cannot tell it from" in check_attention(bent)[0]


def test_the_scale_of_an_axis_is_told_from_a_function():
    found = check(surveyed(1), few_distances(stretched(truth_of_tests(), "X", 25e-6), 9))
    assert found.findings[0].name == "scale of X"
    assert abs(found.findings[0].size - 25e-6 * 760.0) < 3 * found.findings[0].u


@pytest.mark.parametrize("seed", [5, 8, 11])
def test_a_change_that_a_circle_cannot_tell_from_another_is_within_u_of_the_updated_solution(seed):
    """A circle of 150 mm sees another scale of X as one of Y, or of the bar; released alone, the wrong one left X by 20 u."""
    slope = 15e-6
    found = check(surveyed(1), circle(stretched(truth_of_tests(), "X", slope), seed))
    (only,) = found.findings
    assert {"scale of X", "scale of Y"} <= {only.name, *only.rivals}
    model = found.updated.model
    low, high = model.machine.axis("X").travel
    q = np.array([[x if a.letter == "X" else a.reference for x in (low, high)] for a in model.machine.axes])
    rows = function_rows(model, "EXX", q, np.zeros_like(q))
    row = rows[1] - rows[0]
    exact = stretched(truth_of_tests(), "X", slope).functions["EXX"]
    away = row @ np.asarray(found.updated.parameters) - (exact(high) - exact(low))
    assert abs(away) < 2.5 * np.sqrt(row @ found.updated.parameter_covariance @ row)
    assert any("do not tell what was released from its rivals" in n for n in found.updated.notes)


def test_what_the_findings_leave_is_said():
    """Two changes of which no pair of suspects is asked: the rest of chi-square tells that something is missing."""
    truth = stretched(changed(truth_of_tests(), "EC0Y", SQUARENESS["EC0Y"]), "X", 15e-6)
    found = check(surveyed(1), few_distances(truth, 6))
    assert found.changed and found.rest < 1e-3
    assert any("does not explain all" in t for t in check_attention(found))


def test_a_function_that_changed_is_named():
    old = surveyed(1, extra="")
    found = check(old, few_distances(changed(truth_of_tests(), "EXX", 0.010), 5, ""))
    assert [f.name for f in found.findings] == ["EXX"]
    assert 0.008 < abs(found.findings[0].size) < 0.013


@pytest.mark.slow
def test_a_wrong_tool_is_not_taken_for_the_machine():
    """Two tools are read, the length of one of them is wrong by 40 µm."""
    campaigns = [few_distances(truth_of_tests(), seed) for seed in (12, 13)]
    tools = (np.array([0.0, 0.0, -150.0]), np.array([0.0, 90.0, -200.0]))
    sets = []
    for own, tool, campaign in zip((0.0, 0.040), tools, campaigns, strict=True):
        s = campaign.sets[0]
        q = s.positions
        true = np.tile(tool - [0.0, 0.0, own], (len(s), 1))
        places = np.array([default_stations(EXACT)[n] for n in s.labels["station"]])
        length = np.linalg.norm(EXACT.functional_point(q, true, truth_of_tests(), None) - places, axis=1)
        noise = 0.0005 * np.random.default_rng(3).standard_normal(len(s))
        sets.append(
            replace(
                s, name=f"tool {own:g}", readings=(length + noise)[:, None], u=np.full((len(s), 1), 0.0005),
                tool=np.tile(tool, (len(s), 1)), labels={**s.labels, "segment": np.full(len(s), "1")},
            )
        )  # fmt: skip
    found = check(surveyed(1), replace(campaigns[0], sets=tuple(sets)))
    assert found.changed and not found.findings[0].is_machine and found.findings[0].name.startswith("length of tool")
    assert "the tool of the new readings" in check_attention(found)[0]


def test_readings_of_their_own_unknowns_alone_are_refused():
    with pytest.raises(InputError, match="all taken up by its own stations"):
        check(surveyed(1), few_distances(truth_of_tests(), 5, stations=1, n=4))


def test_a_campaign_of_another_machine_is_refused():
    campaign = survey(truth_of_tests(), 3)
    other = replace(campaign.machine, axes=tuple(replace(a, primed=not a.primed) for a in campaign.machine.axes))
    with pytest.raises(InputError):
        check(surveyed(1), replace(campaign, machine=other))


def test_false_alarms_are_5_percent_at_most_and_powers_as_stated():
    """Draws of readings around the prediction, and with each squareness changed by the size that is stated to be found.

    Half of the level belongs to chi-square of everything, which is exact; suspects resemble each other, and take less.
    """
    held = held_out(surveyed(1), few_distances(truth_of_tests(), 5))
    whitened = Whitened.of(linear(held.solution, held.campaign))
    search = Search(whitened, tuple(suspects_of(whitened)))
    rng, count = np.random.default_rng(3), 1000
    noise = rng.standard_normal((count, len(whitened.v)))
    noise -= (noise @ whitened.basis) @ whitened.basis.T

    def changes(v):
        now = Search(replace(whitened, v=v), search.suspects)
        everything = float(chdtrc(whitened.freedom, float(v @ v)))
        return everything <= 0.5 * LEVEL or bool(now.picked(everything))

    alarms = sum(changes(v) for v in noise)
    assert binom.ppf(1e-3, count, 0.5 * LEVEL) <= alarms <= binom.ppf(1 - 1e-3, count, LEVEL)
    for suspect in (s for s in search.suspects if s.name in SQUARENESS):
        size = search.smallest()[suspect.name] / suspect.size(np.ones(1), np.zeros((1, 1)))[0]
        moved = noise[:100] + size * whitened.free(suspect.columns)[:, 0]
        assert sum(changes(v) for v in moved) >= binom.ppf(1e-3, 100, 0.9)
