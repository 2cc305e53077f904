"""The page's section of residuals: its numbers are the library's, its figures stay small, names from files are escaped."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from volid.fitting.fit import fit
from volid.io import load_campaign
from volid.report.contents.contents import Contents
from volid.report.contents.readings import readings_of
from volid.report.language import LANGUAGES, Texts
from volid.report.page.sections.residuals import build, panels_of
from volid.report.plot.residuals import remarks
from volid.report.text.summary import summary_data

DATA = re.compile(r'<data value="([^"]+)"(?: data-unit="[^"]+")? data-key="([^"]+)">')


def contents_of(solution):
    """What the section asks of the contents of a report."""
    summary = summary_data(solution)
    return Contents(solution, summary, tuple(summary["tool"]))


def numbers(body):
    """Every number of the section by its key."""
    return {key: float(value) for value, key in DATA.findall(body)}


@pytest.fixture(scope="module")
def contents(outlier_solution):
    return contents_of(outlier_solution)


@pytest.fixture(scope="module")
def body(contents):
    return str(build(contents, Texts()).body)


def test_numbers_of_the_summary_are_found_again(body, contents):
    found = 0
    for key, value in numbers(body).items():
        head, *rest = key.split(".")
        if head in contents.summary:
            expected = contents.summary[head]
            for part in rest:
                expected = expected[int(part)] if part.isdigit() else expected[part]
            assert value == expected
            found += 1
    assert found > 2 * min(len(contents.summary["outliers"]), 10)


def test_numbers_of_stations_and_groups_are_those_of_the_adequacy(body, contents):
    found, adequacy = numbers(body), contents.solution.adequacy
    groups = {g.what: g for g in adequacy.groups}
    for i, strip in enumerate(readings_of(contents.solution).strips):
        assert found[f"residuals.strips.{i}.rms"] == pytest.approx(
            groups[f"station {strip.name}"].unit_weight, rel=1e-9
        )
        assert found[f"residuals.strips.{i}.n"] == groups[f"station {strip.name}"].n
    for i, group in enumerate(adequacy.groups[:10]):
        assert found[f"residuals.groups.{i}.unit_weight"] == group.unit_weight
        assert found[f"residuals.groups.{i}.probability"] == group.probability


def test_outliers_are_listed_by_file_and_row_the_largest_first(body, contents):
    named = sorted(contents.solution.readings.outlier_readings, key=lambda r: -abs(r.normalised))
    at = [body.index(f"{r.where}</bdi>") for r in named[:10]]
    assert at == sorted(at)
    rows = re.findall(r'class="n">(\d+)</td><th scope="row"><bdi>([^<]+)</bdi>', body)
    readings = readings_of(contents.solution)
    assert rows == [(str(k), readings.where(n)) for k, n in enumerate(readings.worst, 1)]  # numbered as in the figures


@pytest.mark.parametrize("language", LANGUAGES)
def test_section_without_redundancy_says_that_zeros_are_no_good_sign(language):
    solution = fit(load_campaign("datasets/published_positioning/campaign.toml"))
    body = str(build(contents_of(solution), Texts(language)).body)
    assert str(Texts(language)("residuals.untestable")) in body
    assert body.count("<svg") == 2  # no distribution, no map of nothing


def test_held_out_table_is_there_for_rotary_axes(rotary_solution):
    contents = contents_of(rotary_solution)
    found = numbers(str(build(contents, Texts("de")).body))
    for i, row in enumerate(contents.summary["held_out"]):
        assert found[f"held_out.{i}.held_out"] == row["held_out"]
    assert contents.summary["held_out"]


def test_names_from_files_are_escaped(solution):
    (readings,) = solution.campaign.sets
    station = readings.labels["station"]
    labels = {**readings.labels, "station": np.where(station == "S1", "<script>alert(1)</script> $\\frac$", station)}
    campaign = replace(solution.campaign, sets=(replace(readings, labels=labels),))
    body = str(build(replace(contents_of(solution), solution=replace(solution, campaign=campaign)), Texts()).body)
    assert "<script" not in body
    assert "&lt;script&gt;alert(1)&lt;/script&gt; $\\frac$" in body


def test_a_hundred_thousand_readings_make_a_small_page(solution):
    readings, times = readings_of(solution), 300
    n = times * len(readings.row)
    assert n > 100_000
    rng = np.random.default_rng(4)
    many = replace(
        readings,
        **{
            name: np.tile(getattr(readings, name), times)
            for name in ("set_number", "row", "column", "redundancy", "outlier", "time")
        },
        normalised=rng.standard_normal(n),
        positions=np.tile(readings.positions, (times, 1)),
    )
    assert sum(len(panel) for panel in panels_of(many, Texts())) < 1_500_000


def test_a_sample_of_the_readings_and_an_estimated_u_are_told(solution):
    readings = replace(readings_of(solution), all_readings=4_000_000, estimated=("tracker",))
    told = " ".join(remarks(readings, Texts("de")))
    assert f"{len(readings.row)} der 4000000 Messwerte" in told
    assert "Die u von tracker wurde aus eben diesen Restabweichungen geschätzt" in told
    assert remarks(readings_of(solution), Texts("de")) == []


def test_no_number_is_infinite(body):
    assert all(math.isfinite(value) for value in numbers(body).values())
