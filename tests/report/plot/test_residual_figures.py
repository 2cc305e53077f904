"""Figures of residuals: they draw what the solution holds, divided where the station changes, the worst named by file and row."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from support.figures import faults

from volid.fitting.diagnosis.robust import critical_value
from volid.fitting.fit import fit
from volid.io import load_campaign
from volid.report.contents.readings import readings_of
from volid.report.language import Texts
from volid.report.plot import collection
from volid.report.plot.asked import Asked
from volid.report.plot.panels import figure_with_panels
from volid.report.plot.residual_distribution import order_band
from volid.report.plot.residual_regions import CELLS, cells_over, moving_pairs
from volid.report.plot.residuals import draw, order_panel, position_panel, residual_plot, strips_panel, weights_over

ENGLISH = Texts()


def lines(panel, gid):
    """Values of all lines of that name, each (n, 2)."""
    return [line.get_xydata() for line in panel.get_lines() if line.get_gid() == gid]


@pytest.mark.parametrize(
    ("name", "language"), [("outlier_solution", "de"), ("rich_solution", "en"), ("rotary_solution", "de")]
)
def test_figures_can_be_read(name, language, request):
    solution = request.getfixturevalue(name)
    for figure in draw(Asked(solution, (0.0, 0.0, -150.0), Texts(language))).values():
        assert faults(figure) == []


def test_figures_without_redundancy_say_so():
    solution = fit(load_campaign("datasets/published_positioning/campaign.toml"))
    figure = residual_plot(solution)
    assert sum("no reading checks another" in t.get_text() for a in figure.axes for t in a.texts) == 2
    assert all(not lines(panel, "readings") for panel in figure.axes)  # none looks like a good one
    assert sum(len(x) for x in lines(figure.axes[0], "idle")) == 70
    assert faults(figure) == []


def test_names_from_files_are_texts_not_formulas(solution):
    (s,) = solution.campaign.sets
    labels = {**s.labels, "station": np.where(s.labels["station"] == "S1", "$\\frac$", s.labels["station"])}
    stations = tuple(replace(x, name="$\\frac$") if x.name == "S1" else x for x in solution.campaign.stations)
    campaign = replace(solution.campaign, sets=(replace(s, labels=labels, source="$\\frac$.csv"),), stations=stations)
    for found in collection.draw(
        Asked(replace(solution, campaign=campaign), (0.0, 0.0, -150.0)), ["residuals", "stations"]
    ):
        assert faults(found.figure) == []


def test_strips_draw_every_reading_at_its_residual(outlier_solution):
    readings, (_, panel) = readings_of(outlier_solution), figure_with_panels()
    strips_panel(panel, readings, ENGLISH)
    drawn = [values[:, 0] for gid in ("readings", "set aside") for values in lines(panel, gid)]
    beyond = sum(len(values) for values in lines(panel, "beyond"))
    inside = np.abs(readings.normalised) <= panel.get_xlim()[1]
    assert sorted(np.concatenate(drawn)) == sorted(readings.normalised[inside])
    assert beyond == (~inside).sum() > 0
    assert [t.get_text() for t in panel.get_yticklabels()] == ["S1", "S2", "S3", "S4", "S5", "S6"]


def test_strips_state_the_rms_of_their_station(rejected_solution):
    _, panel = figure_with_panels()
    strips_panel(panel, readings_of(rejected_solution), ENGLISH)
    tested = {g.what: g.unit_weight for g in rejected_solution.adequacy.groups}
    said = [t.get_text() for t in panel.texts if t.get_text()[0].isdigit() and "." in t.get_text()]
    assert said == [f"{tested[f'station S{i}']:.2f}" for i in range(1, 7)]


def test_a_line_divides_stations(solution):
    readings, (_, panel) = readings_of(solution), figure_with_panels()
    order_panel(panel, readings, ENGLISH)
    (stations,) = [s.labels["station"] for s in solution.campaign.sets]
    changes = np.flatnonzero(stations[1:] != stations[:-1])
    at = sorted(x[0, 0] for x in lines(panel, "change"))
    if readings.time.size and np.isfinite(readings.time).all():
        order = np.argsort(readings.time, kind="stable")
        hours = (readings.time[order] - readings.time.min()) / 3600.0
        changes = np.flatnonzero(stations[order][1:] != stations[order][:-1])
        assert at == pytest.approx(0.5 * (hours[changes] + hours[changes + 1]))
    else:
        assert at == pytest.approx(changes + 1.5)
    assert len(at) == 5


def test_critical_value_is_that_of_the_largest_of_all(rejected_solution):
    readings, (_, panel) = readings_of(rejected_solution), figure_with_panels()
    order_panel(panel, readings, ENGLISH)
    n = rejected_solution.campaign.n_readings
    assert readings.critical == critical_value(n) == pytest.approx(-norm.ppf(0.025 / n))
    assert sorted(y[0, 1] for y in lines(panel, "critical")) == pytest.approx([-readings.critical, readings.critical])


def test_footnote_names_the_worst_by_file_and_row(outlier_solution):
    text = residual_plot(outlier_solution)._supxlabel.get_text()
    worst = max(outlier_solution.readings.outlier_readings, key=lambda r: abs(r.normalised))
    assert f"1: {worst.where} ({worst.label})" in text
    assert "set aside" in text


def test_bars_over_positions_are_rms_over_expected_in_sixths(solution):
    readings, i = readings_of(solution), solution.machine.index("X")
    _, panel = figure_with_panels()
    position_panel(panel, readings, i, ENGLISH)
    tested = [g for g in solution.adequacy.groups if g.what.startswith("X ") and "…" in g.what]
    drawn = {round(float(v[0, 1]), 9) for v in lines(panel, "rms") if v[0, 1] > 0.0}
    low, high = np.ptp(readings.positions[:, i]), solution.campaign.machine.axis("X").length
    assert low == pytest.approx(high)  # measured over the whole travel, so that the library tests the same sixths
    assert drawn == {round(g.unit_weight, 9) for g in tested}
    assert len(weights_over(readings, readings.positions[:, i])) == 6


def test_cells_count_every_reading_once_and_make_up_the_chi_square(rejected_solution):
    readings, adequacy = readings_of(rejected_solution), rejected_solution.adequacy
    assert len(moving_pairs(readings)) == 3
    for pair in moving_pairs(readings):
        cells = cells_over(readings, pair)
        assert cells.n.sum() == readings.used.sum()
        dof = np.zeros((CELLS, CELLS))
        for position, share in zip(readings.positions[readings.used], readings.redundancy[readings.used], strict=True):
            i, j = (int(np.sum(position[a] >= e[1:-1])) for a, e in zip(pair, cells.edges, strict=True))
            dof[i, j] += share
        assert np.all(dof > 1.0)
        assert np.sum(cells.weight**2 * dof) == pytest.approx(
            adequacy.reading_weight**2 * adequacy.redundancy, rel=1e-9
        )


def test_a_region_that_is_wrong_is_framed_and_no_other(solution):
    readings = readings_of(solution)
    pair = moving_pairs(readings)[0]
    assert not cells_over(readings, pair, tests=48).flagged.any()
    cells = cells_over(readings, pair)
    low, high = (e[1] for e in cells.edges)
    corner = (readings.positions[:, pair[0]] < low) & (readings.positions[:, pair[1]] < high)
    readings.normalised[corner] *= 4.0
    flagged = cells_over(readings, pair, tests=48).flagged
    assert flagged[0, 0] and flagged.sum() == 1


def test_band_holds_so_many_of_good_readings():
    n, trials = 200, 400
    _, low, high = order_band(n)
    drawn = np.sort(np.random.default_rng(3).standard_normal((trials, n)), axis=1)
    inside = ((drawn > low) & (drawn < high)).mean(axis=0)
    assert inside.mean() == pytest.approx(0.95, abs=0.01)
    assert inside.min() > 0.90  # each by itself: 400 trials leave 0.011
