"""What is determined: counts, words, and the null space verified by moving the exact chain's truth along it."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import COMPONENTS, LINEAR, ExactMachine, Truth, random_truth, tracker_campaign
from support.judging import judge, spline_truth
from support.machines import fixed, volid_machine
from support.trackers import distance_campaign

from volid.exceptions import InputError
from volid.fitting.diagnosis.identifiability import analyse, parameter_units
from volid.fitting.equations.problem import build_problem
from volid.fitting.fit import fit
from volid.fitting.prediction.deviations import is_determined
from volid.fitting.starts import find_starts
from volid.model.error_functions import motion_names
from volid.model.error_model import build_model

TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}
BED_XYZ = ExactMachine("w b X Y Z t", TRAVEL)
TABLE = ExactMachine("w Y' X' b Z t", TRAVEL)
SEGMENTS = 2
NO_TOOL_ROTATION = '[model.functions]\n"E?0S" = false'
ONE = [[0.0, 0.0, -150.0]]
LATERAL = [[80.0, 40.0, -150.0]]
ON_AXIS = [[0.0, 0.0, -150.0], [0.0, 0.0, -250.0], [0.0, 0.0, -330.0]]
THREE = [[0.0, 0.0, -150.0], [80.0, 0.0, -250.0], [0.0, 90.0, -200.0]]


def analysed(tools, stations=6, exact=BED_XYZ, extra=NO_TOOL_ROTATION, segments=SEGMENTS, all_tools=True, q=None):
    """Problem of a noiseless campaign of a perfect machine, its campaign and what is determined."""
    rng = np.random.default_rng(5)
    tracker = tracker_campaign(
        exact, Truth(), rng, tools=tools, n_per_station=90, every_station_sees_every_tool=all_tools
    )
    if q is not None:
        for letter, value in q.items():
            tracker.q[:, exact.column(letter)] = value
    rows = np.isin(tracker.station, [f"S{i + 1}" for i in range(stations)])
    for name in ("q", "tool", "station", "segment", "distance", "u"):
        setattr(tracker, name, getattr(tracker, name)[rows])
    campaign = distance_campaign(volid_machine(exact, fixed(segments, extra)), tracker, off_by=0.0)
    kept = tuple(s for s in campaign.stations if s.name in set(tracker.station))
    campaign = replace(campaign, stations=kept)
    model = build_model(campaign.machine, {n: (segments,) for n in motion_names(campaign.machine)})
    problem = build_problem(campaign, model, find_starts(campaign))
    return problem, campaign, analyse(problem, campaign)


# ---------------------------------------------------------------------------------------------------------- counts


@pytest.mark.parametrize(
    "tools, determined", [(ONE, 53), (LATERAL, 53), (ON_AXIS, 61), (THREE, 69)], ids=["one", "lateral", "axis", "three"]
)
def test_counts_of_determined_coefficients(tools, determined):
    """Counting by hand: 53, 61 and 69 of 72 coefficients of a bed-X-Y-Z-tool machine, tool rotation aside.

    72 = 18 functions of 4 coefficients that are zero at the reference (cubic, 2 segments: 5, minus 1). The datum takes 3
    of them, which are rotations of the frame: 6 slopes of straightness less, 3 squarenesses more, 69. Three tools determine
    these. Tools on the spindle axis miss ECY and ECZ, whose arm is the tool's lateral offset: 61. A single tool misses
    EAZ and EBZ too, which then are translations EYZ and EXZ: 53.
    """
    problem, _, found = analysed(tools)
    assert problem.model.n_parameters == 69
    assert 69 - found.null_space.shape[1] == determined
    assert found.full_rank == (determined == 69)
    assert found.basis.shape[1] == problem.free.shape[1] - (69 - determined)
    assert sum(found.undetermined.values()) == pytest.approx(69 - determined)


def test_more_stations_do_not_help_a_single_tool():
    assert analysed(ONE, stations=4)[2].null_space.shape[1] == analysed(ONE, stations=6)[2].null_space.shape[1] == 16


# ----------------------------------------------------------------------------------------------------------- words


def test_tools_on_the_spindle_axis_are_said_to_miss_rolls():
    _, _, found = analysed(ON_AXIS)
    (statement,) = found.statements
    assert statement.startswith(
        "ECY (all 4 coefficients), ECZ (all 4 coefficients): every tool vector lies on the spindle"
    )
    assert "add one with a lateral offset" in statement and "set ECY = false" in statement
    assert found.undetermined == pytest.approx({"ECY": 4, "ECZ": 4})


def test_single_tool_names_what_it_cannot_separate():
    _, _, found = analysed(LATERAL)
    text = " ".join(found.statements)
    assert "a single tool vector (80, 40, -150) mm was used; use three that do not lie on one line" in text
    assert set(found.undetermined) >= {"EAZ", "EBZ", "ECZ", "ECY"}
    assert not set(found.undetermined) & {"EXX", "EYX", "EZX", "EAX", "EBX", "ECX", "EAY"}


@pytest.mark.parametrize(
    "stations, words", [(1, "distances from one station only"), (2, "distances from two stations only")]
)
def test_one_and_two_stations(stations, words):
    _, _, found = analysed(THREE, stations=stations, exact=TABLE)
    assert found.null_space.shape[1] > 1
    text = " ".join(found.statements)
    assert words in text and "at least three are needed" in text
    for name in found.undetermined:
        assert name in text, "every function concerned is named"


def test_axis_that_stands_still():
    _, _, found = analysed(THREE, q={"X": 500.0})
    text = " ".join(found.statements)
    assert "axis X was measured at 1 position only" in text
    for c in COMPONENTS:
        size = 3 if c in ("EY", "EZ") else 4
        assert found.undetermined[c + "X"] == pytest.approx(size)
        assert f"{c}X (all {size} coefficients)" in text
    assert found.undetermined.keys() <= {c + "X" for c in COMPONENTS} | {"EC0Y", "EA0Z", "EB0Z"}


def beside_the_axis(offset):
    """Tools on the spindle axis as they are measured: a little beside it."""
    return [[0.0, 0.0, -150.0], [offset, 0.0, -250.0], [0.0, offset, -330.0]]


def test_an_offset_that_measures_roll_a_little_is_called_weak():
    """2 mm beside the spindle axis: determined, with a large u, and named."""
    _, _, found = analysed(beside_the_axis(2.0), extra="")
    assert found.undetermined == {} and len(found.weak) == 1
    assert "ECZ" in found.weak[0].names and found.weak[0].reason
    assert analysed(beside_the_axis(50.0), extra="")[2].weak == ()


@pytest.mark.parametrize("offset", [0.005, 0.02])
def test_an_offset_too_small_to_measure_roll_does_not_count(offset):
    """20 µm beside the spindle axis: u(ECZ) would be 0.3 µm / 20 µm = 15 mrad, some 5000 times the u of other rotations.

    The rank decision then meets singular values that are small, not zero; what is well determined stays so: EA0S and EB0S,
    the deviation of tools on the axis, but not of a tool 10 mm beside it.
    """
    problem, _, found = analysed(beside_the_axis(offset), extra="")
    assert found.undetermined == pytest.approx({"ECY": 4, "ECZ": 4}, abs=1e-3)
    (statement,) = found.statements
    assert "every tool vector lies on the spindle axis" in statement
    assert found.tool_rotation.shape == (3, 1)
    np.testing.assert_allclose(np.abs(found.tool_rotation[:, 0]), [0, 0, 1], atol=1e-2)
    q = np.random.default_rng(0).uniform([0, 0, -500], [1000, 600, 0], (20, 3))
    for tool, known in ([0.0, 0.0, -200.0], [1, 1, 1, 1, 1, 0]), ([10.0, 10.0, -200.0], [0, 0, 1, 1, 1, 0]):
        judged = is_determined(
            problem.model,
            found.null_space,
            parameter_units(problem.model),
            q,
            np.tile(tool, (20, 1)),
            np.zeros((20, 3)),
        )
        assert judged.all(axis=0).tolist() == [bool(k) for k in known]


def test_fit_with_tools_a_little_beside_the_axis_is_right_for_them():
    """The tool rotations that are determined are not held with the one that is not: 50 µrad of them would be 9 µm."""
    solution, truth = fitted(beside_the_axis(0.02), every_station_sees_every_tool=True)
    assert solution.held_tool_rotation == ("EC0S",)
    assert not solution.adequacy.rejected
    q = np.random.default_rng(0).uniform([0, 0, -500], [1000, 600, 0], (40, 3))
    assert 0.6 < judge(solution, BED_XYZ, truth, q, np.array(ONE[0]), tool_rotation=False).normalised_rms < 1.5
    for name in ("EA0S", "EB0S"):
        found = solution.location(name)
        assert abs(found.value - truth.constants[name]) < 4 * found.u and found.u < 1e-5


def test_a_lateral_offset_that_is_large_enough():
    assert analysed(beside_the_axis(20.0))[2].full_rank


# ------------------------------------------------------------------------------------------------- null space, checked


def change_of_distances(exact, problem, campaign, theta):
    """RMS change of the distances that no station or dead path can follow, to first order [mm]; by the exact chain."""
    s = campaign.sets[0]
    truth = spline_truth(problem.model, theta)
    shift = exact.functional_point(s.positions, s.tool, truth) - exact.functional_point(s.positions, s.tool)
    at = {
        e.name: x for e, x in zip(problem.nuisance, problem.start[problem.model.layout.n_coefficients :], strict=True)
    }
    station = np.array([[at[f"station {n} {c}"] for c in LINEAR] for n in s.labels["station"]])
    ray = exact.functional_point(s.positions, s.tool) - station
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    columns = []
    for name in dict.fromkeys(s.labels["station"]):
        here = s.labels["station"] == name
        columns += [np.where(here, ray[:, k], 0) for k in range(3)]
        columns += [np.where(here & (s.labels["segment"] == b), 1.0, 0.0) for b in set(s.labels["segment"][here])]
    change, A = np.sum(ray * shift, axis=1), np.column_stack(columns)
    return np.sqrt(np.mean((change - A @ np.linalg.lstsq(A, change, rcond=1e-12)[0]) ** 2))


CASES = {
    "one tool": dict(tools=ONE),
    "tools on the spindle axis": dict(tools=ON_AXIS),
    "one station": dict(tools=THREE, stations=1),
    "two stations": dict(tools=THREE, stations=2, exact=TABLE),
    "X stands still": dict(tools=THREE, q={"X": 500.0}),
    "table machine, lateral tool": dict(tools=LATERAL, exact=TABLE),
    "tool rotation, all tools": dict(tools=ON_AXIS, extra=""),
}


@pytest.mark.parametrize("case", CASES)
def test_null_space_changes_no_distance_and_the_rest_does(case):
    exact = CASES[case].get("exact", BED_XYZ)
    problem, campaign, found = analysed(**CASES[case])
    units = parameter_units(problem.model)
    null, _ = np.linalg.qr(found.null_space / units[:, None])
    rng = np.random.default_rng(0)
    assert null.shape[1] > 0
    size = 0.1  # tenths of 0.1 mm and 0.1 mrad: 10 µm, 10 µrad, second order below 1e-6 mm
    for _ in range(4):
        undetermined = units * (null @ rng.normal(size=null.shape[1]))
        assert change_of_distances(exact, problem, campaign, size * undetermined) < 1e-6
        determined = rng.normal(size=len(units))
        determined -= null @ (null.T @ determined)
        if found.tool_rotation.size:
            places = [f.parameters.start for f in problem.model.functions if f.name.endswith("0S")]
            determined[places] -= found.tool_rotation @ (found.tool_rotation.T @ determined[places])
        assert change_of_distances(exact, problem, campaign, size * units * determined) > 1e-4


# ---------------------------------------------------------------------------------------------------- tool rotation


@pytest.mark.parametrize(
    "tools, all_tools, held",
    [(THREE, False, 3), (THREE, True, 0), (ON_AXIS, True, 1), (ONE, True, 3)],
    ids=["one each", "three each", "on the axis", "one"],
)
def test_constant_tool_rotation(tools, all_tools, held):
    problem, campaign, found = analysed(tools, extra="", all_tools=all_tools)
    assert found.tool_rotation.shape == (3, held)
    if held == 1:
        np.testing.assert_allclose(np.abs(found.tool_rotation[:, 0]), [0, 0, 1], atol=1e-9)
    if tools is THREE:
        assert found.full_rank, "a constant tool rotation that is held at 0 is no defect of the functions"
    for direction in found.tool_rotation.T:
        theta = np.zeros(problem.model.n_parameters)
        theta[[problem.model.by_name[f"E{c}0S", "location"].parameters.start for c in "ABC"]] = 1e-5 * direction
        assert change_of_distances(BED_XYZ, problem, campaign, theta) < 1e-6


def test_tool_vectors_along_any_line_leave_the_rotation_about_it():
    line = np.array([1.0, 2.0, -2.0]) / 3
    tools = [[30.0, 0.0, -100.0] + t * line for t in (0.0, 60.0, 150.0)]
    _, _, found = analysed(tools, extra="")
    assert found.tool_rotation.shape == (3, 1)
    np.testing.assert_allclose(np.abs(found.tool_rotation[:, 0]), np.abs(line), atol=1e-6)


# ---------------------------------------------------------------------------------------------------- whole fits


def fitted(tools, stations=6, extra="", **plan):
    rng = np.random.default_rng(1)
    truth = random_truth(BED_XYZ, rng, waviness=0.3)  # within reach of 4 segments
    tracker = tracker_campaign(BED_XYZ, truth, rng, tools=tools, n_per_station=90, **plan)
    rows = np.isin(tracker.station, [f"S{i + 1}" for i in range(stations)])
    campaign = distance_campaign(volid_machine(BED_XYZ, fixed(4, extra)), tracker)
    s = campaign.sets[0]
    part = s.rows_of(rows)
    kept = tuple(x for x in campaign.stations if x.name in set(part.labels["station"]))
    return fit(replace(campaign, sets=(part,), stations=kept)), truth


def test_fit_goes_on_with_a_single_tool_and_is_right_for_it():
    """The grid for the measured tool is right within its u, other tools are refused, undetermined values are NaN."""
    solution, truth = fitted(ONE, every_station_sees_every_tool=True)
    assert not solution.fully_determined and solution.statements
    assert set(solution.held_tool_rotation) == {"EA0S", "EB0S", "EC0S"}
    q = np.random.default_rng(0).uniform([0, 0, -500], [1000, 600, 0], (40, 3))
    measured, other = solution.evaluate(q, np.array(ONE[0])), solution.evaluate(q, np.array([80.0, 0.0, -250.0]))
    assert measured.determined[:, :3].all() and np.isfinite(measured.u[:, :3]).all()
    assert not other.determined[:, :3].all(axis=1).any() and np.isnan(other.values[~other.determined]).all()
    verdict = judge(solution, BED_XYZ, truth, q, np.array(ONE[0]))
    assert 0.6 < verdict.normalised_rms < 1.5, "one seed: about 20 effective values"
    by_name = {f.name: f for f in solution.functions(points=3)}
    assert np.isnan(by_name["ECZ"].value) and np.isnan(by_name["EA0S"].u) and np.isfinite(by_name["EXX"].value)


def test_fit_with_two_stations_blanks_what_it_cannot_say():
    solution, _ = fitted(THREE, stations=2)
    assert not solution.fully_determined
    found = solution.evaluate(np.array([[100.0, 500.0, -100.0]]), np.array(ONE[0]))
    assert np.isnan(found.values[0, :3]).any()


def test_fewer_readings_than_parameters():
    with pytest.raises(InputError, match=r"90 readings for \d+ parameters .*take more readings"):
        fitted(THREE, stations=1)
