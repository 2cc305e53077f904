"""A step gauge alone: few readings, which determine few combinations; the rest is named, and nothing is blamed."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, random_truth
from support.machines import volid_machine

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
