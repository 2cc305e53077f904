"""Leadscrew error compensation of the ISG kernel: lists as the vendor's pages write them."""

import numpy as np
import pytest
from support.control_cases import MACHINE, error_table, job, levered, pitch, spatial, written

import volid
from volid.compensation.package import Compensation
from volid.controllers import CONTROLS
from volid.controllers.base import options_of
from volid.exceptions import InputError

NAME = "isg-ssfk"
TRUNNION = volid.load_machine("models/wCAYXbZt_trunnion.toml")
EXAMPLE = """\
kopf.log_achs_nr 2
kopf.log_achs_name Y-ACHSE
kw.ssfk.interval 0
kw.ssfk.kw_startpos -200000
kw.ssfk.kw_nr_max 4
kw.ssfk.unit 1
kw.ssfk.bilateral 1
kw.ssfk.table[0].setpoint -200000
kw.ssfk.table[1].setpoint -199306
kw.ssfk.table[2].setpoint -198667
kw.ssfk.table[3].setpoint -198001
kw.ssfk.table[0].pos 0
kw.ssfk.table[1].pos 24
kw.ssfk.table[2].pos -102
kw.ssfk.table[3].pos -55
kw.ssfk.table[0].neg 0
kw.ssfk.table[1].neg 67
kw.ssfk.table[2].neg 80
kw.ssfk.table[3].neg 114
"""


def read(files):
    return CONTROLS[NAME].read(files, MACHINE, options_of(CONTROLS[NAME].declaration, {})).axis_tables


def test_the_worked_example_of_the_vendor_is_read():
    """19866.7 µm commanded, 19856.5 µm reached in +, 19874.7 µm in - (the list counts this place with a minus sign)."""
    (table,) = read({"achskw2.lis": EXAMPLE})
    assert table.output == table.argument == "Y"
    at = table.positions.tolist().index(-19.8667)
    assert table.forward[at] == pytest.approx(19.8565 - 19.8667, abs=1e-12)
    assert table.reverse[at] == pytest.approx(19.8747 - 19.8667, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "axis"), [("Achse_Y", "Y"), ("Y1", "Y"), ("AX2", "Y"), ("Bett", "Y"), ("X-ACHSE", None), ("C Y", "Y")]
)
def test_a_list_is_of_the_axis_that_its_name_or_its_number_says(name, axis):
    """Not of the axis whose letter another word of the name begins with, such as A of Achse, on a machine that has A and C."""
    machine = TRUNNION if axis else MACHINE
    files = {"f.lis": EXAMPLE.replace("Y-ACHSE", name)}
    options = options_of(CONTROLS[NAME].declaration, {})
    if axis:
        assert [t.output for t in CONTROLS[NAME].read(files, machine, options).axis_tables] == [axis]
        return
    with pytest.raises(InputError, match=r"line 2: kopf\.log_achs_name is X-ACHSE, but its number 2 is that of Y"):
        CONTROLS[NAME].read(files, machine, options)


def test_the_worked_example_of_the_vendor_is_written():
    x = np.array([0.0, 19.8667, 100.0])
    up, down = np.array([0.0, 19.8565 - 19.8667, 0.0]), np.array([0.0, 19.8747 - 19.8667, 0.0])
    text = written(NAME, Compensation((), (error_table("EXX", x, up, down),), ()))["x_ssfk.lis"]
    values = dict(line.split() for line in text.splitlines())
    assert values["kw.ssfk.interval"] == "0" and values["kw.ssfk.bilateral"] == "1"
    assert values["kw.ssfk.table[1].setpoint"] == "198667"
    assert (values["kw.ssfk.table[1].pos"], values["kw.ssfk.table[1].neg"]) == ("-102", "80")


def test_equal_steps_have_a_start_and_an_interval():
    """Y without reversal: one column; -6, 0 and 12 µm at 0, 300 and 600 mm in units of 0.1 µm."""
    text = written(NAME, pitch())["y_ssfk.lis"]
    assert [line.split() for line in text.splitlines()] == [
        ["kopf.achs_nr", "2"],
        ["kopf.log_achs_name", "Y"],
        ["kw.ssfk.interval", "3000000"],
        ["kw.ssfk.kw_startpos", "0"],
        ["kw.ssfk.kw_nr_max", "3"],
        ["kw.ssfk.unit", "1"],
        ["kw.ssfk.bilateral", "0"],
        ["kw.ssfk.modulo", "0"],
        ["kw.ssfk.table[0].pos", "-60"],
        ["kw.ssfk.table[1].pos", "0"],
        ["kw.ssfk.table[2].pos", "120"],
    ]


def test_rounding_is_told_and_within_half_a_step():
    made = CONTROLS[NAME].write(job(NAME, Compensation((), (error_table("EXX", [0, 500], [0.0, 0.00123]),), ())))
    assert made.rounding == pytest.approx(3e-5, abs=1e-12)  # 1.23 µm is written as 1.2 µm


def test_positions_that_are_no_multiple_of_the_unit_take_the_value_of_where_they_are_written():
    """A slope of 1 mm/m: at 100.00004 mm the file says 100.0000 mm, and the value of there."""
    made = Compensation((), (error_table("EXX", [0.0, 100.00004, 250.0], [0.0, 0.10000004, 0.25]),), ())
    (table,) = read(written(NAME, made))
    assert table.positions.tolist() == [0.0, 100.0, 250.0]
    np.testing.assert_allclose(table.forward, [0.0, 0.1, 0.25], atol=1e-12)


def test_tables_over_other_axes_and_grids_are_refused():
    with pytest.raises(InputError, match=r"moves Z by the position of another axis; isg-crosscomp"):
        written(NAME, Compensation((), (error_table("EZX", [0, 500], [0.0, 0.003]),), ()))
    with pytest.raises(InputError, match="no grid over X, Y, Z; isg-volcomp carries grids"):
        written(NAME, spatial())
    assert levered().tables[0].function == "EAY"
    with pytest.raises(InputError, match="position of another axis"):
        written(NAME, levered())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "kw.ssfk.unit 1",
            "kw.ssfk.unit 0",
            r"a.lis, line 6: kw.ssfk.unit is 0: increments of the encoder; expected 1",
        ),
        ("kw.ssfk.table[2].pos -102\n", "", r"a.lis: kw.ssfk.table\[2\].pos is missing"),
        ("table[2].setpoint -198667", "table[2].setpoint -199999", r"a.lis: kw.ssfk.table\[2\].setpoint does not rise"),
        ("kw_nr_max 4", "kw_nr_max 3", r"a.lis: kw.ssfk.kw_nr_max is 3, but table\[3\] stands in the list"),
        ("kw_nr_max 4", "kw_nr_max 4.5", r"a.lis, line 5: kw.ssfk.kw_nr_max is '4.5'; expected a whole number"),
        ("pos 24", "pos 24µ", r"a.lis, line 13: kw.ssfk.table\[1\].pos is '24µ'; expected a number"),
        ("pos 24", "pos 24\nkw.ssfk.table[1].pos 25", r"a.lis, line 14: kw.ssfk.table\[1\].pos stands twice"),
        ("log_achs_name Y-ACHSE", "log_achs_name 2. achse", "axis|Y"),
        ("kw.ssfk.bilateral 1", "kw.ssfk.bilateral", "a.lis, line 7: 'kw.ssfk.bilateral'; expected a key and a value"),
    ],
)
def test_lists_that_cannot_be_understood_are_refused_with_their_line(old, new, message):
    text = EXAMPLE.replace(old, new)
    assert text != EXAMPLE
    if "achse" in new:  # the number says the axis
        assert read({"a.lis": text})[0].output == "Y"
        return
    with pytest.raises(InputError, match=message):
        read({"a.lis": text})


def test_two_lists_of_one_axis_are_refused():
    with pytest.raises(InputError, match="axis Y has several lists"):
        read({"a.lis": EXAMPLE, "b.lis": EXAMPLE})


def test_a_turn_of_a_rotary_axis_is_counted_in_ten_thousandths_of_a_degree():
    """40 µrad are 0.00229183°, 23 units; the full turn is a modulo axis."""
    from support.control_contract import TRUNNION, Case, turning

    case = Case(NAME, "R-POS", turning, "error", True)
    (file,) = CONTROLS[NAME].write(case.job()).files
    values = dict(line.split() for line in file.content.splitlines())
    assert file.name == "c_ssfk.lis" and values["kopf.achs_nr"] == "6"
    assert values["kw.ssfk.modulo"] == "1" and values["kw.ssfk.interval"] == "900000"
    along = TRUNNION.axis("C").unit_vector[2]
    assert int(values["kw.ssfk.table[2].pos"]) == 23 * along


def test_a_repeating_list_that_does_not_close_its_turn_is_refused():
    lines = EXAMPLE.replace("Y-ACHSE", "C").replace("achs_nr 2", "achs_nr 6") + "kw.ssfk.modulo 1\n"
    with pytest.raises(InputError, match=r"modulo is 1, and the positions of C go from -20 to -19\.8001"):
        CONTROLS[NAME].read({"f.lis": lines}, TRUNNION, options_of(CONTROLS[NAME].declaration, {}))


def test_a_list_repeats_only_where_it_says_so():
    """P-COMP-00022 is 0 by default: compensation without modulo handling, though the positions are those of a turn."""
    options = options_of(CONTROLS[NAME].declaration, {})
    head = "kopf.log_achs_nr 6\nkw.ssfk.interval 1800000\nkw.ssfk.kw_startpos 0\nkw.ssfk.kw_nr_max 3\nkw.ssfk.unit 1\n"
    rows = "".join(f"kw.ssfk.table[{i}].pos {v}\n" for i, v in enumerate((0, 10, 0)))
    for line, period in (("", 0.0), ("kw.ssfk.modulo 0\n", 0.0), ("kw.ssfk.modulo 1\n", 360.0)):
        (found,) = CONTROLS[NAME].read({"c.lis": head + line + rows}, TRUNNION, options).axis_tables
        assert found.period == period


def test_half_the_reversal_alone_stands_beside_a_compensation_of_the_mean():
    """X at 500 mm: 10 µm in + and 13 µm in - are -1.5 and +1.5 µm about the mean."""
    text = written(NAME, pitch(), values="reversal")["x_ssfk.lis"]
    values = dict(line.split() for line in text.splitlines())
    assert [values[f"kw.ssfk.table[{i}].pos"] for i in range(3)] == ["-10", "-15", "-15"]
    assert [values[f"kw.ssfk.table[{i}].neg"] for i in range(3)] == ["10", "15", "15"]


def test_lines_of_cross_compensation_in_the_same_list_are_named():
    (table,) = read({"a.lis": EXAMPLE + "kw.crosscomp.unit 1\n"})
    assert table.notes == ("a.lis has lines kw.crosscomp too, which isg-crosscomp reads.",)
    assert CONTROLS[NAME].recognises("a.lis", EXAMPLE) and not CONTROLS["isg-crosscomp"].recognises("a.lis", EXAMPLE)


def test_mean_and_reversal_together_correct_both_directions():
    mean = CONTROLS["isg-volcomp"].read(written("isg-volcomp", pitch()), MACHINE, job("isg-volcomp", pitch()).options)
    half = read(written(NAME, pitch(), values="reversal"))
    both = Compensation((), mean.tables, (), half).control(MACHINE)
    q = np.stack(
        [MACHINE.order(X=x, Y=y, Z=-100.0) for x, y in ((0.0, 0.0), (250.0, 450.0), (500.0, 600.0), (1000.0, 300.0))]
    )
    for way in (1.0, -1.0):
        ways = np.full_like(q, way)
        wanted = pitch().control(MACHINE).command(q, np.zeros(3), ways)
        np.testing.assert_allclose(both.command(q, np.zeros(3), ways), wanted, atol=5.1e-5)  # half a step of 0.1 µm
