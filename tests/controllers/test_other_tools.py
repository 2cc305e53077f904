"""What another tool is wrong by, where tables of axes hold for one tool vector: written out by hand, and by the exact chain."""

import re

import numpy as np
import pytest
from support.control_cases import MACHINE, TOOL, error_table, job, levered, pitch
from support.made_up import made_up

import volid
from volid.compensation.package import Compensation
from volid.controllers import CONTROLS
from volid.controllers.other_tools import other_tool_notes


def told(made: Compensation) -> float | None:
    """Micrometres in the sentence, or None without one."""
    notes = other_tool_notes(job("sinumerik-cec", made, sign="error"), CONTROLS["sinumerik-cec"].declaration)
    return float(re.search(r"wrong by up to ([\d.]+) µm", notes[0]).group(1)) if notes else None


def test_a_rotation_of_20_microradians_is_2_micrometres_for_100_mm():
    assert told(levered()) == 2.0


def test_rotations_of_several_axes_about_one_direction_add_up():
    """EBX from -10 to 30 µrad and EBZ from 0 to 15 µrad: 45 µrad at one corner, whichever side bears X and Z."""
    tables = (
        error_table("EBX", [0, 500, 1000], [-10e-6, 30e-6, 0.0], kind="L-ANG"),
        error_table("EBZ", [-500, 0], [0.0, 15e-6], kind="L-ANG"),
    )
    assert told(Compensation(("L-ANG",), tables, ())) == 4.5


def test_positioning_is_right_for_any_tool():
    assert told(pitch()) is None


def test_controls_with_lever_arms_say_nothing():
    assert other_tool_notes(job("isg-volcomp", levered()), CONTROLS["isg-volcomp"].declaration) == ()


@pytest.mark.parametrize("name, options", [("sinumerik-cec", {}), ("pmac", {"counts": "10000"})])
def test_an_export_says_it_and_a_longer_tool_is_off_by_no_more(name, options):
    """Against a control with a kinematic model, told of tools 100 mm longer in each direction, and of the tool itself."""
    solution = made_up(MACHINE)
    base = volid.compensation_base(solution, tuple(TOOL.tolist()))
    sign = "error" if name == "sinumerik-cec" else None
    made = volid.export(solution, name, ["L-VOL"], base=base, sign=sign, options=options)
    (note,) = [n for n in made.notes if n.startswith("all tables hold for the tool vector (0, 0, -150) mm")]
    most = 1e-3 * float(re.search(r"up to ([\d.]+) µm", note).group(1))
    rng = np.random.default_rng(3)
    q = np.stack([rng.choice(np.linspace(*a.travel, 21), 4000) for a in MACHINE.axes], axis=1)
    model = volid.Control(MACHINE, made.job.compensation.tables)
    off = [np.abs(model.command(q, TOOL + step) - model.command(q, TOOL)).max() for step in 100.0 * np.eye(3)]
    assert 0.5 * most < max(off) < most + 1e-5
