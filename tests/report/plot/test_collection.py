"""Every figure of a solution can be read: with reversal, cross effects, one tool, a rotary table, in both languages."""

import subprocess
import sys

import pytest
from support.figures import faults

from volid.exceptions import InputError
from volid.report.language import Texts
from volid.report.plot.asked import Asked
from volid.report.plot.collection import draw

STATES = [("rich_solution", "en"), ("single_tool_solution", "de"), ("rotary_solution", "de")]


@pytest.mark.slow  # the figures of three solutions, measured text by text
@pytest.mark.parametrize(("state", "language"), STATES)
def test_no_figure_has_texts_that_collide_or_leave_it(state, language, request):
    solution = request.getfixturevalue(state)
    drawn = list(draw(Asked(solution, solution.most_used_tool(), Texts(language))))
    assert [n for n in drawn if n.figure is not None]
    found = {n.name: faults(n.figure) for n in drawn if n.figure is not None}
    assert {name: why for name, why in found.items() if why} == {}


def test_a_figure_is_drawn_or_a_reason_is_given(rotary_solution):
    asked = ("functions", "locations", "coverage")
    drawn = list(draw(Asked(rotary_solution, (0.0, 0.0, -150.0)), asked))
    assert [(n.name, n.figure is None, bool(n.reason)) for n in drawn] == [
        ("functions_rotary", False, False),
        ("locations", False, False),
        ("coverage", True, True),
    ]


def test_names_of_figures_are_checked(rotary_solution):
    with pytest.raises(InputError, match="there is no figure 'function'; choose among functions, "):
        draw(Asked(rotary_solution, (0.0, 0.0, 0.0)), ["function"])


def test_nothing_is_drawn_that_would_follow_from_a_mistake(rotary_solution, monkeypatch):
    monkeypatch.setattr(type(rotary_solution.adequacy), "barrier", "the hands of the frames differ")
    (found,) = draw(Asked(rotary_solution, (0.0, 0.0, 0.0)), ["functions"])
    assert found.figure is None
    assert found.reason == "its numbers would follow from a mistake: the hands of the frames differ"


def test_figures_are_imported_like_other_names_and_only_when_they_are_used():
    code = """
import sys
from volid.plot import polar_plot
import volid
assert volid.plot.polar_plot is polar_plot
assert not {"matplotlib.figure", "jax"} & set(sys.modules)
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
