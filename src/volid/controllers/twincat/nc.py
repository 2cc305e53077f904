"""TwinCAT NC (Tc2_MC2): tables of MC_TableBasedPositionCompensation, as constants of the PLC and as plain columns.

A table is an array of position and value at equal steps; its parameters say between which positions and in which direction of
motion it acts. A function with reversal becomes two tables, one for each direction, each for a function block of its own. The
pages call the value additive, and the result a correction of the actual value; the sense is left open. The columns (x.csv:
position, value in +, value in -) hold the same numbers for PLC programs that read files.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from volid.compensation.package import Compensation
from volid.compensation.types import TABLES
from volid.controllers.base import (
    COLUMNS,
    COMPENSATION,
    DOCUMENTED,
    EQUAL,
    INFERRED,
    NOT_KNOWN,
    OPEN,
    Commissioning,
    ControlFile,
    Controller,
    Declaration,
    Fact,
    Job,
    Written,
    refuse_grids,
    text_of,
)
from volid.controllers.tables.equal_steps import lattice_of, loss, on
from volid.controllers.twincat.plc_tables import (
    columns,
    declarations,
    read_columns,
    read_declarations,
    table_of,
    values_of,
)
from volid.exceptions import InputError
from volid.model.machine import Machine

_DOCS = "Beckhoff Tc2_MC2 (infosys.beckhoff.com, tcplclib_tc2_mc2)"

DECLARATION = Declaration(
    name="twincat-nc",
    title="TwinCAT NC, table based position compensation (MC_TableBasedPositionCompensation)",
    carries={"L-POS": TABLES, "R-POS": TABLES},
    nearest="MC_TableBasedPositionCompensation corrects an axis by its own position alone; a cross compensation is the "
    ""
    "older function "
    "block FB_PositionCompensation, whose result a PLC program adds itself; isg-crosscomp and isg-volcomp are "
    "for TwinCAT CNC",
    sign=OPEN,
    units="mm, degrees for rotary axes, positions and values",
    reversal=COLUMNS,
    outside=NOT_KNOWN,
    spacing=EQUAL,
    limits="as many as the array has",
    zero="make the value 0 where the axis stands when the function block is enabled; Ramp bounds the speed of the "
    "step otherwise",
    switching="Enable of the function block, for each axis and direction",
    commissioning=Commissioning(
        backup=("Save the PLC project and its boot project.",),
        load=(
            "Add the declarations to a global variable list of the PLC, and one function block "
            "MC_TableBasedPositionCompensation for each "
            "table: pTable := ADR of the array, TableSize := SIZEOF of it, TableParameter := its parameters.",
            "Enable position correction in the parameters of the axis.",
        ),
        activate=("Reference the axis, set Ramp, and set Enable.",),
        remove=("Reset Enable, with DisableModeReset.",),
    ),
    facts=(
        Fact(
            "an element is Position, the uncorrected position, and Compensation, an additive value",
            DOCUMENTED,
            f"{_DOCS}, 12929471627",
        ),
        Fact("the table must have equal steps and rise", DOCUMENTED, f"{_DOCS}, 17316396939"),
        Fact(
            "MinPosition, MaxPosition, NoOfTableElements, Direction, Modulo; the compensation acts in the "
            "selected direction only",
            DOCUMENTED,
            f"{_DOCS}, 12929466635",
        ),
        Fact("Direction is WorkDirectionNone, Both, Positive or Negative, 0 … 3", DOCUMENTED, f"{_DOCS}, 12930880011"),
        Fact(
            "Ramp limits the speed of the correction; DisableModeHold keeps the last one, DisableModeReset "
            "takes it back",
            DOCUMENTED,
            f"{_DOCS}, 17316396939",
        ),
        Fact("the sign: an additive value, added to the actual value", OPEN, f"{_DOCS}, 12929471627, 17316396939"),
        Fact(
            "linear between the positions, in the unit of the axis",
            INFERRED,
            f"{_DOCS}, 17316396939: a table of equal steps",
        ),
        Fact(
            "two function blocks, one for each direction, serve one axis", INFERRED, f"{_DOCS}, 12929466635: Direction"
        ),
        Fact("what happens beyond MinPosition and MaxPosition", OPEN),
    ),
)


class TwinCatNC(Controller):
    """Global constants of the PLC, one file for all axes, and columns for each."""

    declaration = DECLARATION

    def write(self, job: Job) -> Written:
        """`position_compensation.st`, and for each axis the same numbers as columns."""
        refuse_grids(DECLARATION, job.compensation, "isg-volcomp")
        tables, notes = [], []
        for table in job.axis_tables():
            if not table.is_pitch:
                raise InputError(
                    f"twincat-nc: a table moves {table.output} by the position of another axis: {DECLARATION.nearest}"
                )
            lattice = lattice_of(table.positions)
            tables.append(on(table, lattice))
            missed = loss(table, lattice)
            if missed > 1e-8:
                unit = "µm" if job.machine.axis(table.output).is_linear else "mrad"
                notes.append(
                    f"{table.output}: {lattice.count} equal steps miss at most {1e3 * missed:.2g} {unit} of the table."
                )
        if not tables:
            raise InputError("twincat-nc: nothing to write; expected tables of positioning")
        text = "".join(declarations(t, values_of(t, job)) for t in tables)
        files = [
            ControlFile("position_compensation.st", f"VAR_GLOBAL CONSTANT\n{text}END_VAR\n", "declarations for the PLC")
        ]
        files += [
            ControlFile(
                f"{t.output.lower()}.csv", columns(t, values_of(t, job)), f"position, value of {t.output} in + and -"
            )
            for t in tables
        ]
        notes.append("Where the compiler refuses the address of a constant, take the word CONSTANT out.")
        return Written(tuple(files), (), tuple(notes))

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Tables of the declarations; columns alone where there are none."""
        factor = -1.0 if options["sign"] == COMPENSATION else 1.0
        texts = {name: text_of(name, content) for name, content in files.items()}
        declared = {n: t for n, t in texts.items() if not n.lower().endswith(".csv")}
        if declared:
            parts = [p for n, t in declared.items() for p in read_declarations(n, t)]
        else:
            parts = [p for n, t in texts.items() for p in read_columns(n, t)]
        if not parts:
            raise InputError(
                f"{', '.join(files)}: no ARRAY OF ST_PositionCompensationTableElement; expected one for each axis"
            )
        letters = dict.fromkeys(letter for letter, _, _, _ in parts)
        return Compensation((), (), (), tuple(table_of(letter, parts, factor, machine) for letter in letters))

    def recognises(self, name: str, content: str | bytes) -> bool:
        """An array of the elements of the function block."""
        return "st_positioncompensationtableelement" in text_of(name, content).lower()


TWINCAT_NC = TwinCatNC()
