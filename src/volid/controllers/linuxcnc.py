"""LinuxCNC: screw compensation of single joints, files of `COMP_FILE` of type 0 and 1.

A file holds one line per position, three numbers: nominal position, then for motion in + and in - either the actual position
(type 0) or what is added to the command (type 1, minus the error). The program stops reading at the first line that is not three
numbers, and says nothing; therefore no comment, no blank line and no header is written.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.types import TABLES
from volid.controllers.base import (
    COLUMNS,
    FREE,
    HELD,
    POSITION,
    RUN,
    Commissioning,
    ControlFile,
    Controller,
    Declaration,
    Fact,
    Job,
    Option,
    Written,
    refuse_points,
    text_of,
)
from volid.exceptions import InputError
from volid.model.machine import Machine

ROWS = 256


def _kind(text: str) -> int:
    if text not in ("0", "1"):
        raise ValueError("expected 0 (actual positions) or 1 (what is added to the command)")
    return int(text)


DECLARATION = Declaration(
    name="linuxcnc",
    title="LinuxCNC, screw compensation (COMP_FILE)",
    carries={"L-POS": TABLES, "R-POS": TABLES},
    nearest="a COMP_FILE corrects a joint by its own position alone; linuxcnc-hal carries spatial grids, linuxcnc-matrixkins "
    "squareness",
    sign=POSITION,
    units="machine units: mm, degrees for rotary joints",
    reversal=COLUMNS,
    outside=HELD,
    spacing=FREE,
    most_points=ROWS,
    zero="after homing nothing is corrected until the joint moves; make the value 0 at the home position to avoid a step",
    switching="one file per joint: leave COMP_FILE of a joint out, and its compensation is off",
    options=(Option("comp_file_type", "0: actual positions; 1: what is added to the command", 0, _kind),),
    commissioning=Commissioning(
        backup=("Copy the INI file and all files that COMP_FILE names.",),
        load=(
            "Copy the .comp files beside the INI file, and add the lines of linuxcnc.ini to its [JOINT_n] sections.",
        ),
        activate=("Start LinuxCNC again, home all joints, and move each joint once before measuring.",),
    ),
    facts=(
        Fact("type 0: the motor moves to q - e, e interpolated", RUN, "LinuxCNC 2.9, simulator"),
        Fact("type 1: the motor moves to q + trim, so that trim = -e", RUN, "LinuxCNC 2.9, simulator"),
    ),
)


class LinuxCNC(Controller):
    """Files of COMP_FILE, one per joint."""

    declaration = DECLARATION

    def write(self, job: Job) -> Written:
        """One .comp file per joint, and the lines of the INI file."""
        kind, files = job.options["comp_file_type"], []
        for table in job.axis_tables():
            refuse_points(DECLARATION, f"the table of {table.output}", len(table.positions))
            files.append(ControlFile(f"{table.output.lower()}.comp", _lines(table, kind, job.machine), table.source))
        return Written(tuple(files))

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Tables of the joints; the name of a file says the joint: x.comp."""
        kind = options["comp_file_type"]
        tables = [_table(name, text_of(name, c), kind, machine) for name, c in files.items() if name.endswith(".comp")]
        return Compensation((), (), (), tuple(tables))


def _lines(table: AxisTable, kind: int, machine: Machine) -> str:
    scale = 1.0 if machine.axis(table.output).is_linear else 180.0 / np.pi
    errors = scale * np.column_stack([table.forward, table.reverse])
    values = table.positions[:, None] + errors if kind == 0 else -errors
    return "".join(f"{q:.6f} {up:.9f} {down:.9f}\n" for q, (up, down) in zip(table.positions, values, strict=True))


def _table(name: str, text: str, kind: int, machine: Machine) -> AxisTable:
    letter = name.rsplit("/", 1)[-1][0].upper()
    try:
        rows = np.array([[float(v) for v in line.split()] for line in text.splitlines()])
    except ValueError:
        raise InputError(f"{name}: expected three numbers in every line") from None
    scale = 1.0 if machine.axis(letter).is_linear else 180.0 / np.pi
    errors = (rows[:, 1:] - rows[:, :1] if kind == 0 else -rows[:, 1:]) / scale
    return AxisTable(letter, letter, rows[:, 0], errors[:, 0], errors[:, 1])


LINUXCNC = LinuxCNC()
