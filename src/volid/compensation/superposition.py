"""A new compensation on top of an existing one (ISO/TR 16907 10.5): the sum, on the union of the points of both.

When a machine was measured with its old tables active, the measurement shows the errors that remain with them; the new tables
must then be added to the old ones, not replace them. Both are piecewise linear, so the sum is exact on the union of their points.
Outside its range a table keeps its end value, as in a control.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from volid.compensation.grids.grid import AnyGrid, RotaryGrid
from volid.compensation.grids.interpolation import grid_positions
from volid.compensation.tables.error_table import ErrorTable
from volid.compensation.types import compensation_type
from volid.exceptions import InputError


def add_tables(new: Sequence[ErrorTable], old: Sequence[ErrorTable]) -> tuple[ErrorTable, ...]:
    """New tables, each added to the old one of the same function; old ones without a new one are kept.

    Raises `InputError` when two tables of one function are applied differently, or the old ones name a function twice.
    """
    names = [t.function for t in old]
    twice = [n for n in names if names.count(n) > 1]
    if twice:
        raise InputError(f"two existing tables of {twice[0]}; expected one per function")
    before = {t.function: t for t in old}
    added = [_add_table(t, before[t.function]) if t.function in before else t for t in new]
    done = {t.function for t in new}
    return (*added, *(t for t in old if t.function not in done))


def _add_table(new: ErrorTable, old: ErrorTable) -> ErrorTable:
    if new.applied != old.applied:
        raise InputError(f"the existing {old.function} acts on {old.applied}, the new one on {new.applied}")
    nodes = np.union1d(old.positions, new.positions)
    up, down = np.ones(len(nodes)), -np.ones(len(nodes))
    ends = new.positions[0] - 1e-9, new.positions[-1] + 1e-9
    return replace(
        new,
        type=f"{new.type} on top of {old.type}",
        positions=nodes,
        forward=new.at(nodes, up) + old.at(nodes, up),
        reverse=new.at(nodes, down) + old.at(nodes, down),
        u=np.stack([np.interp(nodes, new.positions, c) for c in new.u.T], axis=1),
        outside=(np.interp(nodes, new.positions, new.outside) > 0) | (nodes < ends[0]) | (nodes > ends[1]),
        notes=(*new.notes, *_note(old.type, old.zero, len(old.positions), len(new.positions))),
    )


def _note(kind: str, zero: str, before: int, added: int) -> tuple[str, ...]:
    where = f", zero at {zero}" if zero else ""
    return (
        f"sum of the existing compensation ({kind}{where}, {before} points) and the new one ({added} points); u is of "
        f"the new one",
    )


def add_grid(new: AnyGrid, old: AnyGrid) -> AnyGrid:
    """A new grid on top of an existing one, on the union of their nodes; the old one is moved to the new tool vector or
    reference point.

    Raises `InputError` when axes, side or what the control does with the two differ, or rotations that are blank are needed.
    """
    if (new.side, new.axes) != (old.side, old.axes):
        raise InputError(
            f"the existing grid is over {', '.join(old.axes)} ({old.side}), the new one over {', '.join(new.axes)} ({new.side}); "
            "expected the same"
        )
    one, other = compensation_type(new.type), compensation_type(old.type)
    if (one.turns, one.only_turns) != (other.turns, other.only_turns):
        raise InputError(f"a control applies a {old.type} grid otherwise than a {new.type} grid; they have no sum")
    nodes = tuple(np.union1d(a, b) for a, b in zip(old.nodes, new.nodes, strict=True))
    positions = grid_positions(nodes)
    now, before = new.clamped(positions), old.clamped(positions)
    before[:, :3] += _shift(new, old, before)
    return replace(
        new,
        type=new.type,
        nodes=nodes,
        positions=positions,
        values=now + before,
        u=replace(new, values=new.u).clamped(positions),
        outside=replace(new, values=np.repeat(new.outside[:, None] * 1.0, 6, axis=1)).clamped(positions)[:, 0] > 0,
        notes=(*new.notes, *_note(old.type, "", len(old.values), len(new.values))),
        **({"determined": np.isfinite(now + before)} if isinstance(new, RotaryGrid) else {}),
    )


def _shift(new: AnyGrid, old: AnyGrid, values: np.ndarray) -> np.ndarray:
    """What the old rotations do between the old and the new tool vector or reference point."""
    arm = new.reference - old.reference
    if not arm.any():
        return np.zeros((len(values), 3))
    return np.asarray(np.cross(values[:, 3:], arm))
