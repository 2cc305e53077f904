"""Measured, compensated, measured again: the fit of the second campaign is that of the compensated machine.

The first campaign is the exact chain's. Tables and grids go through files to two controls, the package's under the virtual
instruments and the exact one that judges.
"""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import (
    CompensatedMachine,
    ExactControl,
    ExactMachine,
    default_tools,
    gauge_free,
    machine_toml,
    random_truth,
    spread_positions,
    tracker_campaign,
    write_campaign,
)
from support.drives import both_truths
from support.judging import judge
from support.machines import STRUCTURES, exact_machine, volid_machine
from support.rtests import NO_LINEAR, SPHERES, r_test, r_test_campaign, rotary_only

from volid.compensation.base import base_of
from volid.compensation.package import compensate
from volid.compensation.residual.forecast import forecast
from volid.fitting.fit import fit
from volid.fitting.location_errors import location_parameter
from volid.io import load_campaign
from volid.io.compensations import load_control, save_compensation
from volid.model.iso230 import parse
from volid.virtual.simulate import simulate

TOOL = (0.0, 0.0, -150.0)
NODES = 29  # of each axis: 25 mm of 700 mm, so that interpolation leaves less than the tracker sees


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4, 6])
def test_a_tracker_sees_of_an_l_vol_machine_what_was_predicted_to_remain(seed, tmp_path):
    exact = ExactMachine("w Y' X' b Z (C) t", {"X": (0.0, 700.0), "Y": (0.0, 500.0), "Z": (-400.0, 0.0)})
    rng = np.random.default_rng(seed)
    truth = random_truth(exact, rng)
    data = tracker_campaign(exact, truth, rng, n_per_station=300)
    first = load_campaign(write_campaign(tmp_path / "first", data, machine_toml(exact), "before", 5.0, rng))
    solution = fit(first)
    made = compensate(solution, ["L-VOL"], base_of(solution, TOOL), points=NODES, uncertainty=False)
    save_compensation(made, solution, tmp_path / "control")
    control = load_control(first.machine, [tmp_path / "control"])
    second, _ = simulate(first, both_truths(first.machine, truth), seed=seed, control=control)
    after = fit(second)

    compensated = CompensatedMachine(ExactControl.of(exact, [tmp_path / "control"]))
    q = spread_positions(exact, 150, rng)
    tools = default_tools()[np.arange(150) % 3]
    left = gauge_free(compensated.deviation(q, tools, truth)[:, :3], q, tools, machine=exact)[0]
    whole = gauge_free(exact.deviation(q, tools, truth)[:, :3], q, tools, machine=exact)[0]
    size, before = (np.sqrt(np.mean(np.sum(d**2, axis=1))) for d in (left, whole))
    assert size < 0.1 * before

    # what remains is what the first solution predicted, the rigid motion of the workpiece taken out
    (_, column) = forecast(solution, [["L-VOL"]], base_of(solution, TOOL), np.array([TOOL]), points=NODES).columns
    one = np.tile(TOOL, (150, 1))
    there = gauge_free(compensated.deviation(q, one, truth)[:, :3], q, one, tool_rotation=False, machine=exact)[0]
    rms = np.sqrt(np.mean(np.sum(there**2, axis=1)))
    low, high = (float(v[2]) for v in (column.predictions[0].low, column.predictions[0].high))  # of the RMS, 95 %
    assert low < rms < high

    # and the second fit finds it, within its own u
    found = judge(after, compensated, truth, q, tools)
    assert not after.adequacy.rejected
    # about 200 effective values; the scallops of interpolation, 25 mm long, are below what the tracker resolves
    assert 0.8 < found.normalised_rms < 1.2
    assert found.rms < size  # mm: what it found is nearer to the truth than nothing at all


@pytest.mark.slow
def test_an_r_test_sees_location_errors_gone_and_error_motions_left_after_r_por(tmp_path):
    exact = exact_machine(STRUCTURES["tilting table C'A'"])
    truth = rotary_only(random_truth(exact, np.random.default_rng(2)))
    machine = volid_machine(exact, NO_LINEAR)
    data = r_test(exact, truth, np.random.default_rng(3), counts={"A": 13, "C": 25}, noise=1e-4)
    first = r_test_campaign(machine, data, u=1e-4)
    solution = fit(first)
    made = compensate(solution, ["R-POR"], base_of(solution, TOOL), points=37, uncertainty=False)
    save_compensation(made, solution, tmp_path / "control")
    control = load_control(machine, [tmp_path / "control"])
    plan = replace(first, sets=(replace(first.sets[0], options={**first.sets[0].options, "sphere": SPHERES}),))
    second, _ = simulate(plan, both_truths(machine, truth), seed=3, control=control)
    after = fit(second)
    limit = 4.0  # u: about 80 independent comparisons
    locations = [n for n in solution.model.names if parse(n).location and parse(n).axis in "AC"]
    assert len(locations) == 8
    for name in locations:
        before, now = location_parameter(solution, name), location_parameter(after, name)
        assert abs(before.value) > 100.0 * before.u
        assert abs(now.value) < limit * np.hypot(before.u, now.u)
    motions = [f for f in after.functions(points=7) if not parse(f.name).location and f.u > 1e-12]
    for f in motions:
        true = float(truth.functions[f.name](np.array([f.position]))[0])
        assert abs(f.value - true) < limit * f.u, f
    assert len(motions) > 70
