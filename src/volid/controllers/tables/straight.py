"""The straight part of a table, for controls that hold a ratio and no positions: its least-squares line, and what it leaves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.compensation.tables.axis_table import AxisTable
from volid.exceptions import InputError

WORTH = 1e-5  # mm: less is not said to be left


class Line(NamedTuple):
    """`slope` [mm/mm] and value at 0, `constant` [mm]."""

    slope: float
    constant: float


def line_of(table: AxisTable) -> Line:
    """The least-squares line of the mean of both directions, over the range of the table.

    With s = x - middle: slope = ∫ s y ds / ∫ s² ds; the integrals of the piecewise linear y are exact (Simpson's rule). Raises
    `InputError` for a table with one position.
    """
    x, y = table.positions, table.mean
    length, middle = float(x[-1] - x[0]), 0.5 * float(x[0] + x[-1])
    if not length > 0.0:
        raise InputError(f"the table of {table.source or table.output} has one position; a line needs two")
    s, width = x - middle, np.diff(x)
    between = 0.25 * (s[:-1] + s[1:]) * (y[:-1] + y[1:])
    slope = 12.0 / length**3 * float(np.sum(width / 6.0 * (s[:-1] * y[:-1] + 4.0 * between + s[1:] * y[1:])))
    mean = float(np.sum(width * 0.5 * (y[:-1] + y[1:]))) / length
    return Line(slope, mean - slope * middle)


def left_beside(table: AxisTable, line: Line) -> str:
    """What of a table a ratio alone does not hold, in words; "" where that is nothing."""
    bent = float(np.abs(table.mean - line.constant - line.slope * table.positions).max())
    turned = 0.5 * float(np.abs(table.forward - table.reverse).max())
    parts = [
        (bent, "up to {:.2f} µm that is not straight"),
        (turned, "up to {:.2f} µm of the reversal in each direction"),
        (abs(line.constant), "a constant of {:.2f} µm, which shifts the origin alone"),
    ]
    return "; ".join(words.format(1e3 * v) for v, words in parts if v > WORTH)
