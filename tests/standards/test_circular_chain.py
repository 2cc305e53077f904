"""Circular tests of the exact machine with all its errors: against projections apart from the package, and against a fit."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth, random_truth
from exact_chain.ball_bar import BallBar, Drives, turn
from scipy.stats import chi2
from support.circles import TRAVEL, bar, bar_test
from support.machines import volid_machine

from volid.campaign import Environment, Expansion
from volid.exceptions import InputError
from volid.fitting.fit import fit
from volid.planning import circles
from volid.standards.circular.evaluation import evaluate_circular
from volid.standards.circular.sets import circular_tests

DRIVES = Drives(
    lag={"X": 0.008, "Y": 0.0082, "Z": 0.0079}, spike={"X": (0.02, 0.012), "Y": (-0.006, 0.02), "Z": (0.02, -0.02)}
)


def whole(seed: int) -> BallBar:
    """All 21 errors, reversal of positioning that depends on the position, a socket that is off, a bar that is longer."""
    rng = np.random.default_rng(seed)
    machine = ExactMachine("w Y' X' b Z (C) t", TRAVEL)
    virtual = bar(random_truth(machine, rng, reversal=True), machine.structure)
    return replace(virtual, off=tuple(rng.uniform(-0.03, 0.03, 3)), length=4e-4)


def truth_of(virtual: BallBar, plane: str, drives: Drives) -> dict[str, float]:
    a, b = plane
    squareness, scale = virtual.harmonics(plane)
    return {
        f"squareness_{plane}": squareness,
        f"scale_{plane}": scale,
        f"B_E{a}{a}": virtual.reversal(a),
        f"B_E{b}{b}": virtual.reversal(b),
        f"lag_{plane}": drives.feed / 120.0 * (drives.lag[a] - drives.lag[b]),
    }


def reversal_over_the_circle(virtual: BallBar, axis: str) -> tuple[float, float]:
    middle = np.subtract(virtual.socket, virtual.tool)["XYZ".index(axis)]
    values = virtual.truth.reversal[f"E{axis}{axis}"](middle + np.linspace(-virtual.radius, virtual.radius, 301))
    return float(values.min()), float(values.max())


@pytest.mark.parametrize("plane", ["XY", "YZ", "ZX"])
def test_all_errors_at_once_give_the_harmonics_of_the_path(plane):
    """Without noise, the drives' lag and spikes with it: what is not predicted is of second order, 0.1 µm and 1 µm/m."""
    for seed in range(3):
        virtual = whole(seed)
        found = evaluate_circular(bar_test(virtual, plane, drives=DRIVES, step=2.5))
        for symbol, true in truth_of(virtual, plane, DRIVES).items():
            allowed = 1e-6 if symbol[:2] in ("sq", "sc") else 1e-4
            if symbol.startswith("B_"):  # it depends on the position, and what is found is some mean of it
                low, high = reversal_over_the_circle(virtual, symbol[-1])
                assert low - allowed < found[symbol].value < high + allowed, symbol
                continue
            assert found[symbol].value == pytest.approx(true, abs=allowed), symbol
        shown = [q for q in found.quantities if q.symbol.startswith("spike")]
        assert len(shown) == 8
        for spike in shown:
            quadrant = int(spike.symbol.split("_")[2])
            letter = plane[quadrant // 90 % 2]
            height = DRIVES.spike[letter][quadrant // 180]
            assert spike.value == pytest.approx(height, abs=4e-4)  # a reversal that depends on the position is left


def test_u_holds_on_full_circles():
    """χ² of 24 machines with 0.3 µm of noise, five terms each: within its 99.9 % interval."""
    for plane in ("XY", "YZ"):
        z = []
        for seed in range(12):
            virtual = whole(seed)
            found = evaluate_circular(bar_test(virtual, plane, drives=DRIVES, noise=3e-4, seed=seed))
            z += [(found[s].value - v) / (found[s].U / 2.0) for s, v in truth_of(virtual, plane, DRIVES).items()]
        low, high = chi2.ppf([5e-4, 1.0 - 5e-4], len(z)) / len(z)
        # below: reversal and lag share what noise does to them, so that fewer than all are free
        assert 0.5 * low < np.mean(np.square(z)) < high, plane


def test_an_arc_says_that_it_knows_less():
    """The same path over 220°: u of squareness and scale many times that of the full circle, and the truth within 4 u."""
    for seed in range(4):
        virtual = whole(seed)
        full, arc = (
            evaluate_circular(bar_test(virtual, "YZ", a, drives=DRIVES, noise=3e-4, step=2.5)) for a in (360.0, 220.0)
        )
        for symbol, true in truth_of(virtual, "YZ", DRIVES).items():
            assert abs(arc[symbol].value - true) < 4.0 * arc[symbol].U / 2.0, symbol
        for symbol in ("squareness_YZ", "scale_YZ"):
            assert arc[symbol].U > 3.0 * full[symbol].U
        assert "D_YZ" not in [q.symbol for q in arc.quantities]


def plan_with_readings(exact: ExactMachine, truth: Truth, model: str, noise: float):
    """volid's own plan in the plane XY, read by the exact chain."""
    plan = circles(volid_machine(exact, model), ("XY",), length=150.0, n=73, u=noise)
    socket = np.array(plan.stations[0].position)
    rng = np.random.default_rng(8)
    sets = []
    for s in plan.sets:
        point = exact.functional_point(s.positions, s.tool, truth, s.directions)
        length = np.linalg.norm(point - socket - [0.02, -0.01, 0.0], axis=1)
        sets.append(replace(s, readings=(length + noise * rng.standard_normal(len(s)))[:, None]))
    return replace(plan, sets=tuple(sets))


def test_squareness_and_reversal_are_those_of_a_fit_of_the_same_readings():
    """A model that has scale, squareness and reversal alone, which one circle determines: both within a half u of each other."""
    exact = ExactMachine("w b X Y Z t", TRAVEL)
    truth = Truth(
        {"EXX": lambda x: 2e-5 * (x - 500.0), "EYY": lambda y: -1e-5 * (y - 300.0)},
        {"EC0Y": 3e-5},
        {"EXX": lambda q: np.full(np.shape(q), 0.004), "EYY": lambda q: np.full(np.shape(q), -0.002)},
    )
    model = """
[model]
degree = 1
segments = 1
[model.functions]
"E*" = false
EXX = { reversal = "constant" }
EYY = { reversal = "constant" }
EC0Y = true
"""
    campaign = plan_with_readings(exact, truth, model, 3e-4)
    (test,) = circular_tests(campaign)
    found, solution = evaluate_circular(test), fit(campaign)
    square = solution.location("EC0Y")
    assert abs(square.value - 3e-5) < 4.0 * square.u
    assert abs(found["squareness_XY"].value - square.value) < 2.0 * found["squareness_XY"].U / 2.0
    assert 3.0 * square.u > found["squareness_XY"].U / 2.0  # the price of a window and of terms that are none here


def test_a_bar_on_a_cone_is_seen_in_the_plane():
    """The ball 80 mm out of the plane: lengths of 170 mm on a circle of 150 mm; squareness as in the plane, D not known."""
    exact = ExactMachine("w b X Y Z t", TRAVEL)
    truth = Truth(constants={"EC0Y": 4e-5})
    campaign = plan_with_readings(exact, truth, "", 3e-4)
    (flat,) = campaign.sets
    height = 80.0
    point = exact.functional_point(flat.positions, flat.tool, truth, flat.directions)
    ball = np.array(campaign.stations[0].position) - [0.0, 0.0, height]
    readings = np.linalg.norm(point - ball, axis=1)[:, None]
    stations = (replace(campaign.stations[0], position=tuple(ball)),)
    (test,) = circular_tests(replace(campaign, sets=(replace(flat, readings=readings),), stations=stations))
    found = evaluate_circular(test)
    assert test.radius == pytest.approx(150.0) and not test.is_calibrated
    assert found["squareness_XY"].value == pytest.approx(4e-5, abs=1e-8)
    assert found["G_b_XY"].value == pytest.approx(150.0 * 4e-5, abs=2e-6)


def test_turn_runs_over_the_arc():
    assert turn("YZ", 220.0, -1, 20.0)[[0, -1]].tolist() == [200.0, -20.0]


def test_a_warm_machine_is_reduced_to_20_degrees():
    """At 22 °C scales of 11.5e-6/K make the circle larger by R α ΔT, and a bar of 1.2e-6/K reads less of it by its own growth."""
    exact = ExactMachine("w b X Y Z t", TRAVEL)
    campaign = plan_with_readings(exact, Truth(), "", 3e-4)
    expands = {"machine": Expansion(11.5e-6, material="scale_C"), "artefact": Expansion(1.2e-6, material="scale_C")}
    room = Environment("room", {"scale_C": np.array([22.0])}, sets=("circle XY",), **expands)
    as_read, at_20 = (
        evaluate_circular(circular_tests(c)[0])["D_XY"].value
        for c in (campaign, replace(campaign, environments=(room,)))
    )
    assert as_read - at_20 == pytest.approx(150.0 * (11.5e-6 - 1.2e-6) * 2.0, rel=1e-3)


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda s: replace(s, positions=s.positions + [[0.0, 0.0, 1.0]] * np.arange(len(s))[:, None]), "X, Y, Z moved"),
        (lambda s: replace(s, positions=s.positions * [[1.0, 1.01, 1.0]]), "lie up to .* mm off a circle"),
        (lambda s: replace(s, readings=s.readings * np.nan), "readings are missing, as in a plan"),
        (lambda s: replace(s, readings=s.readings + 50.0), r"the readings are 200.* on a circle of 150 mm"),
        (lambda s: replace(s, tool=s.tool * np.linspace(1.0, 1.1, len(s))[:, None]), "tool vectors differ"),
    ],
)
def test_sets_that_are_no_circular_test_say_why(change, message):
    campaign = plan_with_readings(ExactMachine("w b X Y Z t", TRAVEL), Truth(), "", 3e-4)
    with pytest.raises(InputError, match=message):
        circular_tests(replace(campaign, sets=(change(campaign.sets[0]),)), ["circle XY"])
