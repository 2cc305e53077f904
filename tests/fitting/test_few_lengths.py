"""A step gauge alone: few readings, which determine few combinations; the rest is named, and nothing is blamed."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, random_truth
from support.kinds import plan_set
from support.machines import volid_machine

from volid.campaign import Campaign, Station
from volid.fitting.fit import fit
from volid.planning import step_gauge

TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}


@pytest.mark.parametrize("seed", range(3))
def test_a_step_gauge_alone_is_accepted_and_tells_no_more_than_its_lines(seed):
    exact = ExactMachine("w Y' X' b Z t", TRAVEL)
    plan = step_gauge(volid_machine(exact, ""), n=5, u=5e-4, calibrated_u=0.0, scale_u=0.0)
    rng = np.random.default_rng(seed)
    truth, (s,) = random_truth(exact, rng), plan.sets
    first, second = (exact.functional_point(e.positions, e.tool, truth) for e in s.ends)
    readings = np.linalg.norm(second - first, axis=1) + rng.normal(size=len(s)) * 5e-4
    solution = fit(replace(plan, sets=(replace(s, readings=readings[:, None]),)))
    assert solution.statistics.converged and not solution.adequacy.rejected, solution.adequacy.verdict
    assert solution.statements, "the rest is named"
    given = [row for row in solution.functions() if np.isfinite(row.value)]
    assert {"EXX", "EZZ"} <= {row.name for row in given}, "positioning along lines of their own"
    for row in given:
        assert row.u < (2e-3 if row.name[1] in "ABC" else 0.5), "no u that no machine could have"
        own = truth.functions[row.name](np.array([row.position, exact.reference[row.axis]]))
        if row.name in ("EXX", "EZZ"):
            assert abs(row.value - (own[0] - own[1])) < 5.0 * row.u + 1e-9, row


@pytest.mark.parametrize("seed", [102, 106])
def test_points_along_three_lines_are_within_their_u(seed):
    """Lines of the axes that do not meet, three tool vectors: what is given lies within its u, and no misfit is invented."""
    exact = ExactMachine("w Y' X' b Z t", {"X": (0.0, 600.0), "Y": (0.0, 500.0), "Z": (-400.0, 0.0)})
    machine, rng = volid_machine(exact, ""), np.random.default_rng(seed)
    truth = random_truth(exact, rng, waviness=0.6, tool_rotation=False)
    ends = {
        "X": ((0, 100, -100), (600, 100, -100)),
        "Y": ((50, 0, -350), (50, 500, -350)),
        "Z": ((300, 400, -400), (300, 400, 0)),
    }
    line = np.concatenate([np.linspace(*pair, 15) for pair in ends.values()]).astype(float)
    place = {a: np.tile(line[:, i], 3) for i, a in enumerate("XYZ")}
    q, tool = (
        exact.in_axis_order(place),
        np.repeat([(0.0, 0.0, -100.0), (70.0, 0.0, -180.0), (0.0, 80.0, -150.0)], 45, axis=0),
    )
    own = plan_set("points", "point", q, tool, {"station": "S1"}, u=[1e-3] * 3)
    readings = exact.functional_point(q, tool, truth) + 1e-3 * rng.normal(size=(len(q), 3))
    solution = fit(Campaign(machine, (Station("S1"),), (replace(own, readings=readings, time=None, temperature=None),)))
    assert not solution.adequacy.rejected, solution.adequacy.verdict
    z = []
    for row in solution.functions(points=9):
        if np.isfinite(row.value) and abs(row.position - exact.reference.get(row.axis, np.nan)) > 1e-9:
            z.append((row.value - float(truth.functions[row.name](np.array(row.position)))) / row.u)
    assert len(z) > 80 and np.sqrt(np.mean(np.square(z))) < 1.6 and np.max(np.abs(z)) < 5.0
