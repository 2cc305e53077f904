"""LinuxCNC: screw compensation of single joints, files of `COMP_FILE` of type 0 and 1, or one `BACKLASH` value.

A file holds one line per position, three numbers in machine units: nominal position, then for motion in + and in - either the
actual position (type 0) or what is added to the command (type 1, minus the error):

    motor = q + nominal - actual = q - e(q)   (type 0),    motor = q + trim = q - e(q)   (type 1),    motor = q ± BACKLASH / 2.

A joint is corrected by its own position alone. Not modelled: the ramp at reversal, which leaves out steps of one size (see the
facts), and that nothing is corrected after homing until the joint first moves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.types import TABLES
from volid.controllers.base import (
    COLUMNS,
    DOCUMENTED,
    FREE,
    HELD,
    ONE_VALUE,
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
from volid.controllers.linuxcnc.joints import comp_file
from volid.controllers.linuxcnc.joints.ini import (
    INCHES,
    MM,
    SHEET_IN_MM,
    coordinates,
    joints_of,
    states_compensation,
    units,
)
from volid.controllers.linuxcnc.joints.loaded import tables_of
from volid.controllers.linuxcnc.joints.prepared import left_by_backlash, one_per_axis, scales, step_at_home
from volid.model.machine import Machine

INI = "linuxcnc.ini"
BACKLASH = "backlash"
_SIMULATOR = "LinuxCNC 2.9.0~pre1 (Debian 12) in simulation"
_SOURCE = "LinuxCNC source, src/emc/motion/usrmotintf.cc, usrmotLoadComp, and src/emc/motion/command.c, SET_JOINT_COMP"
_CONTROL = "LinuxCNC source, src/emc/motion/control.c, compute_screw_comp"


def _kind(text: str) -> int:
    if text not in ("0", "1"):
        raise ValueError("expected 0 (actual positions) or 1 (what is added to the command)")
    return int(text)


def _reversal(text: str) -> str:
    if text not in ("columns", BACKLASH):
        raise ValueError(
            "expected columns (both directions in the file) or backlash (one value in the INI file, no file)"
        )
    return text


def _home(text: str) -> dict[str, float]:
    try:
        found = {k.strip().upper(): float(v) for k, v in (part.split("=", 1) for part in text.split(","))}
    except ValueError:
        raise ValueError("expected positions by axis letter, such as X=0,Y=0") from None
    if not np.isfinite(list(found.values())).all():
        raise ValueError("expected finite positions")
    return found


DECLARATION = Declaration(
    name="linuxcnc",
    title="LinuxCNC, screw compensation (COMP_FILE)",
    carries={"L-POS": TABLES, "R-POS": TABLES},
    nearest="a COMP_FILE corrects a joint by its own position alone; linuxcnc-hal carries spatial grids, linuxcnc-matrixkins "
    "squareness",
    sign=POSITION,
    units="machine units: mm or inch, degrees for rotary joints",
    reversal=COLUMNS,
    outside=HELD,
    spacing=FREE,
    most_points=comp_file.ROWS,
    zero="nothing is corrected after homing until the joint first moves; make the value 0 at HOME to avoid a step then",
    switching="one file per joint: without COMP_FILE in its section of the INI file, the compensation of a joint is off",
    options=(
        Option("comp_file_type", "0: actual positions; 1: what is added to the command", 0, _kind),
        Option(
            "reversal",
            "columns: both directions in the file; backlash: BACKLASH alone, without a file",
            "columns",
            _reversal,
        ),
        Option("units", "machine unit, [TRAJ]LINEAR_UNITS: mm or inch", MM, units),
        Option(
            "coordinates",
            "letters in the order of the joints, as trivkins and [TRAJ]COORDINATES say",
            None,
            coordinates,
        ),
        Option("home", "HOME of the joints in mm or degrees, such as X=0,Y=0; 0 where it is not stated", None, _home),
    ),
    commissioning=Commissioning(
        backup=("Copy the INI file and all files that its COMP_FILE lines name.",),
        load=(
            f"Copy the .comp files, where there are any, beside the INI file of the machine, and add the lines of {INI} to its "
            "[JOINT_n] sections.",
            "Compare the numbers of the joints with coordinates= of the kinematics and with [TRAJ]COORDINATES. Without "
            "coordinates=, trivkins gives every letter of XYZABCUVW a joint, also those that the machine does not have.",
            "Leave the drives room beyond MAX_VELOCITY and MAX_ACCELERATION, a step generator by STEPGEN_MAXVEL and "
            "STEPGEN_MAXACCEL: at reversal the correction adds up to half of both to the motion.",
        ),
        activate=("Start LinuxCNC again, home all joints, and move each joint once before measuring.",),
        watch=(
            "halcmd getp joint.N.motor-pos-cmd is the position of the motor with the correction, joint.N.pos-cmd without it",
        ),
        remove=("Take the COMP_FILE and BACKLASH lines out of the [JOINT_n] sections, and start LinuxCNC again.",),
    ),
    facts=(
        Fact("type 0: the motor moves to q + nominal - actual = q - e", RUN, _SIMULATOR),
        Fact("type 1: the motor moves to q + trim, so that trim = -e", RUN, _SIMULATOR),
        Fact("linear between rows; the first and last value are held beyond them", RUN, _SIMULATOR),
        Fact(
            "the direction is the sign of the joint's commanded velocity; at rest the last value stays", RUN, _SIMULATOR
        ),
        Fact("directly after homing nothing is corrected until the joint first moves", RUN, _SIMULATOR),
        Fact("the argument is the position of the joint, whatever work offset is active", DOCUMENTED, _CONTROL),
        Fact(
            "at reversal the other column is reached by a ramp with half of MAX_VELOCITY and half of MAX_ACCELERATION, and feed "
            "override 0 stops it; otherwise the correction follows at once",
            RUN,
            f"{_SIMULATOR}: 9.8 µm in 5 ms at 200 mm/s and 2000 mm/s²; feed override: {_CONTROL}",
        ),
        Fact(
            "that ramp leaves out a step that is larger than a quarter and not larger than half of MAX_ACCELERATION times the "
            "square of SERVO_PERIOD, from 0.5 to 1 µm at 2000 mm/s² and 1 ms: the motor keeps the other column meanwhile",
            RUN,
            f"{_SIMULATOR}: 0.7 µm at 2000 mm/s², 30 and 45 µm at 100,000 mm/s²; {_CONTROL}",
        ),
        Fact(
            "with trivkins without coordinates=, joint n is the nth letter of XYZABCUVW; with it, the nth letter stated",
            RUN,
            _SIMULATOR,
        ),
        Fact("position feedback has the correction removed, so that displays show q", RUN, _SIMULATOR),
        Fact("BACKLASH alone moves the motor to q + BACKLASH/2 in +, q - BACKLASH/2 in -", RUN, _SIMULATOR),
        Fact("a COMP_FILE with at least one row makes BACKLASH of the joint ignored", RUN, _SIMULATOR),
        Fact(
            "reading stops at the first line that is not three numbers, without a word", RUN, f"{_SIMULATOR}; {_SOURCE}"
        ),
        Fact("rows that do not rise and those beyond 256 are left out with a message", RUN, f"{_SIMULATOR}; {_SOURCE}"),
        Fact("a line is read up to 254 characters", DOCUMENTED, _SOURCE),
        Fact(
            "rotary joints count in degrees, and beyond the rows the end value is held there too: a file covers all turns of the "
            "travel",
            RUN,
            _SIMULATOR,
        ),
    ),
)


class LinuxCNC(Controller):
    """Files of COMP_FILE, one per axis, or BACKLASH."""

    declaration = DECLARATION

    def of_these_files(self, options: Mapping[str, Any]) -> Mapping[str, str]:
        """The machine unit, and what stands in the columns."""
        own = {"units": f"{options['units']}, degrees for rotary joints"}
        if options["reversal"] == BACKLASH:
            return {**own, "sign": "BACKLASH is minus the mean reversal value, E(+) - E(-)", "reversal": ONE_VALUE}
        if options["comp_file_type"] == 1:
            return {**own, "sign": "what is added to the command, -(actual - nominal)"}
        return own

    def write(self, job: Job) -> Written:
        """One .comp file per axis, or none with BACKLASH, and the lines of the INI file."""
        tables, machine = one_per_axis(DECLARATION, job), job.machine
        joints = joints_of(machine, job.options["coordinates"])
        alone = job.options["reversal"] == BACKLASH
        parameters = [p for t in tables for n in joints[t.output] for p in _parameters(t, n, job)]
        files = [] if alone else [_file(t, job) for t in tables]
        notes = [left_by_backlash(t, machine) for t in tables] if alone else []
        notes += [] if alone else [n for t in tables for n in step_at_home(t, machine, job.options["home"])]
        notes += [SHEET_IN_MM] if job.options["units"] == INCHES else []
        ini = ControlFile(INI, _fragment(parameters), "lines for the [JOINT_n] sections of the INI file")
        return Written((*files, ini), tuple(parameters), tuple(notes), 10.0**-comp_file.DIGITS)

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Tables of the joints; see `volid.controllers.linuxcnc.joints.loaded`."""
        return Compensation((), (), (), tables_of(files, machine, options))

    def recognises(self, name: str, content: str | bytes) -> bool:
        """Three numbers in the first line of a .comp file, or joints with COMP_FILE or BACKLASH in an .ini file."""
        if name.lower().endswith(".ini"):
            return states_compensation(text_of(name, content))
        return name.lower().endswith(".comp") and comp_file.looks_like_one(content)


def _file(table: AxisTable, job: Job) -> ControlFile:
    what = f"the table of {table.output}"
    refuse_points(DECLARATION, what, len(table.positions))
    at, size = scales(job.machine, table.output, job.options["units"])
    positions = np.round(at * table.positions, comp_file.DIGITS)
    errors = size * np.column_stack([table.forward, table.reverse])
    columns = positions[:, None] + errors if job.options["comp_file_type"] == 0 else -errors
    text = comp_file.lines_of(f"{DECLARATION.name}: {what}", positions, columns)
    return ControlFile(_name(table), text, table.source or f"positioning of {table.output}")


def _name(table: AxisTable) -> str:
    return f"{table.output.lower()}.comp"


def _parameters(table: AxisTable, joint: int, job: Job) -> list[tuple[str, str, str]]:
    """Lines of the section of one joint."""
    section, kind = f"[JOINT_{joint}] ", job.options["comp_file_type"]
    if job.options["reversal"] == BACKLASH:
        value = -scales(job.machine, table.output, job.options["units"])[1] * table.reversal_value
        return [
            (f"{section}BACKLASH", f"{value:.{comp_file.DIGITS}f}", f"{table.output}: minus its mean reversal value")
        ]
    meaning = "actual positions" if kind == 0 else "what is added to the command"
    return [
        (f"{section}COMP_FILE_TYPE", str(kind), f"{table.output}: {meaning}"),
        (f"{section}COMP_FILE", _name(table), f"{table.output}: its table; BACKLASH of this joint is ignored with it"),
    ]


def _fragment(parameters: Sequence[tuple[str, str, str]]) -> str:
    """The parameters as lines of an INI file."""
    lines, section = ["# Add these lines to the sections of the INI file of the machine."], ""
    for name, value, meaning in parameters:
        head, key = name.split(" ")
        lines += [] if head == section else [head]
        lines += [f"# {meaning}", f"{key} = {value}"]
        section = head
    return "\n".join(lines) + "\n"


LINUXCNC = LinuxCNC()
