"""Contributions to U: their squares add up to U², whatever is taken together, and U is the solution's."""

import math

import numpy as np
import pytest

from volid.report.contents.contributions import contributions, headline_contributions, source_words, with_main_sources
from volid.report.language import ENGLISH, Texts
from volid.uncertainty.budget import Line
from volid.uncertainty.outputs import FIELD, POSITIONS

TOOL = (0.0, 0.0, -150.0)


@pytest.fixture(scope="module")
def found(rich_solution):
    return headline_contributions(rich_solution, TOOL, ENGLISH)


def test_root_sum_of_squares_is_the_expanded_uncertainty(found):
    assert len(found) > 20
    for output in found:
        assert math.hypot(*output.parts.values()) == pytest.approx(output.expanded, rel=1e-9)


def test_constants_have_twice_the_standard_uncertainty_of_the_covariance(found, rich_solution):
    by_name = {o.output: o for o in found}
    for name in ("EC0Y", "EA0Z", "EB0Z"):
        assert by_name[name].expanded == pytest.approx(2.0 * rich_solution.location(name).u, rel=1e-6)


def test_motions_have_the_root_mean_square_over_the_travel(found, rich_solution):
    by_name = {o.output: o for o in found}
    axis = rich_solution.machine.axis("X")
    rows = rich_solution.motion("EZX", np.linspace(*axis.travel, POSITIONS))
    expected = 2.0 * np.sqrt(np.mean([r.u**2 for r in rows]))
    assert by_name["EZX"].expanded == pytest.approx(float(expected), rel=1e-6)


def lines(parts):
    """Lines of a budget with these contributions by output and source."""
    nan = math.nan
    return [Line(o, nan, "mm", nan, s, nan, "", nan, c, nan) for o, by in parts.items() for s, c in by.items()]


def test_sources_beyond_the_main_ones_are_taken_together():
    given = {"EXX": {"a": 3e-3, "b": 4e-3, "c": 1e-5}, "EYY": {"a": 0.0, "b": 1e-3, "c": 2e-3}, "EZZ": {"d": 5e-5}}
    kept = with_main_sources(contributions(lines(given)), ENGLISH, most=3)
    assert list(kept[0].parts) == ["d", "c", "2 other sources together"]  # d is all of EZZ, c most of EYY
    assert kept[0].parts["2 other sources together"] == pytest.approx(2.0 * 5e-3)
    assert [o.expanded for o in kept] == pytest.approx([2e-3 * math.sqrt(25.0001), 2e-3 * math.sqrt(5.0), 1e-4])


def test_sources_with_the_same_words_are_one():
    given = contributions(
        lines({"EXX": {"form at 0": 3e-3, "form at 100": 4e-3}}), {"form at 0": "form", "form at 100": "form"}
    )
    assert given[0].parts == {"form": pytest.approx(1e-2)}


def test_sources_are_said_in_the_language(rich_solution):
    words = source_words(rich_solution, Texts("de"))
    assert words["readings of set 'levels'"] == "Messwerte von „levels“"


def test_numbers_of_the_volume_are_told_from_others(found):
    assert [o.output for o in found if o.is_of_volume] == list(FIELD)
