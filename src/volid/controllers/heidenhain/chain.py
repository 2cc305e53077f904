"""Error lines of a HEIDENHAIN kinematics table: where the errors of each axis stand in the chain of transformations.

The table starts at the tool reference point and goes to the workpiece. A line `Trans` with an entry in COMPTAB is an error: a
constant, or a reference to a column of the .COM of the axis that causes it. MachAxis is the axis, MachBase the bed. volid writes
the six errors of an axis on the side of its MachAxis on which ISO 230-1 counts them: towards the tool for linear axes that carry
the tool and rotary ones that carry the workpiece, towards the workpiece for the others. The nominal lines (COORD) are the
machine's own and are not written.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from volid.controllers.heidenhain.table import NcTable, Row, fixed, written
from volid.exceptions import InputError
from volid.model.iso230 import DIRECTIONS, SPINDLE
from volid.model.kinematics import error_first
from volid.model.machine import Axis, Machine

KINEMATICS = "VOLID.TAB"
COLUMNS = ("NR", "DOC", "KEY", "AXIS", "COORD", "COMPTAB")
MOST_COMPTAB = 100
_REFERENCE = re.compile(r"(\w+)\.\.C([1-6])")


@dataclass(frozen=True)
class Constant:
    """An error that is the same everywhere: the function that has this value, tool relative to workpiece, such as EXC; [mm or °].

    Not EX0C, which is the place of the axis line: for an axis that carries the workpiece it has the other sign.
    """

    function: str
    value: float


@dataclass(frozen=True)
class Reference:
    """An error function in column C1 … C6 of the .COM of its axis."""

    function: str
    column: int


def column_of(function: str) -> int:
    """Number of the column C of a function: its component, X Y Z A B C."""
    return DIRECTIONS.index(function[1]) + 1


def lines(
    machine: Machine, errors: Mapping[str, Sequence[Constant | Reference]], names: Mapping[str, str], digits: int
) -> str:
    """The proposal for the kinematics table. `errors`: by axis letter, S for the tool frame.

    Raises `InputError` for more entries than the control takes.
    """
    rows = [_error(e, SPINDLE, names, digits) for e in errors.get(SPINDLE, ())]
    on_bed = sum(a.primed for a in machine.axes)
    for i in reversed(range(len(machine.axes))):
        rows += _of_axis(machine.axes[i], errors.get(machine.axes[i].letter, ()), names, digits)
        if i == on_bed:
            rows.append(("", "MachBase", "", "", ""))
    comptab = sum(bool(r[4]) or r[1] == "MachAxis" for r in rows)
    if comptab > MOST_COMPTAB:
        raise InputError(
            f"heidenhain-kinematicscomp: {comptab} entries of COMPTAB, the axes included; the control takes {MOST_COMPTAB}. "
            "Take fewer types"
        )
    return written(KINEMATICS, "MM", COLUMNS, [(str(i), *r) for i, r in enumerate(rows)])


_Line = tuple[str, str, str, str, str]


def _of_axis(axis: Axis, errors: Iterable[Constant | Reference], names: Mapping[str, str], digits: int) -> list[_Line]:
    if axis.error_point != ((0.0, 0.0, 0.0) if axis.is_linear else axis.point) or axis.axis_frame:
        raise InputError(
            f"heidenhain-kinematicscomp: errors of {axis.letter} turn about a point or in a frame of their own; the chain has "
            "them about the machine origin or the axis's point, in the machine's directions"
        )
    own: list[_Line] = [_error(e, axis.letter, names, digits) for e in errors]
    moved: _Line = ("", "MachAxis", names.get(axis.letter, axis.letter), "", "")
    return [*own, moved] if error_first(axis) else [moved, *own]


def _error(e: Constant | Reference, axis: str, names: Mapping[str, str], digits: int) -> _Line:
    if isinstance(e, Constant):
        turned = e.function[1] in "ABC"
        return (e.function, "Trans", e.function[1], "", fixed(e.value, 6 if turned else digits))
    return (e.function, "Trans", e.function[1], "", f"{names.get(axis, axis)}..C{e.column}")


def errors_of(
    name: str, table: NcTable, machine: Machine, names: Mapping[str, str]
) -> list[tuple[str, Constant | Reference]]:
    """Axis letter (S: tool frame) and error of every line of a kinematics table with an entry in COMPTAB.

    Raises `InputError` for lines that volid cannot place: constants without an ISO name, errors on the other side of their axis,
    nominal shifts other than to a rotary axis and back.
    """
    for column in ("KEY", "AXIS", "COORD", "COMPTAB"):
        if column not in table.columns:
            raise InputError(f"{name}: no column {column}; expected a kinematics table with {', '.join(COLUMNS)}")
    found, passed = [], set()
    letters = {names.get(a.letter, a.letter): a.letter for a in machine.axes}
    for row in table.rows:
        key, axis = row.cells["KEY"].upper(), row.cells["AXIS"].upper()
        if key == "MACHAXIS":
            passed.add(letters.get(axis, axis))
        elif key == "TRANS" and row.cells["COMPTAB"]:
            letter, error = _read(row, axis, letters)
            _ask_side(row, letter, passed, machine)
            found.append((letter, error))
        elif key == "TRANS" and row.cells["COORD"]:
            _ask_shift(row, axis, machine)
    return found


def _read(row: Row, component: str, letters: Mapping[str, str]) -> tuple[str, Constant | Reference]:
    if len(component) != 1 or component not in DIRECTIONS:
        raise InputError(f"{row.where}: AXIS of an error is '{component}'; expected X, Y, Z, A, B or C")
    reference = _REFERENCE.fullmatch(row.cells["COMPTAB"])
    if reference:
        if reference[1] not in letters:
            raise InputError(f"{row.where}: '{reference[0]}' names no axis of the machine; state the option axes")
        letter = letters[reference[1]]
        return letter, Reference(f"E{component}{letter}", int(reference[2]))
    doc = re.match(rf"E{component}([XYZABC{SPINDLE}])(?!\w)", row.cells.get("DOC", ""))
    value = row.number("COMPTAB")
    if doc is None:
        raise InputError(
            f"{row.where}: the constant {value:g} names no error in DOC; expected the function that has this value everywhere, "
            f"tool relative to workpiece, such as E{component}C, and not E{component}0C, which ISO 230-1 counts at the axis line"
        )
    return doc[1], Constant(f"E{component}{doc[1]}", value)


def _ask_side(row: Row, letter: str, passed: Iterable[str], machine: Machine) -> None:
    """Raises `InputError` for an error on the side of its axis where volid does not have it."""
    before = letter not in passed
    if letter != SPINDLE and before != error_first(machine.axis(letter)):
        raise InputError(
            f"{row.where}: the error of {letter} stands {'before' if before else 'after'} its MachAxis; volid reads it on the "
            "other side only, where ISO 230-1 counts it"
        )


def _ask_shift(row: Row, component: str, machine: Machine) -> None:
    """Raises `InputError` for a nominal shift that leads to no rotary axis: lever arms would begin elsewhere."""
    value = row.number("COORD")
    places = {p for a in machine.axes if not a.is_linear for c, p in zip("XYZ", a.point, strict=True) if c == component}
    if value and not any(abs(abs(value) - abs(p)) < 1e-6 for p in places):
        raise InputError(
            f"{row.where}: Trans {component} by {value:g} leads to no rotary axis of the machine; volid reads error lines whose "
            "lever arms begin at the machine origin or at a rotary axis"
        )
