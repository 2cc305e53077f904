"""The figure of error motions says what the solution says: lines, bands, scales, and what it leaves out."""

import numpy as np
import pytest

from volid.model.iso230 import parse
from volid.report.plot.curves import cross_effect, curve, curves, limits, shown_axes
from volid.report.plot.functions import cross_effects, error_functions


def panel_of(figure, name):
    (panel,) = [p for p in figure.axes if p.get_title(loc="left").startswith(f"{name}:")]
    return panel


def line_of(panel, start):
    (line,) = [x for x in panel.lines if x.get_label().startswith(start)]
    return line


def test_lines_are_the_values_of_the_solution_by_direction_of_approach(rich_solution):
    panel = panel_of(error_functions(rich_solution), "EXX")
    for direction, label in ((1, "approached in +"), (-1, "approached in −")):
        line = line_of(panel, label)
        x = line.get_xdata()
        rows = [r for r in rich_solution.motion("EXX", x) if r.direction == direction]
        np.testing.assert_allclose(line.get_ydata(), [1e3 * r.value for r in rows], rtol=1e-12, atol=1e-12)
    assert {line.get_linestyle() for line in panel.lines if line.get_label().startswith("appr")} == {"-", "--"}


def test_bands_are_two_standard_uncertainties(rich_solution):
    panel = panel_of(error_functions(rich_solution), "ECY")
    (band,) = panel.collections
    points = band.get_paths()[0].vertices
    x = line_of(panel, "no difference").get_xdata()
    rows = rich_solution.motion("ECY", x)
    middle = x[len(x) // 4]
    at = points[np.isclose(points[:, 0], middle), 1]
    row = rows[len(x) // 4]
    np.testing.assert_allclose([at.min(), at.max()], 1e6 * np.array([row.value - 2 * row.u, row.value + 2 * row.u]))


def test_panels_of_one_unit_have_one_scale_unless_asked_otherwise(rich_solution):
    by_unit = {}
    for panel in error_functions(rich_solution).axes:
        name = panel.get_title(loc="left").split(":")[0]
        if name:
            by_unit.setdefault(parse(name).report_unit, set()).add(panel.get_ylim())
    assert {unit: len(ends) for unit, ends in by_unit.items()} == {"µm": 1, "µrad": 1}
    own = {p.get_ylim() for p in error_functions(rich_solution, own_scales=True).axes if p.get_title(loc="left")}
    assert len(own) > 10


def test_scales_hold_every_value_with_u(rich_solution):
    found = curves(rich_solution, shown_axes(rich_solution))
    for c in found.values():
        low, high = limits(found.values())[c.unit]
        for way in c.ways:
            assert low < np.min(way.values - 2 * way.u) and np.max(way.values + 2 * way.u) < high


def test_what_is_not_shown_is_said_once(single_tool_solution, rotary_solution):
    figure = error_functions(single_tool_solution)
    shown = {p.get_title(loc="left").split(":")[0] for p in figure.axes if p.axison}
    unknown = {n for n in single_tool_solution.undetermined if not parse(n).location}
    note = figure._supxlabel.get_text()
    assert "ECZ" not in shown and note.count("ECZ") == 1
    for name in set(curves(single_tool_solution, shown_axes(single_tool_solution))) - shown:
        assert note.count(name) == 1 and name in unknown
    assert "not in the model" not in note


def test_truth_is_drawn_in_the_units_of_the_panel(solution):
    figure = error_functions(solution, {"EAX": lambda x: 1e-6 * x})
    line = line_of(panel_of(figure, "EAX"), "truth")
    np.testing.assert_allclose(line.get_ydata(), line.get_xdata(), rtol=1e-12)


def test_one_legend_for_all_panels(rich_solution):
    figure = error_functions(rich_solution)
    assert len(figure.legends) == 1
    assert not [p for p in figure.axes if p.get_legend()]
    assert len({t.get_text() for t in figure.legends[0].get_texts()}) == len(figure.legends[0].get_texts()) == 4


def test_a_cross_effect_is_a_map_and_its_line_that_at_the_reference(rich_solution):
    x, y, values = cross_effect(rich_solution, "EZZ")
    line = curve(rich_solution, "EZZ", len(x))
    assert (line.beside.letter, line.at) == ("X", 500.0)
    np.testing.assert_allclose(y[len(y) // 2], 500.0)
    np.testing.assert_allclose(values[:, len(y) // 2], line.ways[0].values, atol=1e-9)
    panel, bar = cross_effects(rich_solution).axes
    assert panel.get_xlabel() == "Z / mm" and panel.get_ylabel() == "X / mm" and bar.get_ylabel() == "µm"


@pytest.mark.parametrize("pitch", [5.0, 10.0])
def test_short_waves_get_points_enough(solution, pitch, monkeypatch):
    """A wave of 5 mm over 1000 mm on 201 points would be drawn as a wave that is not there."""
    axis = solution.machine.axis("X")
    monkeypatch.setitem(solution.model.by_name, ("EXX", "waves"), None)
    object.__setattr__(axis, "pitch", pitch)
    try:
        assert len(curve(solution, "EXX").positions) == 12 * 1000 / pitch
    finally:
        object.__setattr__(axis, "pitch", 0.0)
