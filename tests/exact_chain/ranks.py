"""How many combinations of quartic error functions readings determine: a count apart from the package.

A machine of three linear axes has 18 functions of four coefficients each, those of t, t², t³, t⁴ with t from -1 to 1 over the
travel and 0 at the reference: 72 in all. Straightness keeps its slope, so that squareness is among them.
"""

from collections.abc import Callable

import numpy as np

from exact_chain.machine import ExactMachine
from exact_chain.motions import COMPONENTS, LINEAR
from exact_chain.truth import Truth

DEGREE = 4
STEP = {"E": 1e-4, "A": 1e-7}  # mm, rad: small enough for first order, large beside rounding
LEAST = 1e-7  # of the largest singular value: rounding lies below


class Power:
    """c t^k of the scaled position t."""

    def __init__(self, machine: ExactMachine, axis: str, power: int, coefficient: float):
        low, high = machine.travel[axis]
        self.centre, self.half, self.power, self.c = machine.reference[axis], 0.5 * (high - low), power, coefficient

    def __call__(self, q):
        return self.c * ((np.asarray(q, float) - self.centre) / self.half) ** self.power


def names_of(machine: ExactMachine) -> list[tuple[str, int]]:
    """Function and power of every coefficient, in the order of the columns."""
    axes = [a for a in machine.axes if a in LINEAR]
    return [(component + a, k) for a in axes for component in COMPONENTS for k in range(1, DEGREE + 1)]


def sensitivities(machine: ExactMachine, readings: Callable[[Truth], np.ndarray]) -> np.ndarray:
    """∂readings/∂coefficients by central differences, (m, 72): `readings` of a truth are an array of any shape.

    Columns of rotations are scaled by their lever, 1 m, so that all are of one size.
    """
    columns = []
    for name, power in names_of(machine):
        step = STEP["A" if name[1] in "ABC" else "E"]
        ends = [
            np.ravel(readings(Truth({name: Power(machine, name[2], power, s * step)}))).astype(float) for s in (1, -1)
        ]
        columns.append((ends[0] - ends[1]) / (2 * step) / (1000.0 if name[1] in "ABC" else 1.0))
    return np.stack(columns, axis=1)


def without(nuisance: np.ndarray, design: np.ndarray) -> np.ndarray:
    """The design with the part removed that the columns of the instrument's unknowns (m, k) can follow."""
    scaled = nuisance / np.maximum(np.linalg.norm(nuisance, axis=0), 1e-300)
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    kept = u[:, s > 1e-10 * s.max(initial=1e-300)]
    return design - kept @ (kept.T @ design)


def rank(design: np.ndarray) -> tuple[int, float]:
    """Rank, and the gap: the smallest singular value that counts over the largest that does not."""
    s = np.append(np.linalg.svd(design, compute_uv=False), 0.0)
    found = int(np.sum(s > LEAST * s[0]))
    return found, float(s[found - 1] / max(s[found], 1e-16 * s[0]))


def offsets(labels: np.ndarray) -> np.ndarray:
    """Columns of one unknown offset for every distinct label (m,): (m, k)."""
    labels = np.asarray(labels)
    return (labels[:, None] == np.unique(labels)[None, :]).astype(float)


def differences(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Columns ∂function/∂at by central differences, (m, k): unknowns of an instrument that do not enter linearly."""
    columns = []
    for i, step in enumerate(steps):
        move = np.zeros(len(at))
        move[i] = step
        columns.append(np.ravel(function(at + move) - function(at - move)) / (2 * step))
    return np.stack(columns, axis=1)
