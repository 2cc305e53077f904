"""A ball plate measured in four places: flat at two heights, and upright along two axes.

The plate's points are named like the fields of a chess board, "A1" … A plan can also hold any other artefact in any placements
(`plate_plan`): a hole plate, a beam, a probed bar.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from volid.backend.even_points import round_position
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.kinematics import nominal_point
from volid.model.machine import Machine
from volid.model.requests import LARGEST, ask_plan, ask_tools, ask_uncertainty, checked_count, checked_number
from volid.planning.following import follow, within_travel

USED = 0.8  # of the travels: balls and the probe need some room
HEIGHTS = 0.6  # of the travel of Z: how far the two flat places are apart
ROUND = 5.0  # mm: the distance of neighbouring balls is a multiple of it where it is chosen here
SHIFTS = (
    -0.375,
    -0.125,
    0.125,
    0.375,
)  # of the distance of balls, of the four places: positions between those of the others
PLACES = {
    "flat low": np.eye(3)[[0, 1]],
    "flat high": np.eye(3)[[0, 1]],
    "upright X": np.eye(3)[[0, 2]],
    "upright Y": np.eye(3)[[1, 2]],
}  # where x and y of the plate point


class Placing(NamedTuple):
    """Where an artefact is placed: its name, the middle of its points in the workpiece frame (3,) [mm], rotary axes at 0.

    `x`, `y`: where its x and y point, directions (3,) at right angles.
    """

    name: str
    middle: Sequence[float]
    x: Sequence[float]
    y: Sequence[float]


def ball_plate(
    machine: Machine,
    tools: Sequence[Sequence[float]] = ((0.0, 0.0, -150.0),),
    points: tuple[int, int] = (5, 5),
    *,
    length: float | None = None,
    u: float = 0.0005,
    calibrated_u: float = 0.0003,
    scale_u: float = 5e-7,
) -> Campaign:
    """Plan of a ball plate in four places: flat at two heights, upright along X and along Y. Collisions are not considered.

    Args:
        machine: A machine with X, Y and Z; rotary axes stand at 0.
        tools: Tool vectors to the probe's tip, shape (k, 3) [mm]; every ball is probed with each.
        points: Numbers of balls along both sides of the plate.
        length: Length of the longer side, from ball to ball [mm]; None: 0.8 of the smallest travel, less what tools differ by.
        u: Standard uncertainty of a coordinate of a centre as probed [mm].
        calibrated_u: Standard uncertainty of a calibrated coordinate, each by itself [mm].
        scale_u: That of the plate's scale, a ratio: all coordinates longer or shorter in proportion; inf where it is unknown.

    Returns:
        A campaign with one `artefact` set without readings.

    Raises:
        InputError: an axis is missing, a number is none, or the plate is larger than the travels.

    References:
        Trapet, Wäldele, Measurement 9 (1991) 17 (ball plates); ISO/TR 16907:2015, 7.

    Example:
        >>> from volid.io import read_machine
        >>> plan = ball_plate(read_machine("models/wYXbZt_vertical.toml"))
        >>> len(plan.sets[0]), sorted(set(plan.sets[0].labels["placement"].tolist()))
        (100, ['flat high', 'flat low', 'upright X', 'upright Y'])
    """
    _ask(machine, tools, points, u, calibrated_u)
    if not np.isposinf(scale_u):
        checked_number("scale_u", scale_u, least=0.0)
    low, high = np.array([machine.axis(a).travel for a in "XYZ"]).T
    spread = np.ptp(np.asarray(tools, dtype=float).reshape(-1, 3), axis=0)
    pitch = _pitch(high - low, spread, max(points), length)
    middle = _middle(machine, 0.5 * (low + high), tools)
    slack = 0.5 * (np.min(high - low - spread) - (max(points) - 1) * pitch)
    aside = min(pitch, slack / SHIFTS[-1]) * np.array(SHIFTS)[:, None] * np.ones(3)
    heights = np.array([-1.0, 1.0, 0.0, 0.0]) * 0.5 * (HEIGHTS * (high[2] - low[2]) - spread[2])
    middles = np.round(middle + aside + heights[:, None] * np.array([0.0, 0.0, 1.0]), 1)
    places = [Placing(n, at.tolist(), *way.tolist()) for (n, way), at in zip(PLACES.items(), middles, strict=True)]
    plate = {
        f"{_letters(j)}{i + 1}": [pitch * i, pitch * j, 0.0, *[calibrated_u] * 3]
        for j in range(points[1])
        for i in range(points[0])
    }
    return plate_plan(machine, plate, places, tools, u=u, scale_u=scale_u)


def plate_plan(
    machine: Machine,
    points: Mapping[str, Sequence[float]],
    places: Sequence[Placing],
    tools: Sequence[Sequence[float]],
    *,
    u: float,
    scale_u: float = 0.0,
    **options: Any,
) -> Campaign:
    """Plan of an artefact with these calibrated points in these places, rotary axes at 0.

    Args:
        machine: A machine with X, Y and Z.
        points: Calibrated points by name: x, y, z, or with one u, or with u_x, u_y, u_z [mm].
        places: Where it is placed.
        tools: Tool vectors, shape (k, 3) [mm]; every point is probed with each.
        u: Standard uncertainty of a coordinate as probed [mm].
        scale_u: Standard uncertainty of the artefact's scale, a ratio.
        options: Further options of an `artefact` set, such as `components`.

    Returns:
        A campaign with one `artefact` set without readings. Points outside a travel are left out and named in `warnings`.

    Raises:
        InputError: no point of a placement lies within the travels, or directions are not at right angles.

    Example:
        >>> from volid.io import read_machine
        >>> beam = {f"B{i}": [100.0 * i, 0.0, 0.0, 0.0003] for i in range(5)}
        >>> across = Placing("across", (500.0, 300.0, -350.0), (0.8, 0.6, 0.0), (-0.6, 0.8, 0.0))
        >>> plan = plate_plan(read_machine("models/wYXbZt_vertical.toml"), beam, [across], [(0, 0, -150)], u=0.0005)
        >>> len(plan.sets[0])
        5
    """
    xyz = np.array([row[:3] for row in points.values()], dtype=float)
    xyz, names = xyz - xyz.mean(axis=0), np.array(list(points))
    parts: list[Any] = []
    warnings: list[str] = []
    for place in places:
        at = np.asarray(place.middle, dtype=float) + xyz @ _turned(place).T
        for tool in np.asarray(tools, dtype=float).reshape(-1, 3):
            q = follow(machine, np.zeros((len(at), len(machine.axes))), tool, at)
            kept = within_travel(machine, q, f"placement '{place.name}'")
            warnings += kept.warnings
            parts.append(
                (kept.positions, np.tile(tool, (len(kept.rows), 1)), names[kept.rows], [place.name] * len(kept.rows))
            )
    q, tool, point, placement = (np.concatenate(column) for column in zip(*parts, strict=True))
    m = len(q)
    labels = {"artefact": np.full(m, "plate"), "point": point, "placement": placement, "run": np.full(m, "1")}
    rows = {name: [float(c) for c in row] for name, row in points.items()}
    own = {"points": {"plate": rows}, "scale_u": scale_u, "components": "XYZ", "body": "workpiece", "u": u} | options
    readings = ObservationSet(
        name="plate",
        kind="artefact",
        positions=round_position(q),
        directions=np.zeros_like(q),
        tool=tool,
        readings=np.full((m, 3), np.nan),
        u=np.full((m, 3), u),
        labels=labels,
        options=own,
        source="plate plan",
    )
    return Campaign(machine, (), (readings,), "Ball plate", warnings=tuple(warnings), source="plate plan")


def _ask(machine: Machine, tools: Any, points: tuple[int, int], u: float, calibrated_u: float) -> None:
    missing = [a for a in "XYZ" if a not in machine.letters]
    if missing:
        raise InputError(f"machine '{machine.name}' has no axis {missing[0]}; a ball plate needs X, Y and Z")
    ask_tools(machine, tools)
    for n in points:
        checked_count("points", n, 2, LARGEST)
    ask_uncertainty("u", u)
    if calibrated_u != 0.0:
        ask_uncertainty("calibrated_u", calibrated_u)
    ask_plan("ball plate", 4 * points[0] * points[1] * len(tools))


def _pitch(travels: np.ndarray, spread: np.ndarray, n: int, length: float | None) -> float:
    """Distance of neighbouring balls [mm]. Raises `InputError` for a plate that does not fit."""
    room = float(np.min(USED * travels - spread))
    if length is None:
        whole = np.floor(room / (n - 1) / ROUND) * ROUND
        length = (n - 1) * float(whole if whole > 0.0 else room / (n - 1))
    largest = float(np.min(travels - spread))
    if not 0.0 < length <= largest:
        raise InputError(
            f"`length` is {length:g} mm; expected more than 0 and at most {largest:g} mm, what travels and tools leave"
        )
    return length / (n - 1)


def _middle(machine: Machine, linear: np.ndarray, tools: Any) -> np.ndarray:
    """Functional point of the mean tool vector in the middle of the travels, rotary axes at 0, (3,) [mm]."""
    q = np.zeros((1, len(machine.axes)))
    q[0, [machine.index(a) for a in "XYZ"]] = linear
    tools = np.asarray(tools, dtype=float).reshape(-1, 3)
    between = 0.5 * (tools.min(axis=0) + tools.max(axis=0))
    return np.asarray(nominal_point(machine, q, between[None, :])[0])


def _turned(place: Placing) -> np.ndarray:
    """The rotation whose columns are the placement's directions. Raises `InputError` for directions that are none."""
    x, y = np.asarray(place.x, dtype=float), np.asarray(place.y, dtype=float)
    turn = np.stack([x, y, np.cross(x, y)], axis=1)
    if not np.allclose(turn.T @ turn, np.eye(3), atol=1e-6):
        raise InputError(
            f"placement '{place.name}': x {place.x} and y {place.y} are not at right angles and of length 1; expected directions"
        )
    return turn


def _letters(j: int) -> str:
    """A … Z, AA, AB …"""
    head = _letters(j // 26 - 1) if j >= 26 else ""
    return head + chr(ord("A") + j % 26)
