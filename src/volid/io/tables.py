"""Error and compensation tables as CSV (`volid-table/1`), one function per file (ISO/TR 16907 Table 1).

Lines "# key: value" state what the numbers are and where they come from, so that the table can be made again. Then follow the
columns position, values, u, and `outside` (1: not measured there). The value columns are

    X,EXX                 without reversal, or one `reversal value` for the axis in the header (`reversal=value`)
    X,EXX(+),EXX(-)       approached in + and in - (`reversal=columns`)
    X,EXX(+),EXX(-)-EXX(+)  approached in +, and the reversal that is added for motion in - (`reversal=difference`, 9.2.3)

In the layout of the Technical Report (`layout=iso`) nothing stands beside these columns. Lengths are in mm, rotations in rad,
positions in mm or degrees. Incremental tables hold the differences of *rounded* absolute values, and in the first row the value
itself. A running sum therefore gives the absolute table, and rounding errors do not add up. A table that is read back always
holds error values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees, isfinite
from pathlib import Path

import numpy as np

from volid.backend.even_points import round_position
from volid.compensation.rounding import round_to
from volid.compensation.tables.error_table import COLUMNS, DIFFERENCE, ITSELF, MODEL, VALUE, ErrorTable, added_in_minus
from volid.compensation.tables.meaning import meaning_of
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.io.functions_csv import OUTSIDE, Sheet
from volid.io.layouts import ISO, VOLID, check_layout
from volid.io.record import COMPENSATION, ERROR, SIGN, closing_lines, values_lines
from volid.model.iso230 import LINEAR_AXES, parse
from volid.model.machine import Machine
from volid.model.requests import ask_increments

FORMAT = "volid-table/1"
ABSOLUTE, INCREMENTAL = "absolute", "incremental"
REVERSALS = (COLUMNS, VALUE, DIFFERENCE)
_ROWS = {
    ABSOLUTE: "absolute values, not increments",
    INCREMENTAL: "increments from row to row, the first row the value itself; their running sum is the absolute value",
}
_APPLIED = {
    MODEL: "the control moves X, Y, Z; rotations act through its kinematic model and the current tool vector",
    ITSELF: "the control moves the axis itself",
}


@dataclass(frozen=True)
class TableForm:
    """How tables are written.

    `errors`: error values instead of compensation values. `incremental`: differences from row to row instead of absolute values.
    `reversal`: "columns", "value" or "difference". `layout`: "volid", or "iso" for the columns that ISO/TR 16907 Table 1 has, and
    no others. `increment`, `angle_increment`: least increment to which values are rounded
    [mm], [rad]; None: all digits. Raises `InputError` for a combination that makes no table.
    """

    errors: bool = False
    incremental: bool = False
    reversal: str = COLUMNS
    increment: float | None = None
    angle_increment: float | None = None
    layout: str = VOLID

    def __post_init__(self) -> None:
        check_layout(self.layout)
        if self.reversal not in REVERSALS:
            raise InputError(f"`reversal={self.reversal}`: expected {', '.join(REVERSALS)}")
        if self.incremental and self.reversal == DIFFERENCE:
            raise InputError("`incremental` goes with `reversal=columns` or value, not with difference")
        angle = None if self.angle_increment is None else degrees(self.angle_increment)
        ask_increments((("increment", True, self.increment), ("angle_increment", False, angle)))

    def least(self, table: ErrorTable) -> float | None:
        """Least increment of a table's values [mm or rad]."""
        return self.angle_increment if parse(table.function).is_rotation else self.increment


def increments(absolute: np.ndarray) -> np.ndarray:
    """Differences from row to row, the first row the value itself, (n,) or (n, c)."""
    return np.diff(absolute, axis=0, prepend=np.zeros_like(absolute[:1]))


def written_values(table: ErrorTable, form: TableForm) -> tuple[tuple[str, ...], np.ndarray, float]:
    """Column names, the value columns (n, c) as written, and the largest change by rounding [mm or rad]."""
    columns, rows = table.table_1(form.reversal, errors=form.errors)
    exact = rows[:, 1:]
    rounded = round_to(exact, form.least(table))
    if form.incremental:  # to the digits that are written, before differences are taken, or these digits would add up
        rounded = np.round(rounded, _digits(table))
    loss = float(np.abs(rounded - exact).max())
    return columns, increments(rounded) if form.incremental else rounded, loss


def _digits(table: ErrorTable) -> int:
    """Decimal places of the values of a table: 1e-9 mm or 1e-12 rad."""
    return 12 if parse(table.function).is_rotation else 9


def table_header(
    table: ErrorTable,
    form: TableForm,
    solution: Solution,
    source: str | Path | None = None,
    command: Sequence[str] = (),
) -> dict[str, str]:
    """The record of a table (ISO/TR 16907 12): all that is needed to use it, and to make it again."""
    lines = table_lines(table, form, solution.machine)
    return lines | closing_lines(solution, source, table.datum, command, table.notes)


def _between(table: ErrorTable) -> str:
    if not isfinite(table.interpolation):
        return "; nothing is known between the points"
    return f"; largest deviation between the points {table.interpolation:.6g} {table.unit}"


def table_lines(table: ErrorTable, form: TableForm, machine: Machine) -> dict[str, str]:
    """What the numbers of a table are; where they come from is for the maker of the table to say."""
    unit, axis_unit = table.unit, "mm" if table.axis in LINEAR_AXES else "degrees"
    values = ERROR if form.errors else COMPENSATION
    _, _, loss = written_values(table, form)
    least = form.least(table)
    lines = {
        "format": FORMAT,
        "type": table.type,
        "function": table.function,
        "meaning": meaning_of(table, machine),
        **values_lines(values),
        "rows": INCREMENTAL if form.incremental else ABSOLUTE,
        "rows mean": _ROWS[INCREMENTAL if form.incremental else ABSOLUTE],
        "units": f"{table.axis} {axis_unit}; {table.function} {unit}; u_… standard uncertainty (k = 1)",
        "applied": table.applied,
        "applied means": _APPLIED[table.applied],
        "interpolation": f"linear, end values held outside{_between(table)}",
        "zero": table.zero,
        "reversal": _reversal_text(table, form),
        "least increment": "all digits"
        if least is None
        else f"{least:.9g} {unit}; largest change by rounding {loss:.6g} {unit}",
        "limits": f"{len(table.positions)} points, {table.axis} {table.positions[0]:g} … {table.positions[-1]:g} {axis_unit}",
        "period": f"{table.period:g} degrees" if table.period else "none",
        "frame": "machine",
        **{k: v for k, v in table.basis.items() if v},
    }
    if table.has_reversal and form.reversal == VALUE:
        value = float(round_to(np.array(SIGN[values] * table.reversal_value), least))
        lines["reversal value"] = f"{value:.12g} {unit}"
    return lines


def _reversal_text(table: ErrorTable, form: TableForm) -> str:
    if not table.has_reversal:
        return "none: the same in both approach directions"
    if form.reversal == COLUMNS:
        return "columns: (+) approached with rising, (-) with falling position"
    if form.reversal == DIFFERENCE:
        return f"difference: {added_in_minus(table.function)} is added for motion in -"
    return f"value: one for the axis; up to {table.reversal_loss:.6g} {table.unit} of the reversal at single positions is left"


def table_sheet(table: ErrorTable, form: TableForm, header: Mapping[str, str]) -> Sheet:
    """The table before it is written; values keep 1e-9 mm or 1e-12 rad."""
    columns, values, _ = written_values(table, form)
    digits = _digits(table)
    places = round_position(table.positions).tolist()
    if form.layout == ISO:
        printed = ([q, *v] for q, v in zip(places, values.tolist(), strict=True))
        return Sheet({**header, "layout": ISO}, columns, printed, dict.fromkeys(columns[1:], digits), short=True)
    u = table.u if values.shape[1] == 2 else table.u.max(axis=1, keepdims=True)
    names = (f"u_{c}" for c in columns[1:])
    rows = zip(places, values.tolist(), u.tolist(), table.outside.astype(int).tolist(), strict=True)
    return Sheet(
        header=header,
        columns=(*columns, *names, OUTSIDE),
        rows=([q, *v, *s, flag] for q, v, s, flag in rows),
        digits={name: digits for c in columns[1:] for name in (c, f"u_{c}")},
    )
