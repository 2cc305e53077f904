"""Cases 08, 09, 13: lengths between two places of the machine, and a square with two legs."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from volid.campaign import Campaign, End, ObservationSet
from volid.fitting.fit import fit
from volid.fitting.solution import Solution
from volid.io import load_campaign
from volid.io.machines import parse_machine

CASES = Path(__file__).parent
PRINTER = """format = "volid-machine/1"
name = "printer"
structure = "w Y' b X Z t"
[axis.X]
travel = [0.0, 200.0]
[axis.Y]
travel = [0.0, 200.0]
[axis.Z]
travel = [0.0, 100.0]
[model]
degree = 1
segments = 1
[model.functions]
"*" = false
EXX = true
EYY = true
EC0Y = true
"""


def value_and_u(solution: Solution, name: str) -> tuple[float, float]:
    """A location error with its u [rad]."""
    found = solution.location(name)
    return found.value, found.u


# ------------------------------------------------------------------------------------------------- 13: lengths


def test_piece(issue: str) -> Campaign:
    """The lengths of one issue as a campaign, u = 0.02 mm."""
    machine = parse_machine(PRINTER, "machine.toml")
    with (CASES / "13_length_between_two_machine_points/lengths.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["issue"] == issue]
    still = np.zeros((len(rows), 3))
    ends = []
    for end in "12":
        q = still.copy()
        for letter in "XY":
            q[:, machine.index(letter)] = [float(row[letter + end]) for row in rows]
        ends.append(End(q, still, still))
    lengths = np.array([[float(row["length"])] for row in rows])
    options = {"relative": False, "calibrated_u": 0.0, "scale_u": 0.0}
    labels = {"artefact": np.full(len(rows), "calliper")}
    own = ObservationSet(
        "piece", "length", *ends[0], lengths, np.full_like(lengths, 0.02), labels, options=options, to=ends[1]
    )
    return Campaign(machine, (), (own,))


test_piece.__test__ = False  # type: ignore[attr-defined]


def corners(solution: Solution) -> np.ndarray:
    """Actual corners A, B, D of the piece, (3, 2) [mm]: A = (0, 0), B = (0, 100), D = (100, 0)."""
    machine = solution.campaign.machine
    x, y = machine.index("X"), machine.index("Y")
    q = np.zeros((3, 3))
    q[1, y] = q[2, x] = 100.0
    return q[:, [x, y]] + np.asarray(solution.deviation(q, np.zeros(3)))[:, :2]


@pytest.mark.parametrize(
    ("issue", "side", "angle", "skew"), [("8843", 99.616, 90.203, 3542e-6), ("9897", 99.818, 90.093, 1627e-6)]
)
def test_a_printed_parallelogram_gives_scales_and_skew(issue, side, angle, skew):
    """Cosine law: AB = sqrt((AC² + BD²)/2 - AD²), cos(angle) = (AC² - BD²)/(4 AB AD); figures of the README of the case.

    EC0Y counts along the commanded Y (CONVENTIONS 3), of which the piece has AB/100; the skew factor is tan(angle - 90°).
    """
    campaign = test_piece(issue)
    ac, bd, ad = campaign.sets[0].readings[:, 0]
    ab = np.sqrt((ac**2 + bd**2) / 2.0 - ad**2)
    between = np.arccos((ac**2 - bd**2) / (4.0 * ab * ad))
    assert (round(ab, 3), round(np.degrees(between), 3)) == (side, angle)
    solution = fit(campaign)
    a, b, d = corners(solution)
    assert np.linalg.norm(b - a) == pytest.approx(ab, abs=1e-6)
    assert np.linalg.norm(d - a) == pytest.approx(ad, abs=1e-6)
    cosine = (b - a) @ (d - a) / (ab * ad)
    assert np.arccos(cosine) == pytest.approx(between, abs=1e-8)
    assert np.tan(np.arccos(cosine) - np.pi / 2.0) == pytest.approx(skew, abs=1.5e-6)
    value, u = value_and_u(solution, "EC0Y")
    assert value == pytest.approx(ab * np.sin(between - np.pi / 2.0) / 100.0, abs=1e-8)
    # EC0Y = (BD² - AC²)/(4 AD · 100 mm): u by propagation of 0.02 mm of both diagonals
    expected = 0.02 * np.hypot(ac, bd) / (2.0 * ad * 100.0)
    assert u == pytest.approx(expected, rel=0.01)


# ------------------------------------------------------------------------------------------------ 08, 09: a square


def slopes(campaign: Campaign, line: str | None = None) -> tuple[float, float]:
    """Least-squares slopes of Y along X and of X along Y [rad]."""
    own, found = campaign.sets[0], []
    for component, axis in (("Y", "X"), ("X", "Y")):
        rows = own.labels["component"] == component
        q = own.positions[rows, campaign.machine.index(axis)]
        found.append(float(np.polyfit(q, own.readings[rows, 0], 1)[0]))
    return found[0], found[1]


def test_two_legs_of_one_square_give_the_squareness():
    """A square turned by c adds -c along X and +c along Y: what both slopes have in common is -EC0Y (CONVENTIONS 3)."""
    campaign = load_campaign(CASES / "08_square_two_lines/run1_alignment.toml")
    along_x, along_y = slopes(campaign)
    value, u = value_and_u(fit(campaign), "EC0Y")
    assert value == pytest.approx(-(along_x + along_y), abs=1e-8)
    assert u == pytest.approx(
        172e-6, abs=0.5e-6
    )  # README: 0.01 mm over two readings 110 mm apart, and four over 0 … 110 mm


def turned_over(campaign: Campaign) -> Campaign:
    """The readings of Y along X with the other sign."""
    (own,) = campaign.sets
    sign = np.where(own.labels["component"] == "Y", -1.0, 1.0)[:, None]
    return replace(campaign, sets=(replace(own, readings=sign * own.readings),))


def test_the_published_squareness_of_run_1_counts_the_gauge_the_other_way_along_x():
    """2091 µrad (README) is the difference of both slopes, the squareness where one gauge counts the other way.

    That it did so, the third placement shows (case 09): a square 1.6° off the axes has slopes of opposite sign, and those
    readings have slopes of the same sign.
    """
    campaign = load_campaign(CASES / "08_square_two_lines/run1_alignment.toml")
    value, u = value_and_u(fit(turned_over(campaign)), "EC0Y")
    assert value == pytest.approx(2091e-6, abs=0.5e-6) and u == pytest.approx(172e-6, abs=0.5e-6)
    third = load_campaign(CASES / "09_component_over_1_mm_refused/campaign.toml")
    assert min(slopes(third)) < max(slopes(third)) < -0.02


def test_legs_whose_slopes_are_their_own_say_what_would_determine_the_squareness():
    campaign = load_campaign(CASES / "08_square_two_lines/run1_slope_true.toml")
    solution = fit(campaign)
    assert solution.undetermined == {"EC0Y": 1.0}
    (said,) = solution.statements
    assert "slope = true" in said and "takes the squareness of X, Y away" in said and "[[alignment]]" in said


def test_a_square_1_6_degrees_off_the_axes_gives_the_squareness():
    """Case 09 as one square, the gauge as in run 1: 4091 µrad (0.2344°, README) from least-squares slopes.

    With gauges along Y and X the slopes are exactly -tan(c) along X and tan(c) - EC0Y along Y, however large c is.
    """
    campaign = turned_over(load_campaign(CASES / "09_component_over_1_mm_refused/campaign.toml"))
    (own,) = campaign.sets
    square = load_campaign(CASES / "08_square_two_lines/run1_alignment.toml")
    lines = {"leg_X": {"along": [1, 0, 0], "normal": [0, 1, 0]}, "leg_Y": {"along": [0, 1, 0], "normal": [1, 0, 0]}}
    names = np.where(own.labels["component"] == "Y", "leg_X", "leg_Y")
    options = {"slope": False, "alignment": "square", "lines": lines}
    aligned = replace(own, labels={**own.labels, "line": names}, options=options)
    value, u = value_and_u(fit(replace(campaign, sets=(aligned,), alignments=square.alignments)), "EC0Y")
    assert value == pytest.approx(-sum(slopes(campaign)), abs=1e-8)
    assert value == pytest.approx(4091e-6, abs=1.5e-6) and u < 200e-6
