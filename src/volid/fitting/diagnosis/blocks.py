"""Hold-outs by block: what whole stations, levels, times, tool vectors and rotary positions say against all others.

Readings held out one by one tell nothing of a misfit that neighbours share, and the more there are the less. Here a whole block g
goes at a time, and the question is put to the outcome (`outcome`), in units of its u:

    Δ_g = O (1 - B_g)⁻¹ c_g,   B_g = (J L)_gᵀ(J L)_g,  c_g = (J L)_gᵀ v_g,

the change of the outcome when block g is left out. A sound model has E Δ_g² = O ((1 - B_g)⁻¹ - 1) Oᵀ; what is beyond that,
summed over the blocks, is the variance that a misfit common to each block brings to the outcome (delete-a-group jackknife; Shao
and Tu 1995, 2.3). It does not fall when there are more readings in a block.

A model may also be wrong in form and yet say the same whatever is left out. So each block is asked besides for the displacement
of the target that its readings show and the model does not, predicted from all others: d = M⁻¹b with the sensitivities to a
displacement, as in `alternatives.base`; the mean of d² beyond its variance is part of the outcome's variance too.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import chdtrc

from volid.campaign import SAME_TOOL
from volid.fitting.diagnosis.around import Around
from volid.model.machine import Machine

TIMES, LEVELS, CELLS = 6, 6, 4  # blocks in time, along an axis, and per axis of a pair
MOST = 24  # blocks of one sort
FEWEST = 6  # readings of a block
ENOUGH = 8  # readings of a block per unknown from which on a part of them tells its information
ALONE = 1e-7  # added to 1 - B, which is singular where a block alone carries something (its own station)
CARRIED = 100.0  # variances: where leaving a block out makes u so much larger, it tells nothing
WEAK = 0.02  # of the largest eigenvalue: directions of a displacement that a block hardly sees


class Blocks(NamedTuple):
    """A partition of readings: `sort` in words ("stations"), `number` of the block of every reading (n,), -1 for none."""

    sort: str
    number: np.ndarray


class Excess(NamedTuple):
    """What a partition shows beyond a sound model: `variance` added to the outcome, in units of u², and its `probability`."""

    sort: str
    variance: float
    probability: float


def partitions(around: Around, machine: Machine) -> Iterator[Blocks]:
    """Stations, times, tool vectors, levels of every axis, and rotary positions.

    Where there are more rotary positions than `MOST`, several of them, spread over all, make a block.
    """
    yield from _few("stations", around.standing, around.active)
    yield Blocks("times", _by_quantile(around.when, around.active, TIMES))
    rounded = np.round(around.tools, SAME_TOOL)
    yield from _few("tool vectors", np.unique(rounded, axis=0, return_inverse=True)[1].ravel(), around.active)
    for i, axis in enumerate(machine.axes):
        positions = around.positions[:, i]
        if np.ptp(positions[around.active]) > 1e-6 * axis.length:
            yield Blocks(f"positions of {axis.letter}", _by_quantile(positions, around.active, LEVELS))
    rotary = [i for i, axis in enumerate(machine.axes) if not axis.is_linear]
    if len(rotary) > 1:
        poses = np.unique(np.round(around.positions[:, rotary], 3), axis=0, return_inverse=True)[1].ravel()
        yield Blocks("rotary positions", np.where(around.active, poses % MOST, -1))


def cells(around: Around, machine: Machine) -> Iterator[Blocks]:
    """Cells of the volume, by axis and by pair of axes."""
    moved = [i for i, a in enumerate(machine.axes) if np.ptp(around.positions[around.active, i]) > 1e-6 * a.length]
    fine = {i: _by_quantile(around.positions[:, i], around.active, LEVELS) for i in moved}
    coarse = {i: _by_quantile(around.positions[:, i], around.active, CELLS) for i in moved}
    for i in moved:
        yield Blocks(f"places along {machine.letters[i]}", fine[i])
    for a, i in enumerate(moved):
        for j in moved[a + 1 :]:
            both = np.where((coarse[i] >= 0) & (coarse[j] >= 0), coarse[i] * CELLS + coarse[j], -1)
            yield Blocks(f"places in {machine.letters[i]} and {machine.letters[j]}", both)


def _few(sort: str, values: np.ndarray, active: np.ndarray) -> Iterator[Blocks]:
    """One block per value, where there are several but not too many."""
    found, number = np.unique(values, return_inverse=True)
    if 1 < len(found) <= MOST:
        yield Blocks(sort, np.where(active, number.ravel(), -1))


def _by_quantile(values: np.ndarray, active: np.ndarray, count: int) -> np.ndarray:
    """Number of the block of every reading: equal values stay together, blocks are of about one size; -1 where not active."""
    distinct, number, sizes = np.unique(np.round(values, 6), return_inverse=True, return_counts=True)
    if len(distinct) > count:
        middle = (np.cumsum(sizes) - 0.5 * sizes) / sizes.sum()
        number = np.minimum((middle * count).astype(int), count - 1)[number.ravel()]
    return np.where(active, number.ravel(), -1)


def influence(around: Around, blocks: Blocks, square: float) -> Excess:
    """What leaving out whole blocks does to the outcome beyond noise; `square`: by how much the noise's variance is larger."""
    outcome, width = around.outcome.rows, around.rows.shape[1]
    own = np.sum(outcome**2, axis=1)
    beyond, expected, spread, q = 0.0, 0.0, 0.0, max(len(outcome), 1)
    plain = outcome @ outcome.T
    for number in np.unique(blocks.number[blocks.number >= 0]):
        members = np.flatnonzero(blocks.number == number)
        if len(members) < FEWEST:
            continue
        rows = around.rows[members]
        some = rows[:: max(len(rows) // (ENOUGH * width), 1)]
        lower = _root((1.0 + ALONE) * np.eye(width) - len(rows) / len(some) * (some.T @ some))
        reach = solve_triangular(lower, outcome.T, lower=True)
        change = reach.T @ solve_triangular(lower, rows.T @ around.v[members], lower=True)
        variance = np.sum(reach**2, axis=0) - own
        told = variance < CARRIED * np.maximum(own, 1.0)
        beyond += float(np.sum(change[told] ** 2)) / q
        expected += square * float(np.sum(variance[told])) / q
        joint = (reach.T @ reach - plain)[np.ix_(told, told)]
        spread += 2.0 * square**2 * float(np.sum(joint**2)) / q**2
    return Excess(blocks.sort, max(beyond - expected, 0.0), _chance(beyond, expected, spread))


def _root(matrix: np.ndarray) -> np.ndarray:
    """Lower triangle with the matrix as its square; what rounding makes negative counts as `ALONE`."""
    try:
        return np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(matrix)
        return np.asarray(np.linalg.qr((vectors * np.sqrt(np.maximum(values, ALONE))).T, mode="r")).T


def _chance(value: float, mean: float, variance: float) -> float:
    """Probability of so large a sum of squares, by a scaled chi-square of the same mean and variance (Satterthwaite)."""
    if mean <= 0.0 or variance <= 0.0:
        return 1.0
    scale = variance / (2.0 * mean)
    return float(chdtrc(2.0 * mean**2 / variance, value / scale))


def displacement(around: Around, blocks: Blocks, square: float) -> Excess:
    """Mean square of the displacements that cells show and the model does not, beyond noise, over that of the outcome's u."""
    lengths = around.outcome.u[around.outcome.is_length]
    if not len(lengths) or not np.any(around.target):
        return Excess(blocks.sort, 0.0, 1.0)
    total, weights, chi, k = 0.0, 0.0, 0.0, 0
    for number in np.unique(blocks.number[blocks.number >= 0]):
        members = np.flatnonzero(blocks.number == number)
        if len(members) < FEWEST:
            continue
        columns = around.target[:, members].T
        reach = columns.T @ around.rows[members]
        values, vectors = np.linalg.eigh(columns.T @ columns - reach @ reach.T)
        kept = values > max(WEAK * values[-1], 1e-12)
        pull = vectors[:, kept].T @ (columns.T @ around.v[members])
        chi += float(np.sum(pull**2 / values[kept])) / square
        k += int(kept.sum())
        noise = square * float(np.sum(1.0 / values[kept]))
        weight = 1.0 / noise**2 if noise > 0.0 else 0.0
        total += weight * (float(np.sum((pull / values[kept]) ** 2)) - noise)
        weights += weight
    if not k or not weights:
        return Excess(blocks.sort, 0.0, 1.0)
    u = 3.0 * float(np.mean(lengths**2))
    return Excess(blocks.sort, max(total / weights, 0.0) / u, float(chdtrc(k, chi)))
