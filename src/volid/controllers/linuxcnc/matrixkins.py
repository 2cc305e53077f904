"""LinuxCNC: `matrixkins`, kinematics of nine numbers that take the scale and the squareness out of three linear axes.

The program computes the joints from the axes, joint = C · axis. A machine whose axes lie and count with small linear errors
stands at (I + M) · joint, where M_ij is the slope of the deviation of axis i over axis j [mm/mm]; it stands at the commanded
place with

    C = (I + M)⁻¹,      and, where it was measured with a matrix C₀ in use,  C = C₀ · (I + M)⁻¹.

Tables of axes, such as those read from the nine numbers, are what an axis is moved by, C = I - E, without the second order.

Only the straight part of a table goes into the matrix: its least-squares line over the travel. What bends, what depends on the
direction, and the constant of the line stay; the first two belong into COMP_FILE, the third is an origin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.by_axis import axis_tables
from volid.compensation.types import TABLES
from volid.controllers.base import (
    COMPENSATION,
    CONTINUES,
    DOCUMENTED,
    FREE,
    NO_REVERSAL,
    RUN,
    Commissioning,
    ControlFile,
    Controller,
    Declaration,
    Fact,
    Job,
    Option,
    Written,
    text_of,
)
from volid.controllers.linuxcnc.joints.nine import DIGITS, LETTERS, has_lines, lines_of, matrix_of, nine, parameters_of
from volid.controllers.tables.straight import left_beside, line_of
from volid.exceptions import InputError
from volid.model.machine import Machine

HAL, INI = "matrixkins.hal", "matrixkins.ini"
_SOURCE = "LinuxCNC source, src/hal/components/matrixkins.comp"
_SIMULATOR = "LinuxCNC 2.9.0~pre1 (Debian 12) in simulation"


DECLARATION = Declaration(
    name="linuxcnc-matrixkins",
    title="LinuxCNC, kinematics of nine numbers (matrixkins)",
    carries={"L-SQU": TABLES, "L-POS": TABLES},
    nearest="matrixkins holds squareness and scale of X, Y, Z alone; linuxcnc carries positioning that bends, linuxcnc-hal "
    "spatial grids",
    sign=COMPENSATION,
    units="none: nine ratios, the same for mm and inch",
    reversal=NO_REVERSAL,
    outside=CONTINUES,
    spacing=FREE,
    limits="nine numbers whatever the positions",
    linear=True,
    zero="at X = Y = Z = 0, because the matrix has no constant",
    switching="all nine numbers at once: without the setp lines the matrix is the identity",
    options=(
        Option(
            "existing",
            "matrix in use while measuring, nine numbers xx xy xz yx yy yz zx zy zz; the identity by default",
            None,
            nine,
        ),
    ),
    commissioning=Commissioning(
        backup=(
            "Copy the INI file and all HAL files, and note the values that `halcmd show param matrixkins` prints.",
        ),
        load=(
            "See whether there is /usr/lib/linuxcnc/modules/matrixkins.so; if not, build it from its source with halcompile.",
            f"Set KINEMATICS = matrixkins in section [KINS] of the INI file, as {INI} says; joints 0, 1, 2 are X, Y, Z.",
            f"Name {HAL} as a HALFILE after the one that loads motmod: the parameters come to be when motmod is loaded.",
            "Let MIN_LIMIT and MAX_LIMIT of the joints reach as far beyond those of the axes as the correction.",
        ),
        activate=(
            "Start LinuxCNC again and home all joints; with machine power off, `halcmd setp` changes the numbers as well.",
        ),
        remove=("Take the HALFILE line out, or set the nine numbers to those of the identity with machine power off.",),
    ),
    facts=(
        Fact(
            "joint = C · axis; feedback takes the inverse",
            RUN,
            f"{_SIMULATOR}, module built from the public source; {_SOURCE}",
        ),
        Fact(
            "the machine stands where it is told with C = (I + M)⁻¹", RUN, f"{_SIMULATOR}, against exact 4×4 matrices"
        ),
        Fact(
            "a machine measured with C₀ in use wants C₀ · (I + M)⁻¹", RUN, f"{_SIMULATOR}, against exact 4×4 matrices"
        ),
        Fact(
            "the source says that new adjustments are added to the old numbers; that is the first order of the product",
            DOCUMENTED,
            _SOURCE,
        ),
        Fact(
            "the parameters come to be when motmod is loaded; a setp line before that stops the start",
            RUN,
            f"{_SIMULATOR}, module built from the public source",
        ),
        Fact("further joints, from the fourth on, pass through as A, B, C, U, V, W in this order", DOCUMENTED, _SOURCE),
        Fact("power is to be off when the numbers are changed, because the axes jump", DOCUMENTED, _SOURCE),
        Fact(
            "Debian 12's package linuxcnc-uspace does not hold the module",
            RUN,
            "linuxcnc-uspace 2.9.0~pre1+git20230208",
        ),
        Fact(
            "COMP_FILE acts on the joints behind the matrix, at their positions, so that both go together",
            RUN,
            _SIMULATOR,
        ),
    ),
)


class Matrixkins(Controller):
    """Nine setp lines."""

    declaration = DECLARATION

    def write(self, job: Job) -> Written:
        """The setp lines, and the line of the INI file."""
        _ask_axes(job.machine)
        tables = axis_tables(job.machine, job.compensation.tables, job.at, job.tool, products=False)
        added = job.compensation.axis_tables
        old = np.eye(3) if job.options["existing"] is None else job.options["existing"]
        matrix = old @ (np.linalg.inv(np.eye(3) + _slopes(tables)) - _slopes(added))
        notes = [note for t in (*tables, *added) for note in _left(t)]
        hal = ControlFile(HAL, lines_of(matrix), "setp lines of the nine numbers")
        ini = ControlFile(INI, "[KINS]\nKINEMATICS = matrixkins\n", "line for the INI file")
        return Written((hal, ini), parameters_of(matrix), tuple(notes), 0.5 * 10.0**-DIGITS * _reach(job.machine))

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """What the control does with the numbers, as tables of error values over the travels: (I - C) times the position."""
        _ask_axes(machine)
        matrix = matrix_of({n: text_of(n, c) for n, c in files.items() if not n.lower().endswith(".ini")})
        return Compensation((), (), (), tuple(_tables(np.eye(3) - matrix, machine)))

    def recognises(self, name: str, content: str | bytes) -> bool:
        """A line that sets one of the nine numbers."""
        return has_lines(text_of(name, content))


def _ask_axes(machine: Machine) -> None:
    missing = [a for a in LETTERS if a not in machine.letters]
    if missing:
        raise InputError(f"{DECLARATION.name}: the machine has no axis {missing[0]}; matrixkins is for X, Y, Z")


def _place(table: AxisTable) -> tuple[int, int]:
    """Row and column of a table in the matrix. Raises `InputError` for other axes and for products."""
    if table.factor is not None or table.output not in LETTERS or table.argument not in LETTERS:
        raise InputError(
            f"{DECLARATION.name}: {table.source or 'a table'} moves {table.output} by {table.argument}; {DECLARATION.nearest}"
        )
    return LETTERS.index(table.output), LETTERS.index(table.argument)


def _slopes(tables: Sequence[AxisTable]) -> np.ndarray:
    """Slopes of the deviation of X, Y, Z (rows) over X, Y, Z (columns), (3, 3) [mm/mm]."""
    found = np.zeros((3, 3))
    for table in tables:
        found[_place(table)] += line_of(table).slope
    return found


def _left(table: AxisTable) -> list[str]:
    """What of a table is not in the matrix, where it is worth a note."""
    line = line_of(table)
    words = left_beside(table, line)
    what = f"{table.source or 'the table'}, {table.output} over {table.argument}"
    return [f"{what}: {1e6 * line.slope:.2f} µm/m goes into the matrix; what stays: {words}"] if words else []


def _reach(machine: Machine) -> float:
    """Sum of the largest positions of the three axes [mm]."""
    return float(sum(max(abs(v) for v in machine.axis(a).travel) for a in LETTERS))


def _tables(errors: np.ndarray, machine: Machine) -> Sequence[AxisTable]:
    """Straight tables for the elements of a matrix of slopes that are not 0."""
    found = []
    for i, output in enumerate(LETTERS):
        for j, argument in enumerate(LETTERS):
            if errors[i, j]:
                at = np.array(machine.axis(argument).travel)
                values = errors[i, j] * at
                found.append(
                    AxisTable(output, argument, at, values, values, source=f"C_{output}{argument}".replace("C_", "C "))
                )
    return found


MATRIXKINS = Matrixkins()
