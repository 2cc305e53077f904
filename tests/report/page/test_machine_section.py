"""The sections about the machine and its constants: every number is the library's, every direction the exact chain's."""

import re
from dataclasses import replace

import numpy as np
import pytest
from exact_chain import Truth
from lxml import html
from support.axis_lines import axis_line, line_error
from support.machines import NUTATING, STRUCTURES, exact_machine

from volid.report.contents.contents import Contents
from volid.report.language import Texts
from volid.report.page.sections import constants, machine
from volid.report.text.summary import summary_data

GROUPS = ("squareness", "location_errors", "tool_frame")


@pytest.fixture(params=["solution", "rotary_solution"])
def asked(request):
    return contents(request.getfixturevalue(request.param))


def contents(solution):
    summary = summary_data(solution)
    return Contents(solution, summary, tuple(summary["tool"]))


def numbers_of(section):
    """Numbers of a section by their keys, as a program reads them."""
    return {e.get("data-key"): float(e.get("value")) for e in html.fromstring(section.body).iter("data")}


@pytest.mark.parametrize("language", ["en", "de"])
def test_numbers_of_constants_are_those_of_the_summary(asked, language):
    found = numbers_of(constants.build(asked, Texts(language)))
    expected = {
        f"{group}.{c['name']}.{part}": c[part]
        for group in GROUPS
        for c in asked.summary[group]
        for part in ("value", "U")
        if c["value"] is not None
    }
    assert expected
    assert found == expected


def test_numbers_of_axes_are_those_of_the_machine(asked):
    found = numbers_of(machine.build(asked, Texts("de")))
    for axis in asked.summary["axes"]:
        for part in ("travel", "measured"):
            got = [found[f"machine.axes.{axis['axis']}.{part}.{k}"] for k in (0, 1)]
            assert got == list(axis[part])
    stated = dict(re.findall(r"([A-C X-Z]) = (-?[\d.]+)", asked.summary["datum"]))
    assert {a["axis"] for a in asked.summary["axes"]} == set(stated)
    for letter, value in stated.items():
        assert found[f"machine.axes.{letter}.reference"] == pytest.approx(float(value), rel=1e-5)


def test_what_is_not_determined_is_named(single_tool_solution):
    asked = contents(single_tool_solution)
    text = " ".join(html.fromstring(constants.build(asked, Texts()).body).text_content().split())
    (named,) = re.findall(r"Not determined by the data: ([^.]*)\.", text)
    missing = [c for g in GROUPS for c in asked.summary[g] if c["value"] is None]
    forms = [name for c in missing for name in dict.fromkeys((c["name"], c.get("symbol", c["name"])))]
    assert named == ", ".join(forms)  # squareness errors in their short and their full form
    assert {"EA0S", "EB0S", "EC0S"} <= set(named.split(", "))  # CONVENTIONS 4: each station saw a single tool vector


def test_what_a_mistake_would_lead_to_is_not_shown(solution):
    asked = contents(solution)
    nothing = {**asked.summary, "squareness": [], "location_errors": [], "tool_frame": []}  # as behind a barrier
    assert constants.build(replace(asked, summary=nothing), Texts()) is None


@pytest.mark.parametrize("structure", [*STRUCTURES.values(), *NUTATING.values()])
def test_words_name_the_side_to_which_the_physical_line_stands_and_leans(structure):
    exact = exact_machine(structure)
    rng = np.random.default_rng(11)
    sizes = [(d, 0.02 if d in "XYZ" else 1e-4) for d in "XYZABC"]
    rotary = [a for a in exact.axes if a in "ABC"]
    along = {a: "ABC".index(a) for a in rotary}
    truth = Truth(
        constants={f"E{d}0{a}": s * rng.normal() for a in rotary for k, (d, s) in enumerate(sizes) if k % 3 != along[a]}
    )
    for a in rotary:
        direction, _ = axis_line(exact, truth, a)
        six = line_error(exact, truth, a)
        for k, (d, _) in enumerate(sizes):
            if k % 3 == along[a]:
                continue
            words = constants.side_in_words(f"E{d}0{a}", six[k], 1e-9, Texts())
            end = np.sign(exact.frame[a][:, along[a]] @ direction)  # the end towards the letter's own direction
            moved = six[:3] if k < 3 else end * exact.frame[a].T @ (direction - exact.direction[a])
            sign, letter = words[-2:]
            assert (sign == "+") == (moved["XYZ".index(letter)] > 0.0), (words, six)
            assert constants.side_in_words(f"E{d}0{a}", six[k], 1.0, Texts()) == "not distinguishable from 0"
