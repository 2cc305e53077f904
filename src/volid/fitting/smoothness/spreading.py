"""A campaign with its positions moved a little, so that no level, node or rounding decides what its geometry determines.

Every axis of a reading moves between its neighbouring levels. Where several axes move together along a straight path, as on a
diagonal, a reading moves on the path instead, by up to half the way to the one before or behind it: a body diagonal tells no
more of its three axes than what it tells on the line. A length between two places moves along its own line. The random numbers
are always the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.observations import KINDS

SAME = 1e-6  # of the travel: positions that near are one level
ENOUGH = 6  # readings per unknown from which on a part of them is enough
WANTED = 3  # readings per unknown that a repeated campaign has at least
MOST_COPIES = 40
HALF = 0.5  # of the way to the next one on a path
QUARTER = 0.25  # of a length, at either end
STRAIGHT = 1.0 - 1e-6  # cosine between two steps of a straight path


def spread_out(campaign: Campaign, n_unknowns: int, still: set[str] | None = None) -> Campaign:
    """The campaign with its positions moved; readings and labels stay.

    A reading keeps its station, tool vector and directions. An axis that was not moved, or is among those that stand `still`,
    stays where it was.
    """
    rng = np.random.default_rng(12)
    share = campaign.n_readings / max(n_unknowns, 1)
    levels = [levels_of(campaign, i) for i in range(len(campaign.machine.axes))]
    levels = [v[:1] if a in (still or ()) else v for a, v in zip(campaign.machine.letters, levels, strict=True)]
    scale = np.array([axis.length for axis in campaign.machine.axes])
    sets = tuple(_moved(s, _chosen(s, share, rng), levels, scale, rng) for s in campaign.sets if len(s))
    return replace(campaign, sets=sets)


def levels_of(campaign: Campaign, axis: int) -> np.ndarray:
    """Distinct positions of an axis in ascending order."""
    step = SAME * campaign.machine.axes[axis].length
    return np.asarray(np.unique(np.round(campaign.positions[:, axis] / step)) * step)


def _chosen(readings: ObservationSet, share: float, rng: np.random.Generator) -> np.ndarray:
    """Rows that are used, some of them several times."""
    rows = np.arange(len(readings))
    if share > ENOUGH:
        groups = np.unique(
            np.stack([np.unique(v, return_inverse=True)[1] for v in _kinds_of_row(readings)], axis=1),
            axis=0,
            return_inverse=True,
        )[1]
        keep = rng.permutation(len(rows))[: int(np.ceil(len(rows) * ENOUGH / share))]
        first = np.unique(np.asarray(groups).ravel(), return_index=True)[1]
        return np.unique(np.concatenate([keep, first]))
    return np.tile(rows, min(MOST_COPIES, max(1, int(np.ceil(WANTED / max(share, 1e-9))))))


def _kinds_of_row(readings: ObservationSet) -> list[np.ndarray]:
    """What sorts readings: labels and tool vector."""
    _, tool = np.unique(np.round(readings.side_by_side.tool, 6), axis=0, return_inverse=True)
    return [*readings.labels.values(), np.asarray(tool).ravel()]


def _moved(
    readings: ObservationSet, rows: np.ndarray, levels: list[np.ndarray], scale: np.ndarray, rng: np.random.Generator
) -> ObservationSet:
    """Some rows of a set at moved positions."""
    free = np.array([len(known) > 1 for known in levels])
    chosen = readings.rows_of(rows)
    if chosen.to is not None:
        return _along_its_line(chosen, free, rng)
    moved = _between(levels, chosen.positions, rng)
    path = np.zeros_like(moved)
    for own in _groups(readings):
        here = np.isin(rows, own)
        path[here] = _steps(readings.positions[own] / scale, np.searchsorted(own, rows[here]), rng) * scale
    together = (np.abs(path) > SAME * scale).sum(axis=1) > 1
    steps = HALF * rng.random((len(rows), 1)) * path
    moved = np.where(together[:, None] & free, chosen.positions + steps, moved)
    return _standing_still(chosen, moved)


def _between(levels: list[np.ndarray], positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Positions (m, n_axes) at random between the neighbours of their levels."""
    positions = positions.copy()
    for i, known in enumerate(levels):
        if len(known) < 2:
            continue
        edges = np.concatenate([known[:1], 0.5 * (known[1:] + known[:-1]), known[-1:]])
        at = np.clip(np.searchsorted(edges, positions[:, i], side="right") - 1, 0, len(known) - 1)
        positions[:, i] = edges[at] + rng.random(len(positions)) * (edges[at + 1] - edges[at])
    return positions


def _standing_still(chosen: ObservationSet, moved: np.ndarray) -> ObservationSet:
    """The set at its moved positions, in which an axis stands still where it did along a line of the kind."""
    labels = [chosen.labels[label] for label in KINDS[chosen.kind].still_by]
    lines = np.unique(np.stack(labels), axis=1, return_inverse=True)[1].ravel() if labels else np.arange(len(chosen))
    for line in np.unique(lines) if labels else ():
        own = np.flatnonzero(lines == line)
        still = np.ptp(chosen.positions[own], axis=0) == 0.0
        moved[np.ix_(own, still)] = moved[own[0], still]
    return replace(chosen, positions=moved)


def _along_its_line(readings: ObservationSet, free: np.ndarray, rng: np.random.Generator) -> ObservationSet:
    """Both ends moved inwards by up to a quarter of the way to the other."""
    assert readings.to is not None
    way = free * (readings.to.positions - readings.positions)
    first, second = QUARTER * rng.random((2, len(readings), 1))
    there = readings.to._replace(positions=readings.to.positions - second * way)
    return replace(readings, positions=readings.positions + first * way, to=there)


def _groups(readings: ObservationSet) -> Iterator[np.ndarray]:
    """Rows that are read with one tool vector, and along one line where the kind has lines."""
    sorts = [np.unique(np.round(readings.tool, 6), axis=0, return_inverse=True)[1].ravel()]
    sorts += [np.unique(readings.labels[name], return_inverse=True)[1] for name in KINDS[readings.kind].still_by]
    number = np.unique(np.stack(sorts), axis=1, return_inverse=True)[1].ravel()
    order = np.argsort(number, kind="stable")
    yield from np.split(order, np.flatnonzero(np.diff(number[order])) + 1)


def _steps(q: np.ndarray, used: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """From positions number `used` (k,) of a path (m, n_axes) to the one before or behind, (k, n_axes), taken at random.

    0 where three positions that follow each other are not on a straight line.
    """
    ways = np.diff(q, axis=0, append=q[-1:])
    sizes = np.linalg.norm(ways, axis=1)
    straight = np.zeros(len(q), dtype=bool)
    both = sizes[:-2] * sizes[1:-1] if len(q) > 2 else np.zeros(0)
    straight[1:-1] = np.sum(ways[:-2] * ways[1:-1], axis=1) > STRAIGHT * np.where(both > 0.0, both, np.inf)
    behind = (straight | np.append(straight[1:], False))[used]  # the next one lies on the line
    before = (straight | np.append(False, straight[:-1]))[used]
    forward = behind & (~before | (rng.random(len(used)) < 0.5))
    back = np.concatenate([np.zeros((1, q.shape[1])), -ways[:-1]])
    return np.where(forward[:, None], ways[used], np.where(before[:, None], back[used], 0.0))
