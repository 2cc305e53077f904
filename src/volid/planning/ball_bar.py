"""Cone-frustum path for a ball bar: all five axes move at once, and the bar is perpendicular to the tool axis.

The tool axis describes a cone whose axis is inclined to the table. The ball in the spindle runs on a circle about the cone axis,
and the other ball stands on the cone axis. The path follows the cone-frustum workpiece of NAS 979 and ISO 10791-7.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign, ObservationSet, Station
from volid.exceptions import InputError
from volid.model.machine import Machine
from volid.model.requests import (
    LARGEST,
    ask_bar,
    ask_place,
    ask_plan,
    ask_tools,
    ask_uncertainty,
    checked_count,
    checked_number,
)
from volid.planning.following import follow, one_turn, rotary_axes, with_rotary, within_travel
from volid.planning.places import reachable

_GUESSES = 37  # angles of either axis tried for the first position
_STEPS = 30  # of Gauss-Newton, at most
_REACHED = 1e-9  # rad


def cone_frustum(
    machine: Machine,
    centre: Sequence[float] | None = None,
    tool: Sequence[float] = (0.0, 0.0, -150.0),
    *,
    length: float = 100.0,
    half_angle: float = 15.0,
    inclination: float = 10.0,
    n: int = 73,
    u: float = 0.0005,
    calibrated_u: float = 0.0005,
) -> Campaign:
    """Plan of a ball-bar test on a cone frustum: one turn with all five axes moving and the bar perpendicular to the tool axis.

    The ball in the spindle runs on a circle of radius length·cos(half_angle); the ball on the workpiece stands
    length·sin(half_angle) above the centre of the circle, on the axis of the cone. Positions outside a travel are left out and
    named in `warnings`. Collisions are not considered.

    Args:
        machine: A machine with X, Y, Z and two rotary axes.
        centre: Centre of the circle, (x, y, z) in the workpiece frame with all axes at 0 [mm]; None: one within the travels.
        tool: Vector to the ball in the spindle, (x, y, z) [mm].
        length: Length of the bar between the centres of its balls [mm].
        half_angle: Half angle of the cone [degrees].
        inclination: Inclination of the axis of the cone, about Y [degrees].
        n: Number of readings, both ends of the turn included.
        u: Standard uncertainty of a reading [mm].
        calibrated_u: Standard uncertainty of the calibrated length [mm].

    Returns:
        A campaign with one `distance` set without readings, and the station "ball".

    Raises:
        InputError: the machine has not two rotary axes, or cannot turn the tool that far, or no position lies within the travels.

    References:
        NAS 979, cone-frustum workpiece; ISO 10791-7.

    Example:
        >>> from volid.io import read_machine
        >>> plan = cone_frustum(read_machine("models/wCAYXbZt_trunnion.toml"), tool=(0, 0, -120), n=37)
        >>> plan.n_readings, plan.stations[0].name
        (37, 'ball')
    """
    return _plan(machine, _Test(centre, tool, length, half_angle, inclination, n, u, calibrated_u))


class _Test(NamedTuple):
    """A test on a cone frustum; the fields are the arguments of `cone_frustum`."""

    centre: Sequence[float] | None
    tool: Sequence[float]
    length: float
    half_angle: float
    inclination: float
    n: int
    u: float
    calibrated_u: float


def _plan(machine: Machine, test: _Test) -> Campaign:
    if len(rotary_axes(machine)) != 2:
        raise InputError(f"machine '{machine.name}' needs two rotary axes for a cone frustum")
    from scipy.spatial.transform import Rotation  # slow to import, and few need it

    _ask(machine, test)
    alpha, turn = np.deg2rad(test.half_angle), 2.0 * np.pi * np.arange(test.n) / max(test.n - 1, 1)
    tilt = Rotation.from_euler("y", test.inclination, degrees=True)
    radial = tilt.apply(np.stack([np.cos(turn), np.sin(turn), np.zeros(test.n)], axis=1))
    axis = tilt.apply([0.0, 0.0, 1.0])
    angles = _angles(machine, np.cos(alpha) * axis + np.sin(alpha) * radial)
    positions = with_rotary(machine, **dict(zip((a.letter for a in rotary_axes(machine)), angles.T, strict=True)))
    circle = test.length * np.cos(alpha) * radial
    centre = reachable(machine, positions, test.tool, circle) if test.centre is None else test.centre
    middle = np.asarray(centre, dtype=float)
    reached = follow(machine, positions, np.asarray(test.tool), middle + circle)
    kept = within_travel(machine, reached, "cone frustum")
    x, y, z = (float(c) for c in middle + test.length * np.sin(alpha) * axis)
    ball = Station("ball", position=(x, y, z))
    sets = (_readings(test, kept.positions),)
    return Campaign(machine, (ball,), sets, "Cone frustum", warnings=kept.warnings, source="cone frustum plan")


def _ask(machine: Machine, test: _Test) -> None:
    """Raises `InputError` for what is none, or looks like another unit than mm."""
    ask_tools(machine, test.tool)
    if test.centre is not None:
        ask_place(machine, "centre", test.centre)
    ask_bar(machine, test.length)
    ask_uncertainty("u", test.u)
    checked_number("calibrated_u", test.calibrated_u, least=0.0)
    if test.calibrated_u:
        ask_uncertainty("calibrated_u", test.calibrated_u)
    checked_number("half_angle", test.half_angle)
    checked_number("inclination", test.inclination)
    checked_count("n", test.n, 2, LARGEST)
    ask_plan("cone frustum", test.n)


def _readings(test: _Test, positions: np.ndarray) -> ObservationSet:
    """The set of distances to be read at positions (m, n_axes)."""
    m = len(positions)
    return ObservationSet(
        name="cone frustum",
        kind="distance",
        positions=positions,
        directions=np.zeros_like(positions),
        tool=np.tile(np.asarray(test.tool, dtype=float), (m, 1)),
        readings=np.full((m, 1), np.nan),
        u=np.full((m, 1), test.u),
        labels={"station": np.full(m, "ball"), "segment": np.full(m, "1")},
        options={"relative": False, "calibrated_u": test.calibrated_u, "u": test.u},
        source="cone frustum plan",
    )


def _tool_axis(machine: Machine, angles: np.ndarray) -> np.ndarray:
    """Nominal direction of the tool's z axis in the workpiece frame at rotary positions (m, 2) [degrees], shape (m, 3)."""
    from scipy.spatial.transform import Rotation  # slow to import, and few need it

    axes = rotary_axes(machine)
    direction = np.tile([0.0, 0.0, 1.0], (len(angles), 1))
    for axis, angle in list(zip(axes, angles.T, strict=True))[::-1]:
        turn = Rotation.from_rotvec(np.deg2rad(angle)[:, None] * np.asarray(axis.unit_vector))
        direction = turn.apply(direction)
    return direction


def _angles(machine: Machine, wanted: np.ndarray) -> np.ndarray:
    """Rotary positions (m, 2) that give the tool axes `wanted` (m, 3), each starting from the one before."""
    axes = rotary_axes(machine)
    lines = [np.linspace(*one_turn(axis), _GUESSES) for axis in axes]
    tried = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    angle = tried[np.argmax(_tool_axis(machine, tried) @ wanted[0])]
    found = np.empty((len(wanted), 2))
    for i, direction in enumerate(wanted):
        angle = found[i] = _solve(machine, angle, direction)
    off = np.linalg.norm(_tool_axis(machine, found) - wanted, axis=1)
    if off.max() > _REACHED:
        raise InputError(
            f"machine '{machine.name}' cannot turn its tool axis along the cone, {np.rad2deg(off.max()):.3g}° are missing; "
            "choose another half angle or inclination"
        )
    for k, axis in enumerate(axes):  # whole turns back into the travel
        low, high = one_turn(axis)
        found[:, k] -= 360.0 * np.round((found[:, k] - 0.5 * (low + high)) / 360.0)
    return found


def _solve(machine: Machine, start: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Gauss-Newton from `start`; the derivative of the tool axis by differences of 1e-4 degrees, steps up to 20°."""
    angle = start
    for _ in range(_STEPS):
        trial = _tool_axis(machine, np.stack([angle, *(angle + 1e-4 * np.eye(2)), *(angle - 1e-4 * np.eye(2))]))
        miss = wanted - trial[0]
        if np.linalg.norm(miss) < 1e-3 * _REACHED:
            break
        slope = (trial[1:3] - trial[3:5]).T / 2e-4
        step = np.linalg.lstsq(slope, miss, rcond=1e-9)[0]
        angle = angle + step * min(1.0, 20.0 / max(np.abs(step).max(), 1e-300))
    return np.asarray(angle)
