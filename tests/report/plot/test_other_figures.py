"""Sections, rotary grids, forecasts, location errors and samples: what is drawn is what the library has, and it can be read."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.figures import faults

import volid
from volid.compensation.base import base_of
from volid.compensation.grids.grid import RotaryGrid
from volid.compensation.residual.forecast import forecast
from volid.report.language import Texts
from volid.report.plot.asked import NothingToDrawError
from volid.report.plot.curves import scale_of
from volid.report.plot.forecast import forecast_figure
from volid.report.plot.locations import location_errors
from volid.report.plot.panels import round_levels
from volid.report.plot.rotary import rotary_grid
from volid.report.plot.sections import MESHES, enlargement, round_down, section, volume_sections

TOOL = (0.0, 0.0, -150.0)


@pytest.fixture(scope="module")
def drawn_sections(solution):
    return volume_sections(solution, TOOL)


def test_moved_grid_is_the_deviation_enlarged(solution, drawn_sections):
    plane = section(solution, ("X", "Z"), TOOL)
    factor = enlargement([section(solution, pair, TOOL) for pair in (("X", "Y"), ("X", "Z"), ("Y", "Z"))])
    panel = drawn_sections.axes[1]
    corner = panel.lines[
        2 * (MESHES + 1)
    ]  # after the commanded grid: first line of the actual one, along Z at the low end of X
    q = solution.machine.order(X=0.0, Y=plane.at["Y"], Z=-500.0)
    e = solution.evaluate(q[None], TOOL).values[0]
    np.testing.assert_allclose([corner.get_xdata()[0], corner.get_ydata()[0]], [factor * e[0], -500.0 + factor * e[2]])
    np.testing.assert_allclose(plane.length[0, 0], np.linalg.norm(e[:3]))


def test_sections_are_at_one_scale_and_say_where_they_cut(drawn_sections):
    panels = drawn_sections.axes[:3]
    assert [p.get_title(loc="left") for p in panels] == [
        "XY plane, Z = −250 mm",
        "XZ plane, Y = 300 mm",
        "YZ plane, X = 500 mm",
    ]
    per_mm = [p.get_window_extent().width / np.ptp(p.get_xlim()) for p in panels]
    per_mm += [p.get_window_extent().height / np.ptp(p.get_ylim()) for p in panels]
    np.testing.assert_allclose(per_mm, per_mm[0], rtol=1e-6)
    assert panels[0].get_xlim() == panels[1].get_xlim() and panels[1].get_ylim() == panels[2].get_ylim()
    assert "tool vector (0, 0, −150) mm" in drawn_sections._supxlabel.get_text().replace("\u00a0", " ")


def test_levels_are_round_and_the_same_in_all_sections(drawn_sections):
    levels = {tuple(a.levels) for p in drawn_sections.axes[:3] for a in p.collections if hasattr(a, "levels")}
    (own,) = levels
    step = own[1] - own[0]
    assert step / 10 ** np.floor(np.log10(step)) in (1.0, 2.0, 2.5, 5.0)


@pytest.mark.parametrize("largest", [0.3, 1.0, 7.7, 51.0, 49.9, 1234.0])
@pytest.mark.parametrize("signed", [True, False])
def test_round_levels_hold_what_they_must(largest, signed):
    levels = round_levels(largest, signed)
    assert levels[-1] >= largest and (levels[0] <= -largest if signed else levels[0] == 0.0)
    assert 4 <= len(levels) <= 16 and 0.0 in levels


def test_enlargement_is_round_and_below():
    assert [round_down(x) for x in (1.0, 1.9, 2.0, 4.99, 5.0, 9.9, 1999.0)] == [1.0, 1.0, 2.0, 2.0, 5.0, 5.0, 1000.0]


def test_cut_and_tool_can_be_chosen(solution):
    low = section(solution, ("X", "Y"), TOOL, {"Z": -500.0})
    q = solution.machine.order(X=1000.0, Y=600.0, Z=-500.0)
    np.testing.assert_allclose(low.deviations[-1, -1], solution.evaluate(q[None], TOOL).values[0, :3])


def made_grid(shape, scale):
    """A grid whose six components have known sizes: 1, 2, 3 times `scale` in µm, and 10, 20, 30 times in µrad."""
    nodes = tuple(np.linspace(0.0, 90.0, n) for n in shape)
    mesh = np.stack([m.ravel(order="F") for m in np.meshgrid(*nodes, indexing="ij")], axis=1)
    wave = np.sin(np.deg2rad(4 * mesh[:, :1]))
    sizes = scale * np.array([1e-3, 2e-3, 3e-3, 10e-6, 20e-6, 30e-6])
    known = np.ones((len(mesh), 6), bool)
    names = ("A", "C")[: len(shape)]
    return RotaryGrid(
        type="R-VOL", axes=names, nodes=nodes, positions=mesh, values=wave * sizes, u=0 * known, outside=~known[:, 0],
        side="table", determined=known, reference_point=(0.0, 0.0, 0.0), period=(0.0,) * len(shape), frame="machine", datum="",
    )  # fmt: skip


@pytest.mark.parametrize("language", ["en", "de"])
def test_six_maps_have_two_scales(language):
    figure = rotary_grid(made_grid((25, 31), 2.0), "Machine", texts=Texts(language))
    maps, bars = figure.axes[:6], figure.axes[6:]
    levels = [tuple(next(a.levels for a in p.collections if hasattr(a, "levels"))) for p in maps]
    assert len(bars) == 2 and len(set(levels[:3])) == 1 and len(set(levels[3:])) == 1
    assert levels[0][-1] >= 6.0 and levels[3][-1] >= 60.0
    assert faults(figure) == []


def test_a_grid_of_one_axis_is_drawn_as_lines():
    figure = rotary_grid(made_grid((25,), 1.0), "Machine")
    translations, rotations = figure.axes
    sizes = [np.ptp(line.get_ydata()) for p in (translations, rotations) for line in p.lines[1:]]
    np.testing.assert_allclose(sizes, [2.0, 4.0, 6.0, 20.0, 40.0, 60.0], rtol=1e-2)
    assert len({line.get_linestyle() for line in translations.lines[1:]}) == 3
    assert faults(figure) == []


@pytest.fixture(scope="module")
def predicted(solution):
    tools = np.array([TOOL, (60.0, 20.0, -200.0)])
    return forecast(solution, [["L-POS"], ["L-VOL"]], base_of(solution, TOOL), tools)


def test_forecast_shows_values_and_intervals_of_lengths_and_orientations(predicted):
    left, right = forecast_figure(predicted, "Machine").axes
    for panel, first, factor, tool in ((left, 0, 1e3, 0), (right, 6, 1e6, 0)):
        line, _, (bars,) = panel.containers[0].lines
        p = [c.predictions[tool] for c in predicted.columns]
        np.testing.assert_allclose(line.get_xdata(), [factor * v.value[first] for v in p])
        ends = np.array([segment[:, 0] for segment in bars.get_segments()])
        np.testing.assert_allclose(ends, [[factor * v.low[first], factor * v.high[first]] for v in p])
    assert len(left.containers) == 4 and len(right.containers) == 4
    assert all(len(c.lines[2]) == 1 for c in right.containers)  # intervals are promised, and there


@pytest.mark.parametrize("language", ["en", "de"])
def test_forecast_can_be_read(predicted, language):
    figure = forecast_figure(predicted, "Machine", texts=Texts(language))
    assert faults(figure) == []
    ticks = [t.get_text() for t in figure.axes[0].get_yticklabels()]
    assert ticks[1:] == ["L-POS", "L-VOL"]


def test_location_errors_are_those_of_the_solution(rotary_solution):
    figure = location_errors(rotary_solution)
    for panel in figure.axes:
        names = [t.get_text().split("\n")[0] for t in panel.get_xticklabels()]
        for name, bar in zip(names, panel.patches, strict=True):
            assert bar.get_height() == pytest.approx(scale_of(name) * rotary_solution.location(name).value)
    assert faults(figure) == []


def test_figures_that_do_not_apply_say_why(solution):
    with pytest.raises(NothingToDrawError, match="no error motion of the model depends on two axes"):
        volid.plot.cross_effects(solution)
    with pytest.raises(NothingToDrawError, match="the model has no location errors of rotary axes"):
        location_errors(solution)
    with pytest.raises(NothingToDrawError, match="fewer than two rotary axes"):
        volid.plot.angle_map(SimpleNamespace(machine=solution.machine))


@pytest.mark.parametrize("name", ["a $\\frac{$ b", "price $5$", "x_{1}^2 & <b>"])
def test_names_from_files_are_texts_not_formulas(predicted, name, tmp_path):
    figure = forecast_figure(predicted, name)
    figure.savefig(tmp_path / "f.svg")
    assert figure._suptitle.get_text().startswith(name)
    assert faults(figure) == []
