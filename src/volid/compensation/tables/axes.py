"""What a table of one axis depends on: positions of other axes, the pieces of its functions, and its longest lever arm."""

from __future__ import annotations

import numpy as np

from volid.backend.even_points import evenly
from volid.compensation.base import Base
from volid.fitting.solution import Solution
from volid.model.error_functions import settings_for
from volid.model.iso230 import ROTARY_AXES, parse
from volid.model.machine import Axis, Machine


def judged_axes(solution: Solution, axis: Axis) -> tuple[str, ...]:
    """Axes whose positions a table of `axis` depends on: itself, those of cross effects, for a linear axis those of the line."""
    crossed = [
        solution.machine.letters[s.axis]
        for f in solution.model.functions
        if parse(f.name).axis == axis.letter
        for s in f.splines
    ]
    line = [a.letter for a in solution.machine.linear] if axis.is_linear else []
    return tuple(dict.fromkeys([axis.letter, *line, *crossed]))


def polygon_knots(solution: Solution, axis: Axis, ends: tuple[float, float]) -> np.ndarray | None:
    """Ends of the straight pieces, when the axis's functions are polygons of one spacing: a table of these is exact."""
    splines = {
        (f.splines[0].segments, f.splines[0].degree)
        for f in solution.model.functions
        if parse(f.name).axis == axis.letter and f.splines
    }
    degrees = {settings_for(solution.machine, n).degree for n in solution.model.names if parse(n).axis == axis.letter}
    if len(splines) != 1 or next(iter(splines))[1] != 1 or axis.is_full_turn or not degrees:
        return None
    knots = evenly(*axis.travel, next(iter(splines))[0] + 1)
    return np.array([ends[0], *knots[(knots > ends[0]) & (knots < ends[1])], ends[1]])


def reach(machine: Machine, axis: Axis, base: Base) -> float:
    """Longest lever arm that rotations of an axis may meet [mm]: the other axes' travel and the tool, or the tool alone."""
    tool = float(np.linalg.norm(base.tool))
    if axis.is_linear or axis.primed:
        return float(np.linalg.norm([a.length for a in machine.linear if a.letter != axis.letter])) + tool
    pivots = [np.asarray(a.point) for a in machine.axes if a.letter in ROTARY_AXES and not a.primed]
    return max(float(np.linalg.norm(base.tool - p)) for p in pivots)
