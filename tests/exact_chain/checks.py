"""What the tests of the exact chain share."""

import itertools

import numpy as np

from exact_chain import (
    LINEAR,
    ExactMachine,
)

TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0), "C": (0.0, 360.0), "A": (-120.0, 30.0)}
ARRANGEMENTS = [
    " ".join(["w", *[a + "'" for a in order[:split]], "b", *order[split:], "t"])
    for order in itertools.permutations(LINEAR)
    for split in range(4)
]
MACHINE = ExactMachine("w Y' X' b Z t", TRAVEL)
ROUNDING = 1e-12  # mm at coordinates up to 1 m: a few units in the last place, through eight matrix products


def constant(value):
    """The function f(q) = value."""
    return lambda q: np.full(np.shape(q), value)


def skew(w):
    """Matrix [w x]."""
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def one_deviation(structure, positions, tool, truth, direction=None, **machine_options):
    """Deviation (6,) of a machine with the test's travels at one position."""
    machine = ExactMachine(structure, TRAVEL, **machine_options)
    return machine.deviation(machine.in_axis_order(positions), tool, truth, direction)[0]
