"""Files of $AA_ENC_COMP, as the manual describes them: what stands in them, what is refused, what other programs write."""

from dataclasses import replace

import numpy as np
import pytest
from support.control_cases import MACHINE, crossed, error_table, job, pitch, written
from support.control_contract import TRUNNION

from volid.compensation.package import Compensation
from volid.controllers import CONTROLS
from volid.controllers.base import Job, options_of
from volid.exceptions import InputError

NAME = "sinumerik-enc-comp"


def assignments(text: str) -> dict[str, float]:
    pairs = (line.partition(";")[0].partition("=") for line in text.splitlines() if line.startswith("$"))
    return {left.strip(): float(right) for left, _, right in pairs}


def read(files, machine=MACHINE, **options):
    return CONTROLS[NAME].read(files, machine, options_of(CONTROLS[NAME].declaration, options))


def test_mean_of_both_directions_with_its_steps_and_ends():
    found = assignments(written(NAME, pitch())["x_eec.ini"])
    assert found == {
        "$AA_ENC_COMP[0,0,X1]": 0.001,
        "$AA_ENC_COMP[0,1,X1]": 0.0115,
        "$AA_ENC_COMP[0,2,X1]": -0.0025,
        "$AA_ENC_COMP_STEP[0,X1]": 500.0,
        "$AA_ENC_COMP_MIN[0,X1]": 0.0,
        "$AA_ENC_COMP_MAX[0,X1]": 1000.0,
        "$AA_ENC_COMP_IS_MODULO[0,X1]": 0.0,
    }


def test_backlash_is_positive_where_the_table_lags_behind():
    """X stands 2, 3 and 3 µm farther back when it comes in +: the encoder leads, 2.667 µm on average."""
    made = CONTROLS[NAME].write(job(NAME, pitch()))
    text = next(f.content for f in made.files if f.name == "x_eec.ini")
    assert "; MD32450 $MA_BACKLASH[0,X1]=0.002666667" in text.splitlines()
    assert any("MD32450" in name and value == "0.002666667" for name, value, _ in made.parameters)
    assert any("X: the reversal changes along the axis" in note and "0.33 µm" in note for note in made.notes)


def test_names_of_axes_and_second_encoder():
    text = written(NAME, pitch(), axes="X=AX3, Y=ax1", encoder="1")["y_eec.ini"]
    assert "$AA_ENC_COMP[1,2,AX1]=0.012000000" in text.splitlines()
    back = read({"y.ini": text}, axes="X=AX3,Y=AX1", encoder="1")
    assert [t.output for t in back.axis_tables] == ["Y"]
    with pytest.raises(InputError, match=r"no \$AA_ENC_COMP of encoder 0; the files have encoders 1"):
        read({"y.ini": text}, axes="X=AX3,Y=AX1")
    with pytest.raises(
        InputError, match=r"y.ini, line \d+: machine axis 'AX1' belongs to no axis .* such as axes=Y=AX1"
    ):
        read({"y.ini": text}, encoder="1")


def round_and_round():
    """The trunnion whose C goes round twice each way."""
    axes = tuple(replace(a, travel=(-720.0, 720.0)) if a.letter == "C" else a for a in TRUNNION.axes)
    return replace(TRUNNION, axes=axes)


def test_a_full_turn_is_modulo_and_in_degrees():
    """C is 40 µrad too far at 180°: 40e-6 · 180 / pi = 0.002291831°."""
    turn = Compensation(
        ("R-POS",), (error_table("ECC", [0, 90, 180, 270, 360], [0, 0, 40e-6, 0, 0], kind="R-POS"),), ()
    )
    tables = tuple(replace(t, applied="the axis itself", period=360.0) for t in turn.tables)
    declared = CONTROLS[NAME].declaration
    at = np.zeros(len(TRUNNION.axes))
    made = Job(TRUNNION, replace(turn, tables=tables), at, np.zeros(3), "error", options_of(declared, {}))
    text = CONTROLS[NAME].write(made).files[0].content
    found = assignments(text)
    assert found["$AA_ENC_COMP_IS_MODULO[0,C1]"] == 1.0 and found["$AA_ENC_COMP_MAX[0,C1]"] == 360.0
    assert abs(found["$AA_ENC_COMP[0,2,C1]"]) == pytest.approx(0.002291831, abs=1e-9)
    assert not any("covers" in note for note in CONTROLS[NAME].write(replace(made, machine=round_and_round())).notes)
    (table,) = read({"c.ini": text}, TRUNNION).axis_tables
    assert table.period == 360.0
    assert table.of_argument(np.array([540.0]), np.zeros(1)) == pytest.approx(
        table.of_argument(np.array([180.0]), np.zeros(1))
    )


def test_cross_tables_are_refused_and_the_neighbour_named():
    with pytest.raises(InputError, match=r"sinumerik-enc-comp: the table of X over Y \(EXY\).*sinumerik-cec"):
        written(NAME, crossed())


def test_md38000_is_kept():
    with pytest.raises(InputError, match="the table of Y has 3 positions; MD38000 allows 2"):
        written(NAME, pitch(), max_points="2")


def test_what_stands_at_the_reference_point_and_beyond_the_table_is_said():
    part = Compensation(("L-POS",), (error_table("EXX", [200, 500, 800], [0.004, 0.010, -0.006]),), ())
    notes = CONTROLS[NAME].write(job(NAME, part, reference="X=500")).notes
    assert any("the table is 0.010000 mm at the reference point 500" in n for n in notes)
    assert any("covers 200 … 800 mm of the travel 0 … 1000" in n and "0.004000 and -0.006000" in n for n in notes)


def test_unequal_positions_become_equal_steps_with_the_same_values():
    uneven = Compensation(("L-POS",), (error_table("EXX", [0, 100, 400, 1000], [0.0, 0.004, 0.001, -0.005]),), ())
    found = assignments(written(NAME, uneven)["x_eec.ini"])
    assert found["$AA_ENC_COMP_STEP[0,X1]"] == 100.0
    assert [found[f"$AA_ENC_COMP[0,{n},X1]"] for n in range(11)] == [
        0.0, 0.004, 0.003, 0.002, 0.001, 0.0, -0.001, -0.002, -0.003, -0.004, -0.005,
    ]  # fmt: skip


AS_ANOTHER_PROGRAM_WRITES_IT = """
N10 $AA_ENC_COMP_MAX[ 0 , x1 ] = 1000
; the last assignment is what the control holds
$aa_enc_comp[0,1,X1]=0.5
$AA_ENC_COMP_STEP[0,X1]=1000 ; one step
$AA_ENC_COMP_MIN[0,X1]=0
$AA_ENC_COMP[0,1,X1]=0.01
$AA_ENC_COMP[0,0,X1]=0
$AA_ENC_COMP[0,7,X1]=9.0 ; beyond MAX: never used
$AN_CEC[0,0]=0.1
m30
"""


def test_other_order_blanks_and_comments_are_read():
    (table,) = read({"a.ini": AS_ANOTHER_PROGRAM_WRITES_IT}).axis_tables
    assert table.positions.tolist() == [0.0, 1000.0] and table.forward.tolist() == [0.0, 0.01]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("$AA_ENC_COMP[0,0,X1]=0\n", "", r"line 5: \$AA_ENC_COMP of X has no value at point 0 of 0 … 1"),
        ("STEP[0,X1]=1000", "STEP[0,X1]=300", r"line 5: .*\(MAX - MIN\) / STEP = 3.33333"),
        ("STEP[0,X1]=1000", "STEP[0,X1]=-10", r"line 5: .*expected a step above 0"),
        ("=0.01\n", "=0,01\n", r"line 7: \$AA_ENC_COMP is '0,01'; expected a number"),
        ("=0.01\n", "=nan\n", r"line 7: \$AA_ENC_COMP is 'nan'; expected a number"),
        ("[0,7,X1]", "[0,7]", r"line 9: .*is unknown; expected"),
        ("[0,7,X1]", "[0,-7,X1]", r"line 9: .*has the index '-7'"),
        ("m30", "G1 X10", r"line 11: 'G1 X10' is no assignment"),
        ("$AA_ENC_COMP_MIN[0,X1]=0\n", "", "MIN is not assigned"),
        ("m30", "$MA_BACKLASH[X1]=0.01", r"line 11: \$MA_BACKLASH\[X1\]; expected \$MA_BACKLASH\[encoder,axis\]"),
        ("m30", "$MA_BACKLASH_FACTOR[0,X1]=0.5", r"line 11: \$MA_BACKLASH_FACTOR is 0\.5; .* expected 1"),
    ],
)
def test_what_the_control_would_not_take_is_refused_with_its_line(old, new, message):
    text = AS_ANOTHER_PROGRAM_WRITES_IT
    assert old in text
    with pytest.raises(InputError, match=message):
        read({"a.ini": text.replace(old, new)})


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)], ids=["comment behind", "comment before"])
@pytest.mark.parametrize("axis", ["X1", "x1"])
def test_an_assigned_backlash_wins_over_the_comment(order, axis):
    """5 µm are assigned, 2.667 µm stand in a comment of the file: the table lags by half of 5 µm on either side of its mean."""
    text = written(NAME, pitch())["x_eec.ini"]
    comment = "; MD32450 $MA_BACKLASH[0,X1]=0.002666667\n"
    assert comment in text
    lines = [comment, f"$MA_BACKLASH[0,{axis}]=0.005\n"][order]
    (table,) = read({"x.ini": text.replace(comment, "".join(lines))}).axis_tables
    np.testing.assert_allclose(table.forward, [-0.0015, 0.009, -0.005], atol=1e-9)
    np.testing.assert_allclose(table.reverse, [0.0035, 0.014, 0.0], atol=1e-9)
