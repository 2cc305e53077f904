"""(Turbo) PMAC: compensation tables of motors, over one or two of them, and backlash, as a script of on-line commands.

A table is declared for a motor that it belongs to, with its source motors, its target motor and its span in counts. Its entries
follow, whole sixteenths of a count that are added to the commanded position. A backlash table is subtracted while its motor
moves in -, so that both directions are held.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from volid.compensation.package import Compensation
from volid.compensation.types import TABLES
from volid.controllers.axis_values import axis_option, number, positive, whole
from volid.controllers.base import (
    COLUMNS,
    COMPENSATION,
    DOCUMENTED,
    EQUAL,
    INFERRED,
    OPEN,
    ROLLS_OVER,
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
from volid.controllers.pmac.motors.held import compensation_of
from volid.controllers.pmac.motors.making import tables_of
from volid.controllers.pmac.motors.script import read_script, script_text
from volid.controllers.pmac.motors.spans import motors_of
from volid.controllers.tables.lists import the_list
from volid.model.machine import Machine

_TURBO = "Turbo PMAC software reference, pp. 302-305"
_PMAC = "PMAC software reference, pp. 207-211"
_USER, _SERVO = "PMAC user manual, pp. 80-83", "Turbo PMAC user manual, p. 191"
_BACKLASH = "Turbo PMAC software reference, p. 148"

DECLARATION = Declaration(
    name="pmac",
    title="Turbo PMAC, compensation tables of motors",
    carries={name: TABLES for name in ("L-VOL", "R-POS", "L-ANG", "L-POS", "L-STR", "L-SQU")},
    nearest="a table adds to one motor over the positions of one or two; linuxcnc-hal and isg-volcomp take grids over three axes",
    sign=COMPENSATION,
    units="source positions in counts, values in 1/16 count",
    reversal=COLUMNS,
    outside=ROLLS_OVER,
    spacing=EQUAL,
    limits="as many as the memory allows; one table for each motor (option owners)",
    products=True,
    zero="the value at motor zero is 0 by definition; each axis is shifted as a whole so that it is",
    zero_fixed=True,
    switching="all tables together by I51; a single table by deleting it at the motor that it belongs to",
    options=(
        axis_option("counts", "counts of the motor of an axis per mm or °", positive),
        axis_option("motors", "number of the motor of an axis; X=1,Y=2,Z=3,A=4,B=5,C=6 by default", whole),
        axis_option("home", "position of an axis at motor zero, mm or °", number, 0.0),
        Option("owners", "motors to which tables may belong: 32 of Turbo PMAC, 8 of PMAC", 32, whole),
    ),
    commissioning=Commissioning(
        backup=(
            "Save the settings of the control, and keep a list of the existing tables and of Ixx86 of each motor.",
        ),
        load=(
            "Set I51=0, and delete existing tables of the motors from the lowest number to the highest, backlash tables first; "
            "GATHER, LOOKAHEAD and ROTARY buffers and TCOMP tables before them.",
            "Send the lines of the script in their order: tables of the motor with the highest number come first.",
        ),
        activate=(
            "I51=1 switches the tables on; home all motors, because tables count from motor zero; SAVE keeps them.",
        ),
        remove=("Set I51=0, delete the tables as above, restore the backlash parameters Ixx86, and SAVE.",),
    ),
    facts=(
        Fact(
            "DEFINE COMP entries, source and target motors, span in counts; entries in 1/16 count", DOCUMENTED, _TURBO
        ),
        Fact("the correction is added to the commanded position of the target motor", DOCUMENTED, _PMAC),
        Fact(
            "the value at motor zero is 0; positions outside the span are rolled over; linear in between",
            DOCUMENTED,
            _USER,
        ),
        Fact("positions below motor zero stand behind the positive end of the table", DOCUMENTED, _USER),
        Fact(
            "DEFINE COMP rows.columns: columns along the first source motor, row 0 without its first entry",
            DOCUMENTED,
            _TURBO,
        ),
        Fact("each motor owns one table, and may be source or target of several", DOCUMENTED, _PMAC),
        Fact("COMP before BLCOMP, and higher motor numbers first; I51=1 switches them on", DOCUMENTED, _TURBO),
        Fact("D: over the desired position, advised where a motor is source and target", DOCUMENTED, _TURBO),
        Fact(
            "DEFINE BLCOMP: subtracted while the motor moves in -, added to Ixx86, and 0 at motor zero",
            DOCUMENTED,
            _SERVO,
        ),
        Fact("Ixx86: backlash at motor zero in 1/16 count, 0 … 8388607", DOCUMENTED, _BACKLASH),
        Fact(
            "a table may belong to a motor that drives no axis",
            INFERRED,
            f"{_PMAC}: belonging says nothing about its use",
        ),
        Fact("largest number of entries: as the memory of the control allows", OPEN),
    ),
)


class Pmac(Controller):
    """A script of DEFINE COMP, DEFINE BLCOMP and Ixx86."""

    declaration = DECLARATION

    def declared_for(self, machine: Machine, options: Mapping[str, Any]) -> Declaration:
        """The declaration with the steps that the counts make."""
        motors = motors_of(machine, options, DECLARATION.name).values()
        steps = [max((1.0 / m.parts for m in motors if m.linear == kind), default=None) for kind in (True, False)]
        return replace(DECLARATION, quantum=(steps[0], steps[1]))

    def write(self, job: Job) -> Written:
        """The script. Raises `InputError` for what the control cannot hold, and where the counts are not stated."""
        motors = motors_of(job.machine, job.options, DECLARATION.name)
        made = tables_of(job, motors)
        numbers = ", ".join(f"{m.axis} #{m.number}" for m in motors.values())
        script = script_text(made, (f"motors: {numbers}", "entries in 1/16 count, added to the commanded position"))
        parameters = [
            (f"I{n}86", str(v), "backlash at motor zero, 1/16 count") for n, v in sorted(made.backlash.items())
        ]
        file = ControlFile("compensation.pmc", script, f"on-line commands with {len(made.tables)} tables")
        return Written((file,), (*parameters, ("I51", "1", "tables on")), made.notes, made.rounding)

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Tables of axes, and grids over two axes, over the travels of the machine."""
        name = the_list(files, (".pmc", ".txt", ".cfg"), DECLARATION.name)
        found = read_script(name, text_of(name, files[name]))
        return compensation_of(found, name, machine, motors_of(machine, options, DECLARATION.name))

    def recognises(self, name: str, content: str | bytes) -> bool:
        """A text that defines a table of a motor."""
        words = " ".join(text_of(name, content[:20000]).upper().split())
        return "DEFINE COMP" in words or "DEFINE BLCOMP" in words


PMAC = Pmac()
