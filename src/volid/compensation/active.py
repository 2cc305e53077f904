"""The active compensations of a control in words, as the record of a campaign states them (ISO/TR 16907 9.1)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from volid.compensation.grids.grid import AnyGrid
from volid.compensation.grids.sides import LINEAR
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.error_table import ErrorTable
from volid.compensation.types import TYPES, select
from volid.exceptions import InputError
from volid.model.machine import Machine


def table_words(tables: Iterable[ErrorTable]) -> list[str]:
    """One text for the tables of each type: "L-POS: tables of EXX, EYY"."""
    found: dict[str, list[str]] = {}
    for table in tables:
        found.setdefault(table.type, []).append(table.function)
    return [
        f"{name}: {'tables' if len(functions) > 1 else 'table'} of {', '.join(functions)}"
        for name, functions in found.items()
    ]


def grid_words(grid: AnyGrid) -> str:
    """Such as "L-VOL: grid over X, Y, Z for the tool vector 0, 0, -150 mm"."""
    return f"{grid.type}: grid over {', '.join(grid.axes)} {reference_words(grid)}"


def reference_words(grid: AnyGrid) -> str:
    """Such as "for the tool vector 0, 0, -150 mm"; a grid without rotations and tool vector, as many controls have, says that."""
    if grid.side != LINEAR:
        return f"of the {grid.side}, at the point {vector_words(grid.reference)}"
    if not np.any(grid.reference) and not np.nan_to_num(grid.values[:, 3:]).any():
        return "without a tool vector: the same values with every tool"
    return f"for the tool vector {vector_words(grid.reference)}"


def axis_table_words(table: AxisTable) -> str:
    """Such as "table of EXY: X over Y", or "table of EAY: Y over Y, times Z"."""
    lever = f", times {table.factor.axis}" if table.factor else ""
    return f"table{' of ' + table.source if table.source else ''}: {table.output} over {table.argument}{lever}"


def option_words(
    machine: Machine,
    tool: Sequence[float] | None,
    by_axis: Mapping[str, Mapping[str, float]],
    clamped: Sequence[str],
) -> list[str]:
    """What limits them: the tool vector that the control uses, lengths and steps `by_axis` under their names, clamped axes."""
    found = [] if tool is None else [f"tool vector that the control uses: {vector_words(tool)}"]
    for name, values in by_axis.items():
        if values:
            each = ", ".join(f"{a} {v:g} {'mm' if machine.axis(a).is_linear else 'degrees'}" for a, v in values.items())
            found.append(f"{name}: {each}")
    return [*found, *([f"clamped for compensations: {', '.join(clamped)}"] if clamped else [])]


def vector_words(values: Iterable[float]) -> str:
    """Such as "0, 0, -150 mm"."""
    return ", ".join(f"{v:.9g}" for v in values) + " mm"


def corrected_twice(machine: Machine, tables: Iterable[ErrorTable], grids: Sequence[AnyGrid]) -> list[str]:
    """What tables and grids together correct more than once, in words; a control applies their sum."""
    kinds = [(g.type, g.side) for g in grids]
    several = [k for k in dict.fromkeys(kinds) if kinds.count(k) > 1]
    in_tables = [n for t in tables for n in re.split(r" \+ | on top of ", t.type)]
    found = [f"two {name} grids of one side ({side})" for name, side in several]
    found += [f"{name} stands in tables and in a grid" for name in dict.fromkeys(in_tables) if name in dict(kinds)]
    try:
        select([n for n in (*in_tables, *dict(kinds)) if n in TYPES], machine)
    except InputError as error:
        found.append(str(error).split("; ")[0])
    return [f"{text}: the control applies the sum of both" for text in found]
