"""LinuxCNC with two grids of round numbers in a chain: each switched by itself, ends held; a damaged file stops the start."""

import numpy as np
import pytest
from support.control_cases import spatial, written
from support.linuxcnc_simulator import Joint, LinuxCNCError, Setup, needs_compiler, needs_linuxcnc, run
from support.places import ROOT

from volid.controllers.linuxcnc.hal.wiring import wiring

pytestmark = [needs_linuxcnc, needs_compiler, pytest.mark.slow]

FOLDER = ROOT / "examples" / "linuxcnc"
COMPONENT = FOLDER / "volid_grid.comp"
HOME = 10.0  # of X, where its motor stands at 0: the grid is looked up by the position of the joint
JOINTS = [  # not in the order X, Y, Z
    Joint("Z", -510.0, 10.0),
    Joint("X", -100.0, 1100.0, home=HOME),
    Joint("Y", -10.0, 610.0, lines="COMP_FILE_TYPE = 1\nCOMP_FILE = y.comp"),
]
# by hand: X is 1 µm too far per 100 mm of X; and, in the other file, 1 µm too short per 100 mm of Y
POSITIONING = """volid-hal-grid 1  type L-POS  tool 0 0 -150  unit mm  sign compensation
nodes X 2 0 1000  nodes Y 1 0  nodes Z 1 0
values 2  0 0 0  -0.010 0 0  end"""
SQUARENESS = """volid-hal-grid 1  type L-SQU  tool 0 0 -150  unit mm  sign compensation
nodes X 1 0  nodes Y 2 0 600  nodes Z 1 0
values 2  0 0 0  0.006 0 0  end"""


TRIM = 5.0  # of Y by COMP_FILE, once Y has moved: the grid is looked up without it
COMP_FILE = f"-10 {TRIM} {TRIM}\n610 {TRIM} {TRIM}\n"


def loops(instance: str) -> str:
    """Drives that go where they are told: a component without gain between command and feedback."""
    names = ",".join(f"drive.{a}" for a in "xyz")
    lines = ["source volid_grid.hal", f"loadrt sum2 names={names}", f"setp {instance}.fade-time 0.05"]
    for a in "xyz":
        lines += [
            f"addf drive.{a} servo-thread",
            f"net volid-{a}-motor => drive.{a}.in0",
            f"net volid-{a}-drive <= drive.{a}.out",
        ]
    return "\n".join(lines)


def setup(files, instance: str) -> Setup:
    shared = {"y.comp": COMP_FILE, "volid_grid.h": COMPONENT.with_suffix(".h").read_text()}
    return Setup(
        JOINTS,
        files={**files, **shared},
        kinematics="trivkins coordinates=ZXY",
        hal=loops(instance),
        drives=False,
        components=[COMPONENT],
    )


def two_grids() -> dict[str, str]:
    names = {"L-POS": "l_pos.grid", "L-SQU": "l_squ.grid"}
    hal = wiring(names, {"X": 1, "Y": 2, "Z": 0})
    return {"l_pos.grid": POSITIONING, "l_squ.grid": SQUARENESS, "volid_grid.hal": hal}


def test_two_grids_in_a_chain_each_switched_by_itself():
    pins = [
        "drive.x.out",
        "drive.y.out",
        "joint.1.pos-fb",
        "volid-l-pos.weight",
        "joint.1.f-error",
        "volid-l-pos.beyond",
    ]
    steps = [
        {"wait": 0.2},  # not homed: nothing is corrected
        {"home": True, "wait": 1.2},
        {"mdi": "G53 G0 X500 Y300"},
        {"set": {"volid-l-pos.enable": 0}, "wait": 1.2},
        {"set": {"volid-l-squ.enable": 0}, "wait": 0.2},
        {"set": {"volid-l-pos.enable": 1, "volid-l-squ.enable": 1}, "mdi": "G53 G0 X1100 Y-10", "wait": 1.2},
        {"mdi": "G53 G0 X-100 Y610"},
    ]
    rows = np.array(run(setup(two_grids(), "volid-l-squ"), steps, pins).rows)
    # what is asked for, and what is added to X by hand: -X/100000 within the nodes, Y/100000
    wanted = [
        (0.0, 0.0, 0.0),
        (10.0, 0.0, -0.0001),
        (500.0, 300.0, -0.005 + 0.003),
        (500.0, 300.0, 0.003),
        (500.0, 300.0, 0.0),
    ]
    wanted += [(1100.0, -10.0, -0.010), (-100.0, 610.0, 0.006)]
    for i, (row, (x, y, added)) in enumerate(zip(rows[1:], wanted[1:], strict=True)):
        np.testing.assert_allclose(row[[0, 1, 2, 4]], [x - HOME + added, y + TRIM * (i > 0), x, 0.0], rtol=0, atol=1e-9)
    assert rows[0, 3] == 0.0 and rows[1, 3] == 1.0 and rows[3, 3] == 0.0 and rows[5, 3] == 1.0
    assert rows[2, 5] == 0 and rows[5, 5] == 1


def test_a_damaged_file_stops_the_start_with_its_line():
    files = written("linuxcnc-hal", spatial())
    damaged = {**files, "l_vol.grid": files["l_vol.grid"].replace("values 12", "values 13")}
    with pytest.raises(LinuxCNCError, match=r"volid-l-vol: l_vol.grid: line 11: found '13', expected the product"):
        run(setup(damaged, "volid-l-vol"), [], ["drive.x.out"], seconds=10)
