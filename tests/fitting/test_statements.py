"""What a solution says of an R-test whose table axis C stood still while A swept."""

from dataclasses import replace

import numpy as np
import pytest
from support.kinds import plan_set
from support.machines import exact_of
from support.mixed_sets import CUBIC, FINE, TOOL, campaign_of, drawn
from support.model_files import LINEAR_KNOWN, machine_of, measured, readings_of, rotary_truth_of

from volid.fitting.diagnosis.statements import likely_reasons
from volid.fitting.fit import fit
from volid.planning.rtest import rtest_static_grid


@pytest.fixture(scope="module")
def clamped():
    """Solution of exact readings at 13 angles of A for three spheres, C clamped at 0 degrees."""
    machine = machine_of("wCAYXbZt_trunnion", f'\n[model.functions]\n{LINEAR_KNOWN}"E?0S" = false\n')
    plan = rtest_static_grid(machine, None, None, 5, 13)
    (one,) = plan.sets
    rows = one.positions[:, machine.index("C")] == 0.0
    fields = {name: getattr(one, name)[rows] for name in ("positions", "directions", "tool", "readings", "u")}
    plan = replace(plan, sets=(replace(one, labels={k: v[rows] for k, v in one.labels.items()}, rows=None, **fields),))
    exact = exact_of(machine)
    return fit(measured(plan, readings_of(exact, plan, rotary_truth_of(exact, 3))))


def test_clamped_axis_is_not_determined_and_the_swept_one_is(clamped):
    """Nothing tells C's errors from the spheres' places: 6 functions and 4 locations, and all of A is known."""
    missing, known = clamped.statements
    of_c, of_a = ({f"E{d}{a}" for d in "XYZABC"} for a in "CA")
    of_c |= {"EX0C", "EY0C", "EA0C", "EB0C"}
    of_a |= {"EY0A", "EZ0A", "EB0A", "EC0A"}
    assert {name for name in of_a | of_c if name in missing} == of_c
    assert {name for name in of_a | of_c if name in known} == of_a
    assert "axis C was measured at 1 position only" in missing and "Without C, these are determined" in known
    assert set(clamped.undetermined) == of_c


def test_what_holds_for_one_set_of_several_is_said_of_that_set():
    """A ball bar beside a line of a laser: it is the bar that has one station, not the campaign."""
    line = drawn("laser", FINE, np.random.default_rng(1), (3e-4, 3e-4))
    bar = plan_set("bar", "distance", line.positions, TOOL, {"station": "P1"})
    alone, beside = (likely_reasons(replace(campaign_of(CUBIC, line), sets=s)) for s in ((bar,), (line, bar)))
    assert any(r.startswith("distances from one station only") for r in alone)
    assert not any(r.startswith("distances from") for r in beside)
    assert any(r.startswith("in set 'bar': distances from one station only") for r in beside)
