"""Which types of ISO/TR 16907 tables and grids amount to, and over which positions they reach."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.error_table import ITSELF, ErrorTable
from volid.compensation.types import TYPES
from volid.model.iso230 import SPINDLE, parse
from volid.model.machine import Machine


def types_of(made: Compensation, machine: Machine) -> tuple[str, ...]:
    """Types of ISO/TR 16907 that a compensation holds, told from what it moves by what, in the order of the standard.

    A cross table holds straightness, or squareness as its slope (9.2.3); both are called L-STR here.
    """
    found = {_of_axis(t, machine) for t in made.axis_tables} | {_of_function(t, machine) for t in made.tables}
    found |= {g.type for g in made.grids}
    return tuple(name for name in TYPES if name in found)


def _of_axis(table: AxisTable, machine: Machine) -> str:
    linear = machine.axis(table.argument).is_linear
    if table.is_pitch:
        return "L-POS" if linear else "R-POS"
    if not linear:
        return "R-RAX" if table.factor is None else "R-VOL"
    return "L-STR" if table.factor is None else "L-VOL"


def _of_function(table: ErrorTable, machine: Machine) -> str:
    function = parse(table.function)
    if table.applied == ITSELF:
        return "R-POS"
    if table.axis == SPINDLE or not machine.axis(table.axis).is_linear:
        return "R-VOL"
    if function.is_rotation:
        return "L-VOL"
    return "L-POS" if function.direction == table.axis else "L-STR"


def nodes_by_axis(made: Compensation) -> dict[str, np.ndarray]:
    """All positions at which tables and grids hold values, by the letter of the axis [mm or °]; rising, each once."""
    found: dict[str, np.ndarray] = {}
    for letter, positions in _nodes(made):
        found[letter] = np.union1d(found.get(letter, positions), positions)
    return found


def _nodes(made: Compensation) -> Iterator[tuple[str, np.ndarray]]:
    for table in made.tables:
        if table.axis != SPINDLE:
            yield table.axis, table.positions
    for moved in made.axis_tables:
        yield moved.argument, moved.positions
        if moved.factor is not None:
            yield moved.factor.axis, moved.factor.positions
    for grid in made.grids:
        yield from zip(grid.axes, grid.nodes, strict=True)


def moved_axes(made: Compensation) -> tuple[str, ...]:
    """Letters of the axes that tables of axes move, each once."""
    return tuple(dict.fromkeys(t.output for t in made.axis_tables))
