"""Readings of every kind validate a solution of tracker distances: the same physics as in the fit, whatever reads it.

Readings are simulated by the package itself: what is asked here is not whether its physics is right (`test_validation.py` does,
with the exact chain), but that every kind's own unknowns are taken out, and no more than these.
"""

from dataclasses import replace

import numpy as np
import pytest
from support.places import MODELS

from volid.fitting.fit import fit
from volid.io import read_machine
from volid.planning.catalogue import MAKERS
from volid.planning.standard import standard_plan
from volid.planning.validation import validation_plan
from volid.report.text.validation import validation_data, validation_lines
from volid.validation.readings.validation import validate
from volid.virtual.random_truth import random_truth
from volid.virtual.simulate import simulate

MACHINE = read_machine(MODELS / "wYXbZt_vertical.toml")
PLANS = {
    "diagonals": {},
    "step-diagonals": {"n": 6},
    "parallel-lines": {},
    "circles": {"n": 37},
    "step-gauge": {},
    "direct": {"vertical": "Z", "points": 7},
    "ball-plate": {},
}


@pytest.fixture(scope="module")
def known():
    truth = random_truth(MACHINE, 7)
    campaign, _ = simulate(standard_plan(MACHINE, n_per_station=100), truth, seed=3)
    return truth, fit(campaign)


def polar(solution):
    """An absolute tracker: range in mm, angles in degrees."""
    plan = validation_plan(MACHINE, solution.campaign, n=30)
    s = plan.sets[0]
    u = {"u_range": 0.001, "u_azimuth": 1e-4, "u_elevation": 1e-4}
    read = np.full((len(s), 3), np.nan)
    changed = replace(s, kind="polar", readings=read, u=np.tile(list(u.values()), (len(s), 1)), options=u)
    return replace(plan, sets=(changed,))


@pytest.mark.parametrize("name", [*PLANS, "polar"])
def test_a_right_solution_is_in_agreement_and_a_wrong_one_is_not(name, known):
    truth, solution = known
    plan = polar(solution) if name == "polar" else MAKERS[name](MACHINE, **_given(name))
    found = validate(solution, simulate(plan, truth, seed=5)[0])
    assert found.probability > 1e-3, found.verdict
    assert sum(len(s.rows) for s in found.sets) == sum(len(s) for s in plan.sets)
    other = validate(solution, simulate(plan, random_truth(MACHINE, 8), seed=5)[0])
    assert not other.confirmed and other.probability < 1e-6
    assert "\n".join(validation_lines(other)) and validation_data(other)["causes"] is not None
    assert all(np.isfinite(g.rms) == ("," not in g.unit) for g in found.groups)


def _given(name):
    return {"points" if k == "n" else k: (v,) if k in ("n", "points") else v for k, v in PLANS[name].items()}
