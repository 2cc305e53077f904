"""Linear axes that follow the rotary ones, so that the nominal functional point stays where it should; limits of travel.

The nominal functional point is linear in the positions of the linear axes, p(q) = p(rotary, 0) + Σ q_i d_i(rotary). The equations
therefore have one solution, and it is exact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.backend.even_points import round_position
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.model.kinematics import nominal_point, transform
from volid.model.machine import Axis, Machine

_PARALLEL = 1e-6  # determinant of the three directions


class Followed(NamedTuple):
    """Positions within the travels (k, n_axes), the rows (k,) of those asked for, and what was left out, in words."""

    positions: np.ndarray
    rows: np.ndarray
    warnings: tuple[str, ...]


def rotary_axes(machine: Machine) -> tuple[Axis, ...]:
    """The rotary axes, workpiece to tool. Raises `InputError` when there is none."""
    axes = tuple(axis for axis in machine.axes if not axis.is_linear)
    if not axes:
        raise InputError(f"machine '{machine.name}' has no rotary axis; expected one or two")
    return axes


def one_turn(axis: Axis) -> tuple[float, float]:
    """Travel of a rotary axis, or one full turn of it that holds 0 when it travels more."""
    low, high = axis.travel
    if axis.length <= 360.0:
        return low, high
    start = min(max(low, -180.0), high - 360.0)
    return start, start + 360.0


def with_rotary(machine: Machine, **angles: np.ndarray | float) -> np.ndarray:
    """Positions (m, n_axes) with rotary axes at `angles` [degrees], rounded to 1e-6, everything else at 0."""
    columns = np.broadcast_arrays(*(np.atleast_1d(round_position(np.asarray(a, dtype=float))) for a in angles.values()))
    positions = np.zeros((len(columns[0]), len(machine.axes)))
    for letter, column in zip(angles, columns, strict=True):
        positions[:, machine.index(letter)] = column
    return positions


def follow(machine: Machine, positions: np.ndarray, tool: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Positions with X, Y, Z moved so that the nominal functional point is `point`, workpiece frame.

    `positions`: (m, n_axes), their rotary part is kept. `tool`, `point`: (3,) or (m, 3) [mm]. Raises `InputError` without
    three linear axes, or where two of them are parallel.
    """
    missing = [a for a in LINEAR_AXES if a not in machine.letters]
    if missing:
        raise InputError(
            f"machine '{machine.name}' has no axis {missing[0]}; X, Y and Z have to follow the rotary axes"
        )
    columns = [machine.index(a) for a in LINEAR_AXES]
    q = np.array(positions, dtype=float)
    q[:, columns] = 0.0
    steps = np.stack([_direction(machine, q, i, np.eye(3)[k]) for k, i in enumerate(columns)], axis=-1)
    singular = np.abs(np.linalg.det(steps)) < _PARALLEL
    if singular.any():
        where = ", ".join(
            f"{a.letter} = {x:g}" for a, x in zip(machine.axes, q[np.argmax(singular)], strict=True) if not a.is_linear
        )
        raise InputError(
            f"machine '{machine.name}': at {where} two linear axes are parallel; the point cannot be followed"
        )
    start = nominal_point(machine, q, np.broadcast_to(np.asarray(tool, dtype=float), (len(q), 3)))
    q[:, columns] = np.linalg.solve(steps, (np.asarray(point, dtype=float) - start)[..., None])[..., 0]
    return q


def _direction(machine: Machine, q: np.ndarray, i: int, along: np.ndarray) -> np.ndarray:
    """How the functional point moves in the workpiece frame per mm of linear axis number `i`, (m, 3)."""
    unit = (np.full(len(q), along[0]), np.full(len(q), along[1]), np.full(len(q), along[2]))
    return np.stack(transform(machine, q.T, None, unit, start=i, is_vector=True), axis=1)


def within_travel(machine: Machine, positions: np.ndarray, what: str) -> Followed:
    """The positions inside all travels, and a warning naming the axes that leave them. Raises `InputError` when none is left."""
    low, high = np.array([a.travel for a in machine.axes]).T
    slack = 1e-9 * (high - low)
    outside = (positions < low - slack) | (positions > high + slack)
    rows = np.flatnonzero(~outside.any(axis=1))
    found = ", ".join(
        f"{a.letter} would need {positions[:, i].min():g} … {positions[:, i].max():g} {a.unit}, travel {a.travel[0]:g} … "
        f"{a.travel[1]:g}"
        for i, a in enumerate(machine.axes)
        if outside[:, i].any()
    )
    if not len(rows):
        raise InputError(f"{what}: no position lies within the travels: {found}; choose another place or tool vector")
    removed = len(positions) - len(rows)
    return Followed(
        round_position(positions[rows]),
        rows,
        (f"{what}: {removed} of {len(positions)} positions left out: {found}",) if removed else (),
    )
