"""Circles and arcs for a ball bar in the planes of the linear axes, each run in both senses (ISO 230-4).

In the plane normal to the tool the bar runs a full circle; in a plane that holds the tool's axis it runs the arc that the bar can
reach from above its socket. The ball in the socket is one station for all planes. Its place is unknown, and so may be the bar's
length.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign, ObservationSet, Station
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.model.kinematics import nominal_point
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
from volid.planning.following import Followed, follow, within_travel

PLANES = ("XY", "YZ", "ZX")
ARC = 220.0  # degrees: from a socket on the table up over it, and down on the other side
_ALONG = 0.9  # cosine between the tool and an axis that the plane holds
_STILL = 1e-6  # of the step: a move that is only rounding


def circles(
    machine: Machine,
    planes: Sequence[str] = PLANES,
    tool: Sequence[float] = (0.0, 0.0, -150.0),
    centre: Sequence[float] | None = None,
    *,
    length: float = 150.0,
    arc: float = ARC,
    n: int = 73,
    u: float = 0.0005,
    calibrated_u: float = 0.0005,
) -> Campaign:
    """Plan of a ball-bar test: the ball on the tool runs circles and arcs around the ball in the socket, in both senses.

    The approach directions of both axes are those of the run, so that reversal can be a part of the model
    (`EXX = { reversal = true }`). Positions outside a travel are left out and named in `warnings`. Collisions are not considered.

    Args:
        machine: A machine with the linear axes of the planes.
        planes: Planes by their two axes, such as "XY".
        tool: Vector to the ball on the tool, (x, y, z) [mm].
        centre: Place of the ball in the socket, (x, y, z) in the workpiece frame with all axes at 0 [mm]; None: the functional
            point in the middle of all travels.
        length: Length of the bar between the centres of its balls, the radius [mm].
        arc: Angle of the arc in planes that hold the axis of the tool [degrees]; 360: full circles there, too.
        n: Number of readings of every run, both ends included.
        u: Standard uncertainty of a reading [mm].
        calibrated_u: Standard uncertainty of the calibrated length [mm]; infinite where the length is unknown.

    Returns:
        A campaign with one `distance` set per plane, without readings, and the station "ball".

    Raises:
        InputError: a plane has no two linear axes of the machine, a number is none, or no position lies within the travels.

    References:
        ISO 230-4:2022, circular tests.

    Example:
        >>> from volid.io import read_machine
        >>> plan = circles(read_machine("models/wYXbZt_vertical.toml"), ("XY", "ZX"), n=37)
        >>> [(s.name, len(s)) for s in plan.sets]
        [('circle XY', 74), ('arc ZX', 74)]
    """
    test = _Test(np.array(tool, dtype=float), length, arc, n, u, calibrated_u)
    _ask(machine, test, planes, centre)
    middle = np.asarray(_middle(machine, test.tool) if centre is None else centre, dtype=float)
    found = [_run(machine, plane, middle, test) for plane in planes]
    x, y, z = middle.tolist()
    return Campaign(
        machine,
        (Station("ball", position=(x, y, z)),),
        tuple(s for s, _ in found),
        "Ball bar on circles",
        warnings=tuple(w for _, kept in found for w in kept.warnings),
        source="ball-bar plan",
    )


class _Test(NamedTuple):
    """What all planes share; the fields are the arguments of `circles`."""

    tool: np.ndarray
    length: float
    arc: float
    n: int
    u: float
    calibrated_u: float


def _ask(machine: Machine, test: _Test, planes: Sequence[str], centre: Sequence[float] | None) -> None:
    """Raises `InputError` for what is none, or looks like another unit than mm."""
    linear = [a for a in LINEAR_AXES if a in machine.letters]
    possible = ["".join(pair) for pair in combinations(linear, 2)]
    for plane in planes:
        if "".join(sorted(plane)) not in possible or len(set(planes)) < len(planes):
            given = ",".join(planes)
            raise InputError(
                f"`planes={given}`: expected different pairs of the linear axes of machine '{machine.name}': "
                f"{', '.join(possible) or 'it has not two'}"
            )
    ask_tools(machine, test.tool)
    if centre is not None:
        ask_place(machine, "centre", centre)
    ask_bar(machine, test.length)
    ask_uncertainty("u", test.u)
    if checked_arc(test.arc) and np.isfinite(test.calibrated_u) and test.calibrated_u != 0.0:
        ask_uncertainty("calibrated_u", test.calibrated_u)
    checked_count("n", test.n, 3, LARGEST)
    ask_plan("ball bar on circles", 2 * test.n * len(planes))


def checked_arc(arc: float) -> float:
    """An angle above 0 up to 360 degrees. Raises `InputError`."""
    if checked_number("arc", arc, above=0.0) > 360.0:
        raise InputError(f"`arc={arc:g}`: expected an angle up to 360 degrees")
    return arc


def _middle(machine: Machine, tool: np.ndarray) -> np.ndarray:
    """The nominal functional point with linear axes in the middle of their travels and rotary axes at 0, (3,) [mm]."""
    q = [[0.5 * sum(axis.travel) if axis.is_linear else 0.0 for axis in machine.axes]]
    return np.asarray(nominal_point(machine, np.array(q), tool[None, :])[0])


def _run(machine: Machine, plane: str, middle: np.ndarray, test: _Test) -> tuple[ObservationSet, Followed]:
    """Both senses of one plane as a set, and what was left out of it."""
    first, second = (np.eye(3)["XYZ".index(a)] for a in plane)
    up = -test.tool / max(float(np.linalg.norm(test.tool)), 1e-300)
    holds = max(abs(first @ up), abs(second @ up)) > _ALONG
    wide = np.deg2rad(test.arc if holds else 360.0)
    start = np.arctan2(second @ up, first @ up) if holds else 0.5 * wide
    turn = start + np.linspace(-0.5 * wide, 0.5 * wide, test.n)
    both = np.concatenate([turn, turn[::-1]])
    point = middle + test.length * (np.cos(both)[:, None] * first + np.sin(both)[:, None] * second)
    q = follow(machine, np.zeros((len(both), len(machine.axes))), test.tool, point)
    name = f"circle {plane}" if wide > 2.0 * np.pi - 1e-9 else f"arc {plane}"
    kept = within_travel(machine, q, name)
    ways = np.concatenate([approach(q[: test.n]), approach(q[test.n :])])[kept.rows]
    sense = np.repeat(["1", "2"], test.n)[kept.rows]
    return _readings(name, kept.positions, ways, sense, test), kept


def approach(q: np.ndarray) -> np.ndarray:
    """Approach direction of every axis along a run, (m, n_axes): the sign of its last move; 0 for an axis that never moves.

    The run begins with an overrun: the first position is approached as the second one is.
    """
    moves = np.diff(q, axis=0, prepend=2.0 * q[:1] - q[1:2])
    ways = np.where(np.abs(moves) > _STILL * np.abs(moves).max(initial=1e-300), np.sign(moves), 0.0)
    for i in range(1, len(ways)):  # an axis at its turning point keeps the direction it came from
        ways[i] = np.where(ways[i] == 0.0, ways[i - 1], ways[i])
    return ways


def _readings(name: str, q: np.ndarray, ways: np.ndarray, sense: np.ndarray, test: _Test) -> ObservationSet:
    m, unknown = len(q), not np.isfinite(test.calibrated_u)
    return ObservationSet(
        name=name,
        kind="distance",
        positions=q,
        directions=ways,
        tool=np.tile(test.tool, (m, 1)),
        readings=np.full((m, 1), np.nan),
        u=np.full((m, 1), test.u),
        labels={"station": np.full(m, "ball"), "segment": np.full(m, "bar") if unknown else sense},
        options={"relative": unknown, "calibrated_u": 0.0 if unknown else test.calibrated_u, "u": test.u},
        source="ball-bar plan",
    )
