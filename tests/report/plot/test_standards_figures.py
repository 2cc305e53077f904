"""Figures of evaluations by a standard, and of comparisons, can be read."""

import pytest
from support.figures import faults
from support.places import DATASETS

import volid

EVALUATED = [
    ("positioning_figure", "iso230-2", "iso230_2_synthetic/X.csv", {"axis": "X"}),
    ("positioning_figure", "iso230-2", "iso230_2_synthetic/C_wide.csv", {"axis": "C"}),
    ("polar_plot", "iso230-4", "ball_bar_circles/campaign.toml", {}),
    ("diagonals_figure", "iso230-6", "step_diagonals_800/steps.csv", {}),
    ("nine_figure", "step-diagonal", "step_diagonals_800/steps.csv", {}),
]


@pytest.mark.parametrize(("name", "standard", "file", "options"), EVALUATED)
def test_figures_of_standards_can_be_read(name, standard, file, options):
    figure = getattr(volid.plot, name)(volid.evaluate(standard, DATASETS / file, **options))
    assert faults(figure) == []


@pytest.mark.slow  # a comparison of two solutions, and 25 panels
def test_change_and_no_change_can_be_read(solution):
    figure = volid.plot.changes_figure(volid.compare(solution, solution))
    assert faults(figure) == []
