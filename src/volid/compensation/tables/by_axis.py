"""Tables of error functions as tables of axes, for controls without a kinematic model (ISO/TR 16907 8.2, 10.5).

The deviation of the functional point that the tables of error functions E_ic (axis i, component c) give is

    e(q) = Σ_ic  E_ic(q_i) · [ a_ic(q_i) + Σ_j b_icj(q_i) · (q_j - at_j) ],     j: the other linear axes,

because the influence of an error is affine in the positions of the linear axes. Seen along the direction of each linear axis, the
first term is a pitch or cross table over q_i, the second a product with a lever arm that grows with q_j. The positions `at` are
those of the lines; without products the tables are right there. Positions of other rotary axes are held at `at`.

Constants of the tool frame are made so that they do nothing at the tool vector of the base; at that tool they need no table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from volid.compensation.tables.axis_table import AxisTable, Factor
from volid.compensation.tables.error_table import ITSELF, MODEL, ErrorTable
from volid.exceptions import InputError
from volid.model.iso230 import SPINDLE, parse
from volid.model.jacobian import axis_directions, influence
from volid.model.kinematics import ROWS
from volid.model.machine import Axis, Machine

NEGLIGIBLE = 1e-9  # mm over the travel: a table that is nowhere larger is left out
NEGLIGIBLE_SHIFT = 1e-6  # mm: rounding of constants that cancel at the tool vector of the base


def axis_tables(
    machine: Machine, tables: Sequence[ErrorTable], at: np.ndarray, tool: np.ndarray, *, products: bool = True
) -> tuple[AxisTable, ...]:
    """What the linear axes (and, for R-POS, the rotary axes themselves) must be moved by, one table per pair of axes.

    Args:
        machine: The machine whose axes move.
        tables: Tables of error functions, as `volid.error_tables` makes them.
        at: Positions of the specific lines, machine axis order, shape (n_axes,) [mm or °].
        tool: Tool vector of the lever arms, shape (3,) [mm].
        products: Whether products with lever arms of other linear axes are made; without them they are left out.

    Raises:
        InputError: constants of the tool frame that move the functional point of this tool vector.
    """
    found: list[AxisTable] = []
    for i, axis in enumerate(machine.axes):
        own = [t for t in tables if t.axis == axis.letter]
        found += [_of_itself(axis, t) for t in own if t.applied == ITSELF]
        acting = [t for t in own if t.applied == MODEL]
        if acting:
            found += _of_axis(machine, i, acting, np.asarray(at, dtype=float), np.asarray(tool, dtype=float), products)
    _ask_tool_frame(machine, [t for t in tables if t.axis == SPINDLE], np.asarray(at, dtype=float), np.asarray(tool))
    return tuple(found)


def bent_between(
    machine: Machine, tables: Sequence[ErrorTable], at: np.ndarray, tool: np.ndarray, *, products: bool = True
) -> float:
    """What straight lines between the positions of the tables of axes miss of the tables of error functions, largest [mm].

    Rotations of an axis that carries the workpiece act through a lever arm that contains its own position: a straight line times
    a straight line. Halfway between two positions it is a quarter of the product of both changes off; 0 for other machines.
    """
    halved = [_halved(t) for t in tables]
    coarse, fine = (axis_tables(machine, ts, at, tool, products=products) for ts in (tables, halved))
    known = {_key(t): t for t in coarse}
    found = 0.0
    for t in (t for t in fine if machine.axis(t.output).is_linear and _key(t) in known):
        reach = 1.0 if t.factor is None else float(np.abs(t.factor.values).max())
        for way, values in ((1.0, t.forward), (-1.0, t.reverse)):
            straight = known[_key(t)].of_argument(t.positions, np.full(len(t.positions), way))
            found = max(found, reach * float(np.abs(straight - values).max()))
    return found


def _key(t: AxisTable) -> tuple[str, str, str]:
    return t.output, t.argument, "" if t.factor is None else t.factor.axis


def _halved(t: ErrorTable) -> ErrorTable:
    """A table with a position halfway between any two; the same straight lines."""
    x = np.union1d(t.positions, 0.5 * (t.positions[1:] + t.positions[:-1]))
    up, down = (np.interp(x, t.positions, v) for v in (t.forward, t.reverse))
    return replace(t, positions=x, forward=up, reverse=down)


def _ask_tool_frame(machine: Machine, tables: Sequence[ErrorTable], at: np.ndarray, tool: np.ndarray) -> None:
    """Raises `InputError` where constants of the tool frame move the functional point, which no table over a position undoes."""
    if not tables:
        return
    pull = _pull(machine, np.atleast_2d(at), np.asarray(tool, dtype=float), len(machine.axes))[0]
    shift = sum((pull[:, parse(t.function).component] * t.forward[0] for t in tables), np.zeros(len(pull)))
    if np.abs(shift).max() > NEGLIGIBLE_SHIFT:
        names = ", ".join(t.function for t in tables)
        raise InputError(
            f"{names}: constants of the tool frame move this tool's point by {1e3 * np.abs(shift).max():.3g} µm everywhere, "
            "which no table over a position undoes; put them into the tool data of the control, or take the tool of the base"
        )


def turned_by(axis: Axis, function: str) -> float:
    """Turn of a rotary axis in its own sense per unit of its own angular error: -1 where its line points the other way."""
    return float((axis.frame.T @ np.asarray(axis.unit_vector))[parse(function).component - 3])


def _of_itself(axis: Axis, table: ErrorTable) -> AxisTable:
    along = turned_by(axis, table.function)
    return AxisTable(
        axis.letter,
        axis.letter,
        table.positions,
        along * table.forward,
        along * table.reverse,
        source=table.function,
        period=table.period,
        notes=table.notes,
    )


def _of_axis(
    machine: Machine, i: int, tables: Sequence[ErrorTable], at: np.ndarray, tool: np.ndarray, products: bool
) -> list[AxisTable]:
    """Pitch, cross and product tables over the positions of axis i."""
    axis = machine.axes[i]
    nodes = tables[0].positions
    for t in tables[1:]:
        nodes = np.union1d(nodes, t.positions)
    q = np.tile(at, (len(nodes), 1))
    q[:, i] = nodes
    ways = np.ones(len(nodes))
    period = max(t.period for t in tables)
    parts = {"": _pull(machine, q, tool, i)}  # each (n, outputs, 6)
    linear = [k for k, a in enumerate(machine.axes) if a.is_linear]
    for j in (j for j in linear if j != i and products):
        moved = q.copy()
        moved[:, j] += 1.0
        parts[machine.axes[j].letter] = _pull(machine, moved, tool, i) - parts[""]
    found = []
    for lever, pull in parts.items():
        for row, output in enumerate(linear):
            acting = [t for t in tables if np.abs(pull[:, row, parse(t.function).component]).max() > 1e-12]
            up, down = (
                sum((pull[:, row, parse(t.function).component] * t.at(nodes, w) for t in acting), np.zeros(len(nodes)))
                for w in (ways, -ways)
            )
            factor = _ramp(machine.axis(lever), float(at[machine.index(lever)])) if lever else None
            reach = 1.0 if factor is None else float(np.abs(factor.values).max())
            if max(np.abs(up).max(), np.abs(down).max()) * reach > NEGLIGIBLE:
                source = " + ".join(t.function for t in acting)
                letter = machine.axes[output].letter
                found.append(AxisTable(letter, axis.letter, nodes, up, down, factor, source, period))
    return found


def _pull(machine: Machine, q: np.ndarray, tool: np.ndarray, i: int) -> np.ndarray:
    """Deviation along each linear axis that unit errors of axis i cause, (n, linear axes, 6)."""
    linear = [k for k, a in enumerate(machine.axes) if a.is_linear]
    point = influence(machine, q, tool)[:, :3, ROWS * i : ROWS * i + ROWS]
    inverse = np.linalg.pinv(axis_directions(machine, q)[:, :, linear])
    return np.asarray(inverse @ point)


def _ramp(axis: Axis, zero: float) -> Factor:
    ends = np.array([axis.travel[0], axis.travel[1]])
    return Factor(axis.letter, ends, ends - zero)
