"""Tables of axes on equal steps, for controls that hold nothing else."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.sampling import LARGEST
from volid.controllers.tables.resampling import common_step

DIGITS = 9  # decimals of positions in files
FINEST = 8  # parts of the shortest distance that are tried for common equal steps


@dataclass(frozen=True)
class Lattice:
    """Equally spaced positions, both ends included [mm or °]."""

    low: float
    high: float
    count: int

    @property
    def step(self) -> float:
        """Distance of two positions [mm or °]."""
        return (self.high - self.low) / (self.count - 1)

    @property
    def positions(self) -> np.ndarray:
        """The positions, shape (count,) [mm or °]."""
        return np.linspace(self.low, self.high, self.count)


def lattice_of(positions: np.ndarray, most: int | None = None) -> Lattice:
    """Equal steps that contain all positions, where at most `most` of them do; else so many equal steps over their range.

    Never fewer than there are positions: whether a control has room for them is for the control to say.

    >>> lattice_of(np.array([0.0, 100.0, 400.0])).step, lattice_of(np.array([0.0, 120.0, 250.0, 380.0])).step
    (100.0, 10.0)
    """
    limit = max(LARGEST if most is None else most, len(positions))
    x = np.round(np.asarray(positions, dtype=float), DIGITS)
    if len(x) == 1:
        return Lattice(x[0], x[0] + 1.0, 2)
    gaps, span = np.diff(x), x[-1] - x[0]
    for part in range(1, FINEST + 1):
        step = gaps.min() / part
        if np.allclose(gaps / step, np.rint(gaps / step), rtol=0.0, atol=1e-5) and span / step < limit - 0.5:
            return Lattice(float(x[0]), float(x[-1]), round(span / step) + 1)
    common = common_step(x)
    if common and span / common < limit - 0.5:
        return Lattice(float(x[0]), float(x[-1]), round(span / common) + 1)
    return Lattice(float(x[0]), float(x[-1]), max(2, min(limit, 4 * len(x))))


def widened(lattice: Lattice, travel: tuple[float, float]) -> Lattice:
    """The same steps, continued until they cover the travel."""
    before, after = (
        max(0, int(np.ceil(gap / lattice.step - 1e-6))) for gap in (lattice.low - travel[0], travel[1] - lattice.high)
    )
    low, high = lattice.low - before * lattice.step, lattice.high + after * lattice.step
    return Lattice(round(low, DIGITS), round(high, DIGITS), lattice.count + before + after)


def on(table: AxisTable, lattice: Lattice) -> AxisTable:
    """The table at the positions of a lattice, linear between its own, end values held."""
    x = lattice.positions
    up, down = (table.of_argument(x, np.full(len(x), way)) for way in (1.0, -1.0))
    return replace(table, positions=x, forward=up, reverse=down)


def loss(table: AxisTable, lattice: Lattice) -> float:
    """Largest change of a value at the table's own positions by going over to a lattice [mm or rad]."""
    there = on(table, lattice)
    return float(
        max(
            np.abs(there.of_argument(table.positions, np.full(len(table.positions), way)) - values).max()
            for way, values in ((1.0, table.forward), (-1.0, table.reverse))
        )
    )
