"""A plan that determines the complete rigid model of a three-axis machine: six stations, three tool vectors, spread points."""

from __future__ import annotations

import numpy as np
from scipy.stats import qmc

from volid.campaign import Campaign, ObservationSet, Station
from volid.model.machine import Machine
from volid.model.requests import LARGEST, ask_plan, checked_count

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
CLEARANCE = 150.0  # mm, more than the tools reach to the side
STEPS = 40  # positions stand on so many equal steps of every travel
U = {"constant": 0.0003, "proportional": 3.0e-7}  # mm, mm/mm: a tracking interferometer


def standard_plan(machine: Machine, n_per_station: int = 400, seed: int = 0) -> Campaign:
    """Plan of distances from six stations on the workpiece, each seeing all three tool vectors one after the other.

    It determines the complete rigid model of a machine with three linear axes. The positions are a low-discrepancy sequence that
    includes the end planes and differs from station to station. Collisions and lines of sight are not considered.

    Args:
        machine: The machine to measure.
        n_per_station: Number of distances of every station.
        seed: Seed of the sequence, an integer from 0.

    Returns:
        A campaign with one `distance` set without readings; u as of a tracking interferometer, 0.3 µm + 0.3 µm/m.

    Raises:
        InputError: the number of distances or the seed is none, or so large that the plan needs more than two gigabytes.

    Example:
        >>> from volid.io import read_machine
        >>> plan = standard_plan(read_machine("models/wYXbZt_vertical.toml"), n_per_station=100)
        >>> plan.n_readings, len(plan.stations)
        (600, 6)
    """
    ask_rows(n_per_station, seed)
    sampler = qmc.Halton(len(machine.axes), seed=seed)
    unit = np.clip(sampler.random(n_per_station * len(STATIONS)) * 1.1 - 0.05, 0.0, 1.0)
    low = np.array([axis.travel[0] for axis in machine.axes])
    length = np.array([axis.length for axis in machine.axes])
    positions = low + np.round(unit * STEPS) / STEPS * length
    segment = np.arange(n_per_station) * len(TOOLS) // n_per_station
    names = [f"S{i + 1}" for i in range(len(STATIONS))]
    readings = ObservationSet(
        name="volume",
        kind="distance",
        positions=positions,
        directions=np.zeros_like(positions),
        tool=np.tile(np.array(TOOLS)[segment], (len(STATIONS), 1)),
        readings=np.full((len(positions), 1), np.nan),
        u=np.full((len(positions), 1), np.nan),
        labels={
            "station": np.repeat(names, n_per_station),
            "segment": np.tile((segment + 1).astype(str), len(STATIONS)),
        },
        options={"relative": True, "calibrated_u": 0.0, "u": U},
        source="standard plan",
    )
    stations = tuple(Station(n, position=_place(machine, f)) for n, f in zip(names, STATIONS, strict=True))
    return Campaign(machine, stations, (readings,), title="Standard plan", source="standard plan")


def ask_rows(n_per_station: int, seed: int) -> None:
    """Raises `InputError` for a number of distances, or a seed, that makes no plan, or one beyond memory."""
    checked_count("n_per_station", n_per_station, 1, LARGEST)
    checked_count("seed", seed, 0, LARGEST)
    ask_plan("standard plan", len(STATIONS) * n_per_station)


def _place(machine: Machine, fraction: tuple[float, float, float]) -> tuple[float, float, float]:
    """Position of a station beside the volume of the functional point, workpiece frame [mm]."""
    travel = {axis.letter: axis.travel for axis in machine.linear}
    place = []
    for letter, f, tool in zip("XYZ", fraction, np.mean(TOOLS, axis=0), strict=True):
        low, high = travel.get(letter, (0.0, 0.0))
        beside = CLEARANCE * (np.sign(f - 1.0) * (f > 1.0) - (f < 0.0))
        place.append(float(np.round(tool + low + f * (high - low) + beside)))
    return place[0], place[1], place[2]
