"""HEIDENHAIN: KinematicsComp of the iTNC 530 HSCI, columns C1 … C6 of .COM tables and error lines of the kinematics table.

A .COM of each axis holds its positioning in the column of the axis, as ever, and its other five errors in C1 … C6, in the order
X Y Z A B C of their components; lines `Trans` of the kinematics table put them into the chain. The control corrects the position
of the tool centre point for any tool, not the orientation. Constants (location errors of rotary axes, the tool frame) stand as
numbers in COMPTAB. The kinematics table belongs to the machine: what volid writes is a proposal for a person to enter.

Not modelled: reversal of C1 … C6, which have one value; lever arms of nominal offsets that the machine's own table has elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from volid.compensation.package import Compensation
from volid.compensation.tables.error_table import ITSELF, MODEL, ErrorTable
from volid.compensation.types import TABLES
from volid.controllers.base import (
    COLUMNS,
    COMPENSATION,
    DOCUMENTED,
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
    text_of,
)
from volid.controllers.heidenhain_assignment import (
    AXES,
    CAUSE,
    CMA,
    FIXED,
    ITNC,
    MANUALPLUS,
    ROWS,
    TURN,
    assignment,
    com_name,
    decimals,
    positions_of,
    rows_of,
    tables_by_cause,
    values_of,
)
from volid.controllers.heidenhain_chain import KINEMATICS, Constant, Reference, column_of, errors_of, lines
from volid.controllers.heidenhain_table import FRAME, NcTable, fixed, parse, written
from volid.exceptions import InputError
from volid.model.iso230 import SPINDLE
from volid.model.machine import Axis, Machine

ANGLE_DIGITS = 6

DECLARATION = Declaration(
    name="heidenhain-kinematicscomp",
    title="HEIDENHAIN iTNC 530 HSCI, KinematicsComp (.COM columns C1 … C6)",
    carries={
        "L-VOL": TABLES,
        "L-ANG": TABLES,
        "L-SQU": TABLES,
        "L-STR": TABLES,
        "L-POS": TABLES,
        "R-POR": TABLES,
        "R-RAX": TABLES,
        "R-ANG": TABLES,
        "R-POS": TABLES,
    },
    nearest="KinematicsComp corrects the position of the tool centre point by functions of one axis, not the orientation, and "
    "takes no grids; isg-volcomp takes grids",
    sign=OPEN,
    units="mm, degrees for rotary axes and for C4 … C6",
    reversal=COLUMNS,
    outside=NOT_KNOWN,
    spacing=FREE,
    quantum=(1e-4, float(np.deg2rad(10.0**-ANGLE_DIGITS))),
    most_points=256,
    model=True,
    zero="make the values 0 at the home position of the axis (`zero`), else the chain is not nominal there",
    switching="positioning by the line with * in ACTIVE of the .CMA; the other errors by choosing a kinematics table with or "
    "without the error lines",
    options=(AXES, ROWS, CAUSE, TURN, Option("decimals", "decimals of positions and lengths", 4, decimals)),
    commissioning=Commissioning(
        backup=("Copy the kinematics tables, all .COM and .CMA files and the machine parameters.",),
        load=(
            "Copy the .COM files and CONFIG.CMA to where the control has its own.",
            f"Make a copy of the machine's kinematics table in the description format, and enter the lines of {KINEMATICS} that "
            "have an entry in COMPTAB at the places where they stand between the lines MachAxis. The machine's own lines Trans "
            "with COORD stay; an error line must stand where the chain's origin is the machine origin (linear axes) or the "
            "centre of the axis (rotary axes).",
            "Check in the editor how COMPTAB names a column; the manual's print shows A..C4.",
        ),
        activate=(
            "Choose nonlinear compensation for the axes (MP730), the line of the .CMA, and the new kinematics.",
            "Load one error first, by the sign check, before all others: the sense of the lines is not stated.",
        ),
        remove=("Choose the former kinematics and the former line of the .CMA.",),
    ),
    facts=(
        Fact(
            "errors of ISO 230-1 in columns C1 … C6 of the .COM, positioning in columns 1-18",
            DOCUMENTED,
            f"{ITNC} pp. 680, 686",
        ),
        Fact("lines Trans with COMPTAB: a reference to a column, or a constant", DOCUMENTED, f"{ITNC} pp. 671, 684"),
        Fact("the chain starts at the tool reference point", DOCUMENTED, f"{ITNC} p. 722"),
        Fact("the position of the tool centre point is corrected", DOCUMENTED, f"{ITNC} p. 671"),
        Fact("at most 100 entries of COMPTAB, MachAxis lines included, and 50 of COORD", DOCUMENTED, f"{ITNC} p. 686"),
        Fact("inverse lines may be left out where all axes are known", DOCUMENTED, f"{ITNC} p. 686"),
        Fact(
            "the manual recommends errors before their axis; volid writes them on the side where ISO counts them",
            INFERRED,
            ITNC,
        ),
        Fact("the rate of the compensation depends on MP4070", DOCUMENTED, f"{ITNC} p. 671"),
        Fact(
            "values in negative direction in BACKLASH, of the axis's own column", INFERRED, f"from {MANUALPLUS} p. 716"
        ),
        Fact(
            "were COMPTAB added to the shift of its line as COORD is, +e would take the tool point back by e: the lines would "
            "want `sign=compensation`",
            INFERRED,
            f"example in {ITNC} p. 670: Trans Z 250.051 leads from the tool to the axis B of a head",
        ),
        Fact("C4 … C6 are in degrees", INFERRED, f"from Trans of rotations by COORD in {ITNC} p. 722"),
        Fact(
            "whether a positive entry is the error or its correction, and how COMPTAB names a column: not stated", OPEN
        ),
        Fact("frame of the files, BEGIN … [END]", INFERRED, FRAME),
        Fact("TNC 640 and TNC 7: no public format found", OPEN),
    ),
)


class HeidenhainKinematicsComp(Controller):
    """A .COM for each axis, the .CMA, and the proposed lines of the kinematics table."""

    declaration = DECLARATION

    def write(self, job: Job) -> Written:
        """The tables and the proposal. Raises `InputError` for what they cannot hold."""
        if job.compensation.axis_tables or job.compensation.grids:
            raise InputError(
                f"{DECLARATION.name}: tables of axes and grids are none of error functions: {DECLARATION.nearest}"
            )
        errors: dict[str, list[Constant | Reference]] = {}
        coms: dict[str, _Com] = {}
        for axis in job.machine.axes:
            own = [t for t in job.compensation.tables if t.axis == axis.letter]
            functions = [t for t in own if _column(t) is None or not _is_constant(t)]
            errors[axis.letter] = [_constant(t, job) for t in own if t not in functions]
            errors[axis.letter] += [Reference(t.function, c) for t in functions if (c := _column(t)) is not None]
            if functions:
                coms[axis.letter] = _Com(axis, functions, job)
        errors[SPINDLE] = [_constant(t, job) for t in job.compensation.tables if t.axis == SPINDLE]
        files = [ControlFile(com_name(a), c.text(), f"errors of {a}") for a, c in coms.items()]
        if coms:
            files.append(ControlFile(CMA, assignment(tuple(coms), job.options["axes"]), "assignment"))
        if any(errors.values()):
            text = lines(job.machine, errors, job.options["axes"], job.options["decimals"])
            files.append(ControlFile(KINEMATICS, text, "proposed lines of the kinematics table, to be entered by hand"))
        parameters = tuple((f"MP730, bit of {a}", "1", "nonlinear axis error compensation") for a in coms)
        places = {a.letter: a.point for a in job.machine.axes if errors[a.letter] and not a.is_linear and any(a.point)}
        notes = (
            *(n for c in coms.values() for n in c.notes()),
            *(
                f"the lines of {a} stand where the chain's origin is at {', '.join(f'{v:g}' for v in p)} mm"
                for a, p in places.items()
            ),
        )
        return Written(tuple(files), parameters, notes, 0.5 * 10.0 ** -job.options["decimals"])

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Tables of error functions. Raises `InputError` that names file and line."""
        chains = {n: parse(n, text_of(n, c)) for n, c in files.items() if n.upper().endswith(".TAB")}
        if len(chains) > 1:
            raise InputError(f"{', '.join(chains)}: expected one kinematics table")
        acting = [e for n, t in chains.items() for e in errors_of(n, t, machine, options["axes"])]
        if not acting or len(files) > len(chains):
            coms = tables_by_cause(files, machine, options["axes"], options["cause"])
        else:
            coms = []
        sense = -1.0 if options["sign"] == COMPENSATION else 1.0
        held = {axis.letter: (axis, name, table) for axis, name, table in coms}
        if not chains:
            acting = [(a, Reference(f"E{'XYZABC'[k - 1]}{a}", k)) for a, (_, _, t) in held.items() for k in _filled(t)]
        found = [t for axis, name, table in coms for t in _positioning(axis, name, table, options["axes"])]
        found += [_error(letter, e, held, machine, sense) for letter, e in acting]
        return Compensation((), tuple(found), ())


def _column(t: ErrorTable) -> int | None:
    """Number of the column C of a function; None for positioning, which has the column of its axis."""
    if t.function[1] == t.axis:
        if t.applied == MODEL and t.axis in "ABC":
            raise InputError(
                f"{DECLARATION.name}: {t.function} through the kinematic model has no column; take R-POS, which turns the axis"
            )
        return None
    return column_of(t.function)


def _is_constant(t: ErrorTable) -> bool:
    return bool(np.ptp(np.concatenate([t.forward, t.reverse])) == 0.0)


def _in_file(function: str) -> float:
    """What a value in mm or rad is multiplied by for the file."""
    return 1.0 if function[1] in "XYZ" else 180.0 / np.pi


def _constant(t: ErrorTable, job: Job) -> Constant:
    """A function that is the same everywhere; of the tool frame EA0S becomes EAS."""
    function = f"{t.function[:2]}{t.axis}"
    return Constant(function, float(job.factor * _in_file(function) * t.forward[0]))


class _Com:
    """The .COM of one axis."""

    def __init__(self, axis: Axis, tables: Sequence[ErrorTable], job: Job) -> None:
        self.axis, self.options, self.sense = axis, job.options, job.factor
        self.own = next((t for t in tables if _column(t) is None), None)
        self.others = {column_of(t.function): t for t in tables if t is not self.own}
        places = [t.positions for t in tables]
        self.rows, self.x = rows_of(f"{DECLARATION.name}: {com_name(axis.letter)}", places, axis, self.options)

    def _cells(self, t: ErrorTable, way: float) -> list[str]:
        digits = self.options["decimals"] if t.function[1] in "XYZ" else ANGLE_DIGITS
        sense = 1.0 if t is self.own else self.sense
        values = sense * _in_file(t.function) * t.at(self.x, np.full(len(self.x), way))
        return [fixed(v, digits) for v in values]

    def text(self) -> str:
        """The file."""
        name = self.options["axes"].get(self.axis.letter, self.axis.letter)
        columns = {"AXISPOS": [fixed(x, self.options["decimals"]) for x in self.rows], "BACKLASH": [""] * len(self.x)}
        if self.own is not None:
            columns[name] = self._cells(self.own, 1.0)
            if self.own.has_reversal:
                columns["BACKLASH"] = self._cells(self.own, -1.0)
        columns |= {f"C{k}": self._cells(t, 0.0) for k, t in sorted(self.others.items())}
        rows = [(str(i), *cells) for i, cells in enumerate(zip(*columns.values(), strict=True))]
        return written(com_name(self.axis.letter), "MM", ("NR", *columns), rows)

    def notes(self) -> list[str]:
        """What the table cannot hold."""
        lost = [t.function for t in self.others.values() if t.has_reversal]
        found = [f"{', '.join(lost)}: one value for both directions, their mean"] if lost else []
        low, high = self.axis.travel
        if self.x.min() > low + 1e-6 or self.x.max() < high - 1e-6:
            found.append(
                f"{com_name(self.axis.letter)} covers {self.x.min():g} … {self.x.max():g} of the travel {low:g} … {high:g} "
                f"{self.axis.unit}; what the control does beyond is not stated"
            )
        return found


def _filled(table: NcTable) -> list[int]:
    return [k for k in range(1, 7) if table.filled(f"C{k}")]


def _positioning(axis: Axis, name: str, table: NcTable, names: Mapping[str, str]) -> list[ErrorTable]:
    """The column of the axis itself. Raises `InputError` for columns of other axes."""
    own = names.get(axis.letter, axis.letter)
    known = {*FIXED, own, *(f"C{k}" for k in range(1, 7))}
    for column in table.columns:
        if column not in known and table.filled(column):
            raise InputError(
                f"{name}: column {column} corrects another axis than {own}; heidenhain-com reads such columns"
            )
    if not table.filled(own):
        return []
    x, function = positions_of(table, axis, name), f"E{axis.letter}{axis.letter}"
    factor = (table.length if axis.is_linear else 1.0) / _in_file(function)
    up = values_of(table, own, factor)
    down = values_of(table, "BACKLASH", factor) if table.filled("BACKLASH") else up
    return [_table(function, axis, x, (up, down))]


def _error(
    letter: str, e: Constant | Reference, held: Mapping[str, tuple[Axis, str, NcTable]], machine: Machine, sense: float
) -> ErrorTable:
    """One line of the chain as a table."""
    if isinstance(e, Constant):
        value = np.full(2, sense * e.value / _in_file(e.function))
        if letter == SPINDLE:
            return _table(f"{e.function[:2]}0{SPINDLE}", None, np.zeros(1), (value[:1], value[:1]))
        axis = machine.axis(letter)
        return _table(e.function, axis, np.array(axis.travel), (value, value))
    if letter not in held:
        raise InputError(
            f"{e.function}: COMPTAB names column C{e.column} of {letter}, whose .COM is not among the files or not active"
        )
    axis, name, table = held[letter]
    if not table.filled(f"C{e.column}"):
        raise InputError(
            f"{name}: column C{e.column} has no values, but the kinematics table names it for {e.function}"
        )
    factor = sense * (table.length if e.function[1] in "XYZ" else 1.0) / _in_file(e.function)
    values = values_of(table, f"C{e.column}", factor)
    return _table(e.function, axis, positions_of(table, axis, name), (values, values))


def _table(function: str, axis: Axis | None, x: np.ndarray, both: tuple[np.ndarray, np.ndarray]) -> ErrorTable:
    itself = axis is not None and not axis.is_linear and function[1] == axis.letter
    kind = "R-POS" if itself else "L-VOL" if axis is None or axis.is_linear else "R-VOL"
    turn = axis is not None and not axis.is_linear and abs(x[0]) < 1e-6 and abs(x[-1] - 360.0) < 1e-6
    u, outside = np.full((len(x), 2), np.nan), np.zeros(len(x), dtype=bool)
    applied = ITSELF if itself else MODEL
    return ErrorTable(kind, function, x, *both, u, outside, applied, 0.0, period=360.0 if turn else 0.0)


HEIDENHAIN_KINEMATICSCOMP = HeidenhainKinematicsComp()
