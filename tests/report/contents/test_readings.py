"""Readings one after another: each is the one of its file and row, and their RMS is the library's own test of a group."""

import numpy as np
import pytest
from support.small_campaign import SOLUTIONS

from volid.report.contents.readings import MOST_STRIPS, WORST, readings_of


@pytest.mark.parametrize("name", SOLUTIONS)
def test_residuals_and_redundancy_are_those_of_the_solution(name, request):
    solution = request.getfixturevalue(name)
    readings = readings_of(solution)
    for i, (s, normalised) in enumerate(zip(solution.campaign.sets, solution.readings.normalised, strict=True)):
        own = readings.set_number == i
        at = readings.row[own], readings.column[own]
        assert np.array_equal(readings.normalised[own], normalised[at])
        whitened = solution.readings.residuals[i][at] / s.u[at]
        assert readings.normalised[own] * np.sqrt(readings.redundancy[own]) == pytest.approx(
            np.sign(normalised[at]) * abs(whitened)
        )
    dof = solution.adequacy.redundancy
    assert readings.redundancy[~readings.outlier].sum() == pytest.approx(dof, rel=1e-6)


@pytest.mark.parametrize("name", ["solution", "rejected_solution", "outlier_solution"])
def test_rms_over_expected_is_the_unit_weight_of_the_station(name, request):
    solution = request.getfixturevalue(name)
    readings = readings_of(solution)
    tested = {g.what: g for g in solution.adequacy.groups}
    assert len(readings.strips) == 6
    for strip in readings.strips:
        assert readings.unit_weight(strip.numbers) == pytest.approx(
            tested[f"station {strip.name}"].unit_weight, rel=1e-9
        )


def test_strips_divide_all_readings_and_are_of_one_station(rich_solution):
    readings = readings_of(rich_solution)
    together = np.concatenate([s.numbers for s in readings.strips])
    assert sorted(together.tolist()) == list(range(len(readings.row)))
    assert [s.name for s in readings.strips][-1].startswith("levels")
    assert len(readings.strips) <= MOST_STRIPS
    (volume, _) = rich_solution.campaign.sets
    for strip in readings.strips[:-1]:
        (station,) = set(volume.labels["station"][readings.row[strip.numbers]])
        assert strip.name == f"{volume.name}, {station}"


def test_worst_are_named_by_file_and_row_as_the_fit_names_them(outlier_solution):
    readings = readings_of(outlier_solution)
    named = (*outlier_solution.readings.outlier_readings, *outlier_solution.adequacy.suspects)
    expected = sorted(named, key=lambda r: -abs(r.normalised))[:WORST]
    assert [readings.where(n) for n in readings.worst] == [r.where for r in expected]
    assert readings.normalised[readings.worst] == pytest.approx([r.normalised for r in expected])
    assert [readings.label(n) for n in readings.worst] == [r.label for r in expected]
    assert outlier_solution.readings.outlier_readings


def test_worst_are_the_gross_errors_that_were_put_in(outlier_solution, solution):
    assert all(readings_of(outlier_solution).outlier[readings_of(outlier_solution).worst])
    assert len(readings_of(solution).worst) == len(solution.adequacy.suspects[:WORST])
