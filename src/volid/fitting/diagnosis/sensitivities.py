"""How readings answer the error values of the chain, the axis positions and the tool vector, one by one.

The unknowns of a fit are coefficients of functions; an alternative that a fit does not hold (a cross effect, a reversal, a pitch,
a tool of another length) acts through the same few numbers of every reading: the six errors of each axis at its position.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from volid.backend.reverse import Recorded, gradients
from volid.campaign import Campaign
from volid.effects.prediction import predict_readings
from volid.fitting.equations.problem import Problem
from volid.fitting.equations.system import Block, flat
from volid.model.error_model import ROWS
from volid.model.error_values import error_values, evaluate_bases
from volid.model.kinematics import error_first, turn
from volid.model.machine import Machine

AT_ONCE = 4096  # rows


class Sensitivities(NamedTuple):
    """Partial derivatives of n numbers: `errors` (6 · (n_axes + 1), n) by error values, `tool` (3, n) by the tool vector.

    Of readings: over their u, in the order of sets, rows, columns; 0 where a reading takes no part. `positions`, `directions`
    (n, n_axes): where they are.
    """

    errors: np.ndarray
    tool: np.ndarray
    positions: np.ndarray
    directions: np.ndarray


def of_readings(problem: Problem, campaign: Campaign, z: np.ndarray) -> Sensitivities:
    """Sensitivities of all readings of a campaign at z; `problem`: with the weights that they take part with."""
    shapes = [s.readings.shape for s in campaign.sets]
    width = ROWS * (len(problem.system.machine.axes) + 1)
    found = [np.zeros((width + 3, *shape)) for shape in shapes]
    for block, (number, rows) in zip(problem.system.blocks, problem.places, strict=True):
        for part, values in _partials(problem, block, len(rows), z):
            found[number][:, rows[part]] = values
    whole = np.concatenate([f.reshape(width + 3, -1) for f in found], axis=1)
    k = [shape[1] for shape in shapes]
    positions = np.concatenate([np.repeat(s.positions, n, axis=0) for s, n in zip(campaign.sets, k, strict=True)])
    ways = np.concatenate([np.repeat(s.directions, n, axis=0) for s, n in zip(campaign.sets, k, strict=True)])
    return Sensitivities(whole[:width], whole[width:], positions, ways.astype(float))


def _partials(problem: Problem, block: Block, m: int, z: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
    """Slices of the m rows of a block, and their partial derivatives times weight, (errors + 3, rows, k)."""
    system, n = problem.system, problem.system.layout.n_coefficients
    q, way, tool, slots, constants, weight = (
        flat(a)[:, :m] for a in (block.q, block.direction, block.tool, block.slots, block.constants, block.weight)
    )
    for start in range(0, m, AT_ONCE):
        own = slice(start, min(start + AT_ONCE, m))
        count, notes = own.stop - own.start, list[Recorded]()
        errors = error_values(system.layout, z[:n], evaluate_bases(system.layout, q[:, own], way[:, own]))
        wide = np.zeros((ROWS * (len(system.machine.axes) + 1), count))
        wide[:] = errors if np.shape(errors)[1] else 0.0
        leaves = [Recorded(row, notes) for row in (*wide, *tool[:, own])]
        predicted = predict_readings(
            system.machine, block.form, q[:, own], tuple(leaves[len(wide) :]), leaves[: len(wide)], z[n + slots[:, own]],
            tuple(constants[:, own]),
        )  # fmt: skip
        values = np.stack([gradients(f, leaves, count, weight[k, own]) for k, f in enumerate(predicted)], axis=2)
        yield own, values


def of_displacement(machine: Machine, seen: Sensitivities) -> np.ndarray:
    """Sensitivities to a displacement of the target in the workpiece frame, (3, n) [1/mm].

    It is that of the first factor of the chain; where a table turns behind its errors, N · D, turned with it (CONVENTIONS 3).
    """
    first, rows = machine.axes[0], seen.errors[:3]
    if first.is_linear or not error_first(first):
        return rows
    return np.asarray(np.einsum("nij,jn->in", turn(first, seen.positions[:, 0]), rows))
