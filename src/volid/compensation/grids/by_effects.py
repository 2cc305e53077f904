"""Spatial grids of any compensation type: what its effects do at every node, with uncertainty (ISO/TR 16907 Tables 2 and 3).

L-VOL and R-VOL are grids of the whole model (`grids`, `rotary_grids`); all other types restrict it to their effects. A FOR grid
holds the orientation error alone, zero translations: the control turns rotary axes by it and moves nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from volid.compensation.alignment import alignment_notes
from volid.compensation.base import Base
from volid.compensation.grids.fields import CHUNK, Place, field_gradient, field_values, linear_place, rotary_place
from volid.compensation.grids.interpolation import period_of
from volid.compensation.grids.linear import Grid, describe_datum, grid_positions, linear_grid
from volid.compensation.grids.parts import HEAD, TABLE, part_notes, rotary_letters
from volid.compensation.grids.rotary import RotaryGrid, reference_of_side, rotary_grids
from volid.compensation.grids.sampling import grid_nodes
from volid.compensation.tables.sampling import Sampling
from volid.compensation.types import GRID, TYPES, CompensationType
from volid.exceptions import InputError, NotDeterminedError
from volid.fitting.prediction.spread import linear_uncertainty
from volid.fitting.solution import Solution

Rule = Callable[..., Any]


class _Found(NamedTuple):
    values: np.ndarray
    u: np.ndarray
    determined: np.ndarray


def _evaluate(
    solution: Solution, t: CompensationType, base: Base, place: Place, uncertainty: bool, zero: Place | None = None
) -> _Found:
    """Values of the type, u and whether they are determined; translations less those at `zero`."""
    if not uncertainty:
        values = field_values(solution, t, base, place)
        if zero is not None:
            values[:, :3] -= field_values(solution, t, base, zero)[:, :3]
        return _Found(values, np.full_like(values, np.nan), np.ones(values.shape, dtype=bool))
    covariance = solution.parameter_covariance
    theta = np.asarray(solution.parameters)
    found: list[tuple[np.ndarray, ...]] = []
    origin = 0.0 if zero is None else field_gradient(solution, t, base, zero, slice(0, 1))[:, :3]
    for start in range(0, len(place.full), CHUNK):
        rows = slice(start, start + CHUNK)
        gradient = field_gradient(solution, t, base, place, rows)
        gradient[:, :3] -= origin
        lost = solution.is_not_determined(gradient.reshape(-1, len(theta))).reshape(gradient.shape[:2])
        found.append((gradient @ theta, linear_uncertainty(gradient, covariance), ~lost))
    value, u, known = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return _Found(np.where(known, value, np.nan), np.where(known, u, np.nan), known)


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
    ranges: Mapping[str, tuple[float, float]] | None = None,
    zero: Mapping[str, float] | None = None,
) -> tuple[Grid | RotaryGrid, ...]:
    """Grids of one type: of the linear axes, then of the rotary axes of table and head, those that the type needs.

    `sampling`: step, at most so many points per axis, or a bound on the interpolation; else `points` per axis (default 21,
    rotary axes 37). `rule`: of L-SPEC and R-SPEC, called as rule(solution, positions (m, n_axes), tool (m, 3)), returns error
    values (m, 6) [mm, rad]. `uncertainty`: False leaves out u, and the test whether the data determine the values, which take
    most of the time. `ranges`: lowest and highest node by axis letter, default the travel [mm or °]. `zero`: where the
    translations of a linear grid are 0 for its tool vector, by axis letter [mm], other axes at the lines' crossing; rotations
    stay, because their effect on other tools does not vanish. Raises `InputError` for a type without grids or a `zero` that is
    no place of linear axes, `NotDeterminedError` when the data do not determine its translations.
    """
    if GRID not in t.forms:
        raise InputError(f"--type {t.name} has no grid; it is a table of the axis itself: volid tables --type {t.name}")
    machine, sampling = solution.machine, Sampling() if sampling is None else sampling
    grids: list[Grid | RotaryGrid] = []
    if t.is_linear or t.turns:
        own = t if t.is_linear else _FOR
        grids.append(
            _linear(
                solution,
                own,
                base,
                grid_nodes(solution, own, base, None, sampling, points, ranges=ranges),
                rule,
                uncertainty,
                None if own is _FOR or t.name == "FOR" else zero,
            )
        )
    if t.is_rotary or t.turns:
        own = t if t.is_rotary else _FOR
        for side in (s for s in (TABLE, HEAD) if rotary_letters(machine, s)):
            point = reference_of_side(machine, side, reference_point)
            nodes = grid_nodes(solution, own, base, side, sampling, points, point, ranges)
            grids.append(_rotary(solution, own, base, side, nodes, point, rule, uncertainty))
    return tuple(grids)


_FOR = TYPES["FOR"]


def _linear(
    solution: Solution,
    t: CompensationType,
    base: Base,
    nodes: Mapping[str, np.ndarray],
    rule: Rule | None,
    uncertainty: bool,
    zero: Mapping[str, float] | None,
) -> Grid:
    x, y, z = base.tool.tolist()
    if t.name in ("L-VOL", "L-VOL+") and uncertainty and base.turn is None and not zero:
        return replace(linear_grid(solution, tool=(x, y, z), nodes=nodes), type=t.name)
    lines = tuple(nodes.values())
    positions = grid_positions(lines)
    place = linear_place(solution.machine, positions, base)
    origin = _zero_place(solution, base, zero, place.axes) if zero else None
    if rule is None:
        found = _evaluate(solution, t, base, place, uncertainty, origin)
    else:
        found = _from_rule(solution, rule, place, origin)
    _require(solution, t, found)
    outside = solution.outside(place.full, place.axes)
    notes = _notes(solution, t, base, place, outside, rule)
    if origin is not None:
        at = ", ".join(f"{a} = {origin.full[0, solution.machine.index(a)]:g}" for a in place.axes)
        notes += (f"dX, dY, dZ are zero at {at} mm with the tool vector above; rotations are not shifted",)
    datum = describe_datum(solution)
    return Grid(
        t.name, place.axes, lines, positions, found.values, found.u, outside, (x, y, z), "machine", datum, notes
    )


def _zero_place(solution: Solution, base: Base, zero: Mapping[str, float], axes: Sequence[str]) -> Place:
    """Where translations are zero. Raises `InputError` for another axis than a linear one, or a place beyond its travel."""
    machine = solution.machine
    for letter, value in zero.items():
        low, high = machine.axis(letter).travel
        if letter not in axes or not low <= value <= high:
            raise InputError(
                f"--zero {letter}={value:g}; expected positions of {', '.join(axes)} within their travels: a constant taken out "
                "of a rotary grid would displace its axis"
            )
    at = [zero.get(a, base.at[machine.index(a)]) for a in axes]
    return linear_place(machine, np.array([at]), base)


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
    place = rotary_place(machine, side, positions, point)
    found = _evaluate(solution, t, base, place, uncertainty) if rule is None else _from_rule(solution, rule, place)
    _require(solution, t, found)
    outside = solution.outside(place.full, place.axes)
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
        period=tuple(period_of(machine.axis(a), n) for a, n in zip(place.axes, lines, strict=True)),
        frame="machine",
        datum=describe_datum(solution),
        notes=_notes(solution, t, base, place, outside, rule),
    )


def _from_rule(solution: Solution, rule: Rule, place: Place, zero: Place | None = None) -> _Found:
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
    if zero is not None:
        values = values - np.pad(_from_rule(solution, rule, zero).values[:, :3], ((0, 0), (0, 3)))
    return _Found(values, np.full_like(values, np.nan), np.ones(values.shape, dtype=bool))


def _require(solution: Solution, t: CompensationType, found: _Found) -> None:
    needed = slice(3, 6) if t.name == "FOR" else slice(0, 3)
    lost = [f"d{c}" for c, k in zip("XYZABC"[needed], found.determined[:, needed].T, strict=True) if not k.all()]
    if lost:
        raise NotDeterminedError(
            f"grid: the data do not determine {', '.join(lost)} of {t.name}. {' '.join(solution.statements)} "
            "Measure what is missing, or take another type."
        )


def _notes(
    solution: Solution, t: CompensationType, base: Base, place: Place, outside: np.ndarray, rule: Rule | None
) -> tuple[str, ...]:
    notes = [*part_notes(solution, place.letters), f"{t.name} leaves: {t.leaves}"]
    notes += alignment_notes(solution, base, place.letters)
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
