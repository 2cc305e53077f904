"""matrixkins in LinuxCNC: machines of known squareness and scale, judged by exact 4×4 matrices, stand where they are told.

The module is LinuxCNC's own where the package holds it, that of a source named by VOLID_MATRIXKINS (matrixkins.comp), or else a
stand-in written from the documented formula, joint = C · axis.
"""

import os
from pathlib import Path

import numpy as np
import pytest
from exact_chain import Truth
from support.control_cases import AT, MACHINE, TOOL, error_table
from support.linuxcnc_simulator import MODULES, Joint, Setup, needs_compiler, needs_linuxcnc, run
from support.machines import exact_of

from volid.compensation.package import Compensation
from volid.controllers import CONTROLS
from volid.controllers.base import Job, options_of

pytestmark = [needs_linuxcnc, needs_compiler, pytest.mark.slow]
MATRIXKINS, EXACT = CONTROLS["linuxcnc-matrixkins"], exact_of(MACHINE)
LETTERS = "XYZ"
# slopes of the deviation of X, Y, Z over X, Y, Z: scale up to 1.5 mm/m, squareness up to 2 mm/m, so that the second order shows
SLOPES = np.array([[1.0e-3, 2.0e-3, -0.7e-3], [0.4e-3, -1.5e-3, 0.9e-3], [-0.3e-3, 0.6e-3, 0.8e-3]])
OLD = np.eye(3) + np.array([[-0.5e-3, 1.1e-3, 0.2e-3], [0.0, 0.7e-3, -1.3e-3], [0.9e-3, 0.0, 0.4e-3]])
TRUTH = Truth(
    {f"E{a}{b}": lambda q, s=SLOPES[i, j]: s * q for i, a in enumerate(LETTERS) for j, b in enumerate(LETTERS)}
)
PLACES = np.array(
    [[1000.0, 600.0, -500.0], [1000.0, 0.0, -123.0], [437.0, 600.0, 0.0], [0.0, 0.0, -500.0], [1000.0, 600.0, 0.0]]
)


def component() -> list[Path]:
    """What has to be compiled: nothing where the package holds the module."""
    if Path(MODULES, "matrixkins.so").exists():
        return []
    return [Path(os.environ.get("VOLID_MATRIXKINS", Path(__file__).with_name("stand_in") / "matrixkins.comp"))]


def measured(matrix: np.ndarray) -> tuple:
    """Tables of the deviation that is seen at commanded positions while `matrix` is in use, from the exact chain."""
    tables = []
    for j, b in enumerate(LETTERS):
        ends = np.array(MACHINE.axis(b).travel)
        axis = np.zeros((2, 3))
        axis[:, j] = ends
        seen = points(axis @ matrix.T) - points(np.zeros((1, 3))) - axis
        tables += [error_table(f"E{a}{b}", ends, seen[:, i]) for i, a in enumerate(LETTERS)]
    return tuple(tables)


def points(joints: np.ndarray) -> np.ndarray:
    """Functional point relative to its nominal place at the origin, of the machine with its errors (m, 3) [mm]."""
    q = np.stack([joints[:, LETTERS.index(a)] for a in MACHINE.letters], axis=1)
    return EXACT.functional_point(q, TOOL, TRUTH) - EXACT.functional_point(np.zeros((1, 3)), TOOL)


def files(tables, **options) -> tuple[dict[str, str], np.ndarray]:
    """The files of the control for tables, and the matrix in them."""
    job = Job(
        MACHINE, Compensation((), tables, ()), AT, TOOL, "compensation", options_of(MATRIXKINS.declaration, options)
    )
    written = MATRIXKINS.write(job)
    numbers = np.array([float(v) for _, v, _ in written.parameters]).reshape(3, 3)
    return {f.name: f.content for f in written.files}, numbers


@pytest.fixture(scope="module")
def joints():
    """Joint positions of LinuxCNC at all places, with the file as it was written, then with other matrices set by halcmd."""
    (first, _), (_, onto_old) = (
        files(measured(np.eye(3))),
        files(measured(OLD), existing=" ".join(map(repr, OLD.ravel().tolist()))),
    )
    others = {"identity": np.eye(3), "first order": np.eye(3) - SLOPES, "old": OLD, "onto the old": onto_old}
    moves = [{"mdi": "G53 G0 " + " ".join(f"{a}{v:.9f}" for a, v in zip(LETTERS, p, strict=True))} for p in PLACES]
    steps = [{"home": True}, *moves]
    for matrix in others.values():
        pairs = {
            f"matrixkins.C_{a}{b}".lower().replace("c_", "C_"): matrix[i, j]
            for i, a in enumerate(LETTERS)
            for j, b in enumerate(LETTERS)
        }
        steps += [{"mdi": "G53 G0 X0 Y0 Z0", "after": pairs}, *moves]
    setup = Setup(
        [Joint(a, low - 5, high + 5) for a in LETTERS for low, high in [MACHINE.axis(a).travel]],
        kinematics="matrixkins",
        hal=first["matrixkins.hal"],
        components=component(),
    )
    rows = np.array(run(setup, steps, [f"joint.{n}.motor-pos-cmd" for n in range(3)]).rows).reshape(
        5, len(PLACES) + 1, 3
    )
    return dict(zip(("as written", *others), rows[:, 1:], strict=True))


def off(found: np.ndarray) -> float:
    """Largest distance of the functional point from where it was told to be [mm]."""
    return float(np.abs(points(found) - points(np.zeros((1, 3))) - PLACES).max())


def test_without_the_matrix_the_machine_is_neither_square_nor_to_scale(joints):
    assert joints["identity"] == pytest.approx(PLACES, abs=1e-6)
    assert off(joints["identity"]) > 2.0


def test_with_the_written_numbers_the_machine_stands_where_it_is_told(joints):
    assert off(joints["as written"]) < 1e-6


def test_the_inverse_and_not_the_first_order_is_right(joints):
    """C = I - M leaves M² times the position: the largest component there is is found again."""
    left = np.abs(PLACES @ (SLOPES @ SLOPES).T).max()
    assert off(joints["first order"]) == pytest.approx(left, rel=1e-3) and left > 1e-3


def test_a_machine_measured_with_a_matrix_in_use_gets_the_product(joints):
    assert off(joints["old"]) > 1.0
    assert off(joints["onto the old"]) < 1e-6


def test_the_control_moves_as_it_was_read_back(joints):
    written, _ = files(measured(np.eye(3)))
    control = MATRIXKINS.read(written, MACHINE, options_of(MATRIXKINS.declaration, {})).control(MACHINE)
    order = [LETTERS.index(a) for a in MACHINE.letters]
    predicted = control.command(PLACES[:, order], TOOL)[:, [MACHINE.letters.index(a) for a in LETTERS]]
    assert predicted == pytest.approx(joints["as written"], abs=1e-6)
