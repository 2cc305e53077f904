"""The page's section of the budget: squares of a row add up to U², and nothing is said behind a barrier or without a refit."""

import math
import re
from dataclasses import replace

import pytest

from volid.report.contents.contents import Contents
from volid.report.contents.correlations import LISTED, correlations_of
from volid.report.language import Texts
from volid.report.page.sections.budget import build
from volid.report.text.summary import summary_data

DATA = re.compile(r'<data value="([^"]+)"(?: data-unit="[^"]+")? data-key="budget\.([^"]+)\.(U|\d+)">')


def contents_of(solution):
    """What the section asks of the contents of a report."""
    summary = summary_data(solution)
    return Contents(solution, summary, tuple(summary["tool"]))


@pytest.fixture(scope="module")
def contents(solution):
    return contents_of(solution)


def test_rows_add_up_to_u(rich_solution):
    body = str(build(contents_of(rich_solution), Texts("de")).body)
    rows = {}
    for value, output, part in DATA.findall(body):
        rows.setdefault(output, {})[part] = float(value)
    assert len(rows) > 20
    for row in rows.values():
        assert math.hypot(*(v for part, v in row.items() if part != "U")) == pytest.approx(row["U"], rel=1e-9)
    assert rows["EC0Y"]["U"] == pytest.approx(2.0 * rich_solution.location("EC0Y").u, rel=1e-6)
    assert body.count("<svg") == 3 + 3  # contributions in three panels, U on three sections


def test_nothing_is_said_behind_a_barrier(contents):
    barred = replace(contents, summary={**contents.summary, "barrier": "readings follow a mistake"})
    assert build(barred, Texts()) is None


def test_a_solution_that_cannot_be_refitted_says_so(contents, solution):
    further = solution.extrapolated({"X": (-10.0, 1010.0)})
    body = str(build(replace(contents, solution=further), Texts("de")).body)
    assert 'lang="en"' in body and "<table" not in body


def test_strong_correlations_are_told_with_both_names(contents):
    pairs = correlations_of(contents.solution).strong()
    body = str(build(contents, Texts()).body)
    assert [pair.parameters for pair in pairs[:LISTED]] == re.findall(
        r"<li><bdi>([^<]+)</bdi>, <bdi>([^<]+)</bdi>: ρ", body
    )
