"""Spatial error and compensation grids of the rotary axes (ISO/TR 16907 Table 3; type R-VOL).

Every node has the six components of the rigid error of one side's rotary axes at a reference point. Stacked axes share one grid;
one axis on each side makes two grids, whose effects add up. They are used together with the linear grid, which is evaluated at
the rotated tool vector.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from volid.compensation.base import base_of
from volid.compensation.grids.builder import build_grids
from volid.compensation.grids.grid import AnyGrid, Grid, RotaryGrid
from volid.compensation.grids.request import GridRequest
from volid.compensation.grids.sides import rotary_sides
from volid.compensation.tables.sampling import Sampling
from volid.compensation.types import TYPES
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.model.machine import Machine

if TYPE_CHECKING:
    from jaxtyping import Float


def rotary_grids(
    solution: Solution,
    *,
    step: float | None = None,
    points: int | None = None,
    reference_point: tuple[float, float, float] | None = None,
    nodes: Mapping[str, Float[np.ndarray, " n"]] | None = None,
) -> tuple[RotaryGrid, ...]:
    """Spatial grids of the rotary axes over their entire travel: table first, then head, those that the machine has.

    A grid contains the location errors and error motions of the rotary axes of its side; that of the head also contains the
    constants of the tool frame. The squareness errors of the linear axes stay in the linear grid.

    Args:
        solution: A solution, as `volid.fit` makes it.
        step: Distance between the nodes of an axis [°].
        points: Number of nodes per axis, where no step is given; 37 by default.
        reference_point: Point whose translation the values hold, shape (3,) [mm], in the frame of the body that bears the rotary
            axes, which coincides with the machine frame when the linear axes stand at 0; by default the `point` of the axis
            nearest the bed, for each side its own.
        nodes: The nodes themselves by axis letter, each of shape (n,) [°], instead of a step or a number.

    Raises:
        InputError: the machine has no rotary axes, a linear axis stands between stacked ones, or the step makes no grid.
        NotDeterminedError: the data do not determine the translations.

    Source: ISO/TR 16907 7.5, Table 3.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> (table,) = volid.rotary_grids(solution, points=5)
    >>> table.type, table.side, table.axes, table.values.shape
    ('R-VOL', 'table', ('A', 'C'), (25, 6))
    """
    if not rotary_sides(solution.machine):
        raise InputError(
            f"grid: machine '{solution.machine.name}' has no rotary axis; R-VOL is for rotary axes, L-VOL for linear ones"
        )
    request = GridRequest(
        TYPES["R-VOL"],
        base_of(solution, (0.0, 0.0, 0.0)),
        Sampling(step=step),
        points=points,
        nodes=nodes,
        reference_point=reference_point,
    )
    return tuple(g for g in build_grids(solution, request) if isinstance(g, RotaryGrid))


def deviation_from_grids(
    machine: Machine, linear: Grid, rotary: Sequence[RotaryGrid], positions: np.ndarray, tool: np.ndarray
) -> np.ndarray:
    """Deviation that the grids give at positions (m, n_axes) with tool vectors (m, 3) or (3,), shape (m, 6) [mm, rad].

    As in a control, it is the linear grid at the rotated tool vector plus every rotary grid with its own lever arm. It is NaN
    where a grid's rotations are not determined. Raises `ValueError` for a position outside the nodes.
    """
    total = np.zeros((len(positions), 6))
    grids: tuple[AnyGrid, ...] = (linear, *rotary)
    for grid in grids:
        values = grid.interpolate(grid.own_positions(machine, positions))
        values[:, :3] += np.cross(values[:, 3:], grid.lever_arms(machine, positions, tool))
        total += values
    return total
