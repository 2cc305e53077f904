"""Where spheres stand and which tool vectors see them, when a plan does not state it: as far apart as the travels allow.

Linear axes that follow a place c + r·k of the workpiece need positions that are linear in c and r: q = a + A (c + r k). The
largest r, and then the place nearest to the preferred one, are the solution of a linear program (Boyd, Vandenberghe, Convex
Optimization, 4.3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from volid.model.iso230 import LINEAR_AXES
from volid.model.kinematics import nominal_point
from volid.model.machine import Machine
from volid.planning.following import follow, rotary_axes

Vector = Sequence[float]
LENGTHS = (150.0, 100.0, 60.0)  # mm, of the tool, the longest that reaches
BESIDE = ((0.0, 0.0, 0.0), (40.0, 0.0, -30.0), (0.0, 40.0, -20.0))  # mm added to it under a head: not on one line
ABOVE = 60.0  # mm along the table's axis, where spheres are wanted
RADIUS = (20.0, 80.0)  # mm, least and largest distance of the spheres from their middle
_MARGIN = 1.0  # mm to the ends of travel, for rounding
_NEAR, _LEFT_OUT = 0.01, 10.0  # weights of a mm from the preferred place, of a mm beyond a travel, against one of r


class Places(NamedTuple):
    """Spheres by name, (x, y, z) on the workpiece with all axes at 0, and tool vectors, one or one per sphere [mm]."""

    spheres: dict[str, Vector]
    tools: list[Vector]


def spheres_and_tools(
    machine: Machine,
    positions: np.ndarray,
    spheres: Mapping[str, Vector] | None,
    tools: Vector | Sequence[Vector] | None,
    n: int = 3,
) -> Places:
    """The given spheres and tool vectors; those not given (None) are chosen so that the linear axes can follow `positions`.

    For `n` runs a head gets as many tool vectors that do not lie on one line, and a table gets `n` spheres around its axis, or
    one sphere where it does not turn. Where the travels are too short for all `positions` (m, n_axes), the choice suits most.
    """
    vectors: list[Vector] | None = None
    if tools is not None:
        vectors = np.atleast_2d(np.asarray(tools, dtype=float)).tolist()
    if spheres is not None:
        return Places(dict(spheres), vectors or _tools(machine, LENGTHS[0], n if len(spheres) == 1 else len(spheres)))
    return _chosen_places(machine, positions, vectors, n if vectors is None or len(vectors) == 1 else len(vectors))


def _chosen_places(machine: Machine, positions: np.ndarray, given: list[Vector] | None, n: int) -> Places:
    """Spheres for the given tool vectors, or else for the longest of `LENGTHS` with which the travels suffice."""
    table = next((axis for axis in rotary_axes(machine) if axis.primed), None)
    for length in LENGTHS:
        chosen = given or _tools(machine, length, n)
        runs = len(chosen) if table is None else max(len(chosen), n)
        spread = np.zeros((runs, 3)) if table is None else _around(table.unit_vector, runs)
        vectors = [chosen[i % len(chosen)] for i in range(runs)]
        found = reach(machine, positions, vectors, spread, _preferred(machine, chosen[0]))
        if found.beyond == 0.0 or given:
            break
    centres = np.round(found.centre + found.radius * (spread[:1] if table is None else spread))
    return Places({f"P{i + 1}": tuple(c.tolist()) for i, c in enumerate(centres)}, chosen)


def _tools(machine: Machine, length: float, n: int) -> list[Vector]:
    """One vector along the spindle, or `n` of them side by side under a head."""
    head = any(not axis.primed for axis in rotary_axes(machine))
    return [tuple(np.add((0.0, 0.0, -length), BESIDE[i % len(BESIDE)]).tolist()) for i in range(n if head else 1)]


def _around(direction: Vector, n: int) -> np.ndarray:
    """`n` unit steps around an axis, at different heights along it, off the symmetric places; (n, 3)."""
    along = np.asarray(direction)
    first = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    first /= np.linalg.norm(first)
    turn = 2.0 * np.pi * (np.arange(n) / n + 0.05)
    height = 0.6 * np.arange(n) / n
    return np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * np.cross(along, first) + height[:, None] * along


def _preferred(machine: Machine, tool: Vector) -> np.ndarray:
    """Above the middle of the table; without a rotary table where the tool stands with all axes in mid-travel, rotary at 0."""
    tables = [axis for axis in rotary_axes(machine) if axis.primed]
    if tables:
        return np.asarray(tables[0].point) + ABOVE * np.asarray(tables[0].unit_vector)
    middle = np.array([[0.5 * sum(axis.travel) if axis.is_linear else 0.0 for axis in machine.axes]])
    return np.asarray(nominal_point(machine, middle, np.asarray(tool, dtype=float)[None])[0])


def reachable(machine: Machine, positions: np.ndarray, tool: Vector, offset: np.ndarray) -> Vector:
    """A place c in full mm such that the linear axes reach c + offset (m, 3) at all rotary `positions`, or at most of them."""
    found = reach(machine, positions, [tool], np.zeros((1, 3)), _preferred(machine, tool), offset)
    return tuple(np.round(found.centre).tolist())


class Reach(NamedTuple):
    """Middle of the places (3,) and their distance from it [mm]; `beyond`: sum of the lengths that the travels lack [mm]."""

    centre: np.ndarray
    radius: float
    beyond: float


def reach(
    machine: Machine,
    positions: np.ndarray,
    tools: Sequence[Vector],
    spread: np.ndarray,
    preferred: np.ndarray,
    offset: np.ndarray | None = None,
) -> Reach:
    """Middle c and radius r with which the linear axes reach c + r·spread[k] + offset with tool k, at rotary `positions`.

    `spread`: (k, 3), zeros for r = 0. `offset`: (m, 3) [mm], moves the target at every position. r lies within `RADIUS`.
    When no place suits all positions, the sum of the lengths by which the travels are too short is the least.
    """
    offset = np.zeros((len(positions), 3)) if offset is None else offset
    columns = [machine.index(a) for a in LINEAR_AXES]
    low, high = np.array([machine.axis(a).travel for a in LINEAR_AXES]).T
    rows, limits = [], []
    for tool, step in zip(tools, spread, strict=True):
        base = follow(machine, positions, np.asarray(tool), offset)[:, columns]
        moved = [follow(machine, positions, np.asarray(tool), offset + e)[:, columns] - base for e in np.eye(3)]
        slope = np.stack(moved, axis=-1)  # (m, 3 axes, 3 coordinates of c)
        design = np.concatenate([slope, slope @ step[:, None]], axis=2).reshape(-1, 4)
        rows += [design, -design]
        limits += [(high - _MARGIN - base).ravel(), (base - low - _MARGIN).ravel()]
    design, limit = np.concatenate(rows), np.concatenate(limits)
    bounds = RADIUS if np.any(spread) else (0.0, 0.0)
    solved = _program(design, limit, preferred, bounds, slack=False)
    return solved or _program(design, limit, preferred, bounds, slack=True) or Reach(preferred, bounds[0], np.inf)


def _program(
    design: np.ndarray, limit: np.ndarray, preferred: np.ndarray, bounds: tuple[float, float], slack: bool
) -> Reach | None:
    """The linear program in c, r, |c - preferred| and, with `slack`, what each row may lack; None when it has no solution."""
    n = len(limit)
    from scipy.optimize import linprog  # slow to import, and few need it
    from scipy.sparse import csr_array, hstack, identity, vstack

    block, near = csr_array(design), csr_array(np.hstack([np.eye(3), np.zeros((3, 1))]))
    width = n if slack else 0
    lines = [
        hstack([block, csr_array((n, 3)), -identity(n, format="csr") if slack else csr_array((n, 0))]),
        hstack([near, -identity(3), csr_array((3, width))]),
        hstack([-near, -identity(3), csr_array((3, width))]),
    ]
    cost = np.concatenate([np.zeros(3), [-1.0], np.full(3, _NEAR), np.full(width, _LEFT_OUT)])
    found = linprog(
        cost,
        A_ub=vstack(lines).tocsr(),
        b_ub=np.concatenate([limit, preferred, -preferred]),
        bounds=[(None, None)] * 3 + [bounds] + [(0.0, None)] * (3 + width),
    )
    return Reach(found.x[:3], float(found.x[3]), float(found.x[7:].sum())) if found.success else None
