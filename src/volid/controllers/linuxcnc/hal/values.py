"""Spatial grids as corrections of X, Y, Z for one tool vector, and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from volid.compensation.grids.grid import Grid
from volid.compensation.grids.interpolation import grid_positions
from volid.controllers.base import Job
from volid.controllers.linuxcnc.hal.text import HalGrid
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.model.machine import Machine

ABSENT = np.zeros(1)  # the single node of an axis that the machine does not have
NO_LEVER = "rotations are 0: this control adds no lever arm, and moves by the same values with every tool"
NEAR = 1e-9  # mm


def for_tool(grid: Grid, job: Job) -> Grid:
    """The grid for the tool vector of a job, its rotations times the lever arm added. Raises `InputError` for blank values."""
    arm = grid.lever_arms(job.machine, job.at[None], job.tool)[0]
    if np.abs(arm).max() > NEAR:
        values = grid.values.copy()
        values[:, :3] += np.cross(values[:, 3:], arm)
        x, y, z = (grid.reference + arm).tolist()
        grid = replace(grid, values=values, tool=(x, y, z))
    blank = np.isnan(grid.values[:, :3]).any(axis=1)
    if blank.any():
        at = ", ".join(f"{a} = {v:g}" for a, v in zip(grid.axes, grid.positions[np.argmax(blank)], strict=True))
        tool = ", ".join(f"{v:g}" for v in grid.tool)
        raise InputError(
            f"{grid.type} with the tool vector ({tool}) mm is not determined at {int(blank.sum())} of {len(blank)} nodes, the "
            f"first at {at}; state `ranges` within what was measured, or a measured `tool`"
        )
    return grid


def nodes_of(grid: Grid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes of X, Y, Z; a single one at 0 for an axis that the grid does not have [mm]."""
    by_letter = dict(zip(grid.axes, grid.nodes, strict=True))
    x, y, z = (np.asarray(by_letter.get(a, ABSENT), dtype=float) for a in LINEAR_AXES)
    return x, y, z


def corrections_of(grid: Grid) -> np.ndarray:
    """What is added to the commands at the nodes, (nx, ny, nz, 3) [mm]."""
    shape = tuple(len(n) for n in nodes_of(grid))
    return np.ascontiguousarray(grid.compensation[:, :3].reshape(*shape[::-1], 3).transpose(2, 1, 0, 3))


def grid_of(name: str, held: HalGrid, machine: Machine) -> Grid:
    """The error values that the file `name` means. Raises `InputError` for nodes of an axis that the machine does not have."""
    axes = tuple(a for a in LINEAR_AXES if a in machine.letters)
    for letter, nodes in zip(LINEAR_AXES, held.nodes, strict=True):
        if letter not in axes and len(nodes) > 1:
            raise InputError(
                f"{name}: {len(nodes)} nodes of {letter}, and machine '{machine.name}' has no axis {letter}; expected one node"
            )
    lines = tuple(n for a, n in zip(LINEAR_AXES, held.nodes, strict=True) if a in axes)
    errors = 0.0 - held.values.transpose(2, 1, 0, 3).reshape(-1, 3)  # 0 - v: no negative zero
    values = np.hstack([errors, np.zeros_like(errors)])
    unknown, inside = np.full_like(values, np.nan), np.zeros(len(values), dtype=bool)
    common = (held.type, axes, lines, grid_positions(lines), values, unknown, inside)
    return Grid(*common, tool=held.tool, frame="machine", datum="not stated in the file", notes=(NO_LEVER,))


def steepest(grid: Grid, component: int) -> float:
    """Largest change of a correction per mm of motion, where all axes move at the same speed."""
    table, found = corrections_of(grid)[..., component], 0.0
    for i, nodes in enumerate(nodes_of(grid)):
        if len(nodes) > 1:
            steps = np.diff(nodes).reshape([-1 if k == i else 1 for k in range(3)])
            found += float(np.abs(np.diff(table, axis=i) / steps).max())
    return found
