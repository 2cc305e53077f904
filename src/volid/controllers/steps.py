"""Tables in equal steps, for controls that know no others: on the common lattice of their positions where there is one."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from math import gcd
from typing import Any

import numpy as np

from volid.backend.even_points import evenly
from volid.compensation.package import Compensation

LATTICE = 1e-3  # mm or °: positions are whole multiples of it where a lattice is looked for
SAME = 1e-6  # mm or °
MOST = 2000  # positions of one table, where the control states no limit


def with_equal_steps(made: Compensation, most_points: int | None) -> tuple[Compensation, float]:
    """All tables in equal steps, and by how much a value differs from the old ones at most [mm or rad].

    A table whose positions lie on a lattice of at most so many points keeps all its values; another one is sampled with as many
    points as there may be. The largest difference is that at all old positions.

    Args:
        made: Tables, and grids, which stay as they are.
        most_points: Most positions of a table; None: no limit is known.
    """
    pairs = [_equal(t, most_points or MOST) for t in (*made.tables, *made.axis_tables)]
    tables = tuple(t for t, _ in pairs[: len(made.tables)])
    by_axis = tuple(t for t, _ in pairs[len(made.tables) :])
    return replace(made, tables=tables, axis_tables=by_axis), max((loss for _, loss in pairs), default=0.0)


def _equal(table: Any, most: int) -> tuple[Any, float]:
    x = table.positions
    if len(x) < 3 or np.ptp(np.diff(x)) < SAME:
        return table, 0.0
    count = _points(x)
    nodes = evenly(float(x[0]), float(x[-1]), count if count is not None and count <= most else most)
    up, down = (np.interp(nodes, x, v) for v in (table.forward, table.reverse))
    losses = [np.abs(np.interp(x, nodes, v) - old).max() for v, old in ((up, table.forward), (down, table.reverse))]
    changes: dict[str, Any] = {"positions": nodes, "forward": up, "reverse": down}
    if hasattr(table, "u"):
        changes["u"] = np.stack([np.interp(nodes, x, c) for c in table.u.T], axis=1)
        changes["outside"] = np.interp(nodes, x, table.outside) > 0
    return replace(table, **changes), float(max(losses))


def _points(x: np.ndarray) -> int | None:
    """Points of the coarsest lattice that holds all positions; None where none is found.

    >>> _points(np.array([0.0, 40.0, 50.0, 100.0]))
    11
    """
    steps = np.diff(x) / LATTICE
    whole = np.round(steps)
    if np.abs(steps - whole).max() > SAME / LATTICE:
        return None
    common = reduce(gcd, (int(v) for v in whole))
    return round((x[-1] - x[0]) / (common * LATTICE)) + 1
