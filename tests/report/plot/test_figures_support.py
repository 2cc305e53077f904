"""The check of figures finds what it is to find, and nothing else."""

from io import StringIO

import numpy as np
import pytest
from matplotlib import rc_context
from support.figures import faults

from volid.report.plot.panels import figure_with_panels


def test_a_plain_figure_has_no_faults():
    figure, panel = figure_with_panels(1, 1, figsize=(4, 3))
    panel.plot([0, 1, 2], [0, 1, 4], label="line")
    panel.set_xlabel("x / mm")
    panel.set_title("a title", loc="left", fontsize=9)
    assert faults(figure) == []


@pytest.mark.parametrize("rotation", [0, 60])
def test_labels_that_collide(rotation):
    figure, panel = figure_with_panels(1, 1, figsize=(3, 3))
    panel.set_xticks(np.arange(12), [f"number {i}" for i in range(12)], rotation=rotation, ha="right", fontsize=7)
    lying = [f for f in faults(figure) if "lies on 'number" in f]
    assert bool(lying) == (rotation == 0)  # turned labels pass beside each other, though their upright boxes overlap


def test_a_text_beyond_the_paper():
    figure, panel = figure_with_panels(1, 1, figsize=(3, 3))
    panel.set_axis_off()
    figure.text(0.9, 0.5, "far too long for the paper")
    assert faults(figure) == ["'far too long for the paper' leaves the figure"]


def test_small_type():
    figure, panel = figure_with_panels(1, 1, figsize=(3, 3))
    panel.set_axis_off()
    panel.text(0.5, 0.5, "small print", fontsize=4)
    assert faults(figure) == ["'small print' has 4 points"]


def test_a_legend_on_the_data():
    figure, panel = figure_with_panels(1, 1, figsize=(3, 3))
    panel.plot([0, 1, 2, 3], [0, 1, 2, 3], label="rising")
    panel.set_title("rising", loc="left")
    panel.legend(loc="upper right")
    assert faults(figure) == ["the legend of 'rising' lies on what is drawn"]
    panel.legend(loc="upper left")
    assert faults(figure) == []


def test_names_from_files_are_drawn_as_they_are_written():
    figure, panel = figure_with_panels(1, 1, figsize=(4, 3))
    panel.set_title("a $\\frac{1}{$\u202eb\u200f", parse_math=True)
    panel.set_yticks([0, 1], ["$x^2$", "$ a $"])
    panel.text(0.5, 0.5, "\x1bS1")
    stream = StringIO()
    with rc_context({"svg.fonttype": "none"}):
        figure.savefig(stream, format="svg")
    text = stream.getvalue()
    assert "a $\\frac{1}{$\\u202eb\\u200f" in text and ">$x^2$<" in text and "\\x1bS1" in text
    assert not {"\u202e", "\u200f", "\x1b"} & set(text)
