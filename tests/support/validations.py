"""A second campaign on the exact chain: other stations and tools, and machines that something has happened to since."""

from __future__ import annotations

import copy

import numpy as np
from exact_chain import ExactMachine, Truth, default_stations

PAIRS = ((0, 1), (2, 3), (1, 2))  # of the other stations, between which one stands
OTHER_TOOLS = np.array([[0.0, 0.0, -190.0], [60.0, -50.0, -170.0]])


def other_stations(exact: ExactMachine) -> dict[str, np.ndarray]:
    """Three stations, none near those of `default_stations`."""
    places = list(default_stations(exact).values())
    middle = np.mean(places, axis=0)
    return {f"V{i + 1}": middle + 1.15 * (0.5 * (places[a] + places[b]) - middle) for i, (a, b) in enumerate(PAIRS)}


def changed(exact: ExactMachine, truth: Truth, fault: str, size: float) -> Truth:
    """The machine after something has happened to it.

    "squareness": of Y to X by `size` [rad]. "scale": of X [mm/mm]. "cross effect": EYX over Y, one wave of amplitude `size` [mm]
    along X that grows from nothing in mid-travel of Y. "sign": EXX negated. "bump": in EYY, Gaussian, `size` [mm] high, a tenth
    of the travel wide (standard deviation), in its middle.
    """
    found = copy.deepcopy(truth)
    if fault == "squareness":
        found.constants["EC0Y"] = found.constants.get("EC0Y", 0.0) + size
    elif fault == "scale":
        found.functions["EXX"] = _sum(found.functions["EXX"], lambda q: size * np.asarray(q))
    elif fault == "cross effect":
        (low, high), (near, far) = exact.travel["X"], exact.travel["Y"]
        wave = lambda q, y: size * np.sin(2 * np.pi * (q - low) / (high - low)) * (2 * (y - near) / (far - near) - 1)  # noqa: E731
        found.cross["EYX"] = ("Y", wave)
    elif fault == "sign":
        found.functions["EXX"] = found.functions["EXX"].times(-size)
    else:
        low, high = exact.travel["Y"]
        middle, width = 0.5 * (low + high), 0.1 * (high - low)
        bump = lambda q: size * np.exp(-0.5 * ((np.asarray(q) - middle) / width) ** 2)  # noqa: E731
        found.functions["EYY"] = _sum(found.functions["EYY"], bump)
    return found


def _sum(first, second):
    return lambda q: first(q) + second(q)
