"""Parameters of ISO 230 in blocks, from volid's tables of error functions, and volid's tables from blocks that were read.

A location error or a squareness stands once: within the functions (the default), or as a constant of its own, C0Y or X0C, which
is then taken out of the functions. By a constant of a linear axis the direction of the axis turns: e gains q · (r × d), d the
axis's direction, r = (A0, B0, C0); that of a rotary axis is added to the function of its kind.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from volid.compensation.grids.grid import Grid
from volid.compensation.grids.interpolation import period_of
from volid.compensation.tables.error_table import ITSELF, MODEL, ErrorTable
from volid.controllers.base import Option
from volid.controllers.isg.iso_convention import AXIS_LINE, RELATIVE, AxisErrors, Convention, refined
from volid.controllers.isg.iso_texts import Block
from volid.controllers.isg.kernel_lists import one_of
from volid.controllers.tables.position_grid import position_grid
from volid.exceptions import InputError
from volid.model.iso230 import DIRECTIONS, LINEAR_AXES, ROTATIONS
from volid.model.kinematics import ROWS
from volid.model.machine import Axis, Machine

SMALLEST = 1e-12  # mm/mm or mm: a constant that is smaller stays in its function
WITHIN, APART = "functions", "constants"

OPTIONS = (
    Option(
        "location_errors",
        "functions: location errors and squareness stand within the functions; constants: as constants such as "
        "C0Y, X0C",
        WITHIN,
        one_of(WITHIN, APART),
    ),
    Option(
        "table_errors",
        "whose errors those of a rotary axis of the workpiece side are: 'table' (of the table itself, as "
        "location errors of ISO "
        "230-1 are) or 'tool relative to workpiece'; the one-point check tells",
        AXIS_LINE,
        one_of(AXIS_LINE, RELATIVE),
    ),
)


# ------------------------------------------------------------------------------------------------ writing


def refuse_turns(name: str, tables: Sequence[ErrorTable], nearest: str) -> None:
    """Raises `InputError` for a table that turns the rotary axis itself."""
    turning = [t.function for t in tables if t.applied == ITSELF]
    if turning:
        raise InputError(f"{name}: {', '.join(turning)} shall turn the rotary axis itself; {nearest}")


def lost_reversal(tables: Sequence[ErrorTable], where: str) -> tuple[str, ...]:
    """What becomes of the directions of approach, in words."""
    lost = {t.function: 0.5e6 * float(np.abs(t.forward - t.reverse).max()) for t in tables if t.has_reversal}
    if not lost:
        return ()
    parts = ", ".join(f"{f} {v:.3g} µrad" if f[1] in ROTATIONS else f"{f} {1e-3 * v:.3g} µm" for f, v in lost.items())
    return (
        f"The file knows no direction of motion: it holds the mean of both, and up to half the reversal stays "
        f"({parts}); {where}",
    )


def blocks_of(found: Sequence[AxisErrors], location_errors: str) -> list[Block]:
    """Blocks of the functions of each axis, and of the constants where they stand apart."""
    constants: dict[str, float] = {}
    blocks = []
    for one in found:
        values = one.values
        if location_errors == APART:
            own, values = _taken_out(one)
            constants |= own
        used = [k for k in range(ROWS) if np.any(values[:, k])] or [0]
        names = tuple(f"E{DIRECTIONS[k]}{one.axis.letter}" for k in used)
        blocks.append(Block((one.axis.letter,), names, one.positions[:, None], values[:, used], ""))
    return [*constant_block(constants), *blocks]


def constant_block(constants: dict[str, float]) -> list[Block]:
    """One block of constants, or none."""
    if not constants:
        return []
    return [Block((), tuple(constants), np.zeros((1, 0)), np.array([list(constants.values())]), "")]


def _taken_out(one: AxisErrors) -> tuple[dict[str, float], np.ndarray]:
    """Location errors by name, and the functions without them (n, 6)."""
    axis, values = one.axis, one.values.copy()
    if axis.is_linear:
        d = np.asarray(axis.unit_vector)
        slopes = np.polyfit(one.positions, values[:, :3], 1)[0] if len(one.positions) > 1 else np.zeros(3)
        turn = np.cross(d, slopes)
        turn[np.abs(turn) < SMALLEST] = 0.0
        values[:, :3] -= one.positions[:, None] * np.cross(turn, d)
        return {f"{c}0{axis.letter}": float(v) for c, v in zip(ROTATIONS, turn, strict=True) if v}, values
    own = ROTATIONS.index(axis.letter)
    mean = np.array([0.0 if k == own else float(v) for k, v in enumerate(values.mean(axis=0))])
    mean[np.abs(mean) < SMALLEST] = 0.0
    return {f"{c}0{axis.letter}": float(v) for c, v in zip(DIRECTIONS, mean, strict=True) if v}, values - mean


# ------------------------------------------------------------------------------------------------ reading


def tables_of(convention: Convention, blocks: Sequence[Block]) -> tuple[ErrorTable, ...]:
    """volid's tables from blocks of functions of single axes and of constants. Raises `InputError`."""
    given: dict[str, list[Block]] = {a.letter: [] for a in convention.machine.axes}
    for block in blocks:
        for letter in {name[-1] for name in block.names}:
            if letter not in given:
                raise InputError(f"{block.where}: {', '.join(block.names)}: the machine has no axis {letter}")
            given[letter].append(block)
    found: list[ErrorTable] = []
    for axis in convention.machine.axes:
        if given[axis.letter]:
            found += _tables_of_axis(convention, axis, given[axis.letter])
    return tuple(found)


def _tables_of_axis(convention: Convention, axis: Axis, blocks: Sequence[Block]) -> list[ErrorTable]:
    curves: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    constants, level = np.zeros(ROWS), np.zeros(ROWS)  # location errors; functions that a file states as constants
    for block in blocks:
        for name, column in zip(block.names, block.values.T, strict=True):
            if name[-1] != axis.letter:
                continue
            if block.is_constant and name[0] == "E":
                level[DIRECTIONS.index(name[1])] += column[0]
            elif block.is_constant:
                constants[DIRECTIONS.index(name[0])] += column[0]
            elif DIRECTIONS.index(name[1]) in curves:
                raise InputError(f"{block.where}: {name} stands in two blocks over {axis.letter}; expected it once")
            else:
                curves[DIRECTIONS.index(name[1])] = _sorted(block, column)

    def function(q: np.ndarray) -> np.ndarray:
        values = level + _with_constants(axis, q, constants)
        for k, (x, y) in curves.items():
            values[:, k] += np.interp(q, x, y)
        return convention.from_file(axis, q, values)

    nodes = np.asarray(axis.travel, dtype=float)
    if curves:
        nodes = np.unique(np.concatenate([x for x, _ in curves.values()]))
    nodes = refined(nodes, function)
    values = function(nodes)
    used = [k for k in range(ROWS) if np.any(values[:, k])] or sorted(curves) or [0]
    return [_table(axis, f"E{DIRECTIONS[k]}{axis.letter}", nodes, values[:, k]) for k in used]


def _with_constants(axis: Axis, q: np.ndarray, constants: np.ndarray) -> np.ndarray:
    """What location errors (6,) of an axis make of its functions, (m, 6)."""
    if not axis.is_linear:
        return np.tile(constants, (len(q), 1))
    values = np.zeros((len(q), ROWS))
    values[:, :3] = constants[:3] + q[:, None] * np.cross(constants[3:], np.asarray(axis.unit_vector))
    return values


def _sorted(block: Block, column: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rising positions and values. Raises `InputError` for a position that stands twice."""
    order = np.argsort(block.at[:, 0])
    x = block.at[order, 0]
    if np.any(np.diff(x) <= 0):
        twice = x[int(np.argmin(np.diff(x)))]
        raise InputError(f"{block.where}: position {block.arguments[0]} = {twice:g} stands twice; expected each once")
    return x, column[order]


def _table(axis: Axis, name: str, nodes: np.ndarray, values: np.ndarray) -> ErrorTable:
    return ErrorTable(
        "L-VOL" if axis.is_linear else "R-VOL",
        name,
        nodes,
        values,
        values.copy(),
        np.full((len(nodes), 2), np.nan),
        np.zeros(len(nodes), dtype=bool),
        MODEL,
        0.0,
        period=period_of(axis, nodes),
        notes=("Read from a file of a control, which states no uncertainty.",),
    )


# ------------------------------------------------------------------------------------------------ spatial grids


def grid_of(machine: Machine, block: Block) -> Grid:
    """A grid from translations over linear axes; rotations are 0, because the control adds no lever arm.

    Raises `InputError` for positions that do not form a grid.
    """
    axes = tuple(a for a in LINEAR_AXES if a in block.arguments)
    for letter in axes:
        machine.index(letter)
    at = block.at[:, [block.arguments.index(a) for a in axes]]
    nodes = tuple(np.unique(column) for column in at.T)
    count = int(np.prod([len(n) for n in nodes]))
    places = np.stack([np.searchsorted(n, c) for n, c in zip(nodes, at.T, strict=True)])
    order = np.ravel_multi_index(tuple(places), tuple(len(n) for n in nodes), order="F")
    if count != len(at) or len(np.unique(order)) != count:
        counts = " × ".join(str(len(n)) for n in nodes)
        raise InputError(
            f"{block.where}: {len(at)} rows, whose positions do not form a grid; expected each of {counts} = "
            f"{count} nodes over "
            f"{', '.join(axes)} once (the control refuses it too, error 70471)"
        )
    errors = np.zeros((count, 3))
    for name, column in zip(block.names, block.values.T, strict=True):
        errors[order, DIRECTIONS.index(name[1])] += column
    note = "Read from a file of a control that adds no lever arm: rotations are 0, for every tool vector."
    return position_grid(axes, nodes, errors, note)
