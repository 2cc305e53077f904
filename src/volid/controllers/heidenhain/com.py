"""HEIDENHAIN: nonlinear axis error compensation, tables .COM of values over the position of an axis, assigned by a table .CMA.

One .COM for each axis that causes errors: AXISPOS, its positions; one column for each axis that is corrected, the own one
(pitch) and others (sag, squareness) together; BACKLASH, the values measured in negative direction. The values are errors,
actual - nominal.

Not modelled: what the control does beyond the first and last row; it is taken to hold the end values.
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
    ERROR,
    FREE,
    INFERRED,
    NOT_KNOWN,
    OPEN,
    Commissioning,
    ControlFile,
    Controller,
    Declaration,
    Fact,
    Job,
    Option,
    Written,
)
from volid.controllers.heidenhain.assignment import (
    AXES,
    CAUSE,
    CMA,
    DECIMALS,
    FIXED,
    ITNC,
    MANUALPLUS,
    ROWS,
    TNC407,
    TURN,
    assignment,
    axis_of,
    com_name,
    positions_of,
    rows_of,
    tables_by_cause,
    values_of,
)
from volid.controllers.heidenhain.table import FRAME, NcTable, begins, fixed, has_columns_c, written
from volid.controllers.options import one_of
from volid.exceptions import InputError
from volid.model.machine import Axis, Machine

COLUMN, PARAMETER = "column", "parameter"


DECLARATION = Declaration(
    name="heidenhain-com",
    title="HEIDENHAIN TNC, nonlinear axis errors (.COM, .CMA)",
    carries={"L-SQU": TABLES, "L-STR": TABLES, "L-POS": TABLES, "R-POS": TABLES},
    nearest="a .COM corrects axes by the position of one axis, without lever arms; heidenhain-kinematicscomp carries angles and "
    "location errors",
    sign=ERROR,
    units="mm, degrees for rotary axes",
    reversal=COLUMNS,
    outside=NOT_KNOWN,
    spacing=FREE,
    quantum=(1e-4, float(np.deg2rad(1e-4))),
    most_points=256,
    zero="make the values 0 at the reference point (`zero`): nominal positions change by what stands there when a table begins",
    switching="the line with * in the column ACTIVE of the .CMA holds what is on; write further lines for other selections. All "
    "columns of a .COM are on together",
    options=(
        AXES,
        ROWS,
        CAUSE,
        TURN,
        DECIMALS,
        Option(
            "backlash",
            "column: values in negative direction go into the column BACKLASH; parameter: mean of both, and MP710",
            COLUMN,
            one_of(COLUMN, PARAMETER),
        ),
    ),
    commissioning=Commissioning(
        backup=("Copy all .COM and .CMA files and the machine parameters.",),
        load=(
            "Copy the .COM files and CONFIG.CMA to where the control has its own; where there is a CONFIG.CMA, enter the .COM "
            "files in a new line of it instead.",
            "Open each table once in the control's editor: it must show all rows.",
        ),
        activate=(
            "Choose nonlinear compensation for each axis that causes errors (MP730, its bit 1).",
            "Set * in the column ACTIVE of the line, or select it with PLC module 9095; reference the axes.",
        ),
        remove=("Set * in the former line, or the bits of MP730 to 0.",),
    ),
    facts=(
        Fact(
            "axis of the column in .COM = F(axis of the column in .CMA)",
            DOCUMENTED,
            f"{MANUALPLUS} p. 718; {TNC407} p. 4-28",
        ),
        Fact("AXISPOS refers to the machine datum", DOCUMENTED, f"{MANUALPLUS} p. 716"),
        Fact("values measured in negative direction stand in the column BACKLASH", DOCUMENTED, f"{MANUALPLUS} p. 716"),
        Fact(
            "BACKLASH holds the values, not differences, of the axis's own column; other columns have one value",
            INFERRED,
            f"from {MANUALPLUS} p. 716",
        ),
        Fact(
            "values are errors, positive where the table travels too far",
            INFERRED,
            f"{TNC407} p. 4-26, which says so of MP720, and the figure of p. 4-28",
        ),
        Fact("at most 256 rows of a .COM (error 3 of module 9095)", DOCUMENTED, f"{TNC407} p. 622"),
        Fact("one line of the .CMA is active, marked * in ACTIVE", DOCUMENTED, f"{MANUALPLUS} p. 718"),
        Fact("rotary axes: rows from 0 to 360° only", DOCUMENTED, f"{TNC407} p. 4-31"),
        Fact("linear or nonlinear compensation, by bits of MP730", DOCUMENTED, f"{TNC407} p. 4-26; {ITNC} p. 647"),
        Fact(
            "backlash parameter: positive where the encoder is ahead of the table, whose travel is too short",
            DOCUMENTED,
            f"{TNC407} p. 4-23; {ITNC} p. 647",
        ),
        Fact("frame of the files, BEGIN … [END], columns at the places of their names", INFERRED, FRAME),
        Fact(
            "number of decimals that a column takes, and what happens beyond the first and last row: not stated", OPEN
        ),
        Fact(
            "older controls want rows at distances of 2^n µm; their tables are not written",
            DOCUMENTED,
            f"{TNC407} p. 4-28",
        ),
    ),
)


class HeidenhainCom(Controller):
    """One .COM for each axis that causes errors, and the .CMA that assigns them."""

    declaration = DECLARATION

    def write(self, job: Job) -> Written:
        """The tables and their assignment. Raises `InputError` for what they cannot hold."""
        by_cause: dict[str, list[AxisTable]] = {}
        for table in job.axis_tables():
            if table.factor is not None:
                raise InputError(f"{DECLARATION.name}: {table.source} acts through a lever arm: {DECLARATION.nearest}")
            by_cause.setdefault(table.argument, []).append(table)
        causes = {a: _Cause(job.machine.axis(a), tables, job) for a, tables in by_cause.items()}
        files = [ControlFile(com_name(a), c.text(), f"errors that {a} causes") for a, c in causes.items()]
        files.append(ControlFile(CMA, assignment(tuple(causes), job.options["axes"]), "assignment"))
        parameters = [p for c in causes.values() for p in c.parameters()]
        notes = [n for c in causes.values() for n in c.notes()]
        return Written(tuple(files), tuple(parameters), tuple(notes), 0.5 * 10.0 ** -job.options["decimals"])

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Tables of the axes. Raises `InputError` that names file and line."""
        found: list[AxisTable] = []
        for cause, name, table in tables_by_cause(files, machine, options["axes"], options["cause"]):
            found += _of_com(cause, name, table, machine, options["axes"])
        return Compensation((), (), (), tuple(found))

    def recognises(self, name: str, content: str | bytes) -> bool:
        """Whether a table .COM without columns of KinematicsComp begins, or a .CMA."""
        return begins(content, "COM", "CMA") and not has_columns_c(content)


class _Cause:
    """What one axis causes."""

    def __init__(self, axis: Axis, tables: Sequence[AxisTable], job: Job) -> None:
        self.axis, self.machine, self.options = axis, job.machine, job.options
        self.tables = {t.output: t for t in tables}
        places = [t.positions for t in tables]
        self.rows, self.x = rows_of(f"{DECLARATION.name}: {com_name(axis.letter)}", places, axis, self.options)

    @property
    def _own(self) -> AxisTable | None:
        return self.tables.get(self.axis.letter)

    @property
    def _both(self) -> bool:
        """Whether the column BACKLASH is filled."""
        return self._own is not None and self._own.has_reversal and self.options["backlash"] == COLUMN

    def _values(self, output: str) -> np.ndarray:
        """The column of an axis, in the unit of the file: in +, where the other direction has a column, else the mean."""
        way = 1.0 if output == self.axis.letter and self._both else 0.0
        return self._scale(output) * self.tables[output].of_argument(self.x, np.full(len(self.x), way))

    def _scale(self, output: str) -> float:
        return 1.0 if self.machine.axis(output).is_linear else 180.0 / np.pi

    def text(self) -> str:
        """The .COM."""
        digits, names = self.options["decimals"], self.options["axes"]
        columns = {names.get(o, o): self._values(o) for o in self.tables}
        back = [""] * len(self.x)
        if self._own is not None and self._both:
            down = self._own.of_argument(self.x, np.full(len(self.x), -1.0))
            back = [fixed(self._scale(self.axis.letter) * v, digits) for v in down]
        rows = [
            (str(i), fixed(x, digits), back[i], *(fixed(v[i], digits) for v in columns.values()))
            for i, x in enumerate(self.rows)
        ]
        return written(com_name(self.axis.letter), "MM", (*FIXED, *columns), rows)

    def parameters(self) -> list[tuple[str, str, str]]:
        """Machine parameters of the axis."""
        letter = self.axis.letter
        found = [(f"MP730, bit of {letter}", "1", "nonlinear axis error compensation")]
        if self._both:
            found.append((f"MP710, MP750 / MP_backLash of {letter}", "0", "the reversal stands in the column BACKLASH"))
        elif self._own is not None and self._own.has_reversal:
            lost = -self._scale(letter) * self._own.reversal_value
            found.append(
                (f"MP710 / MP_backLash of {letter}", fixed(lost, 4), f"backlash [{self.axis.unit}], not the former")
            )
        return found

    def notes(self) -> list[str]:
        """What the table cannot hold, sentence by sentence."""
        found, (low, high) = [], self.axis.travel
        for o, t in self.tables.items():
            lost = self._scale(o) * np.abs(t.forward - t.reverse).max()
            if lost > 1e-7 and not (o == self.axis.letter and self._both):
                found.append(
                    f"{com_name(self.axis.letter)}, {o}: one value for both directions; they differ by up to {lost:.5f}"
                )
        if self.x.min() > low + 1e-6 or self.x.max() < high - 1e-6:
            found.append(
                f"{com_name(self.axis.letter)} covers {self.x.min():g} … {self.x.max():g} {self.axis.unit} of the travel "
                f"{low:g} … {high:g}; what the control does beyond is not stated"
            )
        return found


def _of_com(cause: Axis, name: str, table: NcTable, machine: Machine, names: Mapping[str, str]) -> list[AxisTable]:
    """The columns of a .COM as tables of axes."""
    x, found = positions_of(table, cause, name), []
    period = 360.0 if not cause.is_linear and abs(x[0]) < 1e-6 and abs(x[-1] - 360.0) < 1e-6 else 0.0
    for column in (c for c in table.columns if c not in FIXED and table.filled(c)):
        output = axis_of(column, name, names, machine)
        factor = table.length if output.is_linear else np.pi / 180.0
        up = values_of(table, column, factor)
        two = output.letter == cause.letter and table.filled("BACKLASH")
        down = values_of(table, "BACKLASH", factor) if two else up
        found.append(AxisTable(output.letter, cause.letter, x, up, down, period=period))
    if not found:
        raise InputError(
            f"{name}: no column of an axis has values; expected columns such as X beside {', '.join(FIXED)}"
        )
    return found


HEIDENHAIN_COM = HeidenhainCom()
