"""Which axis causes what a .COM table of a HEIDENHAIN control holds: the active line of the .CMA table, and the tables by cause.

[axis of a column of the .COM] = F(axis of the column of the .CMA in which the .COM is entered).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from volid.controllers.base import Option, text_of
from volid.controllers.heidenhain.table import NcTable, parse, written
from volid.controllers.options import axis_names, one_of, whole
from volid.exceptions import InputError
from volid.model.machine import Axis, Machine

CMA = "CONFIG.CMA"
REFUSE, WRAP = "refuse", "wrap"
FIXED = ("NR", "AXISPOS", "BACKLASH")
MANUALPLUS = "HEIDENHAIN, MANUALplus 620 Technical Manual (01/2012)"
ITNC = "HEIDENHAIN, iTNC 530 HSCI Technical Manual (07/2013)"
TNC407 = "HEIDENHAIN, TNC 407/415/425 Technical Manual (01/1998)"


DECIMALS = Option("decimals", "decimals of positions and lengths", 4, whole(3, 7, "a number of decimals"))
AXES = Option(
    "axes",
    "keys of the axes at the control, such as X=X,Y=Y1 (CfgAxes/axisList); by default the letters",
    {},
    axis_names,
)
CAUSE = Option(
    "cause", "the axis whose positions a single .COM file holds, to read it without its .CMA", "", one_of("", *"xyzabc")
)
TURN = Option(
    "below_zero",
    "rotary positions below 0: refuse, or wrap: written one turn up, for a control that looks up -30° at 330°",
    REFUSE,
    one_of(REFUSE, WRAP),
)
ROWS = Option(
    "max_rows",
    "rows that a .COM table may have: 256 on a TNC 407; not stated for later controls",
    256,
    whole(2, 5000, "a number of rows"),
)


def axis_of(name: str, where: str, names: Mapping[str, str], machine: Machine) -> Axis:
    """The axis that the control calls so. Raises `InputError` where none is."""
    for axis in machine.axes:
        if name == names.get(axis.letter, axis.letter):
            return axis
    known = ", ".join(f"{a.letter}={names.get(a.letter, a.letter)}" for a in machine.axes)
    raise InputError(f"{where}: column '{name}' is no axis of the machine ({known}); state the option axes")


def tables_by_cause(
    files: Mapping[str, str | bytes], machine: Machine, names: Mapping[str, str], cause: str
) -> list[tuple[Axis, str, NcTable]]:
    """Each active .COM with the axis that causes what it holds, and the name of its file.

    Raises `InputError` where the assignment is missing or does not name one line.
    """
    parsed = {n: parse(n, text_of(n, c)) for n, c in files.items() if n.upper().endswith((".COM", ".CMA"))}
    by_name = {n.replace("\\", "/").rsplit("/", 1)[-1].upper(): n for n, t in parsed.items() if t.ending == "COM"}
    assignments = {n: t for n, t in parsed.items() if t.ending == "CMA"}
    if not by_name:
        raise InputError(
            f"{', '.join(files)}: no table of the kind .COM; expected a file that begins with BEGIN XAXIS.COM MM"
        )
    if not assignments and cause and len(by_name) == 1:
        (name,), cause = by_name.values(), cause.upper()
        return [(axis_of(names.get(cause, cause), name, names, machine), name, parsed[name])]
    if len(assignments) != 1:
        raise InputError(
            f"{', '.join(files)}: {len(assignments)} tables of the kind .CMA; expected one, which says whose positions the .COM "
            "hold, or one .COM and the option cause"
        )
    ((name, table),) = assignments.items()
    return [
        (axis_of(column, where, names, machine), by_name[com], parsed[by_name[com]])
        for column, com, where in _active(name, table, by_name)
    ]


def _active(name: str, table: NcTable, known: Mapping[str, str]) -> Iterable[tuple[str, str, str]]:
    """Column, .COM and place of every entry of the active line."""
    active = [row for row in table.rows if row.cells.get("ACTIVE") == "*"]
    if len(active) != 1:
        raise InputError(f"{name}: {len(active)} lines are active, with * in the column ACTIVE; expected one")
    found = []
    for column in table.columns:
        entry = active[0].cells[column].replace("\\", "/").rsplit("/", 1)[-1].upper()
        if column not in ("NR", "ACTIVE", "DOC") and entry:
            com = entry if entry.endswith(".COM") else f"{entry}.COM"
            if com not in known:
                raise InputError(f"{active[0].where}: {column} has '{entry}', which is not among the files")
            found.append((column, com, active[0].where))
    if not found:
        raise InputError(f"{active[0].where}: the active line assigns no table")
    return found


def assignment(causes: Sequence[str], names: Mapping[str, str]) -> str:
    """The .CMA table whose line 0 is active and assigns XAXIS.COM to X, and so on."""
    columns = [names.get(a, a) for a in causes]
    return written(CMA, "", ("NR", "ACTIVE", *columns), [("0", "*", *(com_name(a) for a in causes))])


def com_name(letter: str) -> str:
    """Name of the .COM of an axis."""
    return f"{letter}AXIS.COM"


def positions_of(table: NcTable, axis: Axis, where: str) -> np.ndarray:
    """AXISPOS of the rows, rising [mm or °]. Raises `InputError` for fewer than two rows, and rows that do not rise."""
    if "AXISPOS" not in table.columns or len(table.rows) < 2:
        raise InputError(f"{where}: expected a column AXISPOS and two rows at least; {len(table.rows)} rows found")
    x = np.array([row.number("AXISPOS") for row in table.rows]) * (table.length if axis.is_linear else 1.0)
    wrong = np.flatnonzero(np.diff(x) <= 0.0)
    if len(wrong):
        raise InputError(
            f"{table.rows[wrong[0] + 1].where}: AXISPOS {x[wrong[0] + 1]:g} does not rise above {x[wrong[0]]:g}"
        )
    return x


def values_of(table: NcTable, column: str, factor: float) -> np.ndarray:
    """The values of a column times a factor. Raises `InputError` for an empty cell."""
    return factor * np.array([row.number(column) for row in table.rows])


def rows_of(
    what: str, positions: Sequence[np.ndarray], axis: Axis, options: Mapping[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """AXISPOS of the rows, and the positions of the axis whose values they hold, (n,) each [mm or °].

    They differ for a rotary axis below 0 with `below_zero` "wrap": rows from 0 to 360, -30° in the row of 330°. Raises
    `InputError` for more rows than allowed, and for positions of a rotary axis beyond 0 … 360°.
    """
    x = np.unique(np.round(np.concatenate(positions), options["decimals"]))
    beyond = not axis.is_linear and (x[0] < -1e-9 or x[-1] > 360.0 + 1e-9)
    if beyond and (options["below_zero"] != WRAP or x[-1] - x[0] > 360.0 or x[-1] > 360.0):
        raise InputError(
            f"{what} goes from {x[0]:g} to {x[-1]:g}°; the control recognises positions of a rotary axis from 0 to 360° only. "
            "Where it looks up -30° at 330°, state the option below_zero=wrap; else take types without error motions of this axis"
        )
    rows = np.unique(np.concatenate([[0.0, 360.0], np.mod(x, 360.0)])) if beyond else x
    if len(rows) > options["max_rows"]:
        most = options["max_rows"]
        raise InputError(
            f"{what} has {len(rows)} positions; the control holds {most} (option max_rows). Take a larger `step`, or "
            f"`max_points={most}`"
        )
    return rows, np.where(rows > x[-1], rows - 360.0, rows) if beyond else rows
