"""A virtual tracking interferometer: where it stands, what the machine drives to, what it reads."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from exact_chain.machine import ExactMachine
from exact_chain.motions import LINEAR
from exact_chain.truth import Truth


@dataclass
class TrackerCampaign:
    """Distances of a virtual tracking interferometer, one row per reading, with everything that is true about them."""

    axes: tuple[str, ...]
    q: np.ndarray  # (m, axes), machine axis order [mm, degrees]
    tool: np.ndarray  # (m, 3) [mm]
    station: np.ndarray  # (m,) names
    segment: np.ndarray  # (m,) int, counted per station from 1
    distance: np.ndarray  # (m,) reading [mm]
    u: np.ndarray  # (m,) standard uncertainty of the reading, outliers not included [mm]
    direction: np.ndarray | None  # (m, axes) +1, -1; None when the machine has no reversal
    station_positions: dict[str, np.ndarray]  # true, workpiece frame [mm]
    dead_paths: dict[tuple[str, int], float]  # true, per (station, segment) [mm]
    outlier: np.ndarray  # (m,) bool
    u_constant: float
    u_proportional: float


def default_tools() -> np.ndarray:
    """Three tool vectors not on one line, two off the spindle axis. [mm]."""
    return np.array([[0.0, 0.0, -150.0], [80.0, 0.0, -250.0], [0.0, 90.0, -200.0]])


def default_stations(machine: ExactMachine) -> dict[str, np.ndarray]:
    """Six stations around and outside the volume of the nominal functional point, at many heights."""
    fraction = np.array(
        [
            [-0.3, -0.2, -0.1],
            [1.25, -0.3, 0.55],
            [1.3, 1.2, 0.0],
            [-0.2, 1.3, 0.9],
            [0.45, -0.4, 1.1],
            [0.55, 1.35, 0.3],
        ]
    )
    low, high = (np.array([machine.travel.get(a, (0.0, 0.0))[i] for a in LINEAR]) for i in (0, 1))
    clearance = 150.0 * (np.sign(fraction - 1) * (fraction > 1) - 1.0 * (fraction < 0))
    positions = default_tools().mean(axis=0) + low + fraction * (high - low) + clearance
    return {f"S{i + 1}": p for i, p in enumerate(positions)}


def spread_positions(machine: ExactMachine, n: int, rng: np.random.Generator, n_grid=None) -> np.ndarray:
    """n positions (n, axes), shuffled: a quarter corners (at most all), a quarter on faces, the rest inside.

    Inside, a Kronecker lattice: frac(shift + i / g^j), g the root of g^(d+1) = g + 1.
    `n_grid`: snap to so many positions per axis, ends included; an int or one per axis.
    """
    d = len(machine.axes)
    g = max(root.real for root in np.roots([1.0, *[0.0] * (d - 1), -1.0, -1.0]) if abs(root.imag) < 1e-12)
    x = (rng.random(d) + np.outer(np.arange(n), g ** -np.arange(1.0, d + 1))) % 1.0
    corners = np.array(list(itertools.product([0.0, 1.0], repeat=d)))
    n_corner = min(len(corners), n // 4)
    x[:n_corner] = rng.permutation(corners)[:n_corner]
    face = np.arange(n_corner, n_corner + n // 4)
    x[face, rng.integers(d, size=len(face))] = rng.integers(2, size=len(face))
    if n_grid is not None:
        intervals = np.broadcast_to(n_grid, d) - 1
        x = np.round(x * intervals) / intervals
    low, high = (np.array([machine.travel[a][i] for a in machine.axes]) for i in (0, 1))
    return rng.permutation(low + x * (high - low))


def approach_directions(q: np.ndarray) -> np.ndarray:
    """Direction (m, axes) of each axis's last move, the program `q` run again and again; +1 if it never moves."""
    direction = np.sign(q - np.roll(q, 1, axis=0))
    for _ in range(2):  # second round: the first rows take the direction left over from the previous run
        for i in range(len(q)):
            direction[i] = np.where(direction[i] == 0, direction[i - 1], direction[i])
    return np.where(direction == 0, 1, direction).astype(int)


def tracker_campaign(
    machine: ExactMachine,
    truth: Truth,
    rng: np.random.Generator,
    stations=None,
    tools=None,
    n_per_station: int = 100,
    u_constant: float = 0.0003,
    u_proportional: float = 3e-7,
    every_station_sees_every_tool: bool = False,
    segments: int = 1,
    outlier_fraction: float = 0.0,
    outlier_range: tuple[float, float] = (0.010, 0.500),
    n_grid=None,
) -> TrackerCampaign:
    """Virtual campaign: distance = |functional point - station| + dead path(station, segment) + noise.

    u^2 = u_constant^2 + (u_proportional |functional point - station|)^2. Each station uses one tool in turn, or all of
    them one after another; `segments` beams per station and tool. Outliers: +- log-uniform in `outlier_range`. [mm].
    Approach directions are those of the program, and recorded when the truth has reversal.
    """
    stations = default_stations(machine) if stations is None else stations
    if not isinstance(stations, Mapping):
        stations = {f"S{i + 1}": p for i, p in enumerate(stations)}
    stations = {name: np.asarray(p, float) for name, p in stations.items()}
    tools = default_tools() if tools is None else np.atleast_2d(np.asarray(tools, float))
    rows = {key: [] for key in ("q", "tool", "station", "segment", "direction")}
    for i, name in enumerate(stations):
        q = spread_positions(machine, n_per_station, rng, n_grid)
        used = tools if every_station_sees_every_tool else tools[[i % len(tools)]]
        block = np.arange(n_per_station) * len(used) * segments // n_per_station  # consecutive rows per beam
        rows["q"].append(q)
        rows["tool"].append(used[block // segments])
        rows["station"].append(np.full(n_per_station, name))
        rows["segment"].append(block + 1)
        rows["direction"].append(approach_directions(q))
    q, tool, station, segment, direction = (np.concatenate(rows[key]) for key in rows)
    if not truth.reversal:
        direction = None
    beams = dict.fromkeys(zip(station.tolist(), segment.tolist(), strict=True))
    dead_paths = {beam: float(rng.uniform(-300, 300)) for beam in beams}
    ray = machine.functional_point(q, tool, truth, direction) - np.array([stations[name] for name in station])
    length = np.linalg.norm(ray, axis=1)
    u = np.hypot(u_constant, u_proportional * length)
    dead = np.array([dead_paths[beam] for beam in zip(station.tolist(), segment.tolist(), strict=True)])
    distance = length + dead + u * rng.standard_normal(len(length))
    outlier = np.zeros(len(length), bool)
    outlier[rng.choice(len(length), round(outlier_fraction * len(length)), replace=False)] = True
    gross = np.exp(rng.uniform(*np.log(outlier_range), len(length))) * rng.choice([-1.0, 1.0], len(length))
    distance += np.where(outlier, gross, 0.0)
    return TrackerCampaign(
        machine.axes, q, tool, station, segment, distance, u, direction, stations, dead_paths, outlier,
        u_constant, u_proportional,
    )  # fmt: skip
