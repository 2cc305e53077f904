"""A new compensation on top of what a control holds already, in whatever form the control holds both (ISO/TR 16907 10.5).

Tables of one error function, tables that move one axis by one axis, and grids of one side are added on the union of their
positions, on which the sum of both is exact; what has no partner stays as it is, because a control applies the sum of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from volid.compensation.grids.grid import AnyGrid
from volid.compensation.package import Compensation
from volid.compensation.superposition import add_grid, add_tables
from volid.compensation.tables.axis_table import AxisTable, Factor


def add_compensations(new: Compensation, old: Compensation) -> Compensation:
    """The sum of two compensations, for a control that holds one.

    Args:
        new: What comes on top, such as what `volid.compensate` makes of a solution.
        old: What the control holds already, error values too.

    Raises:
        InputError: partners have no sum, see `volid.compensation.superposition`.

    >>> x, e = np.array([0.0, 100.0]), np.array([0.0, 0.010])
    >>> both = (Compensation((), (), (), (AxisTable("X", "X", x, v, v),)) for v in (e, -e / 2))
    >>> add_compensations(*both).axis_tables[0].forward.tolist()
    [0.0, 0.005]
    """
    return replace(
        new,
        tables=add_tables(new.tables, old.tables),
        grids=add_grids(new.grids, old.grids),
        axis_tables=summed((*new.axis_tables, *old.axis_tables)),
    )


def add_grids(new: Sequence[AnyGrid], old: Sequence[AnyGrid]) -> tuple[AnyGrid, ...]:
    """New grids, each added to the old ones of its side over its axes; old ones without a partner are kept.

    Grids over other axes stay beside each other. Raises `InputError` for partners that a control applies otherwise.
    """
    found = list(new)
    for before in old:
        partner = next(
            (i for i, now in enumerate(found) if are_partners(now, before) and now.axes == before.axes), None
        )
        if partner is None:
            found.append(before)
        else:
            found[partner] = add_grid(found[partner], before)
    return tuple(found)


def are_partners(new: AnyGrid, old: AnyGrid) -> bool:
    """Whether two grids are of one side, and both or neither only turn the rotary axes."""
    return new.side == old.side and (new.type == "FOR") == (old.type == "FOR")


def summed(tables: Sequence[AxisTable], say: bool = True) -> tuple[AxisTable, ...]:
    """Tables that move the same axis by the same axis, with the same factor, as one on the union of their positions.

    `say`: whether a note of the table says so.
    """
    found: list[AxisTable] = []
    for table in tables:
        partner = next((i for i, known in enumerate(found) if _alike(known, table)), None)
        if partner is None:
            found.append(table)
        else:
            found[partner] = _sum(found[partner], table, say)
    return tuple(found)


def _alike(one: AxisTable, other: AxisTable) -> bool:
    same = (one.output, one.argument, one.period) == (other.output, other.argument, other.period)
    return same and _same_factor(one.factor, other.factor)


def _same_factor(one: Factor | None, other: Factor | None) -> bool:
    if one is None or other is None:
        return one is other
    pairs = ((one.positions, other.positions), (one.values, other.values))
    return one.axis == other.axis and all(np.array_equal(a, b) for a, b in pairs)


def _sum(one: AxisTable, other: AxisTable, say: bool) -> AxisTable:
    """Both at the positions of either; ends are held, as the control holds them."""
    nodes = np.union1d(one.positions, other.positions)
    up, down = np.ones(len(nodes)), -np.ones(len(nodes))
    points = f"{len(one.positions)} and {len(other.positions)} points"
    note = (f"sum of two tables of {one.output} over {one.argument} ({points})",) if say else ()
    return replace(
        one,
        positions=nodes,
        forward=one.of_argument(nodes, up) + other.of_argument(nodes, up),
        reverse=one.of_argument(nodes, down) + other.of_argument(nodes, down),
        source=" + ".join(dict.fromkeys(s for s in (one.source, other.source) if s)),
        notes=tuple(dict.fromkeys((*one.notes, *other.notes, *note))),
    )


def with_opposite(whole: Compensation, part: Compensation) -> Compensation:
    """A compensation together with the opposite of a part of it: what the rest alone does. For simulation, not for files."""
    tables = tuple(replace(t, forward=-t.forward, reverse=-t.reverse) for t in part.tables)
    by_axis = tuple(replace(t, forward=-t.forward, reverse=-t.reverse) for t in part.axis_tables)
    grids = tuple(replace(g, values=-g.values) for g in part.grids)
    return replace(
        whole,
        tables=(*whole.tables, *tables),
        grids=(*whole.grids, *grids),
        axis_tables=(*whole.axis_tables, *by_axis),
    )
