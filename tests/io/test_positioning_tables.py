"""Tables of approaches × targets: both forms, units, and messages for what is none of them."""

import numpy as np
import pytest

import volid
from volid.exceptions import InputError
from volid.io.evaluations.positioning import read_positioning

LONG = "target,direction,run,actual\n0,+1,1,0.001\n100,+1,1,100.002\n100,-1,1,100.004\n0,-1,1,0.003\n"
WIDE = "target,up_1,down_1\n0,0.001,0.003\n100,0.002,0.004\n"
EXPECTED = [[[0.001], [0.003]], [[0.002], [0.004]]]


def read(tmp_path, text, axis="X", name="runs.csv", **more):
    (tmp_path / name).write_text(text, encoding="utf-8")
    return [f.runs for f in read_positioning(tmp_path / name, axis, **more)]


@pytest.mark.parametrize(
    "text",
    [
        LONG,
        LONG.replace("actual", "deviation").replace("100.00", "0.00"),
        LONG.replace("+1", "up").replace("-1", "Down"),
        LONG.replace("target,direction,run,actual", "Target [mm],Direction,Run,Actual [mm]"),
        "target,direction,actual\n0,+1,0.001\n100,+1,100.002\n100,-1,100.004\n0,-1,0.003\n",
        LONG.replace(",", ";").replace(".", ","),
        WIDE,
        WIDE.replace("up_1,down_1", "up_1 [µm],down_1 [µm]").replace("0.00", ""),
        WIDE.replace("100,0.002,0.004", "100,100.002,100.004"),
        WIDE.replace("up_1", "forward 1").replace("down_1", "reverse 1"),
        "# a comment\n" + WIDE,
    ],
)
def test_forms_of_the_same_runs(tmp_path, text):
    [runs] = read(tmp_path, text)
    np.testing.assert_allclose(runs.deviations, EXPECTED, rtol=0, atol=1e-12)
    assert runs.targets.tolist() == [0.0, 100.0] and runs.unit == "mm"


def test_several_axes_in_one_table(tmp_path):
    rows = [line.split(",") for line in LONG.splitlines()]
    both = ["axis," + ",".join(rows[0])] + [f"{a}," + ",".join(r) for a in ("X", "C") for r in rows[1:]]
    text = "\n".join(both) + "\n"
    assert [(r.axis, r.unit) for r in read(tmp_path, text, axis=None)] == [("X", "mm"), ("C", "°")]
    assert [r.axis for r in read(tmp_path, text, axis="C")] == ["C"]
    with pytest.raises(InputError, match="no row is of axis Y; expected one of C, X"):
        read(tmp_path, text, axis="Y")


def test_angles_of_the_header_make_an_axis_rotary(tmp_path):
    text = "target [deg],up_1 [arcsec],down_1 [arcsec]\n0,3.6,7.2\n100,0,3.6\n"
    [runs] = read(tmp_path, text, axis=None)
    assert runs.unit == "°"
    np.testing.assert_allclose(runs.deviations[:, :, 0], [[0.001, 0.002], [0.0, 0.001]], rtol=0, atol=1e-15)
    with pytest.raises(InputError, match="target is in deg; expected mm"):
        read(tmp_path, text, axis="X")


def test_a_display_of_angles_may_begin_anew(tmp_path):
    text = "target,direction,actual\n0,+1,359.999\n180,+1,180.001\n360,+1,0.002\n360,-1,359.998\n180,-1,180\n0,-1,0\n"
    [runs] = read(tmp_path, text, axis="C")
    np.testing.assert_allclose(
        runs.deviations[:, :, 0], [[-0.001, 0.0], [0.001, 0.0], [0.002, -0.002]], rtol=0, atol=1e-9
    )


@pytest.mark.parametrize(
    ("axis", "unit", "name"),
    [
        ("C", "°", "C"),
        ("c", "°", "C"),
        ("B2", "°", "B2"),
        ("x", "mm", "X"),
        ("W", "mm", "W"),
        ("Column", "mm", "Column"),
    ],
)
def test_the_letter_of_an_axis_tells_its_unit(tmp_path, axis, unit, name):
    [runs] = read(tmp_path, WIDE, axis=axis)
    assert (runs.unit, runs.axis) == (unit, name)


def test_cells_of_the_wide_form_may_be_empty(tmp_path):
    [runs] = read(tmp_path, "target,up_1,up_2,down_1\n0,0.001,,0.003\n100,0.002,0.005,\n")
    np.testing.assert_array_equal(np.isnan(runs.deviations), [[[0, 1], [0, 1]], [[0, 0], [1, 1]]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y\n1,2\n", r"runs.csv: columns x, y; expected a campaign"),
        ("target,run,actual\n0,1,0\n", r"runs.csv, header: .*direction"),
        (
            "target,direction,run\n0,+1,1\n",
            r"runs.csv, header: columns target, direction, run; expected the columns target",
        ),
        (LONG.replace("-1,1,100.004", "back,1,100.004"), r"row 4: direction is 'back'; expected \+1 or -1"),
        (LONG.replace("-1,1,100.004", "0,1,100.004"), r"row 4: direction is '0'; expected \+1 or -1"),
        (LONG.replace("100.004", "?"), r"row 4: actual is '\?'; expected a finite number"),
        (
            LONG.replace("-1,1,100.004", "+1,1,100.004"),
            r"row 4: target 100 approached in \+1 stands a second time in run 1",
        ),
        (LONG.replace("actual", "deviation"), "the column deviation follows the targets"),
        (LONG.replace("100.00", "0.00"), "the column actual does not follow the targets"),
        (
            WIDE.replace("up_1", "up_1,speed").replace("0.001", "0.001,1").replace("0.002", "0.002,1"),
            "unknown column 'speed'",
        ),
        (WIDE.replace("up_1", "actual_up_1"), "some columns are called actual or deviation, others not"),
        (WIDE.replace("up_1", "actual_up_1").replace("down_1", "actual_down_1"), "columns called actual do not follow"),
        (WIDE.replace("0.00", "1"), "deviations reach .* is it in µm"),
    ],
)
def test_wrong_tables_are_refused(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, text)


def test_large_deviations_can_be_meant(tmp_path):
    with volid.accept_unusual():
        [runs] = read(tmp_path, WIDE.replace("0.00", "1"))
    assert runs.deviations.max() == 14.0


def test_a_small_letter_is_the_same_axis(tmp_path):
    """Or angles of c would be evaluated as mm."""
    rows = LONG.replace("100,", "90,").replace("100.", "90.").splitlines()
    text = "axis," + rows[0] + "\n" + "".join(f"c,{r}\n" for r in rows[1:])
    assert [(r.axis, r.unit) for r in read(tmp_path, text, axis=None)] == [("C", "°")]
    assert [(r.axis, r.unit) for r in read(tmp_path, text, axis="c")] == [("C", "°")]


def test_a_target_without_approaches_is_not_left_out_in_silence(tmp_path):
    with pytest.raises(InputError, match="row 3: no approach of this target; leave the row out"):
        read(tmp_path, WIDE.replace("100,", "50,,\n100,"))


def test_a_unit_of_some_approaches_only_is_refused(tmp_path):
    """Or 0.3 under a column without unit would be 0.3 mm beside 0.3 µm."""
    with pytest.raises(
        InputError, match="column up_1 is in µm, column down_1 is in no unit that it says; expected one unit"
    ):
        read(tmp_path, WIDE.replace("up_1", "up_1 [µm]"))


def test_mm_of_nobody_are_said(tmp_path):
    for text in (LONG, WIDE):
        assert any(
            "targets and deviations were read in mm" in note for note in read(tmp_path, text, axis=None)[0].notes
        )
        assert not any("targets and deviations were read in mm" in note for note in read(tmp_path, text)[0].notes)
