"""Values of a table at the evenly spaced positions that a control counts from its own zero.

Where the positions of the control are not those of the table, its last one may lie beyond the table's end. There the line through
the last two positions of the table is continued, so that the value at the end itself is right; further positions keep it.
"""

from __future__ import annotations

from math import gcd
from typing import TYPE_CHECKING

import numpy as np

from volid.compensation.tables.axis_table import AxisTable

if TYPE_CHECKING:
    from jaxtyping import Float

_ON_NODE = 1e-6  # spacings
_FINE = 1e-3  # mm or °
_PARTS = 10
_FINER = 4.0  # parts of the narrowest distance where no spacing meets all positions


def at_nodes(table: AxisTable, positions: Float[np.ndarray, " n"], way: float) -> Float[np.ndarray, " n"]:
    """Error values of a table without its factor at rising positions, shape (n,) [mm or rad]; `way`: +1, -1, 0 for the mean."""
    if table.period:
        return table.of_argument(positions, np.full(len(positions), way))
    values = table.of_argument(table.positions, np.full(len(table.positions), way))
    return extended(table.positions, values, positions)


def extended(
    positions: Float[np.ndarray, " k"], values: Float[np.ndarray, " k"], at: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Values by linear interpolation, continued up to the first of the rising positions `at` beyond either end.

    >>> extended(np.array([0.0, 2.0]), np.array([0.0, 4.0]), np.array([-2.0, -1.0, 1.0, 3.0, 5.0])).tolist()
    [-2.0, -2.0, 2.0, 6.0, 6.0]
    """
    below, above = at[at <= positions[0]], at[at >= positions[-1]]
    x = np.clip(at, below.max(initial=-np.inf), above.min(initial=np.inf))
    found = np.interp(x, positions, values)
    if len(positions) > 1:
        for beyond, i, j in ((x < positions[0], 0, 1), (x > positions[-1], -1, -2)):
            slope = (values[j] - values[i]) / (positions[j] - positions[i])
            found = np.where(beyond, values[i] + slope * (x - positions[i]), found)
    return np.asarray(found)


def spacing_of(positions: Float[np.ndarray, " n"], zero: float | None = None, most: int = 2000) -> float:
    """Spacing by which a control can count all positions, at most `most` of them, from its `zero` [mm or °].

    Even positions keep their spacing, or with a zero between them the half, third … or tenth of it. Others take the largest
    step of whole micrometres that meets them all. Where there is none, they are not met: the spacing is then a quarter of the
    narrowest of theirs, or as near to that as the number allows, and divides their range. Two positions are a line, which any
    spacing holds.

    >>> spacing_of(np.array([0.0, 40.0, 50.0, 100.0])), spacing_of(np.array([0.0, 50.0, 100.0]), 25.0)
    (10.0, 25.0)
    >>> spacing_of(np.array([-200.0, -115.0, -30.0, 55.0]), 0.0), spacing_of(np.array([0.0, 1.0, 2.0]), 0.01234)
    (5.0, 0.25)
    """
    steps = np.diff(positions)
    span, least = float(positions[-1] - positions[0]), float(steps.min())
    if np.ptp(steps) <= _ON_NODE * least:
        least = span / len(steps)
        for part in range(1, _PARTS + 1):
            away = 0.0 if zero is None else (positions[0] - zero) * part / least
            if abs(away - round(away)) < _ON_NODE:
                return least / part
    found = common_step(positions, zero)
    if found and span / found < most:
        return found
    count = float(np.ceil(span / least - _ON_NODE))
    room = 1.0 if len(positions) == 2 else max(1.0, float((most - 2) // count))
    return span / (count * min(_FINER, room))


def common_step(positions: np.ndarray, zero: float | None = None) -> float:
    """Largest step of whole micrometres (or 0.001°) between all positions, and to the zero; 0 where there is none."""
    away = np.diff(positions) if zero is None else np.append(np.diff(positions), positions[0] - zero)
    whole = np.round(away / _FINE)
    if np.abs(away / _FINE - whole).max() > _ON_NODE:
        return 0.0
    return gcd(*(int(v) for v in whole)) * _FINE
