"""Linear axes of a five-axis machine measured first: as prior knowledge of the R-test, and fitted with it, they say the same."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth, random_truth, tracker_campaign
from support.machines import POINTS, resolved
from support.quick_fit import quick_fit
from support.rtests import r_test, r_test_campaign
from support.trackers import distance_campaign

from volid.campaign import Campaign
from volid.fitting.location_errors import location_parameter
from volid.fitting.prediction.spread import linear_uncertainty
from volid.model.linear_maps import function_rows

TRAVEL = {"X": (-400.0, 400.0), "Y": (-350.0, 350.0), "Z": (-200.0, 500.0), "A": (-100.0, 100.0), "C": (-180.0, 180.0)}
FIVE = ExactMachine("w C' A' Y' X' b Z t", TRAVEL, point={a: POINTS[a] for a in "AC"})
THREE = ExactMachine("w Y' X' b Z t", {a: TRAVEL[a] for a in "XYZ"})
pytestmark = pytest.mark.slow

LINEAR = '"E?[XYZ]" = { segments = 2 }\n'
FUNCTIONS = LINEAR + '"E?A" = { segments = 4 }\n"E?C" = { segments = 6 }\n'


def only(truth: Truth, axes: str) -> Truth:
    return Truth({n: f for n, f in truth.functions.items() if n[2] in axes},
                 {n: v for n, v in truth.constants.items() if n[3] in axes})  # fmt: skip


@pytest.fixture(scope="module")
def measured():
    """Truth; tracker distances at rotary zero, as a campaign of the three linear axes; and an R-test of all five."""
    rng = np.random.default_rng(11)
    truth = random_truth(FIVE, rng, waviness=0.3, scale=0.5)
    tracker = tracker_campaign(THREE, only(truth, "XYZS"), rng, n_per_station=90, every_station_sees_every_tool=True)
    linear = distance_campaign(resolved(THREE, LINEAR), tracker)
    data = r_test(FIVE, truth, rng, counts={"A": 7, "C": 11})
    return truth, linear, r_test_campaign(resolved(FIVE, FUNCTIONS), data)


def together(linear: Campaign, rotary: Campaign) -> Campaign:
    """Both campaigns on the five-axis machine; the rotary axes stood at 0 while the tracker measured."""
    (one,) = linear.sets
    columns = [rotary.machine.index(a) for a in linear.machine.letters]
    positions = np.zeros((len(one), 5))
    positions[:, columns] = one.positions
    distances = replace(one, positions=positions, directions=np.zeros_like(positions))
    return replace(rotary, stations=linear.stations, sets=(distances, *rotary.sets))


def test_linear_axes_as_prior_recover_the_rotary_axes_and_equal_the_joint_fit(measured):
    truth, linear, rotary = measured
    joint = quick_fit(together(linear, rotary))
    before = quick_fit(linear)
    after = quick_fit(rotary, prior=before)
    u = np.sqrt(np.diag(joint.parameter_covariance))
    assert joint.statements == () and joint.model.names == after.model.names
    # first-order equality: products of 15 µm and 40 µrad stay below some thousandths of u
    assert np.max(np.abs(np.asarray(after.parameters - joint.parameters)) / u) < 0.02
    scaled = (after.parameter_covariance - joint.parameter_covariance) / np.outer(u, u)
    assert np.abs(scaled).max() < 5e-3
    normalised = []
    for name in truth.constants:
        row = location_parameter(after, name)
        normalised.append((row.value - truth.constants[name]) / row.u)
        assert abs(normalised[-1]) < 4.0, name
    assert 0.4 < np.sqrt(np.mean(np.square(normalised))) < 1.6  # 14 constants
    # and the R-test adds: what the tracker alone left of the linear axes is less certain
    for name in ("EC0Y", "EA0Z", "EB0Z"):
        assert after.location(name).u < before.location(name).u


def test_the_orientation_of_the_tool_frame_that_a_prior_knew_is_used_by_head_axes():
    """Three axes without the head first: what they call the orientation of the tool frame is that of head and tool frame at 0."""
    five = ExactMachine("w b X Y Z C B t", {**TRAVEL, "B": TRAVEL["A"]}, point={a: POINTS[a] for a in "BC"})
    three = ExactMachine("w b X Y Z t", {a: TRAVEL[a] for a in "XYZ"})
    rng = np.random.default_rng(12)
    truth = random_truth(five, rng, waviness=0.3, scale=0.5)
    tracker = tracker_campaign(three, at_head_zero(truth), rng, n_per_station=90, every_station_sees_every_tool=True)
    linear = distance_campaign(resolved(three, LINEAR), tracker)
    functions = FUNCTIONS.replace("?A", "?B")
    rotary = r_test_campaign(resolved(five, functions), r_test(five, truth, rng, counts={"B": 7, "C": 11}))
    before = quick_fit(linear)
    after = quick_fit(rotary, prior=before)
    joint = quick_fit(together(linear, rotary))
    zero = np.zeros((5, 1))
    for component in ("EA", "EB", "EC"):
        rows = sum(
            function_rows(after.model, name, zero, zero)
            for letter in "CBS"
            for name in (f"{component}{letter}", f"{component}0{letter}")
        )
        assert not after.is_not_determined(rows)[0]
        u = linear_uncertainty(rows, after.parameter_covariance)[0]
        value = float((rows @ np.asarray(after.parameters))[0])
        known = before.location(f"{component}0S")
        assert u <= 1.01 * known.u, "the readings of the R-test can only add"
        assert abs(value - float((rows @ np.asarray(joint.parameters))[0])) < 0.05 * u
        true = sum(truth.constants.get(f"{component}0{a}", 0.0) for a in "CBS")
        true += sum(truth.functions[f"{component}{a}"](np.zeros(1))[0] for a in "CB")
        assert abs(value - true) < 4.0 * u


def at_head_zero(truth: Truth) -> Truth:
    """What a machine without the head has: the head's orientation at 0 belongs to its tool frame."""
    linear = only(truth, "XYZ")
    for component in ("EA", "EB", "EC"):
        own = sum(truth.constants.get(f"{component}0{a}", 0.0) for a in "CBS")
        own += sum(float(truth.functions[f"{component}{a}"](np.zeros(1))[0]) for a in "CB")
        linear.constants[f"{component}0S"] = own
    return linear
