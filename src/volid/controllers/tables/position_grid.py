"""A grid of translations alone, as files of controls that add no lever arm hold it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from volid.compensation.grids.grid import Grid
from volid.compensation.grids.interpolation import grid_positions

if TYPE_CHECKING:
    from jaxtyping import Float


def position_grid(
    axes: tuple[str, ...], nodes: tuple[Float[np.ndarray, " nodes"], ...], errors: Float[np.ndarray, "n 3"], note: str
) -> Grid:
    """The grid, with rotations 0, which is what the control does; `errors`: error values, the first axis fastest [mm].

    >>> position_grid(("X",), (np.array([0.0, 1.0]),), np.zeros((2, 3)), "no lever arm").values.shape
    (2, 6)
    """
    values = np.hstack([errors, np.zeros_like(errors)])
    unknown, inside = np.full_like(values, np.nan), np.zeros(len(values), dtype=bool)
    place = (0.0, 0.0, 0.0)
    return Grid("L-VOL", axes, nodes, grid_positions(nodes), values, unknown, inside, place, "machine", "", (note,))
