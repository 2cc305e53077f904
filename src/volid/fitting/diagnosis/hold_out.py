"""Residuals of readings that the fit has not seen: every rotary position predicted from all others, without a refit.

With whitened residuals r = y - ŷ and H = J C Jᵀ, the prediction of a group g of readings by the fit to all others leaves
    e_g = (I - H_gg)⁻¹ r_g,
exact for a model that is linear in its unknowns (Cook and Weisberg 1982, 2.2; Hastie, Tibshirani and Friedman, 7.10), and to
second order of the errors here. A group is everything that was read at one combination of rotary positions, from any station, at
any sphere, repeats included. A model that only reproduces its readings has small residuals, but not small held-out residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from volid.backend.rms import rms
from volid.campaign import SAME_ANGLE, Campaign, ObservationSet
from volid.fitting.equations.problem import Problem
from volid.model.machine import Machine

CARRIED_ALONE = 1e-6  # eigenvalue of I - H_gg below which a group alone carries something
LARGEST = 50_000_000  # numbers of the projected Jacobian that are kept in memory at once
BINS = 6
LISTED = 8  # distinct positions that are listed one by one


def held_out_residuals(
    problem: Problem, campaign: Campaign, z: np.ndarray, root: np.ndarray, whitened: list[np.ndarray]
) -> tuple[np.ndarray, ...]:
    """Whitened residuals with all readings of the same rotary position held out, (m, k) per set.

    `problem`: with the weights of the fit (0 for outliers, whose residuals are held out already). `root`: L with covariance
    of z = L Lᵀ. `whitened`: residuals of all readings over u. The result is NaN where one rotary position alone determines a
    combination of the unknowns, and empty when the machine has no rotary axis or the campaign is too large for it.
    """
    rotary = any(not axis.is_linear for axis in campaign.machine.axes)
    if not rotary or sum(r.size for r in whitened) * root.shape[1] > LARGEST:
        return ()
    blocks = problem.equations.projected(z, root.T)
    rows = rows_by_reading(problem, campaign, blocks)
    poses = campaign.rotary_poses()
    group = np.concatenate([np.repeat(p, r.shape[1]) for p, r in zip(poses, whitened, strict=True)])
    residual = np.concatenate([r.ravel() for r in whitened])
    predicted = np.empty_like(residual)
    order = np.argsort(group, kind="stable")
    for members in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        predicted[members] = _without(rows[members], residual[members])
    parts = np.split(predicted, np.cumsum([r.size for r in whitened])[:-1])
    return tuple(part.reshape(r.shape) for part, r in zip(parts, whitened, strict=True))


def rows_by_reading(problem: Problem, campaign: Campaign, blocks: list[Any]) -> np.ndarray:
    """J L, one row per scalar reading in the order of sets, rows, columns: (n, r)."""
    width = blocks[0].shape[1]
    result = [np.zeros((*s.readings.shape, width)) for s in campaign.sets]
    for (number, rows), block in zip(problem.places, blocks, strict=True):
        k = campaign.sets[number].readings.shape[1]
        chunks, _, columns = block.shape
        values = np.asarray(block).reshape(chunks, width, k, columns // k).transpose(0, 3, 2, 1)
        result[number][rows] = values.reshape(-1, k, width)[: len(rows)]
    return np.concatenate([r.reshape(-1, width) for r in result])


def _without(rows: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """(I - H)⁻¹ r of one group; NaN when I - H is singular."""
    values, vectors = np.linalg.eigh(np.eye(len(rows)) - rows @ rows.T)
    if values[0] < CARRIED_ALONE:
        return np.full(len(residual), np.nan)
    return np.asarray(vectors @ ((vectors.T @ residual) / values))


@dataclass(frozen=True)
class AngleBin:
    """Residuals of the readings of one set at rotary positions `low` … `high` (equal: one position) of `axis` [degrees].

    `n`: rows; `poses`: combinations of rotary positions. `residual`, `held_out`: root mean square over the rows of the length
    of the residual vector (of three coordinates, or of the one reading), within the fit and held out, in the reading's unit.
    `mean`: mean residual by column, (k,). Outliers and rows without a held-out residual do not count.
    """

    set: str
    axis: str
    low: float
    high: float
    n: int
    poses: int
    residual: float
    held_out: float
    mean: tuple[float, ...]


def by_angle(
    machine: Machine,
    readings: ObservationSet,
    poses: np.ndarray,
    residual: np.ndarray,
    held_out: np.ndarray,
    used: np.ndarray,
) -> list[AngleBin]:
    """Bins of every rotary axis that moves in a set, axis by axis from the workpiece.

    `poses`: (m,) as `Campaign.rotary_poses` gives. `residual`, `held_out`: (m, k) in the reading's unit. `used`: (m,) bool.
    """
    result = []
    for i, axis in enumerate(machine.axes):
        q = readings.positions[:, i]
        if axis.is_linear or not used.any() or np.ptp(q[used]) <= SAME_ANGLE:
            continue
        for low, high, rows in _bins(q, used):
            result.append(_bin(readings.name, axis.letter, (low, high), poses[rows], residual[rows], held_out[rows]))
    return result


def total(name: str, poses: np.ndarray, residual: np.ndarray, held_out: np.ndarray, used: np.ndarray) -> AngleBin:
    """All used rows of a set as one bin."""
    return _bin(name, "", (np.nan, np.nan), poses[used], residual[used], held_out[used])


def _bins(q: np.ndarray, used: np.ndarray) -> list[tuple[float, float, np.ndarray]]:
    """Ends and rows of the bins of positions `q`: the distinct ones when they are few, else equal widths."""
    distinct = np.unique(np.round(q[used] / SAME_ANGLE)) * SAME_ANGLE
    if len(distinct) <= LISTED:
        return [(float(v), float(v), used & (np.abs(q - v) < SAME_ANGLE)) for v in distinct]
    edges = np.linspace(distinct[0], distinct[-1], BINS + 1)
    index = np.clip(np.searchsorted(edges[1:-1], q, side="right"), 0, BINS - 1)
    found = [(float(edges[b]), float(edges[b + 1]), used & (index == b)) for b in range(BINS)]
    return [entry for entry in found if entry[2].any()]


def _bin(
    name: str, axis: str, ends: tuple[float, float], poses: np.ndarray, residual: np.ndarray, predicted: np.ndarray
) -> AngleBin:
    return AngleBin(
        set=name,
        axis=axis,
        low=ends[0],
        high=ends[1],
        n=len(poses),
        poses=len(np.unique(poses)),
        residual=rms(np.linalg.norm(residual, axis=1)),
        held_out=rms(np.linalg.norm(predicted, axis=1)),
        mean=tuple(residual.mean(axis=0).tolist()),
    )
