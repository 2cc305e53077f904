"""Recovery where something is known beforehand: stations in the machine's or their own frame, the length of a ball bar.

Ten campaigns each with its own non-spline truth within reach of the model; differences to the exact chain over stated u, pooled.
"""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import Truth, random_truth
from support.judging import judge
from support.machines import VERTICAL, fixed, volid_machine
from support.trackers import simulated

from volid.campaign import Campaign, ObservationSet, Station
from volid.fitting.fit import fit

SEEDS = 10

pytestmark = pytest.mark.slow
ONLY = '[model]\nsegments = 2\n[model.functions]\n"E*" = false\nEXX = true\nEYY = true\nEC0Y = true\n'
NAMES = ("EXX", "EYY")
BAR, U_BAR, U_READING = 150.0, 1e-3, 2e-4  # mm
CENTRES = [(x, y, -230.0) for x in (180.0, 380.0, 580.0) for y in (170.0, 260.0)]


def known_campaign(seed, frame, shift=0.0):
    """All stations known exactly; `frame`: "machine", or "stations" for a frame of their own that lies elsewhere by `shift`."""
    campaign, truth, tracker = simulated(
        VERTICAL, seed, extra=fixed(4), waviness=0.1, n_per_station=80, every_station_sees_every_tool=True
    )
    stations = tuple(
        Station(name, position=tuple((p + shift).tolist()), known=True, frame=frame)
        for name, p in tracker.station_positions.items()
    )
    return replace(campaign, stations=stations), truth


@pytest.mark.parametrize(("frame", "shift"), [("machine", 0.0), ("stations", np.array([700.0, -400.0, 120.0]))])
def test_known_stations(frame, shift):
    values = []
    for seed in range(SEEDS):
        campaign, truth = known_campaign(seed, frame, shift)
        solution = fit(campaign)
        assert solution.fully_determined
        values.append(judge(solution, VERTICAL, truth, tool_rotation=False).normalised)
    assert 0.85 < np.sqrt(np.mean(np.square(values))) < 1.15


def bar_campaign(seed, calibrated_u):
    """Circles of a ball bar in XY about six balls on the table; one true length, off by N(0, U_BAR) from its calibration."""
    rng = np.random.default_rng(seed)
    full = random_truth(VERTICAL, rng, waviness=0.1, tool_rotation=False)
    truth = Truth({n: full.functions[n] for n in NAMES}, {"EC0Y": full.constants["EC0Y"]})
    angle = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    circle = BAR * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    q = np.concatenate([np.array(c) + circle for c in CENTRES])
    order = ["XYZ".index(a) for a in VERTICAL.axes]
    tool = np.zeros_like(q)
    balls = np.repeat(np.array(CENTRES), len(angle), axis=0)
    length = np.linalg.norm(VERTICAL.functional_point(q[:, order], tool, truth) - balls, axis=1)
    reading = length + U_BAR * rng.standard_normal() + U_READING * rng.standard_normal(len(q))
    names = np.repeat([f"B{i}" for i in range(len(CENTRES))], len(angle))
    readings = ObservationSet(
        name="bar", kind="distance", positions=q[:, order], directions=np.zeros_like(q), tool=tool,
        readings=reading[:, None], u=np.full((len(q), 1), U_READING),
        labels={"station": names, "segment": np.full(len(q), "1")},
        options={"relative": False, "calibrated_u": calibrated_u}, source="bar.csv",
    )  # fmt: skip
    stations = tuple(Station(f"B{i}", position=c) for i, c in enumerate(CENTRES))
    return Campaign(volid_machine(VERTICAL, ONLY), stations, (readings,), title="ball bar"), truth


def test_ball_bar_of_calibrated_length():
    """Positioning within the circles, squareness, and the bar's own length, which its calibration and the circles share."""
    motions, squareness = [], []
    for seed in range(SEEDS):
        campaign, truth = bar_campaign(seed, U_BAR)
        solution = fit(campaign)
        assert solution.fully_determined and not solution.adequacy.rejected
        for name in NAMES:
            low, high = {"EXX": (30.0, 730.0), "EYY": (20.0, 410.0)}[name]
            rows = [
                r for r in solution.functions(points=21) if r.name == name and low <= r.position <= high and r.u > 1e-9
            ]
            motions += [(r.value - float(truth.functions[name](r.position))) / r.u for r in rows]
        found = solution.location("EC0Y")
        squareness.append((found.value - truth.constants["EC0Y"]) / found.u)
        assert found.u < 2e-6, "2 µrad"
    assert 0.7 < np.sqrt(np.mean(np.square(motions))) < 1.3
    assert np.sqrt(np.mean(np.square(squareness))) < 1.7, "99.9 % of ten"


def test_the_calibration_carries_the_scale_of_a_ball_bar():
    """A slope common to EXX and EYY is told from a longer bar by its calibration alone: u(slope) = u(length)/length, 7 µm/m."""
    ends = {}
    for u_bar in (U_BAR, 10.0 * U_BAR):
        solution = fit(bar_campaign(0, u_bar)[0])
        ends[u_bar] = max(r.u for r in solution.functions(points=21) if r.name == "EXX")
    expected = 380.0 * U_BAR / BAR  # mm, at the ends of the travel from the reference at mid-travel
    assert ends[U_BAR] == pytest.approx(expected, rel=0.1)
    assert ends[10.0 * U_BAR] == pytest.approx(10.0 * expected, rel=0.1)
