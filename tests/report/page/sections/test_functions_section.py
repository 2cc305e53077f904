"""The error motions on the page: every function once, its numbers those of the library, what is missing said once."""

import re

import numpy as np
import pytest
from lxml import html

from volid.model.iso230 import parse
from volid.report.contents.contents import gather
from volid.report.language import Texts
from volid.report.page.sections.functions import build
from volid.report.plot.curves import cross_effect, curves, shown_axes
from volid.report.plot.functions import cross_names

STATES = ("rich_solution", "single_tool_solution", "rotary_solution")


@pytest.fixture(scope="module", params=STATES)
def state(request):
    """A solution, and the section made of it, in German."""
    solution = request.getfixturevalue(request.param)
    return solution, html.fromstring(f"<div>{build(gather(solution), Texts('de')).body}</div>")


def test_every_determined_function_has_one_panel(state):
    solution, section = state
    labels = [svg.get("aria-label") for svg in section.xpath("//div[@class='panels']//svg")]
    shown = curves(solution, shown_axes(solution))
    expected = [name for name, c in shown.items() if c.known > 0.0]
    expected += [name for name, c in shown.items() if c.beside is not None]  # its map
    assert sorted(label.split(":")[0] for label in labels) == sorted(expected)


def test_numbers_are_those_of_the_solution(state):
    solution, section = state
    found = {d.get("data-key"): float(d.get("value")) for d in section.iter("data") if d.get("data-key")}
    for name, c in curves(solution, shown_axes(solution)).items():
        rows = solution.motion(name, np.linspace(*c.axis.travel, 101))
        values = np.array([r.value for r in rows])
        if name in cross_names(solution):  # the range is that over both axes, here on a grid of them
            everywhere = cross_effect(solution, name)[2] * (1e-6 if parse(name).is_rotation else 1e-3)
            assert found[f"functions.{name}.range"] == pytest.approx(np.ptp(everywhere), rel=0.02)
        elif np.isfinite(values).all():
            assert found[f"functions.{name}.range"] == pytest.approx(np.ptp(values), rel=1e-12)
            assert found[f"functions.{name}.largest_U"] == pytest.approx(2.0 * max(r.u for r in rows), rel=1e-12)
        else:
            assert f"functions.{name}.range" not in found


def test_reversal_is_that_of_the_solution(rich_solution):
    section = html.fromstring(f"<div>{build(gather(rich_solution), Texts('en')).body}</div>")
    found = {d.get("data-key"): float(d.get("value")) for d in section.iter("data") if d.get("data-key")}
    rows = rich_solution.motion("EYY", np.linspace(*rich_solution.machine.axis("Y").travel, 101))
    ways = {way: np.array([r.value for r in rows if r.direction == way]) for way in (1, -1)}
    expected = np.abs(ways[1] - ways[-1]).max()
    assert found["functions.EYY.largest_reversal"] == pytest.approx(expected, rel=1e-12)
    assert {k for k in found if k.endswith("reversal")} == {f"functions.{n}.largest_reversal" for n in ("EXX", "EYY")}


def test_one_legend_and_every_remark_once(state):
    _, section = state
    assert len(section.xpath("//div[@class='legend']")) == 1
    remarks = [li.text_content() for li in section.xpath("//ul/li")]
    assert len(set(remarks)) == len(remarks) <= 4
    assert not section.xpath("//svg//text()[contains(., 'nicht bestimmt')]")


def test_ids_of_figures_differ(state):
    ids = re.findall(r'\bid="([^"]+)"', html.tostring(state[1], encoding="unicode"))
    assert len(ids) == len(set(ids)) > 10


def test_nothing_is_shown_behind_a_barrier(rotary_solution, monkeypatch):
    contents = gather(rotary_solution)
    monkeypatch.setattr(type(rotary_solution.adequacy), "barrier", "a mistake")
    assert build(contents, Texts()) is None
