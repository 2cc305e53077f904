"""Position tables of TwinCAT NC: declarations of the PLC, and columns."""

import numpy as np
import pytest
from support.control_cases import MACHINE, error_table, pitch, spatial, written

from volid.compensation.package import Compensation
from volid.controllers import CONTROLS
from volid.controllers.base import options_of
from volid.exceptions import InputError

NAME = "twincat-nc"


def read(files, sign="error"):
    return CONTROLS[NAME].read(files, MACHINE, {**options_of(CONTROLS[NAME].declaration, {}), "sign": sign}).axis_tables


def test_declarations_for_both_directions_and_for_each():
    text = written(NAME, pitch(), "error")["position_compensation.st"]
    assert "\n".join(text.splitlines()[:12]) == (
        "VAR_GLOBAL CONSTANT\n"
        "    Y_parameter : ST_PositionCompensationTableParameter := (MinPosition := 0.0, MaxPosition := 600.0, "
        "NoOfTableElements := 3, Direction := WorkDirectionBoth, Modulo := FALSE);\n"
        "    Y_table : ARRAY[0..2] OF ST_PositionCompensationTableElement := [\n"
        "        (Position := 0.0, Compensation := -0.006),\n"
        "        (Position := 300.0, Compensation := 0.0),\n"
        "        (Position := 600.0, Compensation := 0.012)];\n"
        "    X_parameter_positive : ST_PositionCompensationTableParameter := (MinPosition := 0.0, MaxPosition := 1000.0, "
        "NoOfTableElements := 3, Direction := WorkDirectionPositive, Modulo := FALSE);\n"
        "    X_table_positive : ARRAY[0..2] OF ST_PositionCompensationTableElement := [\n"
        "        (Position := 0.0, Compensation := 0.0),\n"
        "        (Position := 500.0, Compensation := 0.01),\n"
        "        (Position := 1000.0, Compensation := -0.004)];\n"
        "    X_parameter_negative : ST_PositionCompensationTableParameter := (MinPosition := 0.0, MaxPosition := 1000.0, "
        "NoOfTableElements := 3, Direction := WorkDirectionNegative, Modulo := FALSE);"
    )
    assert text.endswith("END_VAR\n")


def test_columns_hold_the_same_numbers_with_the_sign_that_is_stated():
    files = written(NAME, pitch(), "compensation")
    assert files["x.csv"] == "position,positive,negative\n0.0,0.0,-0.002\n500.0,-0.01,-0.013\n1000.0,0.004,0.001\n"
    columns = read({"x.csv": files["x.csv"]}, "compensation")
    declared = [t for t in read(files, "compensation") if t.output == "X"]
    for one, other in zip(columns, declared, strict=True):
        np.testing.assert_array_equal(one.positions, other.positions)
        np.testing.assert_array_equal(one.forward, other.forward)
        np.testing.assert_array_equal(one.reverse, other.reverse)


def test_unequal_steps_become_equal_ones_that_contain_them():
    made = Compensation((), (error_table("EXX", [0, 100, 400], [0.0, 0.01, 0.04]),), ())
    (table,) = read(written(NAME, made, "error"))
    assert table.positions.tolist() == [0.0, 100.0, 200.0, 300.0, 400.0]
    np.testing.assert_allclose(table.forward, [0.0, 0.01, 0.02, 0.03, 0.04], atol=1e-12)


def test_a_direction_without_a_table_is_not_corrected():
    text = (
        "X_table : ARRAY[0..1] OF ST_PositionCompensationTableElement := [(Position := 0, Compensation := 1e-2), "
        "(Position := 9, Compensation := 0.02)];\n"
        "X_parameter : ST_PositionCompensationTableParameter := (NoOfTableElements := 2, Direction := WorkDirectionNegative);\n"
    )
    (table,) = read({"a.st": text})
    assert table.forward.tolist() == [0.0, 0.0] and table.reverse.tolist() == [0.01, 0.02]


GOOD = (
    "X_table : ARRAY[0..1] OF ST_PositionCompensationTableElement := [(Position := 0, Compensation := 0), "
    "(Position := 9, Compensation := 0.02)];\n"
    "X_parameter : ST_PositionCompensationTableParameter := (NoOfTableElements := 2, Direction := WorkDirectionBoth);\n"
)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[0..1]", "[0..2]", "a.st, line 1: X_table: 2 elements, but the array has 3"),
        ("Position := 9", "Position := 0", "a.st, line 1: X_table: positions do not rise"),
        ("0.02", "#2", "a.st, line 1: X_table: '#2'; expected a number"),
        (
            "0.02)",
            "0.02, Extra := 1)",
            r"a.st, line 1: X_table: '\(Position := 9, .*'; expected \(Position := …, Compensation",
        ),
        ("X_parameter", "Y_parameter", "a.st, line 1: X_table: no ST_PositionCompensationTableParameter of that name"),
        ("Elements := 2", "Elements := 5", "a.st, line 1: X_table: 2 elements, but NoOfTableElements is 5"),
        ("WorkDirectionBoth", "WorkDirectionNone", "a.st, line 1: X_table: Direction is 'WorkDirectionNone'; expected"),
        ("X_table", "MyTable", "a.st, line 1: MyTable: the name 'MyTable' does not say the axis"),
        (
            "NoOf",
            "MinPosition := 0, MaxPosition := 8, NoOf",
            "a.st, line 1: X_table: MaxPosition is 8, but the table has 9 there",
        ),
        ("];", ")", "a.st: 1 tables are named, 0 understood"),
        ("X_", "A_", "A"),
    ],
)
def test_declarations_that_cannot_be_understood_are_refused(old, new, message):
    text = GOOD.replace(old, new)
    assert text != GOOD
    with pytest.raises(InputError, match=message):
        read({"a.st": text})


def test_two_tables_for_one_direction_are_refused():
    again = GOOD.replace("X_table", "X_table_negative").replace("X_parameter", "X_parameter_negative")
    with pytest.raises(InputError, match="X has 2 tables for WorkDirectionPositive; expected one"):
        read({"a.st": GOOD + again})


def test_columns_that_cannot_be_understood_are_refused():
    with pytest.raises(InputError, match=r"x\.csv, line 3: 2 columns; expected position, value in"):
        read({"x.csv": "position,positive,negative\n0,0,0\n1,2\n"})
    with pytest.raises(InputError, match=r"x\.csv: no rows, or positions that do not rise"):
        read({"x.csv": "position,positive,negative\n"})
    good = "position,positive,negative\n0,0,0\n1,2,2\n"
    assert [t.output for t in read({"axis_x.csv": good})] == ["X"]
    for name in ("compensation.csv", "x_y.csv"):
        with pytest.raises(InputError, match=f"the name '{name[:-4]}' does not say the axis"):
            read({name: good})


def test_tables_over_other_axes_and_grids_are_refused():
    with pytest.raises(
        InputError, match="moves Z by the position of another axis: .*FB_PositionCompensation".replace(".*", "[^$]*")
    ):
        written(NAME, Compensation((), (error_table("EZX", [0, 500], [0.0, 0.003]),), ()), "error")
    with pytest.raises(InputError, match="no grid over X, Y, Z; isg-volcomp carries grids"):
        written(NAME, spatial(), "error")
