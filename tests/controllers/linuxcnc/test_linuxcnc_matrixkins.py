"""Nine numbers of matrixkins: written out by hand from joint = C · axis, read back as what the axes are moved by."""

from dataclasses import replace

import numpy as np
import pytest
from support.control_cases import MACHINE, error_table, job, written
from support.control_contract import scaled, skewed

import volid
from volid.compensation.package import Compensation
from volid.controllers import CONTROLS
from volid.controllers.base import options_of
from volid.exceptions import InputError

MATRIXKINS = CONTROLS["linuxcnc-matrixkins"]


def numbers(files) -> np.ndarray:
    """The nine numbers of the setp lines in the order in which they stand."""
    lines = [line.split() for line in files["matrixkins.hal"].splitlines()]
    assert [w[:2] for w in lines] == [["setp", f"matrixkins.C_{a}{b}"] for a in "xyz" for b in "xyz"]
    return np.array([float(w[2]) for w in lines]).reshape(3, 3)


def read(text: str, **options):
    return MATRIXKINS.read({"a.hal": text}, MACHINE, options_of(MATRIXKINS.declaration, options)).axis_tables


def test_a_leaning_axis_is_set_upright():
    """Y leans by 20 µrad towards +X: at Y = 1 m, X must go back by 20 µm."""
    wanted = np.eye(3)
    wanted[0, 1] = -20e-6
    assert numbers(written("linuxcnc-matrixkins", skewed())) == pytest.approx(wanted, abs=1e-12)
    assert written("linuxcnc-matrixkins", skewed())["matrixkins.ini"] == "[KINS]\nKINEMATICS = matrixkins\n"


def test_scale_and_squareness_are_inverted_together():
    """(I + M)⁻¹ of an upper triangle with scale m and skewness k is [[1/(1+m), -k/(1+m)], [0, 1]]."""
    made = Compensation(("L-POS", "L-SQU"), (*scaled().tables, *skewed().tables), ())
    wanted = np.eye(3)
    wanted[0, :2] = 1 / 1.00002, -20e-6 / 1.00002
    assert numbers(written("linuxcnc-matrixkins", made)) == pytest.approx(wanted, abs=1e-12)


def test_a_matrix_in_use_is_multiplied_from_the_left():
    """C0 (I + M)⁻¹ with M_xy = 20e-6 alone: the second column gets -20e-6 times the first."""
    old = "1.001 0.002 0  0.003 1 0  0 0 0.999"
    found = numbers(written("linuxcnc-matrixkins", skewed(), existing=old))
    wanted = np.array([[1.001, 0.002 - 20e-6 * 1.001, 0], [0.003, 1 - 20e-6 * 0.003, 0], [0, 0, 0.999]])
    assert found == pytest.approx(wanted, abs=1e-12)


def test_the_line_is_that_of_least_squares_and_the_rest_is_said():
    """y = x²/1e8 over 0 … 1000: the line has slope 1000/1e8 and constant -1000²/6e8; 1.667 µm is left at both ends."""
    x = np.linspace(0.0, 1000.0, 2001)
    up = x**2 / 1e8
    made = Compensation(("L-POS",), (error_table("EXX", x, up + 0.001, up - 0.001),), ())
    found = MATRIXKINS.write(job("linuxcnc-matrixkins", made))
    assert float(found.parameters[0][1]) == pytest.approx(1 / (1 + 1e-5), abs=2e-11)
    assert found.notes == (
        "EXX, X over X: 10.00 µm/m goes into the matrix; what stays: up to 1.67 µm that is not straight; up to 1.00 µm of the "
        "reversal in each direction; a constant of 1.67 µm, which shifts the origin alone",
    )


def test_positions_that_are_not_even_weigh_by_their_length():
    """Knee at 900 of 1000: y = 0 up to it, then to 0.1; ∫ s y ds = 50·0.1·(900 + 2/3·100 - 500)."""
    made = Compensation(("L-POS",), (error_table("EXX", [0, 900, 1000], [0.0, 0.0, 0.1]),), ())
    slope = 5.0 * (400.0 + 200.0 / 3.0) * 12.0 / 1000.0**3
    assert numbers(written("linuxcnc-matrixkins", made))[0, 0] == pytest.approx(1 / (1 + slope), abs=1e-12)


def test_read_numbers_are_what_the_axes_move_by():
    """C_xy = -20e-6, C_zz = 0.999: at Y = 500, Z = -200 the X joint is 10 µm back and the Z joint at -199.8."""
    text = "loadrt something\nsetp matrixkins.C_xy -2e-5 # skew\nsetp matrixkins.C_zz 0.5\n  setp matrixkins.C_zz = 0.999\n"
    control = volid.Control(MACHINE, axis_tables=read(text))
    found = control.command(MACHINE.order(X=100.0, Y=500.0, Z=-200.0)[None], np.zeros(3))[0]
    assert found == pytest.approx(MACHINE.order(X=99.99, Y=500.0, Z=-199.8), abs=1e-9)


@pytest.mark.parametrize(
    "text, message",
    [
        ("loadrt matrixkins\n", r"a\.hal: no line 'setp matrixkins\.C_xx"),
        (
            "setp matrixkins.C_xx [MATRIX]XX\n",
            r"a\.hal, line 1: '\[MATRIX\]XX'; expected a number with a decimal point",
        ),
        ("\nsetp matrixkins.C_xx 1,0001\n", r"a\.hal, line 2: '1,0001'"),
        ("setp matrixkins.C_xy 1.0\n", r"a\.hal: the matrix differs from the identity by more than 0\.1"),
    ],
)
def test_other_lines_are_refused(text, message):
    with pytest.raises(InputError, match=message):
        read(text)


def test_what_is_not_for_three_linear_axes_is_refused():
    with pytest.raises(InputError, match="linuxcnc-matrixkins: the machine has no axis X"):
        MATRIXKINS.read({}, replace(MACHINE, axes=tuple(a for a in MACHINE.axes if a.letter != "X")), {})
    with pytest.raises(InputError, match="existing is '1 2 3'; expected nine numbers"):
        written("linuxcnc-matrixkins", skewed(), existing="1 2 3")
    with pytest.raises(InputError, match=r"differs from the identity by at most 0\.1"):
        written("linuxcnc-matrixkins", skewed(), existing="1 0 0 0 1 0 0 0 -1")
