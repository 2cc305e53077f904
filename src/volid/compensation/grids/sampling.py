"""How many nodes a grid gets: by step, by number, or the fewest that keep an interpolation error; and what that error is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from volid.compensation.base import Base
from volid.compensation.grids.fields import field_values, linear_place, rotary_place
from volid.compensation.grids.linear import POINTS as LINEAR_POINTS
from volid.compensation.grids.linear import Grid, grid_positions, node_lines
from volid.compensation.grids.parts import HEAD, rotary_letters
from volid.compensation.grids.rotary import POINTS as ROTARY_POINTS
from volid.compensation.grids.rotary import RotaryGrid
from volid.compensation.tables.sampling import Sampling, choose_nodes
from volid.compensation.types import CompensationType
from volid.fitting.solution import Solution
from volid.model.iso230 import LINEAR_AXES, ROTARY_AXES
from volid.model.machine import Machine

MOST = 20_000  # points at which the interpolation of a grid is looked at
LINES = 401  # dense points of a line on which the number of nodes is decided


def grid_interpolation(solution: Solution, t: CompensationType, base: Base, grid: Grid | RotaryGrid) -> float:
    """Largest deviation of a grid's linear interpolation in X, Y or Z [mm], at the centres of its cells and of their edges.

    There the interpolation of a smooth function is worst: h² |f''| / 8 along each axis, summed over the axes.
    """
    lines = [np.sort(np.concatenate([n, 0.5 * (n[1:] + n[:-1])])) for n in grid.nodes]
    positions = grid_positions(tuple(lines))
    if len(positions) > MOST:
        positions = positions[np.random.default_rng(0).choice(len(positions), MOST, replace=False)]
    if isinstance(grid, RotaryGrid):
        place = rotary_place(solution.machine, grid.side, positions, np.asarray(grid.reference_point))
    else:
        place = linear_place(solution.machine, positions, base)
    off = field_values(solution, t, base, place) - grid.interpolate(positions)
    return float(np.abs(off[:, :3]).max())


def _axes_of(machine: Machine, side: str | None) -> tuple[str, ...]:
    own, order = (
        (machine.letters, LINEAR_AXES) if side is None else (rotary_letters(machine, side), ROTARY_AXES)
    )  # a linear grid or a side's
    return tuple(a for a in order if a in own)


def grid_nodes(
    solution: Solution,
    t: CompensationType,
    base: Base,
    side: str | None,
    sampling: Sampling,
    points: int | None,
    point: np.ndarray | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> dict[str, np.ndarray]:
    """Nodes by axis letter: by number, by step, or the fewest that share the stated interpolation error between the axes.

    `ranges`: lowest and highest node by axis letter, default the travel [mm or °].
    """
    reach = {a.letter: a.travel for a in solution.machine.axes} | dict(ranges or {})
    axes = _axes_of(solution.machine, side)
    count = sampling.max_points if sampling.max_error is None and sampling.max_points else points
    default = LINEAR_POINTS if side is None else ROTARY_POINTS
    if sampling.max_error is None:
        return dict(zip(axes, node_lines(solution, axes, sampling.step, count, default, ranges=reach), strict=True))
    share = replace(sampling, max_error=sampling.max_error / len(axes), spacing="equal")
    nodes = {}
    for letter in axes:
        x = np.linspace(*reach[letter], LINES)
        curves = [_line(solution, t, base, side, letter, x, at, point) for at in _crossings(reach, axes, letter)]
        values = np.concatenate(curves, axis=1)
        values[:, _rotations(values)] *= _offset(solution, base, sampling, side)
        nodes[letter] = choose_nodes(f"grid axis {letter}", x, values, share)
    return nodes


def _rotations(values: np.ndarray) -> np.ndarray:
    return np.arange(values.shape[1]) % 6 >= 3


def _offset(solution: Solution, base: Base, sampling: Sampling, side: str | None) -> float:
    """Lever arm that rotations are weighed with [mm]: the tool offset asked for; else half the travel, or the tool of a head."""
    if sampling.offset is not None:
        return sampling.offset
    tool = float(np.linalg.norm(base.tool))
    if side is None:
        return 0.0  # a grid of the linear axes already holds the translations at its tool vector
    return tool if side == HEAD else 0.5 * float(np.linalg.norm([a.length for a in solution.machine.linear]))


def _crossings(reach: Mapping[str, tuple[float, float]], axes: tuple[str, ...], moving: str) -> list[dict[str, float]]:
    """Where the other axes stand while one moves: all ends, and the middle."""
    others = [a for a in axes if a != moving]
    ends = np.stack(np.meshgrid(*([[0.0, 1.0]] * len(others)), indexing="ij"), axis=-1).reshape(-1, len(others))
    places = np.vstack([ends, np.full(len(others), 0.5)])
    return [
        {a: reach[a][0] + f * (reach[a][1] - reach[a][0]) for a, f in zip(others, row, strict=True)} for row in places
    ]


def _line(
    solution: Solution,
    t: CompensationType,
    base: Base,
    side: str | None,
    letter: str,
    x: np.ndarray,
    at: Mapping[str, float],
    point: np.ndarray | None,
) -> np.ndarray:
    machine = solution.machine
    axes = _axes_of(machine, side)
    positions = np.stack([x if a == letter else np.full(len(x), at[a]) for a in axes], axis=1)
    place = (
        linear_place(machine, positions, base)
        if side is None
        else rotary_place(machine, side, positions, np.asarray(point))
    )
    return field_values(solution, t, base, place)
