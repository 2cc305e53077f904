"""Plans of direct measurement: for every machine with three linear axes, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from support.places import MODELS

from volid.exceptions import InputError
from volid.io import load_campaign, read_machine, write_manifest
from volid.io.machines import parse_machine
from volid.observations.unread import unread
from volid.planning.direct import direct_plan

CROSS_BED = read_machine(MODELS / "wXZbYt_cross_bed.toml")
TWO_AXES = """format = "volid-machine/1"
name = "two axes"
structure = "w X' b Z t"
[axis.X]
travel = [0.0, 600.0]
[axis.Z]
travel = [0.0, 300.0]
"""


@pytest.mark.parametrize("file", sorted(MODELS.glob("*.toml")), ids=lambda f: f.stem)
def test_on_every_machine_all_functions_and_squareness_are_read(file, tmp_path):
    machine = read_machine(file)
    plan = direct_plan(machine, "Z", points=4)
    assert unread(plan) == []
    low, high = np.array([a.travel for a in machine.axes]).T
    assert (plan.positions >= low - 1e-9).all() and (plan.positions <= high + 1e-9).all()
    again = load_campaign(write_manifest(plan, tmp_path / "p"), plan=True)
    assert [s.name for s in again.sets] == [s.name for s in plan.sets] and again.alignments == plan.alignments


def test_the_roll_is_read_by_gauges_600_mm_apart_or_as_far_as_the_travel_goes():
    plan = direct_plan(CROSS_BED, "Y", (5.0, 0.0, -150.0))
    here, there = (s for s in plan.sets if s.name in ("square here", "square there"))
    np.testing.assert_array_equal(there.tool[0] - here.tool[0], [600.0, 0.0, 0.0])
    np.testing.assert_array_equal(0.5 * (there.tool[0] + here.tool[0]), [5.0, 0.0, -150.0])
    small = parse_machine(CROSS_BED.text.replace("[0.0, 1000.0]", "[0.0, 400.0]"), "machine.toml")
    here, there = (s for s in direct_plan(small, "Y").sets if s.name in ("square here", "square there"))
    assert there.tool[0, 0] - here.tool[0, 0] == 400.0


def test_straight_edges_are_read_one_way_up():
    names = {s.name for s in direct_plan(CROSS_BED, "Y", form_u=0.0).sets}
    assert not any("turned over" in name for name in names) and "edge XY upright" in names


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({}, r"`vertical` is not stated; expected X, Y or Z"),
        ({"vertical": "C"}, "`vertical` is C; expected X, Y or Z"),
        ({"vertical": "Y", "points": 2}, "`points=2`"),
        ({"vertical": "Y", "u": 1.0}, "u"),
        ({"vertical": "Y", "form_u": -1.0}, "`form_u=-1`"),
        ({"vertical": "Y", "at": {"X": 1e7}}, "at: "),
    ],
)
def test_what_is_wrong_is_said(stated, said):
    with pytest.raises(InputError, match=said):
        direct_plan(CROSS_BED, **stated)


def test_a_machine_without_three_linear_axes_is_refused():
    with pytest.raises(InputError, match="needs X, Y and Z; its linear axes are X, Z"):
        direct_plan(parse_machine(TWO_AXES, "machine.toml"), "Z")
