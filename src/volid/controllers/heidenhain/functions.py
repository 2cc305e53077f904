"""Error functions of one axis in a .COM of a HEIDENHAIN control with KinematicsComp, and back.

Positioning has the column of the axis itself, with BACKLASH for the other direction, and is an error whatever the sense of the
others; these have columns C1 … C6, one value for both directions, angles in degrees.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from volid.compensation.tables.by_axis import turned_by
from volid.compensation.tables.error_table import ITSELF, MODEL, ErrorTable
from volid.controllers.base import Job
from volid.controllers.heidenhain.assignment import FIXED, com_name, positions_of, rows_of, values_of
from volid.controllers.heidenhain.chain import Constant, Reference, column_of
from volid.controllers.heidenhain.table import NcTable, fixed, written
from volid.exceptions import InputError
from volid.model.iso230 import SPINDLE
from volid.model.machine import Axis, Machine

NAME = "heidenhain-kinematicscomp"
ANGLE_DIGITS = 6


def own_column(t: ErrorTable) -> int | None:
    """Number of the column C of a function; None for positioning, which has the column of its axis."""
    if t.function[1] == t.axis:
        if t.applied == MODEL and t.axis in "ABC":
            raise InputError(
                f"{NAME}: {t.function} through the kinematic model has no column; take R-POS, which turns the axis"
            )
        return None
    return column_of(t.function)


def is_constant(t: ErrorTable) -> bool:
    return bool(np.ptp(np.concatenate([t.forward, t.reverse])) == 0.0)


def _in_file(function: str) -> float:
    """What a value in mm or rad is multiplied by for the file."""
    return 1.0 if function[1] in "XYZ" else 180.0 / np.pi


def _own_sense(axis: Axis, function: str) -> float:
    """From the error function of an axis's positioning to its own column, which counts as the axis does."""
    return 1.0 if axis.is_linear else turned_by(axis, function)


def constant_of(t: ErrorTable, job: Job) -> Constant:
    """A function that is the same everywhere; of the tool frame EA0S becomes EAS."""
    function = f"{t.function[:2]}{t.axis}"
    return Constant(function, float(job.factor * _in_file(function) * t.forward[0]))


class Com:
    """The .COM of one axis."""

    def __init__(self, axis: Axis, tables: Sequence[ErrorTable], job: Job) -> None:
        self.axis, self.options, self.sense = axis, job.options, job.factor
        self.own = next((t for t in tables if own_column(t) is None), None)
        self.others = {column_of(t.function): t for t in tables if t is not self.own}
        places = [t.positions for t in tables]
        self.rows, self.x = rows_of(f"{NAME}: {com_name(axis.letter)}", places, axis, self.options)

    def _cells(self, t: ErrorTable, way: float) -> list[str]:
        digits = self.options["decimals"] if t.function[1] in "XYZ" else ANGLE_DIGITS
        sense = _own_sense(self.axis, t.function) if t is self.own else self.sense
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


def filled(table: NcTable) -> list[int]:
    return [k for k in range(1, 7) if table.filled(f"C{k}")]


def positioning(axis: Axis, name: str, table: NcTable, names: Mapping[str, str]) -> list[ErrorTable]:
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
    factor = (table.length if axis.is_linear else _own_sense(axis, function)) / _in_file(function)
    up = values_of(table, own, factor)
    down = values_of(table, "BACKLASH", factor) if table.filled("BACKLASH") else up
    return [_table(function, axis, x, (up, down))]


def error_of(
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
