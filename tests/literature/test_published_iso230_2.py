"""Harja and Candra by ISO 230-2: E from their incremental compensation tables, and their verdicts from their table of figures.

The source compares with ISO 10791-4, whose limits it does not print and which are not at hand: the verdicts are reproduced with
limits stated here, by any limit between the figures that are in and those that are out.
"""

import runpy

import numpy as np
import pytest
from support.places import DATASETS

from volid.io.evaluations.positioning import read_positioning
from volid.standards.positioning.evaluation import evaluate_positioning
from volid.standards.results import Evaluation, Quantity, judged

MAKE = runpy.run_path(str(DATASETS / "published_positioning" / "make.py"))
E = {"X": 31.8, "Z": 33.3}  # µm, as printed
FIGURES = {  # µm, as printed, both directions
    "X": {"E": 31.8, "R": 4.2, "A": 34.2},
    "Y": {"E": 12.9, "R": 3.3, "A": 14.4},
    "Z": {"E": 33.3, "R": 6.3, "A": 35.8},
}
VERDICTS = {"X": {"E": "fail", "A": "fail", "R": "pass"}, "Z": {"E": "fail", "A": "fail", "R": "pass"}}
VERDICTS["Y"] = dict.fromkeys("EAR", "pass")


def table_file(path, axis):
    """The table as printed, as an incremental compensation table in the layout of ISO/TR 16907 Table 1, mm."""
    forward, reverse = ([float(v) / 1000 for v in MAKE["TABLES"][axis][way].split()] for way in (1, -1))
    rows = [f"{25 * i},{a!r},{b!r}" for i, (a, b) in enumerate(zip(forward, reverse, strict=True))]
    head = ["# values: compensation", "# rows: incremental", f"{axis},E{axis}{axis}(+),E{axis}{axis}(-)"]
    path.write_text("\n".join([*head, *rows]) + "\n")
    return path


@pytest.mark.parametrize("axis", E)
def test_e_follows_from_the_incremental_tables(axis, tmp_path):
    """Their running sums, sign reversed, are the mean deviations."""
    [found] = read_positioning(table_file(tmp_path / "table.csv", axis))
    evaluation = evaluate_positioning(found.runs)
    assert 1e3 * evaluation["E"].value == pytest.approx(E[axis], abs=0.05)  # half of the last printed digit
    sums = {way: -np.cumsum([float(v) for v in MAKE["TABLES"][axis][way].split()]) for way in (1, -1)}
    assert 1e3 * evaluation["B"].value == pytest.approx(np.abs(sums[1] - sums[-1]).max(), abs=1e-9)
    assert {q.symbol for q in evaluation.quantities} == {"E", "E_up", "E_down", "M", "B", "B_mean"}
    assert 1e3 * evaluation["B"].value < FIGURES[axis]["R"]  # by R's definition


@pytest.mark.parametrize("axis", E)
def test_the_campaign_of_the_means_gives_the_same(axis):
    found = {f.runs.axis: f for f in read_positioning(DATASETS / "published_positioning" / "campaign.toml")}
    assert 1e3 * evaluate_positioning(found[axis].runs)["E"].value == pytest.approx(E[axis], abs=0.05)


@pytest.mark.parametrize("share", [0.01, 0.5, 0.99])
@pytest.mark.parametrize("axis", FIGURES)
def test_published_verdicts(axis, share):
    """Limits anywhere between the largest figure that is in and the smallest that is out; of R, of which all are in, above."""
    quantities = tuple(Quantity(name, value / 1000, "mm") for name, value in FIGURES[axis].items())
    limits = {name: (FIGURES["Y"][name] + share * (FIGURES["X"][name] - FIGURES["Y"][name])) / 1000 for name in "EA"}
    limits["R"] = (6.3 + 10.0 * share) / 1000
    found = judged(Evaluation("ISO 230-2", axis, quantities), limits)
    assert {q.symbol: q.verdict for q in found.quantities} == VERDICTS[axis]
