"""Which error functions share one smoothness, and what it says of their coefficients.

A process stands for one group of the model: a function of one axis; a coupled pair of a rotary axis; a function of two axes; a
reversal; short waves. Its parameters φ are logarithms, each with a wide prior: the size s (median 5 µm or 5 µrad) and the
length l (median 0.3 ranges); for a function of two axes also how much it changes over the second axis, relative to s, and the
length there. Functions of one machine are alike: a part of these priors is shared (`prior_covariance`), so that what the
readings say of the functions they see well tells something of those that they hardly see.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from volid.fitting.results import PARAMETERS
from volid.fitting.smoothness.covariance import (
    correlation,
    free_functions,
    pseudo_readings,
    unit_precision,
    unit_rows,
    values_at_greville,
)
from volid.model.error_model import LOCATION, MEAN, WAVES, ErrorModel
from volid.model.iso230 import LINEAR_AXES, parse
from volid.model.splines import Spline

SIZE = {False: 5e-3, True: 5e-6}  # mm, rad: median size of a translation, of a rotation
SMALL_SIZE = {False: 1e-3, True: 1e-6}  # the same of reversal and short waves
SIZE_SPREAD = 1.5  # standard deviation of log size: a factor of 4.5 either way is ordinary
LENGTH, LENGTH_SPREAD = 0.3, 0.6  # ranges; of log length
ALIKE_SIZE = 0.9  # standard deviation of log size that all translations, or all rotations, of a machine share
ALIKE_LENGTH, ALIKE_ON_AXIS = (
    0.4,
    0.37,
)  # the same of log length: of all linear, or all rotary axes; of the functions of one axis
CHANGE, CHANGE_SPREAD = 0.5, 1.0  # of a function of two axes: its change over the second axis, relative to its size

DERIVATIVE_STEP = 1e-4  # of log lengths and log changes, central differences


@dataclass(frozen=True, eq=False)
class Process:
    """A group of error functions with one smoothness.

    `names`, `part`: as in the model. `parameters`: columns of θ. `members`: splines and block of P of every function.
    """

    names: tuple[str, ...]
    part: str
    parameters: slice
    members: tuple[tuple[tuple[Spline, ...], np.ndarray], ...]

    @property
    def unit(self) -> float:
        """Median size [mm or rad]."""
        rotation = parse(self.names[0]).is_rotation
        return (SIZE if self.part == MEAN else SMALL_SIZE)[rotation]

    @property
    def label(self) -> str:
        """The functions' names."""
        return "+".join(self.names) + ("" if self.part == MEAN else f" {self.part}")

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """What φ stands for."""
        return PARAMETERS[: len(self.median)]

    @cached_property
    def median(self) -> np.ndarray:
        """Median of φ: log size [mm or rad], log length; with a second axis log change, log length there."""
        across = len(self.members[0][0]) > 1
        return np.log([self.unit, LENGTH, *([CHANGE, LENGTH] if across else [])])

    @cached_property
    def spread(self) -> np.ndarray:
        """Standard deviations of the prior of φ."""
        across = len(self.members[0][0]) > 1
        return np.array([SIZE_SPREAD, LENGTH_SPREAD, *([CHANGE_SPREAD, LENGTH_SPREAD] if across else [])])

    def rows(self, phi: np.ndarray) -> np.ndarray:
        """Pseudo-readings with unit variance on the process's own θ, shape (r, size)."""
        return np.vstack([rows_of(splines, phi) @ free for splines, free in self.members]) / np.exp(phi[0])

    def precision(self, phi: np.ndarray) -> np.ndarray:
        """Prior precision Q = WᵀW of the process's own θ."""
        rows = self.rows(phi)
        return np.asarray(rows.T @ rows)

    def precision_with_slopes(self, phi: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Q and ∂Q/∂φ_i; ∂Q/∂(log size) = -2 Q. For a function of one axis from a table, else by central differences."""
        if len(phi) == 2:
            return self._tabulated(phi)
        q = self.precision(phi)
        slopes = [-2.0 * q]
        for i in range(1, len(phi)):
            step = np.zeros(len(phi))
            step[i] = DERIVATIVE_STEP
            slopes.append((self.precision(phi + step) - self.precision(phi - step)) / (2.0 * DERIVATIVE_STEP))
        return q, slopes

    def _tabulated(self, phi: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        found = [unit_precision(splines[0], float(phi[1])) for splines, _ in self.members]
        weight = np.exp(-2.0 * phi[0])
        q, slope = (
            weight * sum(free.T @ f[i] @ free for f, (_, free) in zip(found, self.members, strict=True)) for i in (0, 1)
        )
        return q, [-2.0 * q, slope]


def stacked_rows(processes: Sequence[Process], phi: Sequence[np.ndarray], n: int) -> np.ndarray:
    """Pseudo-readings of all processes, each at its own φ, as rows on θ (n,)."""
    blocks = [np.zeros((0, n))]
    for process, own in zip(processes, phi, strict=True):
        rows = process.rows(own)
        block = np.zeros((len(rows), n))
        block[:, process.parameters] = rows
        blocks.append(block)
    return np.vstack(blocks)


def prior_covariance(processes: Sequence[Process]) -> np.ndarray:
    """Covariance of φ before any reading: functions of one machine are alike, in size by kind, in length the more so on one
    axis.
    """
    owner = [(p, i) for p in processes for i in range(len(p.median))]
    found = np.diag(np.concatenate([p.spread**2 for p in processes]))
    for a, (p, i) in enumerate(owner):
        for b, (q, j) in enumerate(owner):
            if a != b and i == j and i < 2 and p.part == q.part == MEAN:
                found[a, b] = _shared_size(p, q) if i == 0 else _shared_length(p, q)
    return found


def _shared_size(p: Process, q: Process) -> float:
    return ALIKE_SIZE**2 if parse(p.names[0]).is_rotation == parse(q.names[0]).is_rotation else 0.0


def _shared_length(p: Process, q: Process) -> float:
    one, other = parse(p.names[0]).axis, parse(q.names[0]).axis
    alike = ALIKE_LENGTH**2 if (one in LINEAR_AXES) == (other in LINEAR_AXES) else 0.0
    return alike + (ALIKE_ON_AXIS**2 if one == other else 0.0)


def rows_of(splines: tuple[Spline, ...], phi: np.ndarray) -> np.ndarray:
    """Pseudo-readings on the coefficients of one function of size 1.

    With a second axis the covariance at the grid of Greville points is (K + X Xᵀ) ⊗ (1 1ᵀ + c² K₂), lines X varying over the
    second axis as much as the rest; free is what is a line in the first axis and constant over the second.
    """
    own = splines[0]
    if len(splines) == 1:
        return unit_rows(own, float(np.exp(phi[1])))
    k, x, b = correlation(own, float(np.exp(phi[1]))), free_functions(own), values_at_greville(own)
    other = splines[1]
    change = float(np.exp(2.0 * phi[2])) * correlation(other, float(np.exp(phi[3])))
    ones = np.ones((other.size, 1))
    covariance = np.kron(k + x @ x.T, change + ones @ ones.T)
    return pseudo_readings(covariance, np.kron(x, ones), np.kron(b, values_at_greville(other)))


def processes_of(model: ErrorModel, smooth: frozenset[str] | None = None) -> tuple[Process, ...]:
    """Processes of the functions named in `smooth` (default: all that are functions of position)."""
    found = []
    for names, part, parameters in model.groups:
        functions = [model.by_name[name, part] for name in names]
        stated = smooth is not None and part != WAVES and not set(names) <= smooth
        if part == LOCATION or not functions[0].splines or stated:
            continue
        members = tuple((f.splines, model.parametrisation[f.coefficients, f.parameters]) for f in functions)
        found.append(Process(names, part, parameters, members))
    return tuple(found)
