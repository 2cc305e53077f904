"""What a control does with tables of motors that it holds: tables of axes and grids over two axes, of error values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from volid.compensation.grids.grid import Grid
from volid.compensation.grids.interpolation import period_of
from volid.compensation.on_top import summed
from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.controllers.pmac.motors.script import BLCOMP, COMP, MotorTable, Script
from volid.controllers.pmac.motors.spans import Motor, Span, reach, rolled, span_of
from volid.controllers.tables.position_grid import position_grid
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.model.jacobian import axis_directions
from volid.model.machine import Machine


def compensation_of(script: Script, name: str, machine: Machine, motors: Mapping[str, Motor]) -> Compensation:
    """Tables of axes and grids over two axes that the control applies. Raises `InputError` for motors that drive no axis."""
    by_number = {m.number: m for m in motors.values()}
    used = {n for t in script.tables for n in (*t.sources, t.target)} | set(script.backlash)
    unknown = sorted(used - set(by_number))
    if unknown:
        raise InputError(
            f"{name}: motor {unknown[0]} drives no axis of the machine; state motors=X=1,Y=2,… as they are"
        )
    alone = [t for t in script.tables if len(t.sources) == 1 and t.command == COMP]
    found = [_axis_table(t, machine, by_number) for t in alone]
    found += [t for number in sorted(used) for t in _backlash(number, script, machine, by_number)]
    grids = [_grid(t, name, machine, by_number) for t in script.tables if len(t.sources) == 2]
    return Compensation((), (), _together(grids), summed(found, say=False))


def _axis_table(table: MotorTable, machine: Machine, motors: Mapping[int, Motor]) -> AxisTable:
    source, target = motors[table.sources[0]], motors[table.target]
    span = span_of(source, len(table.entries) - 1, table.spans[0], *machine.axis(source.axis).travel)
    error = -rolled(table.entries, span) / target.parts
    return AxisTable(target.axis, source.axis, span.positions, error, error, period=_period(span, machine))


def _period(span: Span, machine: Machine) -> float:
    """360 where the table closes a full turn of an axis that turns fully, else 0 [°]."""
    axis = machine.axis(span.motor.axis)
    turn = not axis.is_linear and axis.is_full_turn and abs(span.length - 360.0 * span.motor.counts) <= 1.0
    return 360.0 if turn else 0.0


def _backlash(number: int, script: Script, machine: Machine, motors: Mapping[int, Motor]) -> list[AxisTable]:
    """What a motor moves further in -, as the error value of that direction; nothing for a motor without backlash."""
    motor, held = motors[number], script.backlash.get(number, 0)
    own = [t for t in script.tables if t.command == BLCOMP and t.owner == number]
    low, high = machine.axis(motor.axis).travel
    period = 0.0
    if own:
        span = span_of(motor, len(own[-1].entries) - 1, own[-1].spans[0], low, high)
        q, further, period = span.positions, held + rolled(own[-1].entries, span), _period(span, machine)
    elif held:
        q, further = np.array(reach(motor, low, high, motor.counts)), np.full(2, held)
        period = period_of(machine.axis(motor.axis), q)
    else:
        return []
    return [AxisTable(motor.axis, motor.axis, q, np.zeros(len(q)), further / motor.parts, period=period)]


def _grid(table: MotorTable, name: str, machine: Machine, motors: Mapping[int, Motor]) -> Grid:
    """A table over two motors as a grid; the control knows no lever arm, so that rotations are 0."""
    sources, target = [motors[n] for n in table.sources], motors[table.target]
    if not all(m.linear for m in (*sources, target)) or sources[0].axis == sources[1].axis:
        raise InputError(
            f"{name}: a table moves {target.axis} over {sources[0].axis} and {sources[1].axis}; expected two different linear "
            "axes that move a linear one"
        )
    rows, columns = (n - 1 for n in table.entries.shape)
    first, second = (
        span_of(m, n, length, *machine.axis(m.axis).travel)
        for m, n, length in zip(sources, (columns, rows), table.spans, strict=True)
    )
    error = -rolled(rolled(table.entries, first).T, second) / target.parts  # (first, second)
    nodes = {m.axis: s.positions for m, s in zip(sources, (first, second), strict=True)}
    axes = tuple(a for a in LINEAR_AXES if a in nodes)
    if axes[0] != sources[0].axis:
        error = error.T
    lines = tuple(nodes[a] for a in axes)
    direction = axis_directions(machine, np.zeros((1, len(machine.axes))))[0][:, machine.index(target.axis)]
    errors = error.ravel(order="F")[:, None] * direction
    note = "the control holds translations over two axes and adds no lever arm"
    return position_grid(axes, lines, errors, note)


def _together(grids: Sequence[Grid]) -> tuple[Grid, ...]:
    """Grids of the same nodes added up."""
    found: list[Grid] = []
    for grid in grids:
        for i, other in enumerate(found):
            if (
                grid.axes == other.axes
                and grid.positions.shape == other.positions.shape
                and np.allclose(grid.positions, other.positions)
            ):
                found[i] = replace(other, values=other.values + grid.values)
                break
        else:
            found.append(grid)
    return tuple(found)
