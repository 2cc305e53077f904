"""The commissioning sheet: its sign checks written out by hand, and what a person must be able to read from it."""

from dataclasses import replace

import numpy as np
import pytest
from support.control_cases import MACHINE, error_table, job, levered, pitch, spatial

from volid.compensation.helping_axes import HelpingMotion
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable, Factor
from volid.controllers import CONTROLS
from volid.controllers.base import ONE_VALUE, OPEN, Written
from volid.controllers.export import Export
from volid.controllers.handover.sheet import commissioning_sheet
from volid.controllers.handover.sign_check import sign_checks

JOB = job("linuxcnc", pitch())


def held(**parts) -> Compensation:
    return Compensation((), parts.get("tables", ()), parts.get("grids", ()), parts.get("axis_tables", ()))


def row(check):
    return check.table, dict(check.at), check.way, check.axis, round(check.alone, 6), round(check.together, 6)


def test_tables_of_axes_are_checked_where_and_whence_they_move_most():
    """X is 13 µm too far at 500 when it comes from above, and 12 µm · 288/300 at Y = 588: it is moved back by that.

    The end of the travel, Y = 600, cannot be approached from above: 2 % of it stay free.
    """
    x, y = np.array([0.0, 500.0, 1000.0]), np.array([0.0, 300.0, 600.0])
    found = sign_checks(
        held(
            axis_tables=(
                AxisTable("X", "X", x, np.array([0.0, 0.010, -0.004]), np.array([0.002, 0.013, -0.001]), source="EXX"),
                AxisTable("X", "Y", y, np.array([-0.002, 0.0, 0.012]), np.array([-0.002, 0.0, 0.012]), source="EXY"),
            )
        ),
        JOB,
    )
    assert [row(c) for c in found] == [
        ("table of EXX: X over X", {"Y": 300.0, "X": 500.0, "Z": -250.0}, -1.0, "X", -0.013, -0.013),
        (
            "table of EXY: X over Y",
            {"Y": 588.0, "X": 500.0, "Z": -250.0},
            1.0,
            "X",
            -0.01152,
            -0.02152,
        ),  # and -10 µm of EXX
    ]


def test_with_one_value_of_reversal_the_mean_is_checked():
    x = np.array([0.0, 500.0, 1000.0])
    table = AxisTable("X", "X", x, np.array([0.0, 0.010, -0.004]), np.array([0.002, 0.013, -0.001]))
    (check,) = sign_checks(held(axis_tables=(table,)), JOB, both=False)
    assert (check.way, check.alone) == (0.0, pytest.approx(-0.0115))


def test_a_product_is_checked_near_the_end_of_its_lever():
    """19.6 µrad at Y = 588 times 240 mm of Z below its line: error -4.704 µm, so that it moves by +4.704 µm."""
    y = np.array([0.0, 600.0])
    lever = Factor("Z", np.array([-500.0, 0.0]), np.array([-250.0, 250.0]))
    table = AxisTable("Y", "Y", y, np.array([0.0, 20e-6]), np.array([0.0, 20e-6]), lever, "EAY")
    (check,) = sign_checks(held(axis_tables=(table,)), JOB)
    assert row(check) == (
        "table of EAY: Y over Y, times Z",
        {"Y": 588.0, "X": 500.0, "Z": -490.0},
        1.0,
        "Y",
        0.004704,
        0.004704,
    )
    assert check.is_together
    (line,) = [x for x in commissioning_sheet(made(axis_tables=(table,))).splitlines() if "[ ] table of EAY" in x]
    assert [cell.strip() for cell in line.strip("|").split("|")][4:] == ["-", "-", "+0.0047 mm"]


def test_a_point_shows_the_same_direction_alone_and_with_everything_loaded():
    """At X = 600 EYX alone moves Y most, 6 µm up, but EYY takes it down by 8 µm: at X = 400 a third table undoes EYY.

    Errors there are -5 µm, 8 µm and -8 µm, so that EYX moves Y by 5 µm alone, and so does everything together.
    """
    x, y = np.array([0.0, 200.0, 400.0, 600.0, 1000.0]), np.array([0.0, 300.0, 600.0])
    values = {
        "EYX": (x, [0.0, 0.0, -0.005, -0.006, 0.0]),
        "other": (x, [0.0, 0.0, -0.008, 0.0, 0.0]),
        "EYY": (y, [0.008] * 3),
    }
    tables = tuple(
        AxisTable("Y", "Y" if n == "EYY" else "X", q, np.array(v), np.array(v), source=n)
        for n, (q, v) in values.items()
    )
    check = sign_checks(held(axis_tables=tables), JOB)[0]
    assert row(check)[1:] == ({"Y": 300.0, "X": 400.0, "Z": -250.0}, 1.0, "Y", 0.005, 0.005)


def test_where_no_point_shows_the_same_direction_the_table_alone_is_shown():
    """EYX moves Y up by 5 µm at X = 400, where another table takes 6 µm off; 1 µm at X = 600 is nothing for a dial."""
    x = np.array([0.0, 200.0, 400.0, 600.0, 1000.0])
    values = {"EYX": [0.0, 0.0, -0.005, -0.001, 0.0], "other": [0.0, 0.0, 0.006, 0.0, 0.0]}
    tables = tuple(AxisTable("Y", "X", x, np.array(v), np.array(v), source=n) for n, v in values.items())
    check = sign_checks(held(axis_tables=tables), JOB)[0]
    assert row(check)[1:] == ({"Y": 300.0, "X": 400.0, "Z": -250.0}, 1.0, "Y", 0.005, -0.001)


def test_ends_of_travels_are_no_places():
    """The table reaches over both ends of X, 0 … 1000, and is largest there."""
    x = np.linspace(-100.0, 1100.0, 13)
    table = AxisTable("X", "X", x, 1e-5 * (x - 450.0), 1e-5 * (x - 450.0))
    (check,) = sign_checks(held(axis_tables=(table,)), JOB)
    assert (check.at["X"], round(check.alone, 6)) == (900.0, -0.0045)


def test_a_function_of_a_model_is_checked_on_the_axis_that_it_moves_most():
    """The pitch of Y' of 20 µrad at its end turns the point about the origin: X stays, Y or Z move with the larger lever arm."""
    (check,) = sign_checks(levered(), JOB)
    assert (check.table, check.axis, abs(round(check.alone, 6))) == (
        "table of EAY over Y",
        "Y",
        0.012288,
    )  # 20 µrad · (588 - 300)/(600 - 300) · 640 mm
    assert (check.at["Y"], check.at["Z"]) == (
        588.0,
        -490.0,
    )  # the functional point 640 mm below the origin: Z -490, tool 150


def test_a_grid_has_one_check_for_each_axis_that_it_moves():
    """dX = 10 µm · X/1000, dY = -5 µm · Z/500, dZ = 2 µm: largest at X = 980, at Z = -490, everywhere."""
    found = {c.axis: c for c in sign_checks(spatial(), JOB)}
    assert {a: round(c.alone, 6) for a, c in found.items()} == {"X": -0.0098, "Y": -0.0049, "Z": -0.002}
    assert found["X"].at["X"] == 980.0 and found["Y"].at["Z"] == -490.0


def test_what_moves_nothing_has_no_check():
    x = np.array([0.0, 1000.0])
    zero = AxisTable("X", "X", x, 0.0 * x, 0.0 * x)
    assert sign_checks(held(axis_tables=(zero,)), JOB) == ()
    assert "All values are zero" in commissioning_sheet(made(axis_tables=(zero,)))


def made(declaration=None, notes=(), helping=(), **parts) -> Export:
    """An export of held tables, of LinuxCNC or of a control with another declaration."""
    control = CONTROLS["linuxcnc"]
    if declaration:
        control = type("Other", (type(control),), {"declaration": replace(control.declaration, **declaration)})()
    return Export(
        control, JOB, Written((), (("P1", "7", "a meaning"),)), held(**parts), ("L-POS",), helping=helping, notes=notes
    )


def test_the_sheet_says_what_must_be_seen():
    x = np.array([0.0, 500.0, 1000.0])
    table = AxisTable("X", "X", x, np.array([0.0, 0.010, -0.004]), np.array([0.0, 0.010, -0.004]), source="EXX")
    text = commissioning_sheet(made(axis_tables=(table,), notes=("a note",)))
    (line,) = [line for line in text.splitlines() if "[ ] table of EXX" in line]
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells == [
        "[ ] table of EXX: X over X", "Y 300  X 500  Z -250", "below (+)", "X", "-0.0100 mm", "X 499.990000", "-0.0100 mm",
    ]  # fmt: skip
    assert "| P1        | 7     | a meaning |" in text and "- a note" in text
    assert "table of EXX: X over X, 0 … 1000 (3 positions)" in text


def test_an_open_sign_is_said_in_the_sheet_and_a_reversal_value_is_put_to_zero():
    x = np.array([0.0, 1000.0])
    table = AxisTable("X", "X", x, np.array([0.0, 0.01]), np.array([0.0, 0.01]))
    text = commissioning_sheet(made({"sign": OPEN, "reversal": ONE_VALUE}, axis_tables=(table,)))
    assert "Public sources do not say which sign this control wants" in text
    assert "Set the reversal value (backlash) of the axes to 0 for this check" in text
    assert "Public sources" not in commissioning_sheet(made(axis_tables=(table,))).split("## 6.")[0]


def test_axes_that_only_help_stand_in_the_sheet():
    one = HelpingMotion("Y", "X", 0.012, 3, 0.0004, 0.001, 0.004)
    text = commissioning_sheet(made(helping=(one,), tables=(error_table("EXX", [0, 1000], [0.0, 0.01]),)))
    assert (
        "While Y moves, X is moved by up to 12.00 µm and turns 3 times; each turn loses its own reversal of 4.00 µm; runs of "
        "0.40 µm are below its least increment of 1.00 µm." in text
    )


def test_names_from_files_cannot_break_the_sheet():
    strange = replace(MACHINE, name="a|b\nc\x1b[2J")
    odd = replace(made(), job=replace(JOB, machine=strange))
    assert "\x1b" not in commissioning_sheet(odd)


def test_the_sheet_says_what_options_made_of_the_files():
    said = {}
    for options in ({}, {"comp_file_type": "1", "units": "inch"}, {"reversal": "backlash"}):
        text = commissioning_sheet(replace(made(), job=job("linuxcnc", pitch(), **options)))
        rows = [[c.strip() for c in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]
        cells = {r[0]: r[1] for r in rows}
        said[tuple(options)] = cells["sign"], cells["units"], cells["reversal"]
    assert said[()] == ("actual positions: nominal + error", "mm, degrees for rotary joints", "both directions")
    assert said["comp_file_type", "units"] == (
        "what is added to the command, -(actual - nominal)",
        "inch, degrees for rotary joints",
        "both directions",
    )
    assert said["reversal",][2] == "one value for the axis"


def test_names_keep_their_letters_at_the_beginning_of_a_sentence():
    text = commissioning_sheet(made({"switching": "lr_param.ssfk of the axis"}))
    assert "\nlr_param.ssfk of the axis.\n" in text
