"""Ball-bar tests of the exact machine as volid's readings."""

from dataclasses import replace

import numpy as np
from exact_chain import ExactMachine, Truth
from exact_chain.ball_bar import BallBar, Drives, turn

from volid.standards.circular.readings import CircularReadings, circular_readings

TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}


def bar(truth: Truth, structure: str = "w b X Y Z t") -> BallBar:
    """A bar of 150 mm in the middle of X and Y, its socket where the program has it."""
    return BallBar(ExactMachine(structure, TRAVEL), truth, (0.0, 0.0, -150.0), (500.0, 300.0, -420.0))


def bar_test(
    virtual: BallBar,
    plane: str,
    arc: float = 360.0,
    *,
    step: float = 5.0,
    drives: Drives | None = None,
    noise: float = 0.0,
    senses: tuple[int, ...] = (1, -1),
    seed: int = 1,
) -> CircularReadings:
    """One run of each sense with noise; u is that of the noise, 10 nm without."""
    angles = [turn(plane, arc, sense, step) for sense in senses]
    read = [virtual.read(plane, angle, sense, drives) for angle, sense in zip(angles, senses, strict=True)]
    deviation = np.concatenate(read) - virtual.radius
    deviation += noise * np.random.default_rng(seed).standard_normal(len(deviation))
    test = circular_readings(plane, virtual.radius, np.concatenate(angles), deviation)
    u = np.full(len(test), noise or 1e-5)
    return replace(test, u=u, length_u=5e-4, feed=drives.feed if drives else None)
