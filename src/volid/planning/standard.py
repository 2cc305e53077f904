"""A plan that determines the complete rigid model of a three-axis machine: six stations, three tool vectors, spread points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import qmc

from volid.backend.even_points import round_position
from volid.campaign import Campaign, ObservationSet, Station, standard_uncertainty
from volid.model.kinematics import nominal_point
from volid.model.machine import Axis, Machine
from volid.model.requests import LARGEST, ask_plan, ask_tools, ask_uncertainty, checked_count

TOOLS = ((0.0, 0.0, -150.0), (80.0, 0.0, -250.0), (0.0, 90.0, -200.0))  # mm, not on one line
# In travels from the lower ends: around the volume, at many heights
STATIONS = (
    (-0.3, -0.2, -0.1),
    (1.25, -0.3, 0.55),
    (1.3, 1.2, 0.0),
    (-0.2, 1.3, 0.9),
    (0.45, -0.4, 1.1),
    (0.55, 1.35, 0.3),
)
CLEARANCE = 150.0  # mm beside the volume that the tool sweeps
_LEAST_GAP = 100.0  # mm: a station nearer to that volume is moved away
STEPS = 40  # positions stand on about so many steps of every travel
ROUND = 0.5  # mm or degrees: steps of multiples of this are round enough for an NC program
U = {"constant": 0.0003, "proportional": 3.0e-7}  # mm, mm/mm: a tracking interferometer


def standard_plan(
    machine: Machine,
    n_per_station: int = 400,
    seed: int = 0,
    tools: Sequence[Sequence[float]] = TOOLS,
    u: float | Mapping[str, float] = U,
) -> Campaign:
    """Plan of distances from six stations on the workpiece, each seeing all tool vectors one after the other.

    With three tool vectors that are not on one line it determines the complete rigid model of a machine with three linear axes.
    The positions are round numbers, a low-discrepancy sequence that includes the end planes and differs from station to
    station. Stations stand outside the box of all places of the functional point. Other collisions and lines of sight are not
    considered.

    Args:
        machine: The machine to measure.
        n_per_station: Number of distances of every station.
        seed: Seed of the sequence, an integer from 0.
        tools: Tool vectors, shape (k, 3) [mm].
        u: Standard uncertainty of a distance [mm], or its constant and proportional parts [mm, mm/mm].

    Returns:
        A campaign with one `distance` set without readings; u by default as of a tracking interferometer, 0.3 µm + 0.3 µm/m.
        Tool vectors that leave errors undetermined are named in `warnings`.

    Raises:
        InputError: the number of distances or the seed is none, or so large that the plan needs more than two gigabytes.

    Example:
        >>> from volid.io import read_machine
        >>> plan = standard_plan(read_machine("models/wYXbZt_vertical.toml"), n_per_station=100)
        >>> plan.n_readings, len(plan.stations)
        (600, 6)
    """
    ask_rows(n_per_station, seed)
    ask_tools(machine, tools)
    ask_uncertainty("u", float(u.get("constant", 0.0)) if isinstance(u, Mapping) else float(u))
    sampler = qmc.Halton(len(machine.axes), seed=seed)
    unit = np.clip(sampler.random(n_per_station * len(STATIONS)) * 1.1 - 0.05, 0.0, 1.0)
    lines = [levels(axis) for axis in machine.axes]
    positions = np.stack(
        [line[np.round(share * (len(line) - 1)).astype(int)] for line, share in zip(lines, unit.T, strict=True)], axis=1
    )
    vectors = np.array(tools, dtype=float).reshape(-1, 3)
    segment = np.arange(n_per_station) * len(vectors) // n_per_station
    names, stated = [f"S{i + 1}" for i in range(len(STATIONS))], dict(u) if isinstance(u, Mapping) else float(u)
    empty = np.full((len(positions), 1), np.nan)
    readings = ObservationSet(
        name="volume",
        kind="distance",
        positions=positions,
        directions=np.zeros_like(positions),
        tool=np.tile(vectors[segment], (len(STATIONS), 1)),
        readings=empty,
        u=standard_uncertainty(stated, empty),
        labels={
            "station": np.repeat(names, n_per_station),
            "segment": np.tile((segment + 1).astype(str), len(STATIONS)),
        },
        options={"relative": True, "calibrated_u": 0.0, "u": stated},
        source="standard plan",
    )
    places = places_beside(machine, readings, vectors, STATIONS)
    stations = tuple(Station(n, position=place) for n, place in zip(names, places, strict=True))
    return Campaign(
        machine, stations, (readings,), "Standard plan", warnings=_left_open(vectors), source="standard plan"
    )


def ask_rows(n_per_station: int, seed: int) -> None:
    """Raises `InputError` for a number of distances, or a seed, that makes no plan, or one beyond memory."""
    checked_count("n_per_station", n_per_station, 1, LARGEST)
    checked_count("seed", seed, 0, LARGEST)
    ask_plan("standard plan", len(STATIONS) * n_per_station)


def levels(axis: Axis) -> np.ndarray:
    """Round positions over a travel, some 40 steps, and its ends [mm or degrees].

    A travel whose 40th parts are no multiples of 0.5 is divided by 1, 2, 2.5 or 5 times a power of ten.
    """
    (low, high), step = axis.travel, axis.length / STEPS
    if all(abs(v / ROUND - round(v / ROUND)) < 1e-9 for v in (low, step)):
        return round_position(low + step * np.arange(STEPS + 1))
    decade = 10.0 ** np.floor(np.log10(step))
    step = decade * min((1.0, 2.0, 2.5, 5.0, 10.0), key=lambda s: abs(np.log(s * decade / step)))
    inner = step * np.arange(np.ceil(low / step), np.floor(high / step) + 1)
    inner = inner[(inner > low + 0.5 * step) & (inner < high - 0.5 * step)]
    return np.concatenate([[low], round_position(inner), [high]])


def _left_open(tools: np.ndarray) -> tuple[str, ...]:
    """Which errors the tool vectors cannot show."""
    spread = np.linalg.matrix_rank(tools - tools[0], tol=1.0)  # mm
    if spread >= 2:
        return ()
    found = "one tool vector does" if spread == 0 else "tool vectors on one line do"
    return (f"{found} not determine all rotations: take three that are not on one line, some 50 mm apart or more",)


def places_beside(
    machine: Machine, readings: ObservationSet, tools: np.ndarray, fractions: Sequence[tuple[float, float, float]]
) -> list[tuple[float, float, float]]:
    """Positions of stations outside the box that the functional point sweeps, workpiece frame [mm].

    `fractions`: where they are wanted, in travels from the lower ends.
    """
    swept = nominal_point(machine, readings.positions, readings.tool)
    low, high = swept.min(axis=0), swept.max(axis=0)
    places = []
    for fraction in fractions:
        place = _beside_travels(machine, fraction, tools)
        gaps = np.maximum(low - place, place - high)
        if gaps.max() < _LEAST_GAP:
            i = int(np.argmax(np.abs(np.array(fraction) - 0.5)))  # the direction in which it stands outside
            place[i] = high[i] + CLEARANCE if fraction[i] > 0.5 else low[i] - CLEARANCE
        x, y, z = np.round(place).tolist()
        places.append((x, y, z))
    return places


def _beside_travels(machine: Machine, fraction: tuple[float, float, float], tools: np.ndarray) -> np.ndarray:
    """Position of a station beside the travels [mm]."""
    travel = {axis.letter: axis.travel for axis in machine.linear}
    place = np.zeros(3)
    for i, (letter, f, tool) in enumerate(zip("XYZ", fraction, tools.mean(axis=0), strict=True)):
        low, high = travel.get(letter, (0.0, 0.0))
        beside = CLEARANCE * (np.sign(f - 1.0) * (f > 1.0) - (f < 0.0))
        place[i] = tool + low + f * (high - low) + beside
    return place
