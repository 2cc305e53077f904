"""Tables .COM and .CMA: what stands in them, what other hands write, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from support.control_cases import MACHINE, crossed, error_table, job, levered, pitch, written
from support.control_contract import TRUNNION, Case, turning

from volid.compensation.package import Compensation
from volid.controllers import CONTROLS
from volid.controllers.base import options_of
from volid.exceptions import InputError

NAME = "heidenhain-com"


def cells(text: str) -> list[list[str]]:
    return [line.split() for line in text.splitlines()]


def read(files, machine=MACHINE, **options):
    return CONTROLS[NAME].read(files, machine, options_of(CONTROLS[NAME].declaration, options))


def test_pitch_with_the_values_of_both_directions():
    files = written(NAME, pitch())
    assert cells(files["XAXIS.COM"]) == [
        ["BEGIN", "XAXIS.COM", "MM"],
        ["NR", "AXISPOS", "BACKLASH", "X"],
        ["0", "0.0000", "0.0020", "0.0000"],
        ["1", "500.0000", "0.0130", "0.0100"],
        ["2", "1000.0000", "-0.0010", "-0.0040"],
        ["[END]"],
    ]
    assert cells(files["YAXIS.COM"])[2] == ["0", "0.0000", "-0.0060"], "no reversal, no value in BACKLASH"
    assert cells(files["CONFIG.CMA"]) == [
        ["BEGIN", "CONFIG.CMA"],
        ["NR", "ACTIVE", "Y", "X"],
        ["0", "*", "YAXIS.COM", "XAXIS.COM"],
        ["[END]"],
    ]


def test_what_one_axis_causes_stands_in_one_table():
    """20 µrad of X over Y: at 600 mm X is 6 µm too far; Y itself is right. Z over X bends by 3 µm."""
    files = written(NAME, crossed())
    assert cells(files["YAXIS.COM"])[1:5] == [
        ["NR", "AXISPOS", "BACKLASH", "X"],
        ["0", "0.0000", "-0.0060"],
        ["1", "300.0000", "0.0000"],
        ["2", "600.0000", "0.0060"],
    ]
    assert cells(files["XAXIS.COM"])[1] == ["NR", "AXISPOS", "BACKLASH", "X", "Z"]
    assert cells(files["XAXIS.COM"])[3] == ["1", "500.0000", "0.0100", "0.0030"]


def test_backlash_as_a_parameter_is_positive_where_the_table_travels_too_little():
    made = CONTROLS[NAME].write(job(NAME, pitch(), backlash="parameter"))
    text = next(f.content for f in made.files if f.name == "XAXIS.COM")
    assert [row[2] for row in cells(text)[2:5]] == ["0.0010", "0.0115", "-0.0025"]
    assert ("MP710 / MP_backLash of X", "0.0027", "backlash [mm], not the former") in made.parameters
    other = CONTROLS[NAME].write(job(NAME, pitch()))
    assert ("MP710, MP750 / MP_backLash of X", "0", "the reversal stands in the column BACKLASH") in other.parameters


def test_a_rotary_table_is_in_degrees_and_only_within_a_turn():
    case = Case(NAME, "R-POS", turning, "error", rotary=True)
    rows = cells(next(f.content for f in CONTROLS[NAME].write(case.job()).files if f.name == "CAXIS.COM"))
    largest = max(abs(float(row[-1])) for row in rows[2:-1])
    assert largest == pytest.approx(0.0023), "40 µrad are 0.0023°"
    tilted = Compensation(
        ("R-POS",),
        (replace(error_table("EAA", [-90, 0, 30], [0, 1e-5, 0], kind="R-POS"), applied="the axis itself"),),
        (),
    )
    with pytest.raises(
        InputError, match=r"heidenhain-com: AAXIS.COM goes from -90 to 30°; .*360° only.*below_zero=wrap"
    ):
        CONTROLS[NAME].write(case.job(tilted))
    files = {f.name: f.content for f in CONTROLS[NAME].write(case.job(tilted, below_zero="wrap")).files}
    rows = [line[1:] for line in cells(files["AAXIS.COM"])[2:-1]]
    # 10 µrad at 0 are 0.0006°; -90° stands at 270°, and 0 closes the turn
    assert rows == [["0.0000", "0.0006"], ["30.0000", "0.0000"], ["270.0000", "0.0000"], ["360.0000", "0.0006"]]
    (table,) = read(files, TRUNNION).axis_tables
    np.testing.assert_allclose(
        table.of_argument(np.array([-90.0, -45.0, 0.0, 15.0]), np.ones(4)),
        np.deg2rad([0.0, 0.0003, 0.0006, 0.0003]),
        atol=1e-12,
    )
    assert (
        read({f.name: f.content for f in CONTROLS[NAME].write(case.job()).files}, TRUNNION).axis_tables[0].period
        == 360.0
    )


def test_lever_arms_are_left_to_the_neighbour():
    made = CONTROLS[NAME].write(job(NAME, levered()))
    assert all(f.name in ("YAXIS.COM", "CONFIG.CMA") for f in made.files), "the lines alone"
    assert "L-VOL" not in CONTROLS[NAME].declaration.carries
    assert "heidenhain-kinematicscomp" in CONTROLS[NAME].declaration.nearest


X = """BEGIN XAXIS.COM INCH VERSION: 'Update:1.2'
#STRUCTBEGIN
name = "NR"
#STRUCTEND
NR      AXISPOS     BACKLASH    X           Y           Z
0       0                                               0.001
1       10                                              0.002
2       20                                              0.000
[END]
"""
CMA = """BEGIN CONFIG.CMA
NR      ACTIVE  X           Y
0       *       XAXIS.COM
[END]
"""


def test_inches_empty_columns_and_a_described_structure_are_read():
    (table,) = read({"XAXIS.COM": X, "CONFIG.CMA": CMA}).axis_tables
    assert (table.output, table.argument) == ("Z", "X")
    np.testing.assert_allclose(table.positions, [0.0, 254.0, 508.0])
    np.testing.assert_allclose(table.reverse, [0.0254, 0.0508, 0.0])


def test_one_table_alone_needs_to_be_told_its_axis():
    with pytest.raises(InputError, match=r"0 tables of the kind \.CMA; expected one"):
        read({"XAXIS.COM": X})
    (table,) = read({"XAXIS.COM": X}, cause="y").axis_tables
    assert table.argument == "Y"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[END]", "", "XAXIS.COM: the last line, .END., is missing"),
        ("BEGIN XAXIS.COM", "XAXIS.COM", "XAXIS.COM, line 1: .* begins no table"),
        ("1       10 ", "1       30 ", "XAXIS.COM, line 8: AXISPOS 508 does not rise above 762"),
        ("0.002", "0,002", "XAXIS.COM, line 7: Z is '0,002'; expected a number"),
        ("          0.002", "               ", "XAXIS.COM, line 7: Z is ''; expected a number"),
        ("   0.002", "0.002   ", "XAXIS.COM, line 7: 3 cells do not stand below their 6 columns"),
        ("   Z\n", "   C4\n", "XAXIS.COM: column 'C4' is no axis of the machine"),
        ("0.001", "nan", "XAXIS.COM, line 6: Z is 'nan'"),
    ],
)
def test_damage_is_named_with_its_line(old, new, message):
    assert old in X
    with pytest.raises(InputError, match=message):
        read({"XAXIS.COM": X.replace(old, new), "CONFIG.CMA": CMA})


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("*", " ", "CONFIG.CMA: 0 lines are active"),
        ("XAXIS.COM", "OLD.COM  ", "CONFIG.CMA, line 3: X has 'OLD.COM', which is not among the files"),
        (" X  ", " U  ", "CONFIG.CMA, line 3: column 'U' is no axis of the machine .* state the option axes"),
    ],
)
def test_an_assignment_that_names_nothing_is_refused(old, new, message):
    assert old in CMA
    with pytest.raises(InputError, match=message):
        read({"XAXIS.COM": X, "CONFIG.CMA": CMA.replace(old, new)})
