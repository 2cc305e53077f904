"""Files of COMP_FILE and lines of the INI file: written out by hand, read as LinuxCNC would."""

from dataclasses import replace

import numpy as np
import pytest
from support.control_cases import MACHINE, crossed, error_table, job, pitch, written
from support.control_contract import TRUNNION, turning
from support.malformed_comp_files import CASES

from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.controllers import CONTROLS
from volid.controllers.base import options_of
from volid.exceptions import InputError

LINUXCNC = CONTROLS["linuxcnc"]


def read(files, machine=MACHINE, **options):
    return LINUXCNC.read(files, machine, options_of(LINUXCNC.declaration, options)).axis_tables


def numbers(text: str) -> list[list[float]]:
    return [[float(v) for v in line.split()] for line in text.splitlines()]


def only(function: str, positions, forward, reverse=None) -> Compensation:
    return Compensation(("L-POS",), (error_table(function, positions, forward, reverse),), ())


def test_actual_positions_as_the_manual_wants_them():
    files = written("linuxcnc", pitch())
    assert numbers(files["x.comp"]) == [[0.0, 0.0, 0.002], [500.0, 500.010, 500.013], [1000.0, 999.996, 999.999]]
    assert files["x.comp"].splitlines()[1] == "500.0 500.01 500.013"


def test_what_is_added_to_the_command_is_minus_the_error():
    files = written("linuxcnc", pitch(), comp_file_type="1")
    assert numbers(files["x.comp"]) == [[0.0, 0.0, -0.002], [500.0, -0.010, -0.013], [1000.0, 0.004, 0.001]]
    assert numbers(files["y.comp"]) == [[0.0, 0.006, 0.006], [300.0, 0.0, 0.0], [600.0, -0.012, -0.012]]
    assert "-0.0 " not in files["x.comp"]


def test_lines_of_the_ini_file_by_joint():
    lines = [r for r in written("linuxcnc", pitch())["linuxcnc.ini"].splitlines() if not r.startswith("#")]
    x, y = (["COMP_FILE_TYPE = 0", f"COMP_FILE = {a}.comp"] for a in "xy")
    assert lines == ["[JOINT_0]", *x, "[JOINT_1]", *y]
    gantry = written("linuxcnc", pitch(), coordinates="YXYZ")["linuxcnc.ini"]
    sections = [
        (r[7], gantry[gantry.index(r) :].split("COMP_FILE = ")[1][0]) for r in gantry.splitlines() if r[:1] == "["
    ]
    assert sorted(sections) == [("0", "y"), ("1", "x"), ("2", "y")]


def test_one_backlash_value_and_no_file():
    """X moves 2 µm less in + than in - at 0, 3 µm at 500 and 1000: BACKLASH takes up the mean, 2.667 µm."""
    files = written("linuxcnc", pitch(), reversal="backlash")
    assert list(files) == ["linuxcnc.ini"]
    assert "[JOINT_0]\n# X: minus its mean reversal value\nBACKLASH = 0.002666667\n" in files["linuxcnc.ini"]
    (x,) = (t for t in read(files) if t.output == "X")
    assert x.at({"X": np.array([0.0, 900.0])}, {"X": np.array([1.0, -1.0])}) == pytest.approx(
        [-0.004 / 3, 0.004 / 3], abs=1e-8
    )
    (note, *_) = LINUXCNC.write(job("linuxcnc", pitch(), reversal="backlash")).notes
    assert (
        "mean reversal of -2.67 µm alone" in note
        and "up to 11.50 µm, stays" in note
        and "up to 0.33 µm of the reversal" in note
    )


def test_inches():
    files = written("linuxcnc", only("EXX", [0, 254, 508], [0.0, 0.0254, -0.0508]), units="inch")
    assert numbers(files["x.comp"]) == [[0.0, 0.0, 0.0], [10.0, 10.001, 10.001], [20.0, 19.998, 19.998]]
    (x,) = read(files, units="inch")
    assert x.positions == pytest.approx([0.0, 254.0, 508.0]) and x.forward == pytest.approx(
        [0.0, 0.0254, -0.0508], abs=1e-7
    )


def test_a_rotary_joint_counts_in_degrees_in_any_unit():
    for units in ("mm", "inch"):
        files = LINUXCNC.write(job("linuxcnc", turning(), machine=TRUNNION, units=units, comp_file_type="1")).files
        rows = numbers(next(f.content for f in files if f.name == "c.comp"))
        assert [r[0] for r in rows] == [0.0, 90.0, 180.0, 270.0, 360.0]
        assert rows[2][1] == pytest.approx(-np.rad2deg(40e-6), abs=1e-9)


def test_a_table_of_one_turn_is_written_over_all_turns_of_the_travel():
    """LinuxCNC holds the end value and does not roll over."""
    axis = np.array([0.0, 180.0, 360.0])
    e = np.array([0.0, 40e-6, 0.0])
    table = AxisTable("C", "C", axis, e, e, period=360.0)
    axes = tuple(replace(a, travel=(-200.0, 400.0)) if a.letter == "C" else a for a in TRUNNION.axes)
    wide = replace(TRUNNION, axes=axes)
    made = Compensation((), (), (), (table,))
    text = next(f.content for f in LINUXCNC.write(job("linuxcnc", made, machine=wide, comp_file_type="1")).files)
    rows = np.array(numbers(text))
    assert rows[:, 0].tolist() == [-200.0, -180.0, 0.0, 180.0, 360.0, 400.0]
    wanted = -np.rad2deg(40e-6) * np.array([160 / 180, 1.0, 0.0, 1.0, 0.0, 40 / 180])
    assert rows[:, 1] == pytest.approx(wanted, abs=1e-9)


def test_tables_of_one_axis_are_added():
    one, two = (
        AxisTable("X", "X", np.array(x), np.array(e), np.array(e))
        for x, e in (([0.0, 100.0], [0.0, 0.010]), ([50.0, 150.0], [0.002, 0.004]))
    )
    text = written("linuxcnc", Compensation((), (), (), (one, two)), comp_file_type="1")["x.comp"]
    assert numbers(text) == [
        [0.0, -0.002, -0.002],
        [50.0, -0.007, -0.007],
        [100.0, -0.013, -0.013],
        [150.0, -0.014, -0.014],
    ]


def test_what_moves_another_axis_is_refused():
    with pytest.raises(InputError, match=r"linuxcnc: EXY moves X by the position of Y.*linuxcnc-hal.*Export L-POS"):
        LINUXCNC.write(job("linuxcnc", crossed()))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_none_are_refused(value):
    with pytest.raises(InputError, match="linuxcnc: the table of X is not finite everywhere"):
        written(
            "linuxcnc",
            Compensation((), (), (), (AxisTable("X", "X", np.array([0.0, 1.0]), np.array([0.0, value]), np.zeros(2)),)),
        )


def test_positions_rise_after_rounding():
    x = np.array([0.0, 100.0, 100.0 + 1e-11, 200.0])
    same = AxisTable("X", "X", x, np.array([0.0, 0.01, 0.01, 0.0]), np.zeros(4))
    assert [r[0] for r in numbers(written("linuxcnc", Compensation((), (), (), (same,)))["x.comp"])] == [
        0.0,
        100.0,
        200.0,
    ]
    step = AxisTable("X", "X", x, np.array([0.0, 0.01, 0.02, 0.0]), np.zeros(4))
    with pytest.raises(InputError, match=r"two values at 100\.000000000; LinuxCNC wants positions that rise"):
        written("linuxcnc", Compensation((), (), (), (step,)))


def test_the_step_after_homing_is_said():
    notes = LINUXCNC.write(job("linuxcnc", pitch())).notes
    assert notes[0].startswith("X: at HOME = 0 mm the correction is 0.00 µm for motion in +, -2.00 µm in -")
    assert LINUXCNC.write(job("linuxcnc", only("EXX", [0, 500], [0.0, 0.01]))).notes == ()
    notes = LINUXCNC.write(job("linuxcnc", pitch(), home="X=500,Y=300")).notes
    assert (
        len(notes) == 1
        and notes[0].startswith("X: at HOME = 500 mm")
        and "-10.00 µm" in notes[0]
        and "-13.00 µm" in notes[0]
    )


def test_a_whole_ini_file_of_somebody_else_is_read():
    ini = """# machine
[TRAJ]
COORDINATES = X Y Y Z
LINEAR_UNITS = inch
[JOINT_0]
COMP_FILE = tables/pitch_of_x.txt
COMP_FILE = other.comp
BACKLASH = 5
[JOINT_1]
BACKLASH = 0.001
[JOINT_2]
BACKLASH = 0.001
[JOINT_3]
COMP_FILE_TYPE = 1
COMP_FILE = z.comp
"""
    files = {"mill.ini": ini, "pitch_of_x.txt": "0 0 0\n10 10.001 10.002\n", "z.comp": "-10 0.001 0.002\n0 0 0\n"}
    x, y, z = read(files)
    assert (x.output, y.output, z.output) == ("X", "Y", "Z")
    assert x.positions == pytest.approx([0.0, 254.0]) and x.forward == pytest.approx([0.0, 0.0254])
    assert y.forward == pytest.approx(-0.0127) and y.reverse == pytest.approx(0.0127)
    assert z.positions == pytest.approx([-254.0, 0.0]) and z.reverse == pytest.approx([-0.0508, 0.0])


@pytest.mark.parametrize(
    "files, message",
    [
        (
            {"a.ini": "[JOINT_0]\nCOMP_FILE = x.comp\n"},
            r"a\.ini, \[JOINT_0\] COMP_FILE: x\.comp is not among the files",
        ),
        ({"a.ini": "[JOINT_7]\nBACKLASH = 1\n"}, r"a\.ini, \[JOINT_7\]: no axis of the machine has joint 7"),
        ({"a.ini": "[JOINT_0]\nBACKLASH = 1,5\n"}, r"a\.ini, \[JOINT_0\] BACKLASH: '1,5'; expected a number"),
        (
            {"a.ini": "[TRAJ]\nLINEAR_UNITS = cubit\n[JOINT_0]\nBACKLASH = 1\n"},
            r"a\.ini, \[TRAJ\]: expected mm or inch",
        ),
        (
            {"a.ini": "[JOINT_0]\nCOMP_FILE = x.comp\n", "x.comp": "0 0 0\n", "y.comp": "0 0 0\n"},
            r"y\.comp: a\.ini does not name it",
        ),
        ({"a.ini": "", "b.ini": ""}, r"b\.ini: a second INI file"),
        ({"a.ini": "lorem"}, "neither COMP_FILE nor BACKLASH"),
        ({"table.txt": "0 0 0\n"}, r"table\.txt: its name does not say which axis of Y, X, Z"),
        (
            {"x.comp": "0 0.01 0.01\n500 0.02 0.02\n"},
            r"x\.comp: deviations of up to 499\.98 .* State `comp_file_type=1`",
        ),
        ({"x.comp": "0 0 0\n", "x-new.comp": "0 0.001 0\n"}, "two different tables of axis X"),
        ({"x.comp": "0 0 0\n1 nan 0\n"}, r"x\.comp, line 2: '1 nan 0'; expected three numbers"),
        ({"x.comp": "0 0 0\n0x10 0 0\n"}, r"x\.comp, line 2"),
        ({"x.comp": "0 0 0\n1 1" + " " * 260 + "1\n"}, r"x\.comp, line 2: 264 characters; LinuxCNC reads at most 254"),
    ],
)
def test_one_message_for_what_linuxcnc_would_not_load(files, message):
    with pytest.raises(InputError, match=message):
        read(files)


@pytest.mark.parametrize("name", CASES)
def test_malformed_tables_are_refused_or_read_as_linuxcnc_does(name):
    case = CASES[name]
    if case.message is not None:
        with pytest.raises(InputError, match=rf"(?s)x\.comp.*{case.message}"):
            read({"x.comp": case.content}, comp_file_type=1)
        return
    (table,) = read({"x.comp": case.content}, comp_file_type=1)
    found = [-float(table.at({"X": x}, {"X": 1.0})) for x in (50.0, 150.0, 260.0)]
    assert found == pytest.approx(case.found, abs=1e-9)


@pytest.mark.parametrize(
    "option, value",
    [("units", "furlong"), ("coordinates", "XQ"), ("home", "X"), ("home", "X=nan"), ("reversal", "both")],
)
def test_options_say_what_they_take(option, value):
    with pytest.raises(InputError, match=f"linuxcnc: option {option} is '{value}'; expected"):
        options_of(LINUXCNC.declaration, {option: value})


def test_every_axis_needs_a_joint():
    with pytest.raises(InputError, match="`coordinates=XY`: the machine's axis Z has no joint"):
        written("linuxcnc", pitch(), coordinates="XY")


def test_a_machine_in_inches_is_told_that_its_sheet_is_in_mm():
    for unit, said in (("inch", True), ("mm", False)):
        notes = CONTROLS["linuxcnc"].write(job("linuxcnc", pitch(), units=unit)).notes
        assert any("sheet are in mm: command them after G21" in n for n in notes) == said
