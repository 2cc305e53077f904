"""Measuring geometry, U over the volume, and correlations: what is drawn is the solution's, to one scale, and says where."""

import numpy as np
import pytest
from support.figures import faults, renderer_of

from volid.report.contents.correlations import correlations_of
from volid.report.contents.geometry import geometry_of
from volid.report.language import Texts
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.collection import draw
from volid.report.plot.correlation import correlation_matrix
from volid.report.plot.stations import station_geometry
from volid.report.plot.uncertainty_map import cut_positions, sections_of, uncertainty_sections

TOOL = (0.0, 0.0, -150.0)
NAMES = ("stations", "uncertainty", "correlation")


@pytest.mark.parametrize(
    ("name", "language"), [("solution", "de"), ("rotary_solution", "en"), ("single_tool_solution", "de")]
)
def test_figures_can_be_read(name, language, request):
    solution = request.getfixturevalue(name)
    for found in draw(Asked(solution, solution.most_used_tool(), Texts(language)), NAMES):
        assert found.figure is not None, found.reason
        assert faults(found.figure) == []


def test_three_views_have_one_scale_and_fit_to_each_other(solution):
    figure = station_geometry(solution)
    figure.draw(renderer_of(figure))
    front, side, top = figure.axes[:3]
    scales = []
    for panel in (front, side, top):
        box = panel.get_window_extent()
        (left, right), (low, high) = panel.get_xlim(), panel.get_ylim()
        scales += [box.width / (right - left), box.height / (high - low)]
    assert scales == pytest.approx([scales[0]] * 6, rel=0.02)
    assert (
        front.get_xlim() == top.get_xlim() and front.get_ylim() == side.get_ylim() and side.get_xlim() == top.get_ylim()
    )


def test_stations_are_drawn_where_the_fit_found_them_and_named(solution):
    front, side, top = station_geometry(solution).axes[:3]
    geometry = geometry_of(solution)
    for panel, pair in ((front, (0, 2)), (side, (1, 2)), (top, (0, 1))):
        (stands,) = [line.get_xydata() for line in panel.get_lines() if line.get_gid() == "stands"]
        assert stands == pytest.approx(np.array([s.place for s in geometry.stations])[:, pair])
        named = ", ".join(t.get_text() for t in panel.texts).split(", ")
        assert sorted(named) == ["S1", "S2", "S3", "S4", "S5", "S6"]


def test_u_of_sections_is_twice_the_norm_of_the_standard_uncertainties(solution):
    section = sections_of(solution, TOOL)[0]
    for i, j in ((0, 0), (5, 17), (20, 3)):
        q = solution.machine.order(X=section.across[i], Y=section.up[j], Z=-250.0)
        u = solution.evaluate(q[None], TOOL).u[0, :3]
        assert section.expanded[i, j] == pytest.approx(2.0 * np.sqrt(np.sum(u**2)))
    assert section.cut == {"Z": -250.0}


def test_sections_have_one_scale_and_state_cut_and_tool(solution):
    figure = uncertainty_sections(solution, TOOL)
    titles = [panel.get_title(loc="left") for panel in figure.axes[:3]]
    assert titles == ["Z = −250 mm", "Y = 300 mm", "X = 500 mm"]
    assert "(0, 0, −150) mm" in figure._suptitle.get_text().replace("\N{NO-BREAK SPACE}", " ")
    limits = {panel.collections[0].get_clim() for panel in figure.axes[:3]}
    assert len(limits) == 1


def test_what_is_not_determined_is_hatched_not_coloured(single_tool_solution):
    """With another tool vector than the one that was measured U is known at the reference alone, where all is 0."""
    with pytest.raises(NothingToDrawError, match="not determined for this tool vector"):
        sections_of(single_tool_solution, (0.0, 300.0, -150.0))


def test_rotary_axes_stand_at_zero(rotary_solution):
    assert cut_positions(rotary_solution.machine, ("X", "Y")) == {"Z": -250.0, "C": 0.0}


def test_matrix_is_drawn_as_it_is(solution):
    found, figure = correlations_of(solution), correlation_matrix(solution)
    drawn = np.ma.filled(figure.axes[0].collections[0].get_array(), np.nan)
    assert np.array_equal(drawn.reshape(found.matrix.shape), found.matrix, equal_nan=True)
    assert figure.axes[0].collections[0].get_clim() == (-1.0, 1.0)
