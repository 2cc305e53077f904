"""Small synthetic campaigns of several sets: of one axis, where all is linear, and of three with instruments of several kinds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from support.kinds import PLACES, THREE, TOOLS, exact_readings, machine_of, plan_set, positions_of
from volid.campaign import Campaign, End, ObservationSet, Station

ONE = """format = "volid-machine/1"
name = "one axis"
structure = "w X' b Y Z t"
[axis.X]
travel = [0.0, 500.0]
[axis.Y]
travel = [0.0, 400.0]
[axis.Z]
travel = [-300.0, 0.0]
[model]
degree = {degree}
[model.functions]
"E*[XYZS]" = false
"E*0*" = false
"""
CUBIC = ONE.format(degree=3) + "EXX = { segments = 1 }\n"
LINE = ONE.format(degree=1) + "EXX = { segments = 1 }\n"
SMOOTH = ONE.format(degree=3) + "EXX = true\n"
TWO = CUBIC + "EYX = { segments = 1 }\n"
TOOL = (0.0, 0.0, -150.0)
FINE = np.tile(np.linspace(0.0, 500.0, 11), 5)  # positions of X, five runs
COARSE = np.tile(np.linspace(0.0, 500.0, 6), 4)


def error(x: np.ndarray) -> np.ndarray:
    """EXX and EYX of the machine, a cubic function [mm]."""
    t = (x - 250.0) / 250.0
    return 5e-3 * t - 2e-3 * t**2 + 1e-3 * t**3


def line_set(name: str, x: np.ndarray, readings: np.ndarray, u: float, component: str = "X") -> ObservationSet:
    """Readings of one component along X, with the offset of their own line."""
    q = np.tile([0.0, 200.0, -100.0], (len(x), 1))
    q[:, 0] = x
    plan = plan_set(name, "component", q, TOOL, {"component": component}, u=u)
    return replace(plan, readings=readings[:, None], time=None, temperature=None)


def drawn(name: str, x: np.ndarray, rng: np.random.Generator, sizes: tuple[float, float], bend=None) -> ObservationSet:
    """A set with noise of the size `sizes[0]` [mm] whose stated u is `sizes[1]`; `bend` adds what only this set sees."""
    own = error(x) if bend is None else error(x) + bend(x)
    return line_set(name, x, own + 1e-3 + sizes[0] * rng.standard_normal(len(x)), sizes[1])


def campaign_of(text: str, *sets: ObservationSet) -> Campaign:
    """The campaign of these sets."""
    return Campaign(machine_of(text), (), sets)


def design(sets: tuple[ObservationSet, ...]) -> np.ndarray:
    """Columns of a cubic EXX that is 0 in the middle, and of the offset of every set: a separate linear model."""
    x = np.concatenate([s.positions[:, 0] for s in sets])
    number = np.repeat(np.arange(len(sets)), [len(s) for s in sets])
    t = (x - 250.0) / 250.0
    return np.column_stack([t, t**2, t**3, *(number == i for i in range(len(sets)))]).astype(float)


def instruments(seed: int, sizes: dict[str, Callable[[np.ndarray], np.ndarray]], m: int = 30) -> Campaign:
    """Instruments of five kinds on a machine of three axes.

    A network of lengths, a further set from one of its stations, a tracker, a level, a ball bar and an artefact of calibrated
    length. Readings are exact plus noise of the stated u times what `sizes` gives for a set from its u (m, k), or 1.
    """
    machine, rng = machine_of(THREE), np.random.default_rng(seed)
    labels = {"station": np.repeat(list(PLACES), m), "segment": np.tile(np.where(np.arange(m) < m // 2, "1", "2"), 4)}
    volume = plan_set("volume", "distance", positions_of(machine, 4 * m), TOOLS[np.arange(4 * m) % 3], labels)
    again = plan_set(
        "again", "distance", positions_of(machine, m, 7), TOOLS[0], {"station": "S2", "segment": "9"}, u=1e-3
    )
    tracker = plan_set(
        "tracker", "polar", positions_of(machine, 2 * m, 5), TOOLS[np.arange(2 * m) % 3], {"station": "T"}
    )
    level = np.tile([0.0, 200.0, -150.0], (22, 1))
    level[:, machine.index("X")] = np.tile(np.linspace(0.0, 600.0, 11), 2)
    level[:, machine.index("Y")], level[:, machine.index("Z")] = 200.0, -150.0
    roll = plan_set("level", "component", level, TOOLS[0], {"component": "A"}, u=1e-6)
    turn, middle = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False), np.array([300.0, 200.0, -150.0])
    circle = {"X": middle[0] + 150.0 * np.cos(turn), "Y": middle[1] + 150.0 * np.sin(turn), "Z": np.full(36, middle[2])}
    q = np.stack([circle[letter] for letter in machine.letters], axis=1)
    bar = plan_set("bar", "distance", q, TOOLS[0], {"station": "B"}, relative=False, calibrated_u=1e-3)
    start, end = positions_of(machine, 36, 21), positions_of(machine, 36, 22)
    piece = plan_set("piece", "length", start, TOOLS[0], {"artefact": "gauge"}, calibrated_u=1e-3)
    piece = replace(piece, to=End(end, np.zeros_like(end), piece.tool))
    places = {**PLACES, "T": (-700.0, -350.0, 400.0), "B": tuple((middle + TOOLS[0]).tolist())}
    stations = tuple(Station(name, position=place) for name, place in places.items())
    exact = exact_readings(Campaign(machine, stations, (volume, again, tracker, roll, bar, piece)))
    sets = []
    for s in exact.sets:
        factor = sizes.get(s.name, np.ones_like)(s.u)
        sets.append(replace(s, readings=s.readings + factor * s.u * rng.standard_normal(s.u.shape)))
    return replace(exact, sets=tuple(sets))
