"""Spatial error and compensation grids of the linear axes (ISO/TR 16907 Table 2; type L-VOL)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from volid.compensation.base import base_of
from volid.compensation.grids.builder import build_grid
from volid.compensation.grids.grid import Grid
from volid.compensation.grids.request import GridRequest
from volid.compensation.grids.sides import LINEAR
from volid.compensation.tables.sampling import Sampling
from volid.compensation.types import TYPES
from volid.fitting.solution import Solution

if TYPE_CHECKING:
    from jaxtyping import Float


def linear_grid(
    solution: Solution,
    *,
    step: float | None = None,
    points: int | None = None,
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0),
    nodes: Mapping[str, Float[np.ndarray, " n"]] | None = None,
) -> Grid:
    """Spatial grid of the linear axes over the entire travel, for (rotated) tool vector `tool`.

    On a machine with rotary axes: the errors of the linear axes alone, see `volid.rotary_grids`.

    Args:
        solution: A solution, as `volid.fit` makes it.
        step: Distance between the nodes of an axis [mm].
        points: Number of nodes per axis, where no step is given; 21 by default.
        tool: Tool vector for which the translations hold, (3,) [mm].
        nodes: The nodes themselves by axis letter, each of shape (n,) [mm], instead of a step or a number.

    Raises:
        NotDeterminedError: the data do not determine the translations for this tool vector.
        InputError: the step or the number of points makes no grid.

    Source: ISO/TR 16907 7.5.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> grid = volid.linear_grid(solution, points=3, tool=(0.0, 0.0, -150.0))
    >>> grid.type, grid.side, grid.axes, grid.values.shape
    ('L-VOL', 'linear', ('X', 'Y', 'Z'), (27, 6))
    """
    request = GridRequest(TYPES["L-VOL"], base_of(solution, tool), Sampling(step=step), points=points, nodes=nodes)
    grid = build_grid(solution, request, LINEAR)
    assert isinstance(grid, Grid)
    return grid
