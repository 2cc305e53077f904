"""Nodes of spatial grids: by step, by number, as stated, or the fewest that keep an interpolation error; and that error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from volid.backend.consent import ask_memory, in_bytes, in_digits
from volid.backend.even_points import evenly, every_step, number_of_steps
from volid.compensation.grids.evaluation import evaluate, field_values
from volid.compensation.grids.grid import AnyGrid
from volid.compensation.grids.interpolation import grid_positions
from volid.compensation.grids.places import place_at
from volid.compensation.grids.request import GridRequest
from volid.compensation.grids.sides import HEAD, LINEAR, axes_of
from volid.compensation.tables.sampling import choose_nodes
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.model.machine import Machine
from volid.model.requests import ask_positions, ask_step

POINTS, ROTARY_POINTS = 21, 37  # per axis when nothing is asked for
MEMORY, FILE = 1000.0, 220.0  # bytes of a node while a grid is computed, and in a CSV file
MOST = 20_000  # points at which the interpolation of a grid is looked at
LINES = 401  # dense points of a line on which the number of nodes is decided


def grid_nodes(solution: Solution, request: GridRequest, side: str) -> tuple[np.ndarray, ...]:
    """Nodes of every axis of a side's grid: as stated, by number or by step, or by `max_error`, which the axes share.

    Raises `InputError` for numbers that make no grid, one of more than two million nodes, or nodes far outside the travels.
    """
    if request.points is not None and request.points < 2:
        raise InputError(f"grid: points = {request.points}; expected at least 2 per axis")
    reach = {a.letter: a.travel for a in solution.machine.axes} | dict(request.ranges or {})
    given = {a: np.asarray(n, dtype=float) for a, n in (request.nodes or {}).items()}
    ask_positions(solution.campaign.machine, given, "`nodes`")
    axes = axes_of(solution.machine, side)
    if request.sampling.max_error is None:
        asked = _asked(request, side, {a: reach[a] for a in axes if a not in given})
        _ask_size(request, [*asked, *(len(n) for n in given.values())])
        found = {a: _even_nodes(request, side, reach[a]) for a in axes if a not in given}
    else:
        found = {a: _fewest_nodes(solution, request, side, a, reach) for a in axes if a not in given}
        _ask_size(request, [len(n) for n in (found | given).values()])
    return tuple((found | given)[a] for a in axes)


def _asked(request: GridRequest, side: str, reach: Mapping[str, tuple[float, float]]) -> list[float]:
    """How many nodes the axes are to have, before there are any. Raises `InputError` for a step longer than all of them."""
    step = request.sampling.step
    if step is None:
        return [_number(request, side)] * len(reach)
    ask_step(step, reach)
    return [number_of_steps(*ends, step) for ends in reach.values()]


def _ask_size(request: GridRequest, counts: Sequence[float]) -> None:
    """Raises `InputError` for more nodes than are taken without a question, or than the computer can hold."""
    size = float(np.prod(np.array(counts, dtype=float)))
    each = " × ".join(map(in_digits, counts))
    asked = "grid" if request.sampling.step is None else f"`step={request.sampling.step:g}`"
    what = f"{asked}: {each} = {in_digits(size)} nodes, a file of {in_bytes(FILE * size)}"
    ask_memory(what, MEMORY * size, "Take a larger step or fewer points")


def _number(request: GridRequest, side: str) -> int:
    """Nodes of an axis that is divided evenly."""
    return request.sampling.max_points or request.points or (POINTS if side == LINEAR else ROTARY_POINTS)


def _even_nodes(request: GridRequest, side: str, reach: tuple[float, float]) -> np.ndarray:
    """Nodes of one axis by step or by number, between the ends of `reach`."""
    if request.sampling.step is not None:
        return every_step(*reach, request.sampling.step)
    return evenly(*reach, _number(request, side))


def _fewest_nodes(
    solution: Solution, request: GridRequest, side: str, letter: str, reach: Mapping[str, tuple[float, float]]
) -> np.ndarray:
    """The fewest nodes of one axis that keep its share of the interpolation error wherever the other axes stand."""
    machine, axes = solution.machine, axes_of(solution.machine, side)
    x, reference = np.linspace(*reach[letter], LINES), request.reference(machine, side)
    curves = []
    for at in _crossings(reach, axes, letter):
        positions = np.stack([x if a == letter else np.full(len(x), at[a]) for a in axes], axis=1)
        curves.append(field_values(solution, request, place_at(machine, side, positions, reference)))
    values = np.concatenate(curves, axis=1)
    values[:, np.arange(values.shape[1]) % 6 >= 3] *= _offset(machine, request, side)
    share = replace(request.sampling, max_error=(request.sampling.max_error or 0.0) / len(axes), spacing="equal")
    return choose_nodes(f"grid axis {letter}", x, values, share)


def _offset(machine: Machine, request: GridRequest, side: str) -> float:
    """Lever arm that rotations are weighed with [mm]: the tool offset asked for; else half the travel, or the tool of a head."""
    if request.sampling.offset is not None:
        return request.sampling.offset
    if side == LINEAR:
        return 0.0  # a grid of the linear axes already holds the translations at its tool vector
    tool = float(np.linalg.norm(request.base.tool))
    return tool if side == HEAD else 0.5 * float(np.linalg.norm([a.length for a in machine.linear]))


def _crossings(reach: Mapping[str, tuple[float, float]], axes: tuple[str, ...], moving: str) -> list[dict[str, float]]:
    """Where the other axes stand while one moves: all ends, and the middle."""
    others = [a for a in axes if a != moving]
    ends = np.stack(np.meshgrid(*([[0.0, 1.0]] * len(others)), indexing="ij"), axis=-1).reshape(-1, len(others))
    places = np.vstack([ends, np.full(len(others), 0.5)])
    return [
        {a: reach[a][0] + f * (reach[a][1] - reach[a][0]) for a, f in zip(others, row, strict=True)} for row in places
    ]


def grid_interpolation(solution: Solution, request: GridRequest, grid: AnyGrid) -> float:
    """Largest deviation of a grid's linear interpolation in X, Y or Z [mm], at the centres of its cells and of their edges.

    There the interpolation of a smooth function is worst: h² |f''| / 8 along each axis, summed over the axes. `request`: the
    request that the grid was made from; the values between the nodes are evaluated in the same way.
    """
    lines = [np.sort(np.concatenate([n, 0.5 * (n[1:] + n[:-1])])) for n in grid.nodes]
    positions = grid_positions(tuple(lines))
    if len(positions) > MOST:
        positions = positions[np.random.default_rng(0).choice(len(positions), MOST, replace=False)]
    place = place_at(solution.machine, grid.side, positions, grid.reference)
    off = evaluate(solution, replace(request, uncertainty=False), place).values - grid.interpolate(positions)
    return float(np.abs(off[:, :3]).max())
