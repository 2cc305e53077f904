"""Spatial grids of any compensation type: what its effects do at every node, with uncertainty (ISO/TR 16907 Tables 2 and 3).

L-VOL and R-VOL are grids of the whole model (`grids`, `rotary_grids`); all other types restrict it to their effects. A FOR grid
holds the orientation error alone, zero translations: the control turns rotary axes by it and moves nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from volid.compensation.effects import Base, condensed, effect_errors, model_errors
from volid.compensation.grids import POINTS as LINEAR_POINTS
from volid.compensation.grids import Grid, describe_datum, grid_positions, linear_grid, node_lines
from volid.compensation.nominal import influence
from volid.compensation.parts import (
    HEAD,
    TABLE,
    full_positions,
    part_letters,
    part_notes,
    rotary_letters,
    tool_reaching,
)
from volid.compensation.rotary_grids import POINTS as ROTARY_POINTS
from volid.compensation.rotary_grids import RotaryGrid, reference_of_side, rotary_grids
from volid.compensation.sampling import Sampling, choose_nodes
from volid.compensation.tables import propagated
from volid.compensation.types import GRID, ORIENTATION, TYPES, CompensationType
from volid.error_model import ROWS
from volid.exceptions import InputError, NotDeterminedError
from volid.fitting.solution import Solution
from volid.iso230 import LINEAR_AXES, ROTARY_AXES, SPINDLE
from volid.machine import Machine

CHUNK = 256
MOST = 20_000  # points at which the interpolation of a grid is looked at
LINES = 401  # dense points of a line on which the number of nodes is decided
Rule = Callable[..., Any]


class _Place(NamedTuple):
    """A grid before it has values: axes, full positions (m, n_axes), tool vectors (m, 3), letters whose errors it holds."""

    axes: tuple[str, ...]
    full: np.ndarray
    tool: np.ndarray
    letters: frozenset[str]


class _Found(NamedTuple):
    values: np.ndarray
    u: np.ndarray
    determined: np.ndarray


def _linear_place(machine: Machine, positions: np.ndarray, base: Base) -> _Place:
    axes = tuple(a for a in LINEAR_AXES if a in machine.letters)
    full = full_positions(machine, axes, positions)
    return _Place(axes, full, np.broadcast_to(base.tool, (len(full), 3)), part_letters(machine, None))


def _rotary_place(machine: Machine, side: str, positions: np.ndarray, point: np.ndarray) -> _Place:
    axes = tuple(a for a in ROTARY_AXES if a in rotary_letters(machine, side))
    full = full_positions(machine, axes, positions)
    return _Place(axes, full, tool_reaching(machine, side, full, point), part_letters(machine, side))


def _errors(solution: Solution, t: CompensationType, base: Base, place: _Place, rows: slice) -> np.ndarray:
    """Error values of the type (m, 6·(n_axes + 1), n), of the axes that this grid holds; for FOR the whole model's."""
    q = place.full[rows]
    if t.name == "FOR":
        return model_errors(solution, q, np.zeros_like(q), lambda e: e.axis in place.letters, base.turn)
    effects = tuple(e for e in t.effects if e != ORIENTATION)
    errors = effect_errors(solution, effects, base, q, np.zeros_like(q))
    for i, letter in enumerate((*solution.machine.letters, SPINDLE)):
        if letter not in place.letters:
            errors[:, ROWS * i : ROWS * i + ROWS] = 0.0
    return errors


def _evaluate(solution: Solution, t: CompensationType, base: Base, place: _Place, uncertainty: bool) -> _Found:
    if not uncertainty:
        values = field_values(solution, t, base, place)
        return _Found(values, np.full_like(values, np.nan), np.ones(values.shape, dtype=bool))
    covariance = solution.parameter_covariance
    theta = np.asarray(solution.parameters)
    found: list[tuple[np.ndarray, ...]] = []
    for start in range(0, len(place.full), CHUNK):
        rows = slice(start, start + CHUNK)
        gradient = _gradient(solution, t, base, place, rows)
        lost = solution.is_lost(gradient.reshape(-1, len(theta))).reshape(gradient.shape[:2])
        found.append((gradient @ theta, propagated(gradient, covariance), ~lost))
    value, u, known = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return _Found(np.where(known, value, np.nan), np.where(known, u, np.nan), known)


def _gradient(solution: Solution, t: CompensationType, base: Base, place: _Place, rows: slice) -> np.ndarray:
    """Deviation as linear map of θ, (m, 6, n)."""
    caused = influence(solution.machine, place.full[rows], place.tool[rows])
    gradient = np.asarray(caused @ _errors(solution, t, base, place, rows))
    if t.name == "FOR":
        gradient[:, :3] = 0.0
    return gradient


def field_values(solution: Solution, t: CompensationType, base: Base, place: _Place) -> np.ndarray:
    """Values (m, 6) alone, without uncertainty."""
    small, plain = condensed(solution, base)
    parts = [slice(s, s + 4 * CHUNK) for s in range(0, len(place.full), 4 * CHUNK)]
    return np.concatenate([_gradient(small, t, plain, place, rows).sum(axis=2) for rows in parts])


def effect_grids(
    solution: Solution,
    t: CompensationType,
    base: Base,
    sampling: Sampling | None = None,
    *,
    points: int | None = None,
    reference_point: Sequence[float] | None = None,
    rule: Rule | None = None,
    uncertainty: bool = True,
) -> tuple[Grid | RotaryGrid, ...]:
    """Grids of one type: of the linear axes, then of the rotary axes of table and head, those that the type needs.

    `sampling`: step, at most so many points per axis, or a bound on the interpolation; else `points` per axis (default 21,
    rotary axes 37). `rule`: of L-SPEC and R-SPEC, called as rule(solution, positions (m, n_axes), tool (m, 3)), returns error
    values (m, 6) [mm, rad]. `uncertainty`: False leaves out u, and the test whether the data determine the values, which take
    most of the time. Raises `InputError` for a type without grids, `NotDeterminedError` when the data do not determine its
    translations.
    """
    if GRID not in t.forms:
        raise InputError(f"--type {t.name} has no grid; it is a table of the axis itself: volid tables --type {t.name}")
    machine, sampling = solution.machine, Sampling() if sampling is None else sampling
    grids: list[Grid | RotaryGrid] = []
    if t.is_linear or t.turns:
        own = t if t.is_linear else _FOR
        grids.append(
            _linear(solution, own, base, _nodes(solution, own, base, None, sampling, points), rule, uncertainty)
        )
    if t.is_rotary or t.turns:
        own = t if t.is_rotary else _FOR
        for side in (s for s in (TABLE, HEAD) if rotary_letters(machine, s)):
            point = reference_of_side(machine, side, reference_point)
            nodes = _nodes(solution, own, base, side, sampling, points, point)
            grids.append(_rotary(solution, own, base, side, nodes, point, rule, uncertainty))
    return tuple(grids)


_FOR = TYPES["FOR"]


def grid_interpolation(solution: Solution, t: CompensationType, base: Base, grid: Grid | RotaryGrid) -> float:
    """Largest deviation of a grid's linear interpolation in X, Y or Z [mm], at the centres of its cells and of their edges.

    There the interpolation of a smooth function is worst: h² |f''| / 8 along each axis, summed over the axes.
    """
    lines = [np.sort(np.concatenate([n, 0.5 * (n[1:] + n[:-1])])) for n in grid.nodes]
    positions = grid_positions(tuple(lines))
    if len(positions) > MOST:
        positions = positions[np.random.default_rng(0).choice(len(positions), MOST, replace=False)]
    if isinstance(grid, RotaryGrid):
        place = _rotary_place(solution.machine, grid.side, positions, np.asarray(grid.reference_point))
    else:
        place = _linear_place(solution.machine, positions, base)
    off = field_values(solution, t, base, place) - grid.interpolate(positions)
    return float(np.abs(off[:, :3]).max())


def _axes_of(machine: Machine, side: str | None) -> tuple[str, ...]:
    own, order = (
        (machine.letters, LINEAR_AXES) if side is None else (rotary_letters(machine, side), ROTARY_AXES)
    )  # a linear grid or a side's
    return tuple(a for a in order if a in own)


def _nodes(
    solution: Solution,
    t: CompensationType,
    base: Base,
    side: str | None,
    sampling: Sampling,
    points: int | None,
    point: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Nodes by axis letter: by number, by step, or the fewest that share the stated interpolation error between the axes."""
    axes = _axes_of(solution.machine, side)
    count = sampling.max_points if sampling.max_error is None and sampling.max_points else points
    default = LINEAR_POINTS if side is None else ROTARY_POINTS
    if sampling.max_error is None:
        return dict(zip(axes, node_lines(solution, axes, sampling.step, count, default), strict=True))
    share = replace(sampling, max_error=sampling.max_error / len(axes), spacing="equal")
    nodes = {}
    for letter in axes:
        x = np.linspace(*solution.machine.axis(letter).travel, LINES)
        curves = [
            _line(solution, t, base, side, letter, x, at, point) for at in _crossings(solution.machine, axes, letter)
        ]
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


def _crossings(machine: Machine, axes: tuple[str, ...], moving: str) -> list[dict[str, float]]:
    """Where the other axes stand while one moves: all ends, and mid-travel."""
    others = [a for a in axes if a != moving]
    ends = np.stack(np.meshgrid(*([[0.0, 1.0]] * len(others)), indexing="ij"), axis=-1).reshape(-1, len(others))
    places = np.vstack([ends, np.full(len(others), 0.5)])
    return [
        {a: machine.axis(a).travel[0] + f * machine.axis(a).length for a, f in zip(others, row, strict=True)}
        for row in places
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
        _linear_place(machine, positions, base)
        if side is None
        else _rotary_place(machine, side, positions, np.asarray(point))
    )
    return field_values(solution, t, base, place)


def _linear(
    solution: Solution,
    t: CompensationType,
    base: Base,
    nodes: Mapping[str, np.ndarray],
    rule: Rule | None,
    uncertainty: bool,
) -> Grid:
    x, y, z = base.tool.tolist()
    if t.name in ("L-VOL", "L-VOL+") and uncertainty and base.turn is None:
        return replace(linear_grid(solution, tool=(x, y, z), nodes=nodes), type=t.name)
    lines = tuple(nodes.values())
    positions = grid_positions(lines)
    place = _linear_place(solution.machine, positions, base)
    found = _evaluate(solution, t, base, place, uncertainty) if rule is None else _from_rule(solution, rule, place)
    _require(solution, t, found)
    outside = _outside(solution, place)
    notes = _notes(solution, t, base, place, outside, rule)
    datum = describe_datum(solution)
    return Grid(
        t.name, place.axes, lines, positions, found.values, found.u, outside, (x, y, z), "machine", datum, notes
    )


def _rotary(
    solution: Solution,
    t: CompensationType,
    base: Base,
    side: str,
    nodes: Mapping[str, np.ndarray],
    point: np.ndarray,
    rule: Rule | None,
    uncertainty: bool,
) -> RotaryGrid:
    x, y, z = point.tolist()
    if t.name in ("R-VOL", "R-VOL+") and uncertainty and base.turn is None:
        whole = rotary_grids(solution, reference_point=(x, y, z), nodes=nodes)
        return replace(next(g for g in whole if g.side == side), type=t.name)
    lines, machine = tuple(nodes.values()), solution.machine
    positions = grid_positions(lines)
    place = _rotary_place(machine, side, positions, point)
    found = _evaluate(solution, t, base, place, uncertainty) if rule is None else _from_rule(solution, rule, place)
    _require(solution, t, found)
    outside = _outside(solution, place)
    return RotaryGrid(
        type=t.name,
        side=side,
        axes=place.axes,
        nodes=lines,
        positions=positions,
        values=found.values,
        u=found.u,
        determined=found.determined,
        outside=outside,
        reference_point=(x, y, z),
        period=tuple(360.0 if machine.axis(a).is_full_turn else 0.0 for a in place.axes),
        frame="machine",
        datum=describe_datum(solution),
        notes=_notes(solution, t, base, place, outside, rule),
    )


def _from_rule(solution: Solution, rule: Rule, place: _Place) -> _Found:
    """Error values from a user's rule; no uncertainty. Raises `InputError` when it returns something else."""
    name = getattr(rule, "__name__", "rule")
    try:
        values = np.asarray(rule(solution, place.full, np.asarray(place.tool)), dtype=float)
    except Exception as error:  # whatever a user's code does wrong is input to be mended
        raise InputError(f"--rule {name}: raised {type(error).__name__}: {error}") from error
    if values.shape != (len(place.full), 6) or not np.isfinite(values).all():
        raise InputError(
            f"--rule {name}: returned shape {values.shape}; expected finite error values ({len(place.full)}, 6): mm, "
            f"mm, mm, rad, rad, rad"
        )
    return _Found(values, np.full_like(values, np.nan), np.ones(values.shape, dtype=bool))


def _require(solution: Solution, t: CompensationType, found: _Found) -> None:
    needed = slice(3, 6) if t.name == "FOR" else slice(0, 3)
    lost = [f"d{c}" for c, k in zip("XYZABC"[needed], found.determined[:, needed].T, strict=True) if not k.all()]
    if lost:
        raise NotDeterminedError(
            f"grid: the data do not determine {', '.join(lost)} of {t.name}. {' '.join(solution.statements)} "
            "Measure what is missing, or take another type."
        )


def _outside(solution: Solution, place: _Place) -> np.ndarray:
    columns = [solution.machine.index(a) for a in place.axes]
    low, high = solution.measured_range()[columns].T
    slack = 0.01 * np.array([solution.machine.axis(a).length for a in place.axes])
    own = place.full[:, columns]
    return np.asarray(np.any((own < low - slack) | (own > high + slack), axis=1))


def _notes(
    solution: Solution, t: CompensationType, base: Base, place: _Place, outside: np.ndarray, rule: Rule | None
) -> tuple[str, ...]:
    notes = [*part_notes(solution, place.letters), f"{t.name} leaves: {t.leaves}"]
    if base.turn is not None:
        a, b, _ = 1e6 * (base.turn @ np.asarray(solution.parameters))
        notes.append(f"machine frame aligned to the spindle: turned by A {a:.3f} µrad, B {b:.3f} µrad from the datum")
    if t.based_on == "line" or t.name == "L-ANG":
        at = ", ".join(f"{a} = {v:g}" for a, v in zip(solution.machine.letters, base.at, strict=True))
        notes.append(f"specific lines through {at} with the tool vector above")
    if t.name in ("R-RAX", "R-ANG"):
        tool = ", ".join(f"{v:g}" for v in base.tool)
        notes.append(
            f"elevation {base.elevation:g} mm above each table axis's point; tip of the tool ({tool}) mm for a head"
        )
    if rule is not None:
        notes.append(
            f"values from the user's rule {getattr(rule, '__module__', '')}:{getattr(rule, '__name__', '')}; no uncertainty"
        )
    elif base.functions and t.name.endswith("SPEC"):
        notes.append(f"functions used: {', '.join(base.functions)}")
    if outside.any():
        notes.append(f"{int(outside.sum())} of {len(outside)} nodes lie outside the measured positions: extrapolated")
    if solution.adequacy.rejected:
        notes.append("MODEL REJECTED BY THE DATA: " + solution.adequacy.verdict)
    return tuple(notes)
