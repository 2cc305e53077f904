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

import volid
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


def test_comp_file_acts_on_the_joints_behind_the_matrix():
    """A table of 1 mm/m for joint 0 is looked up at the joint's position, not at the axis's, which would be 2 µm off.

    So steep a table also shows that LinuxCNC does not look it up again for the last step of a motion, some micrometres long.
    """
    written, matrix = files(measured(np.eye(3)))
    lines = "COMP_FILE_TYPE = 1\nCOMP_FILE = x.comp"
    joints = [
        Joint(a, low - 5, high + 5, lines=lines if a == "X" else "")
        for a in LETTERS
        for low, high in [MACHINE.axis(a).travel]
    ]
    setup = Setup(
        joints, {"x.comp": "0 0 0\n2000 2 2\n"}, "matrixkins", written["matrixkins.hal"], components=component()
    )
    rows = run(setup, [{"home": True}, {"mdi": "G53 G0 X1000 Y600 Z-500"}], ["joint.0.motor-pos-cmd"]).rows
    joint = float((matrix @ np.array([1000.0, 600.0, -500.0]))[0])
    assert abs(joint - 1000.0) > 1.0
    assert rows[1][0] == pytest.approx(joint + 1e-3 * joint, abs=1e-5)


def along_the_lines(made) -> np.ndarray:
    """Four positions on the line of each axis through the places of the tables (axes, 4, 3): X, Y, Z [mm]."""
    machine, at = made.job.machine, made.job.at
    found = np.tile([at[machine.index(a)] for a in LETTERS], (3, 4, 1))
    for j, a in enumerate(LETTERS):
        found[j, :, j] = np.linspace(*machine.axis(a).travel, 4)
    return found


def deformation(virtual, made, joints: np.ndarray) -> np.ndarray:
    """Scale errors and half the squareness errors of the lines, from the exact chain: symmetric part of the slopes [mm/mm]."""
    machine, commanded = made.job.machine, along_the_lines(made)
    order = [LETTERS.index(a) for a in machine.letters]
    found = np.zeros((3, 3))
    for j in range(3):
        actual = virtual.machine.functional_point(joints[j][:, order], made.job.tool, virtual.truth)
        wanted = virtual.machine.functional_point(commanded[j][:, order], made.job.tool)
        found[:, j] = np.polyfit(commanded[j, :, j], actual - wanted, 1)[0]
    return 0.5 * (found + found.T)


def test_a_fitted_machine_becomes_square_and_to_scale(virtual, solution):
    """Synthetic tracker readings of a machine of exact matrices, fitted; its rotation in space is nobody's error and left out."""
    made = volid.export(solution, "linuxcnc-matrixkins", ["L-SQU", "L-POS"])
    hal = {f.name: f.content for f in made.written.files}["matrixkins.hal"]
    commanded = along_the_lines(made)
    moves = [
        {"mdi": "G53 G0 " + " ".join(f"{a}{v:.9f}" for a, v in zip(LETTERS, q, strict=True))}
        for q in commanded.reshape(-1, 3)
    ]
    joints = [Joint(a, low - 5, high + 5) for a in LETTERS for low, high in [made.job.machine.axis(a).travel]]
    setup = Setup(joints, kinematics="matrixkins", hal=hal, components=component())
    rows = run(setup, [{"home": True}, *moves], [f"joint.{n}.motor-pos-cmd" for n in range(3)]).rows[1:]
    before = deformation(virtual, made, commanded)
    after = deformation(virtual, made, np.array(rows).reshape(commanded.shape))
    assert np.abs(before).max() > 5e-6
    assert np.abs(after).max() < 1e-6  # u of a reading: 0.3 µm and 0.3 µm/m; lines of 0.5 to 1 m
