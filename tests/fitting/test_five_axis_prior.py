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
        row = after.location(name)
        normalised.append((row.value - truth.constants[name]) / row.u)
        assert abs(normalised[-1]) < 4.0, name
    assert 0.4 < np.sqrt(np.mean(np.square(normalised))) < 1.6  # 14 constants
    # and the R-test adds: what the tracker alone left of the linear axes is less certain
    for name in ("EC0Y", "EA0Z", "EB0Z"):
        assert after.location(name).u < before.location(name).u
