"""The forms of a compensation, tables of error functions, tables of axes, and grids, and how one becomes another exactly.

Tables of axes become tables of error functions where a function moves one axis alone: X over Y is EXY. Tables become a grid on
the product of their positions: functions of one axis, and products of functions of two, are linear in each axis between them. A
grid becomes tables of axes where it is a sum of functions of single axes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from volid.compensation.grids.grid import Grid
from volid.compensation.grids.interpolation import grid_positions
from volid.compensation.package import Compensation
from volid.compensation.superposition import add_tables
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.error_table import ITSELF, MODEL, ErrorTable
from volid.compensation.types import GRID, TABLES
from volid.controllers.base import Declaration
from volid.controllers.existing.contents import nodes_by_axis
from volid.exceptions import InputError
from volid.model.jacobian import axis_directions
from volid.model.machine import Machine

EXACT = 1e-6  # mm: a grid may differ so much from a sum of functions of single axes
BY_DIRECTION = "differ by direction"  # in messages that a mean of both would answer
MOST_NODES = 1_000_000  # of a grid that tables become


def in_form(made: Compensation, machine: Machine, declared: Declaration, tool: np.ndarray) -> Compensation:
    """Tables or grids, as the control holds them."""
    forms = set(declared.carries.values())
    if made.grids and GRID not in forms:
        sums = [g for g in made.grids if isinstance(g, Grid) and sum_of_lines(g)[1] <= EXACT]
        tables = [t for g in sums for t in _of_grid(g, machine)]
        kept = tuple(g for g in made.grids if g not in sums)
        made = replace(made, grids=kept, axis_tables=(*made.axis_tables, *tables))
    if (made.tables or made.axis_tables) and TABLES not in forms:
        _refuse_directions(made, declared)
        return Compensation(made.names, (), as_grid(made, machine, tool))
    return as_functions(made, machine) if declared.model else made


def one_direction(made: Compensation) -> Compensation:
    """The mean of both directions everywhere."""
    tables = tuple(_mean(t) for t in made.tables)
    return replace(made, tables=tables, axis_tables=tuple(_mean(t) for t in made.axis_tables))


def _mean(table: Any) -> Any:
    middle = 0.5 * (table.forward + table.reverse)
    return replace(table, forward=middle, reverse=middle)


def as_functions(made: Compensation, machine: Machine) -> Compensation:
    """Tables of axes as tables of error functions, added to those that there are; grids as they are.

    Raises `InputError` for a table that no error function of one axis stands for.
    """
    directions = axis_directions(machine, np.array([[a.reference for a in machine.axes]]))[0]
    old = tuple(_function(t, machine, directions) for t in made.axis_tables)
    return replace(made, tables=add_tables(made.tables, old), axis_tables=())


def _function(table: AxisTable, machine: Machine, directions: np.ndarray) -> ErrorTable:
    """The function that moves one axis alone: along a linear axis, or the angle of a rotary one itself."""
    output = machine.axis(table.output)
    if table.factor is not None or (not output.is_linear and not table.is_pitch):
        raise InputError(
            f"the table of {table.output} over {table.argument}{_times(table)} is no error function of one axis"
        )
    along = directions[:, machine.index(table.output)] if output.is_linear else output.frame.T @ output.unit_vector
    component = int(np.argmax(np.abs(along)))
    if abs(abs(along[component]) - 1.0) > 1e-9:
        raise InputError(
            f"{table.output} moves in the direction {np.round(along, 3).tolist()}, not along a machine direction; "
            "one error function cannot stand for its table"
        )
    letters, sign = "XYZ" if output.is_linear else "ABC", float(np.sign(along[component]))
    function = f"E{letters[component]}{table.argument}"
    applied = MODEL if output.is_linear else ITSELF
    known, nothing = np.zeros(len(table.positions), dtype=bool), np.full((len(table.positions), 2), np.nan)
    up, down = sign * table.forward, sign * table.reverse
    kind = "L-POS" if table.is_pitch else "L-STR"
    return ErrorTable(
        kind if output.is_linear else "R-POS", function, table.positions, up, down, nothing, known, applied, 0.0,
        period=table.period, notes=table.notes,
    )  # fmt: skip


def _times(table: AxisTable) -> str:
    return "" if table.factor is None else f", times {table.factor.axis},"


def _refuse_directions(made: Compensation, declared: Declaration) -> None:
    """Raises `InputError` for tables with two directions, where the control holds one value for both."""
    bent = [t.function for t in made.tables if t.has_reversal]
    bent += [f"{t.output} over {t.argument}" for t in made.axis_tables if t.has_reversal]
    if bent:
        raise InputError(
            f"{declared.name} holds one value for both directions, and these tables {BY_DIRECTION}: {', '.join(bent)}; hold the "
            "reversal in tables that the control has for it"
        )


def as_grid(made: Compensation, machine: Machine, tool: np.ndarray) -> tuple[Grid, ...]:
    """Tables that move linear axes by linear axes as one grid on the product of their positions; grids as they are.

    Of two directions a grid holds the mean. Raises `InputError` for tables over rotary axes, and for too many nodes.
    """
    grids = tuple(g for g in made.grids if isinstance(g, Grid))
    if not (made.tables or made.axis_tables):
        return grids
    made = replace(made, grids=())
    nodes = _lines(made, machine)
    count = int(np.prod([len(n) for n in nodes.values()]))
    if count > MOST_NODES:
        raise InputError(f"the grid of all positions would have {count} nodes; expected at most {MOST_NODES}")
    positions = grid_positions(tuple(nodes.values()))
    q = np.tile([a.reference for a in machine.axes], (count, 1))
    q[:, [machine.index(a) for a in nodes]] = positions
    values = np.zeros((count, 6))
    values[:, :3] = expected_point(made, machine, q, tool)
    known = np.zeros(count, dtype=bool)
    nothing = np.full_like(values, np.nan)
    grid = Grid(
        "L-VOL", tuple(nodes), tuple(nodes.values()), positions, values, nothing, known, tuple(tool.tolist()), "machine", ""
    )  # fmt: skip
    return (grid, *grids)


def _lines(made: Compensation, machine: Machine) -> dict[str, np.ndarray]:
    """Positions of every linear axis, in the order X, Y, Z; the ends of the travel where tables have none."""
    found = nodes_by_axis(made)
    rotary = [a for a in found if not machine.axis(a).is_linear]
    if rotary:
        raise InputError(f"tables over {', '.join(rotary)} have no place in a grid over the linear axes")
    ends = {a.letter: np.array(a.travel) for a in machine.linear}
    lines = {a: found[a] if len(found.get(a, ())) > 1 else ends[a] for a in sorted(ends)}
    for letter, positions in found.items():
        lines[letter] = np.union1d(lines[letter], positions)
    return lines


def expected_point(
    made: Compensation,
    machine: Machine,
    positions: np.ndarray,
    tool: np.ndarray | None,
    directions: np.ndarray | None = None,
) -> np.ndarray:
    """Deviation of the functional point that a control with this compensation expects, machine frame, shape (m, 3) [mm].

    Args:
        made: Tables and grids.
        machine: The machine whose axes move.
        positions: Commanded positions, machine axis order, shape (m, n_axes) [mm or °].
        tool: Tool vectors, shape (m, 3) or (3,) [mm]; None where no rotation acts.
        directions: Directions of motion, shape (m, n_axes): +1, -1 or 0; None: the mean of both.
    """
    control = made.control(machine)
    found = control.expected(positions, tool, directions).point
    if made.axis_tables:
        linear = [i for i, a in enumerate(machine.axes) if a.is_linear]
        by_axis = Compensation((), (), (), made.axis_tables).control(machine)
        step = by_axis.command(positions, tool, directions) - positions
        found = found - np.einsum("mij,mj->mi", axis_directions(machine, positions)[:, :, linear], step[:, linear])
    return np.asarray(found)


def no_sum(made: Compensation, declared: Declaration) -> InputError:
    """The `InputError` for grids that a control with tables of axes cannot hold, with what such tables would miss."""
    apart = {g.type: sum_of_lines(g)[1] for g in made.grids if isinstance(g, Grid)}
    each = [
        f"the {kind} grid is up to {1e3 * a:.1f} µm off any sum of functions of single axes"
        for kind, a in apart.items()
    ]
    each += [f"the {g.type} grid is over rotary axes" for g in made.grids if not isinstance(g, Grid)]
    return InputError(f"{declared.name} holds tables of axes, and {', '.join(each)}. Take a control that holds a grid")


def sum_of_lines(grid: Grid) -> tuple[list[np.ndarray], float]:
    """The functions of single axes through a grid's first node, and how far its translations are from their sum.

    Returns:
        For each axis the translations along its line, shape (nodes of the axis, 3) [mm], the value of the first node in the
        first of them alone; and the largest difference [mm].
    """
    shape = tuple(len(n) for n in grid.nodes)
    values = grid.values[:, :3].reshape(*shape[::-1], 3).transpose(*range(len(shape) - 1, -1, -1), len(shape))
    first = values[(0,) * len(shape)]
    lines = [_line(values, i) - (first if i else 0.0) for i in range(len(shape))]
    rebuilt = sum(_along(line, i, len(shape)) for i, line in enumerate(lines))
    return lines, float(np.abs(rebuilt - values).max())


def _line(values: np.ndarray, i: int) -> np.ndarray:
    """Values (n, 3) along axis i through the first node."""
    return values[tuple(slice(None) if k == i else 0 for k in range(values.ndim - 1))]


def _along(line: np.ndarray, i: int, axes: int) -> np.ndarray:
    """A line in the shape of the whole grid, one node along the other axes."""
    return line.reshape(*(len(line) if k == i else 1 for k in range(axes)), 3)


def _of_grid(grid: Grid, machine: Machine) -> list[AxisTable]:
    """The functions of single axes whose sum a grid is."""
    lines, _ = sum_of_lines(grid)
    linear = [i for i, a in enumerate(machine.axes) if a.is_linear]
    q = np.array([[a.reference for a in machine.axes]])
    pull = np.linalg.pinv(axis_directions(machine, q)[0][:, linear])
    made = []
    for letter, nodes, line in zip(grid.axes, grid.nodes, lines, strict=True):
        for output, values in zip(machine.linear, pull @ line.T, strict=True):
            if np.abs(values).max() > 0.0:
                made.append(AxisTable(output.letter, letter, nodes, values, values, source=f"E{output.letter}{letter}"))
    return made
