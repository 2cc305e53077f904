"""How readings answer the error values of the chain, the axis positions and the tool vector, one by one.

The unknowns of a fit are coefficients of functions; an alternative that a fit does not hold (a cross effect, a reversal, a pitch,
a tool of another length) acts through the same few numbers of every reading: the six errors of each axis at its position.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from volid.backend.reverse import Recorded, gradients
from volid.campaign import Campaign, End
from volid.effects.prediction import predict_readings
from volid.fitting.equations.problem import Problem
from volid.fitting.equations.system import Block, flat
from volid.model.error_model import ROWS
from volid.model.error_values import error_values, evaluate_bases
from volid.model.kinematics import error_first, turn
from volid.model.machine import Machine

AT_ONCE = 4096  # rows
FELT = 1e-4  # of a reading's largest sensitivity of the same sort; less is rounding, or a product with errors
ARM, TURNED = (
    1e-2,
    1e-9,
)  # mm: a shorter arm is none; 1/mm: a translation that a reading of rotations feels less is none


class Sensitivities(NamedTuple):
    """Partial derivatives of n numbers: `errors` (6 · (n_axes + 1), n) by error values, `tool` (3, n) by the tool vector.

    Of readings: over their u, in the order of sets, rows, columns; 0 where a reading takes no part. `positions`, `directions`
    (n, n_axes): where they are. Readings that see the machine at a second position stand here again, behind all others, with what
    they see there; `reading`: the number of the reading that every entry belongs to, None where each is one of its own.
    """

    errors: np.ndarray
    tool: np.ndarray
    positions: np.ndarray
    directions: np.ndarray
    reading: np.ndarray | None = None

    @property
    def numbers(self) -> np.ndarray:
        """Number of the reading of every entry."""
        return np.arange(self.errors.shape[1]) if self.reading is None else self.reading

    def of_each(self, values: np.ndarray) -> np.ndarray:
        """Values of every entry from those of every reading, along the last axis."""
        return values if self.reading is None else values[..., self.reading]

    def summed(self, columns: np.ndarray) -> np.ndarray:
        """Columns (entries, k) as columns of readings (n, k): what a reading sees at two positions adds up."""
        if self.reading is None:
            return columns
        n = int(self.reading.max(initial=-1)) + 1
        whole = columns[:n].copy()
        np.add.at(whole, self.reading[n:], columns[n:])
        return np.asarray(whole)


def of_readings(problem: Problem, campaign: Campaign, z: np.ndarray) -> Sensitivities:
    """Sensitivities of all readings of a campaign at z; `problem`: with the weights that they take part with."""
    shapes = [s.readings.shape for s in campaign.sets]
    width = ROWS * (len(problem.system.machine.axes) + 1)
    found = [[np.zeros((width + 3, *shape)) for _ in s.ends] for s, shape in zip(campaign.sets, shapes, strict=True)]
    for block, (number, rows) in zip(problem.system.blocks, problem.places, strict=True):
        for part, values in _partials(problem, block, len(rows), z):
            for own, end in zip(found[number], _by_end(values, width), strict=True):
                own[:, rows[part]] = end
    first = np.cumsum([0, *(m * k for m, k in shapes)])
    entries = [_Entries(found[i][0], s.ends[0], first[i]) for i, s in enumerate(campaign.sets)]
    again = [_Entries(found[i][1], s.ends[1], first[i]) for i, s in enumerate(campaign.sets) if s.to is not None]
    whole = np.concatenate([e.partials.reshape(width + 3, -1) for e in (*entries, *again)], axis=1)
    positions, ways = (
        np.concatenate([np.repeat(e.end[i], e.partials.shape[2], axis=0) for e in (*entries, *again)]) for i in range(2)
    )
    numbers = np.concatenate([e.first + np.arange(e.partials[0].size) for e in (*entries, *again)]) if again else None
    return Sensitivities(_felt(whole[:width]), whole[width:], positions, ways.astype(float), numbers)


def _felt(errors: np.ndarray) -> np.ndarray:
    """Sensitivities to errors (6 · (n_axes + 1), n) without those that no reading shows.

    What the readings do not feel but for rounding would otherwise explain any misfit, by an error of any size.
    """
    sorts = np.abs(errors).reshape(-1, 2, 3, errors.shape[1])  # axes; translations, rotations; X, Y, Z; entries
    shift, turned = sorts.max(axis=(0, 2))
    least = np.maximum(FELT * np.stack([shift, turned]), np.stack([TURNED * turned, ARM * shift]))
    return np.where((sorts >= least[None, :, None]).reshape(errors.shape), errors, 0.0)


class _Entries(NamedTuple):
    """What readings of a set see at one of their ends: `partials` (errors + 3, m, k), the end, number of the first reading."""

    partials: np.ndarray
    end: End
    first: int


def _by_end(values: np.ndarray, width: int) -> list[np.ndarray]:
    """Partial derivatives by error values and tool vectors of all ends, (…, rows, k), end by end: errors, then tool."""
    ends = len(values) // (width + 3)
    errors, tools = values[: ends * width], values[ends * width :]
    return [np.concatenate([errors[i * width : (i + 1) * width], tools[3 * i : 3 * i + 3]]) for i in range(ends)]


def _partials(problem: Problem, block: Block, m: int, z: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
    """Slices of the m rows of a block, and their partial derivatives times weight, (errors and tool of all ends, rows, k)."""
    system, n = problem.system, problem.system.layout.n_coefficients
    q, way, tool, slots, constants, weight = (
        flat(a)[:, :m] for a in (block.q, block.direction, block.tool, block.slots, block.constants, block.weight)
    )
    width = ROWS * (len(system.machine.axes) + 1) * (len(q) // system.layout.n_axes)
    for start in range(0, m, AT_ONCE):
        own = slice(start, min(start + AT_ONCE, m))
        count, notes = own.stop - own.start, list[Recorded]()
        errors = error_values(system.layout, z[:n], evaluate_bases(system.layout, q[:, own], way[:, own]))
        wide = np.zeros((width, count))
        wide[:] = errors if np.shape(errors)[1] else 0.0
        leaves = [Recorded(row, notes) for row in (*wide, *tool[:, own])]
        predicted = predict_readings(
            system.machine, block.form, q[:, own], tuple(leaves[width:]), leaves[:width], z[n + slots[:, own]],
            tuple(constants[:, own]),
        )  # fmt: skip
        values = np.stack([gradients(f, leaves, count, weight[k, own]) for k, f in enumerate(predicted)], axis=2)
        yield own, values


def of_displacement(machine: Machine, seen: Sensitivities) -> np.ndarray:
    """Sensitivities to a displacement of the target in the workpiece frame, (3, n) [1/mm].

    It is that of the first factor of the chain; where a table turns behind its errors, N · D, turned with it (CONVENTIONS 3).
    """
    first, rows = machine.axes[0], seen.errors[:3]
    if not first.is_linear and error_first(first):
        rows = np.asarray(np.einsum("nij,jn->in", turn(first, seen.positions[:, 0]), rows))
    return seen.summed(rows.T).T
