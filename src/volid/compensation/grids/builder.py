"""Spatial grids of any compensation type: what its effects do at every node, with uncertainty (ISO/TR 16907 Tables 2 and 3).

One builder makes every grid, of linear and of rotary axes. L-VOL and R-VOL contain the entire model; all other types restrict it
to their effects. A FOR grid contains the orientation error alone, with zero translations: the control turns rotary axes by it and
moves nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from volid.compensation.grids.evaluation import Evaluated, evaluate
from volid.compensation.grids.grid import AnyGrid, Grid, RotaryGrid
from volid.compensation.grids.interpolation import grid_positions, period_of
from volid.compensation.grids.nodes import grid_nodes
from volid.compensation.grids.notes import grid_notes, require_determined
from volid.compensation.grids.places import Place, place_at
from volid.compensation.grids.request import GridRequest
from volid.compensation.grids.sides import LINEAR, axes_of, rotary_sides
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.model.error_functions import describe_datum
from volid.model.requests import ask_metres, ask_place


def build_grids(solution: Solution, request: GridRequest) -> tuple[AnyGrid, ...]:
    """Grids of one type: of the linear axes, then of the rotary axes of table and head, those that the type needs.

    A type that turns rotary axes brings the FOR grids of the other axes with it. Raises `InputError` for a `zero` that is no
    place of linear axes and for numbers that make no grid, `NotDeterminedError` when the data do not determine the translations.
    """
    _ask(solution, request)
    t, grids = request.type, []
    if t.is_linear or t.turns:
        grids.append(build_grid(solution, request if t.is_linear else request.for_orientation(), LINEAR))
    if t.is_rotary or t.turns:
        rotary_request = replace(request, zero=None) if t.is_rotary else request.for_orientation()
        grids += [build_grid(solution, rotary_request, side) for side in rotary_sides(solution.machine)]
    return tuple(grids)


def _ask(solution: Solution, request: GridRequest) -> None:
    """Raises `InputError` for a place or positions that are none, or look like another unit than mm."""
    machine = solution.campaign.machine
    if request.reference_point is not None:
        ask_place(machine, "reference_point", request.reference_point)
    ask_metres(machine, request.zero or {}, "`zero`")


def build_grid(solution: Solution, request: GridRequest, side: str) -> AnyGrid:
    """The grid of one side, without short waves; see `build_grids` for what it raises."""
    solution = solution.without_waves()
    machine, reference = solution.machine, request.reference(solution.machine, side)
    lines = grid_nodes(solution, request, side)
    place = place_at(machine, side, grid_positions(lines), reference)
    zero = _zero_place(solution, request, request.zero) if side == LINEAR and request.zero else None
    found = evaluate(solution, request, place, zero)
    require_determined(solution, request, side, found)
    outside = solution.outside(place.full, place.axes)
    common = _common(solution, request, lines, place, found) | {
        "outside": outside,
        "notes": grid_notes(solution, request, side, place, found, zero),
    }
    x, y, z = reference.tolist()
    if side == LINEAR:
        return Grid(**common, tool=(x, y, z))
    period = tuple(period_of(machine.axis(a), n) for a, n in zip(place.axes, lines, strict=True))
    return RotaryGrid(**common, side=side, determined=found.determined, reference_point=(x, y, z), period=period)


def _common(
    solution: Solution, request: GridRequest, lines: tuple[np.ndarray, ...], place: Place, found: Evaluated
) -> dict[str, Any]:
    """The fields that both classes of grids have in common."""
    return {
        "type": request.type.name,
        "axes": place.axes,
        "nodes": lines,
        "positions": grid_positions(lines),
        "values": found.values,
        "u": found.u,
        "frame": "machine",
        "datum": describe_datum(solution.machine, solution.datum),
    }


def _zero_place(solution: Solution, request: GridRequest, zero: Mapping[str, float]) -> Place:
    """Where translations are zero. Raises `InputError` for another axis than a linear one, or a place beyond its travel."""
    machine, axes = solution.machine, axes_of(solution.machine, LINEAR)
    for letter, value in zero.items():
        low, high = machine.axis(letter).travel
        if letter not in axes or not low <= value <= high:
            raise InputError(
                f"`zero={letter}={value:g}`; expected positions of {', '.join(axes)} within their travels: a constant taken "
                "out of a rotary grid would displace its axis"
            )
    at: Sequence[float] = [zero.get(a, request.base.at[machine.index(a)]) for a in axes]
    return place_at(machine, LINEAR, np.array([at]), request.base.tool)
