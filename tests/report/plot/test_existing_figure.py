"""The figure of an existing compensation: what is drawn are the values of the files, with one scale for one unit."""

import numpy as np
import pytest
from support.control_cases import MACHINE, crossed, error_table, pitch, spatial

import volid
from volid.compensation.package import Compensation
from volid.controllers.existing.reading import ExistingCompensation
from volid.report.language import Texts


def figure_of(made, language="en"):
    found = ExistingCompensation("volid", MACHINE, made, {"tables/EXX.csv": b""})
    return volid.plot.existing_figure(found, texts=Texts(language))


def test_both_directions_are_drawn_at_the_values_of_the_table():
    x, y = figure_of(pitch()).axes
    up, down = [line for line in x.lines if len(line.get_xdata()) == 3]
    np.testing.assert_allclose(up.get_ydata(), [0.0, 10.0, -4.0])
    np.testing.assert_allclose(down.get_ydata(), [2.0, 13.0, -1.0])
    assert x.get_ylim() == y.get_ylim()
    assert [line.get_label() for line in y.lines if len(line.get_xdata()) == 3] == ["both directions"]


@pytest.mark.parametrize("language", ["en", "de"])
def test_every_table_and_section_has_a_panel(language):
    made = Compensation((), crossed().tables, spatial().grids)
    figure = figure_of(made, language)
    titles = [a.get_title(loc="left") for a in figure.axes if a.get_title(loc="left")]
    assert titles[:3] == ["EXX", "EZX", "EXY"]
    assert len(titles) == 3 + 9  # three translations on three planes
    figure.canvas.draw()
    assert "Ist − Soll" in figure.get_suptitle() if language == "de" else "actual − nominal" in figure.get_suptitle()


def test_a_grid_over_one_axis_is_a_line():
    x, values = np.array([0.0, 1000.0]), np.zeros((2, 6))
    values[1, 1] = 0.010
    grid = volid.Grid("L-STR", ("X",), (x,), x[:, None], values, values, x > 1e4, (0.0, 0.0, 0.0), "machine", "")
    panels = figure_of(Compensation((), (), (grid,))).axes
    np.testing.assert_allclose(panels[1].lines[-1].get_ydata(), [0.0, 10.0])


def test_what_was_assumed_is_said_in_the_language(tmp_path):
    (tmp_path / "x.comp").write_text("0 0 0\n500 500.01 500.013\n")
    figure = volid.plot.existing_figure(volid.load_compensation([tmp_path / "x.comp"]), texts=Texts("de"))
    words = " ".join(t.get_text() for t in figure.texts).replace("\n", " ")
    assert "keine Maschine angegeben" in words and "wie ihr Inhalt sagt" in words and "no machine" not in words


def test_a_constant_is_a_level_line_over_no_axis():
    (panel,) = figure_of(Compensation((), (error_table("EX0S", [0.0], [0.003]),), ())).axes
    np.testing.assert_allclose(panel.lines[-1].get_ydata(), [3.0, 3.0])
    assert panel.get_xlabel() == "a constant" and list(panel.get_xticks()) == []
