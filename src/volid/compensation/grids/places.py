"""Places of a grid before it has values."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.compensation.grids.grid import AnyGrid
from volid.compensation.grids.sides import axes_of, full_positions, part_letters, tool_reaching
from volid.model.machine import Machine


class Place(NamedTuple):
    """Where a grid is evaluated: its axes, full positions (m, n_axes), tool vectors (m, 3), letters whose errors it holds."""

    axes: tuple[str, ...]
    full: np.ndarray
    tool: np.ndarray
    letters: frozenset[str]

    def rows(self, some: slice) -> Place:
        """Some of the places."""
        return self._replace(full=self.full[some], tool=self.tool[some])


def place_at(machine: Machine, side: str, positions: np.ndarray, reference: np.ndarray) -> Place:
    """Places at positions (m, k) of a side's axes, for a tool vector or reference point (3,) [mm]; other axes stand still."""
    axes = axes_of(machine, side)
    full = full_positions(machine, axes, positions)
    return Place(axes, full, tool_reaching(machine, side, full, reference), part_letters(machine, side))


def place_of(machine: Machine, grid: AnyGrid) -> Place:
    """The nodes of a grid."""
    return place_at(machine, grid.side, grid.positions, grid.reference)
