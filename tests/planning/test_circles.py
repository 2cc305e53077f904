"""Ball-bar circles and a step gauge: where the positions lie, what they determine, and recovery of what they show."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth
from exact_chain.ranks import differences, offsets, rank, sensitivities, without
from support.machines import exact_of, volid_machine
from support.places import MODELS

from volid.exceptions import InputError
from volid.fitting.diagnosis.identifiability import analyse
from volid.fitting.equations.problem import build_problem
from volid.fitting.fit import fit
from volid.fitting.starts import find_starts
from volid.io import read_machine
from volid.model.error_functions import motion_names
from volid.model.error_model import build_model
from volid.planning import circles, step_gauge

TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}
BED_XYZ = ExactMachine("w b X Y Z t", TRAVEL)
BOX = ExactMachine("w b X Y Z t", {"X": (350.0, 650.0), "Y": (150.0, 450.0), "Z": (-400.0, -100.0)})
SEVEN_LINES = 29  # of 72, three lines along axes and four body diagonals, of calibrated length
QUARTIC = '[model]\ndegree = 4\nsegments = 1\n[model.functions]\n"E?0S" = false'


def with_readings(plan, readings):
    """The plan with readings of every set, without noise."""
    sets = tuple(replace(s, readings=np.asarray(r)[:, None]) for s, r in zip(plan.sets, readings, strict=True))
    return replace(plan, sets=sets)


def determined(campaign):
    """Number of combinations that the package finds determined, of 69 (72 less the three that the datum takes)."""
    model = build_model(campaign.machine, {n: (1,) for n in motion_names(campaign.machine)})
    assert model.n_parameters == 69
    problem = build_problem(campaign, model, find_starts(campaign))
    return 69 - analyse(problem, campaign).null_space.shape[1]


def bar_lengths(exact, plan, truth, centre):
    """What the bar reads in every set: the distance of the functional point from the socket."""
    points = [exact.functional_point(s.positions, s.tool, truth, s.directions) for s in plan.sets]
    return [np.linalg.norm(p - centre, axis=1) for p in points]


@pytest.mark.parametrize("unknown, expected", [(False, 27), (True, 26)])
@pytest.mark.parametrize("arc", [220.0, 360.0])
def test_what_three_circles_determine_is_what_a_count_apart_gives(unknown, expected, arc):
    """Of 72: circles of 150 mm in three planes about one socket, 73 positions each way, limit of the count 1e-7."""
    machine = volid_machine(BOX, QUARTIC)
    plan = circles(machine, arc=arc, length=149.9, n=73, calibrated_u=np.inf if unknown else 0.0)
    centre = np.array(plan.stations[0].position)

    def lengths(truth=None, moved=0.0):
        return np.concatenate(bar_lengths(BOX, plan, truth or Truth(), centre + moved))

    nuisance = differences(lambda p: lengths(moved=p), np.zeros(3), np.full(3, 1e-3))
    if unknown:
        nuisance = np.hstack([nuisance, offsets(np.zeros(len(nuisance)))])
    found, gap = rank(without(nuisance, sensitivities(BOX, lengths)))
    assert gap > 1e4, "the count is clear"
    assert found == expected == determined(with_readings(plan, bar_lengths(BOX, plan, Truth(), centre)))


def test_what_seven_lines_of_a_step_gauge_determine_is_what_a_count_apart_gives():
    machine = volid_machine(BED_XYZ, QUARTIC)
    plan = step_gauge(machine, n=5, calibrated_u=0.0, scale_u=0.0)
    (s,) = plan.sets

    def lengths(truth):
        ends = [BED_XYZ.functional_point(e.positions, e.tool, truth) for e in s.ends]
        return np.linalg.norm(ends[1] - ends[0], axis=1)

    found, gap = rank(sensitivities(BED_XYZ, lengths))
    assert gap > 1e3, "the count is clear"
    assert found == SEVEN_LINES == determined(with_readings(plan, [lengths(Truth())]))


# ------------------------------------------------------------------------------------------------- squareness, reversal

SHOWN = """[model]
segments = 1
[model.functions]
"E??" = false
EXX = { segments = 1, reversal = "constant" }
EYY = { segments = 1, reversal = "constant" }
EZZ = { segments = 1, reversal = "constant" }
"E?0S" = false
"""


@pytest.mark.parametrize("unknown", [False, True])
@pytest.mark.parametrize("structure", ["w b X Y Z t", "w Y' X' b Z t"])
def test_squareness_scale_and_reversal_are_recovered_within_u(structure, unknown):
    """Constant reversal and scale of three axes, three squarenesses, socket and bar unknown; noise of 0.3 µm, drawn once."""
    exact = ExactMachine(structure, TRAVEL)
    squareness = {"EC0Y": 20e-6, "EA0Z": -15e-6, "EB0Z": 12e-6}
    scale = {"EXX": 30e-6, "EYY": -20e-6, "EZZ": 10e-6}  # mm/mm
    back = {"EXX": 4e-3, "EYY": -2.5e-3, "EZZ": 1.5e-3}
    middle = exact.reference
    truth = Truth(
        {n: (lambda q, n=n: scale[n] * (np.asarray(q) - middle[n[2]])) for n in scale},
        squareness,
        {n: (lambda q, n=n: back[n] + 0.0 * np.asarray(q)) for n in back},
    )
    machine = volid_machine(exact, SHOWN)
    plan = circles(machine, length=150.0, u=3e-4, calibrated_u=np.inf if unknown else 2e-4)
    socket = np.array(plan.stations[0].position) + np.array([0.05, -0.08, 0.03])
    rng, bar = np.random.default_rng(11), 0.4 if unknown else 1.5e-4
    readings = [r + bar + rng.normal(size=len(r)) * 3e-4 for r in bar_lengths(exact, plan, truth, socket)]
    solution = fit(with_readings(plan, readings))
    assert not solution.adequacy.rejected, solution.adequacy.verdict
    for name, value in squareness.items():
        row = solution.location(name)
        assert abs(row.value - value) < 3.0 * row.u < 3.0 * 4e-6, name
    if unknown:  # nothing tells a scale that the axes share from the length of the bar
        assert solution.statements and any(n in " ".join(solution.statements) for n in scale)
        return
    for row in solution.functions():
        if row.name in scale and abs(row.position - middle[row.name[2]]) < 100.0:
            expected = scale[row.name] * (row.position - middle[row.name[2]]) + 0.5 * row.direction * back[row.name]
            assert abs(row.value - expected) < 4.0 * row.u < 4.0 * 2e-3, row


# ----------------------------------------------------------------------------------------------------- where they lie


@pytest.mark.parametrize("file", sorted(MODELS.glob("*.toml")), ids=lambda f: f.stem)
def test_the_ball_keeps_its_distance_on_every_machine(file):
    machine = read_machine(file)
    exact = exact_of(machine)
    plan = circles(machine, length=20.0, n=19)
    socket = np.array(plan.stations[0].position)
    for s in plan.sets:
        points = exact.functional_point(s.positions, s.tool)
        np.testing.assert_allclose(np.linalg.norm(points - socket, axis=1), 20.0, rtol=0, atol=3e-6)
        moved = s.directions != 0.0
        assert moved.all(axis=0).sum() == 2, "both axes of the plane have a direction at every position"
        inside = (s.labels["segment"][1:] == s.labels["segment"][:-1])[:, None]
        steps = np.diff(s.positions, axis=0)
        clear = (np.abs(steps) > 1e-3) & inside
        assert np.array_equal(np.sign(steps)[clear], s.directions[1:][clear])


def test_both_senses_approach_a_position_from_both_sides():
    (s,) = circles(volid_machine(BED_XYZ, QUARTIC), ("XY",), n=37).sets
    there, back = s.directions[:37, :2], s.directions[37:, :2][::-1]
    inner = slice(2, -2)
    turning = (np.abs(s.positions[:37, :2] - s.positions[:37, :2].mean(axis=0)) > 149.0).any(axis=1)[inner]
    assert np.array_equal(there[inner][~turning], -back[inner][~turning])


@pytest.mark.parametrize(
    "change, said",
    [
        ({"planes": ("XQ",)}, "`planes=XQ`: expected different pairs of the linear axes"),
        ({"planes": ("XY", "XY")}, "`planes=XY,XY`: expected different pairs"),
        ({"length": 0.15}, "a ball bar of 0.15 mm"),
        ({"arc": 400.0}, "`arc=400`: expected an angle up to 360 degrees"),
        ({"n": 2}, "`n=2`: expected a whole number from 3"),
        ({"centre": (0.0, 0.0, np.nan)}, "expected three finite numbers"),
        ({"centre": (-900.0, 0.0, 0.0)}, "no position lies within the travels"),
    ],
)
def test_wrong_circles_are_named(change, said):
    with pytest.raises(InputError, match=said):
        circles(volid_machine(BED_XYZ, QUARTIC), **change)


def test_a_gauge_that_is_longer_than_a_line_is_named():
    machine = volid_machine(BED_XYZ, QUARTIC)
    with pytest.raises(InputError, match=r"`length=600`: line Z is 500 mm long; expected a length > 0 up to that"):
        step_gauge(machine, length=600.0)
    assert len(step_gauge(machine, length=480.0).sets[0]) == 35
