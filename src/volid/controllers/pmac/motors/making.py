"""From tables of axes and grids over two axes to tables of motors, and back.

The table of an axis over its own position holds the direction + in its COMP table, and what the axis must move further in - as
its backlash: the table over two axes has no direction, so that the mean of both is held there, and over other axes as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from volid.compensation.grids.grid import AnyGrid, Grid
from volid.compensation.tables.axis_table import AxisTable
from volid.controllers.axis_values import taken_off
from volid.controllers.base import Job
from volid.controllers.pmac.motors.script import BLCOMP, COMP, MotorTable, Script
from volid.controllers.pmac.motors.spans import Motor, Span, span_over
from volid.controllers.tables.resampling import at_nodes, extended, spacing_of
from volid.controllers.turning import refuse_turning
from volid.exceptions import InputError
from volid.model.jacobian import axis_directions
from volid.model.machine import Machine

_NOTHING = 1e-9  # mm or rad
_MOST_OF_TWO = 200  # entries along either of two source motors, where the table itself has no more
_MOST_BACKLASH = 8_388_607


def tables_of(job: Job, motors: Mapping[str, Motor]) -> Script:
    """Tables of motors for a job. Raises `InputError` for more tables than there are motors to own them."""
    made = _Maker(motors, job.options["owners"])
    for table in job.axis_tables(products=True):
        if table.factor is None:
            made.over_one(table)
        else:
            made.over_two(table.output, *_of_product(table), table.source)
    for grid in job.compensation.grids:
        for letter, values in _by_axis(job.machine, grid).items():
            made.over_two(letter, grid.axes, grid.nodes, values, f"grid of {grid.type}")
    return made.script()


def _of_product(table: AxisTable) -> tuple[tuple[str, str], tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Axes, nodes and values of a table that a lever arm multiplies; the mean of both directions."""
    assert table.factor is not None
    nodes = (table.positions, table.factor.positions)
    return (table.argument, table.factor.axis), nodes, np.outer(table.mean, table.factor.values)


def _by_axis(machine: Machine, grid: AnyGrid) -> dict[str, np.ndarray]:
    """Deviations along each linear axis at the nodes of a grid over two of them. Raises `InputError` for another grid."""
    if not isinstance(grid, Grid) or len(grid.axes) != 2 or np.isnan(grid.values[:, :3]).any():
        raise InputError(
            f"pmac: grid of {grid.type} over {', '.join(grid.axes)}; expected one over two linear axes without gaps"
        )
    refuse_turning("pmac", machine)
    linear = [i for i, a in enumerate(machine.axes) if a.is_linear]
    directions = axis_directions(machine, np.zeros((1, len(machine.axes))))[0][:, linear]
    along = np.linalg.pinv(directions) @ grid.values[:, :3].T
    shape = tuple(len(n) for n in reversed(grid.nodes))
    return {
        machine.axes[i].letter: row.reshape(shape).T
        for i, row in zip(linear, along, strict=True)
        if np.abs(row).max() > _NOTHING
    }


class _Maker:
    """Collects tables of motors, each owned by a motor of its own."""

    def __init__(self, motors: Mapping[str, Motor], owners: int) -> None:
        self.motors, self.owners = motors, owners
        self.tables: list[MotorTable] = []
        self.backlash: dict[int, int] = {}
        self.notes: list[str] = []
        self.shifts: dict[str, float] = {}  # by axis [mm or rad]
        self.rounding = 0.0

    def script(self) -> Script:
        """All tables."""
        shifted = [_shift_words(self.motors[a], off) for a, off in self.shifts.items() if abs(off) > _NOTHING]
        return Script(tuple(self.tables), self.backlash, (*shifted, *self.notes), self.rounding)

    def over_one(self, table: AxisTable) -> None:
        """A table over one axis; of an axis over itself with its backlash."""
        source, target = self.motors[table.argument], self.motors[table.output]
        q = table.positions
        span = span_over(source, float(q[0]), float(q[-1]), spacing_of(q, source.home), table.period)
        way = 1.0 if table.is_pitch else 0.0
        error = at_nodes(table, span.positions, way)
        entries = self._entries(error, error[span.zero], target)[span.order]
        if entries[-1]:
            raise InputError(
                f"pmac: table of {table.source} differs by {entries[-1]} entries over a turn; expected that it closes"
            )
        self._own(table.source, target, (source,), (span,), entries)
        self._shift(target, float(error[span.zero]))
        if table.period == 0.0:
            held = extended(table.positions, table.of_argument(q, np.full(len(q), way)), span.positions)
            missed = np.abs(np.interp(q, span.positions, held) - table.of_argument(q, np.full(len(q), way))).max()
            self._missed(f"{table.output} over {table.argument}", float(missed), target)
        if table.has_reversal and table.is_pitch:
            self._reversal(table, span, float(error[span.zero]))
        elif table.has_reversal:
            self.notes.append(
                f"{table.output} over {table.argument}: the mean of both directions; up to {_largest(table):.3g} mm are "
                "left in either"
            )

    def over_two(
        self, output: str, axes: tuple[str, ...], nodes: Sequence[np.ndarray], values: np.ndarray, words: str
    ) -> None:
        """A table over two axes: error values of one axis, shape (nodes of the first, of the second) [mm]."""
        sources, target = tuple(self.motors[a] for a in axes), self.motors[output]
        spans = tuple(
            span_over(m, float(n[0]), float(n[-1]), spacing_of(n, m.home, _MOST_OF_TWO))
            for m, n in zip(sources, nodes, strict=True)
        )
        along = np.stack([extended(nodes[0], column, spans[0].positions) for column in values.T])
        error = np.stack([extended(nodes[1], row, spans[1].positions) for row in along.T])
        zero = float(error[spans[0].zero, spans[1].zero])
        entries = self._entries(error, zero, target)
        self._own(words, target, sources, spans, entries[np.ix_(spans[0].order, spans[1].order)].T)
        self._shift(target, zero)
        there = np.stack([np.interp(nodes[0], spans[0].positions, column) for column in error.T], axis=1)
        there = np.stack([np.interp(nodes[1], spans[1].positions, row) for row in there])
        self._missed(f"{output} over {axes[0]} and {axes[1]}", float(np.abs(there - values).max()), target)

    def _entries(self, error: np.ndarray, zero: float, target: Motor) -> np.ndarray:
        """What is added to the target [1/16 count]: minus the error, 0 at motor zero."""
        wanted = target.parts * (zero - error)
        found = np.rint(wanted).astype(np.int64)
        self.rounding = max(self.rounding, float(np.abs(found - wanted).max()) / target.parts)
        return found

    def _own(
        self, words: str, target: Motor, sources: tuple[Motor, ...], spans: tuple[Span, ...], entries: np.ndarray
    ) -> None:
        owned = {t.owner for t in self.tables if t.command == COMP}
        free = [n for n in (target.number, *range(1, self.owners + 1)) if n not in owned]
        if not free:
            raise InputError(
                f"pmac: more than {self.owners} tables; each belongs to a motor of its own. Take fewer types, or state how many "
                "motors the control has by option owners"
            )
        lengths, numbers = tuple(s.length for s in spans), tuple(m.number for m in sources)
        self.tables.append(MotorTable(COMP, free[0], numbers, target.number, lengths, entries, words or "table"))

    def _reversal(self, table: AxisTable, span: Span, zero: float) -> None:
        """What the motor must move further in -: Ixx86 at motor zero, and a BLCOMP table of the differences from it."""
        motor = span.motor
        up, down = (self._entries(at_nodes(table, span.positions, w), zero, motor) for w in (1.0, -1.0))
        further = up - down
        at_zero = int(further[span.zero])
        held = min(max(at_zero, 0), _MOST_BACKLASH)
        if held != at_zero:
            self.notes.append(
                f"{motor.axis}: at motor zero the axis runs ahead by {_size(-at_zero / motor.parts, motor)} after a reversal; "
                f"I{motor.number}86 holds no such value: none is compensated there, "
                "and less than all up to the next positions of its table"
            )
            self.rounding = max(self.rounding, abs(at_zero - held) / motor.parts)
        entries = (further - held)[span.order]
        entries[[0, -1]] = 0
        if held:
            self.backlash[motor.number] = held
        if entries.any():
            words = f"backlash of {motor.axis}"
            self.tables.append(
                MotorTable(BLCOMP, motor.number, (motor.number,), motor.number, (span.length,), entries, words)
            )

    def _shift(self, target: Motor, zero: float) -> None:
        self.shifts[target.axis] = self.shifts.get(target.axis, 0.0) + zero

    def _missed(self, what: str, missed: float, target: Motor) -> None:
        if missed > _NOTHING:
            size = _size(missed, target)
            self.notes.append(f"{what}: other positions than those of the table: up to {size} off at these")


def _size(value: float, motor: Motor) -> str:
    return f"{value:.3g} mm" if motor.linear else f"{np.rad2deg(value):.3g}°"


def _shift_words(motor: Motor, zero: float) -> str:
    off = zero if motor.linear else float(np.rad2deg(zero))
    words = taken_off(off, motor.linear)
    return f"{motor.axis}: {words} the error values of all its tables together everywhere, so that motor zero is 0"


def _largest(table: AxisTable) -> float:
    return float(np.abs(table.forward - table.reverse).max() / 2.0)
