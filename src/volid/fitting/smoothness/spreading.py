"""A campaign with its positions moved a little, so that no level, node or rounding decides what its geometry determines.

A reading moves towards neighbours by up to half the way: to the one before or behind it where three follow each other on a
straight line, and for every axis that this leaves, to the nearest reading where that axis stood elsewhere. So readings on a grid
spread between its levels, those on a line stay on the line, and those on a circle stay near it: a body diagonal tells no more of
its three axes than what it tells on the line. A length between two places moves along its own line. The random numbers are always
the same.
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
HALF = 0.5  # of the way to a neighbour
QUARTER = 0.25  # of a length, at either end
STRAIGHT = 1.0 - 1e-6  # cosine between two steps of a straight path
MOST_NEIGHBOURS = 1500  # readings among which neighbours are looked for


def spread_out(campaign: Campaign, n_unknowns: int, still: set[str] | None = None) -> Campaign:
    """The campaign with its positions moved towards their neighbours; readings and labels stay.

    A reading keeps its station, tool vector and directions. An axis that was not moved, or is among those that stand `still`,
    stays where it was.
    """
    rng = np.random.default_rng(12)
    share = campaign.n_readings / max(n_unknowns, 1)
    scale = np.array([axis.length for axis in campaign.machine.axes])
    free = np.array([letter not in (still or ()) for letter in campaign.machine.letters])
    sets = [_moved(s.rows_of(_chosen(s, share, rng)), scale, free, rng) for s in campaign.sets]
    return replace(campaign, sets=tuple(s for s in sets if len(s)))


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


def _moved(readings: ObservationSet, scale: np.ndarray, free: np.ndarray, rng: np.random.Generator) -> ObservationSet:
    if readings.to is not None:
        return _along_its_line(readings, free, rng)
    positions = readings.positions.copy()
    for rows in _groups(readings):
        moved = _towards_neighbours(readings.positions[rows], scale, rng)
        positions[rows] = np.where(free, moved, positions[rows])
    return replace(readings, positions=positions)


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


def _towards_neighbours(q: np.ndarray, scale: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Positions (m, n_axes), each moved towards neighbours that move all of its axes, as few as can."""
    known = np.unique(np.round(q / (SAME * scale)), axis=0) * (SAME * scale)
    if len(known) > MOST_NEIGHBOURS:
        known = known[np.sort(rng.permutation(len(known))[:MOST_NEIGHBOURS])]
    near, far = _neighbours(q / scale, known / scale, rng)
    step = _on_the_path(q / scale, rng) * scale
    moved, covered = q + HALF * rng.random((len(q), 1)) * step, np.abs(step) > SAME * scale
    rows = np.arange(len(q))
    for axis in np.argsort(far, axis=1, kind="stable").T:
        need = ~covered[rows, axis] & np.isfinite(far[rows, axis])
        step = np.where(need[:, None], known[near[rows, axis]] - q, 0.0)
        covered |= np.abs(step) > SAME * scale
        moved += HALF * rng.random((len(q), 1)) * step
    return np.clip(moved, q.min(axis=0), q.max(axis=0))


def _on_the_path(q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """From each position to the one before or behind it on a straight path, (m, n_axes); 0 where there is no such path."""
    ways = np.diff(q, axis=0, append=q[-1:])
    sizes = np.linalg.norm(ways, axis=1)
    straight = np.zeros(len(q), dtype=bool)
    both = sizes[:-2] * sizes[1:-1] if len(q) > 2 else np.zeros(0)
    straight[1:-1] = np.sum(ways[:-2] * ways[1:-1], axis=1) > STRAIGHT * np.where(both > 0.0, both, np.inf)
    behind = straight | np.append(straight[1:], False)  # the next one lies on the line
    before = straight | np.append(False, straight[:-1])
    forward = behind & (~before | (rng.random(len(q)) < 0.5))
    back = np.concatenate([np.zeros((1, q.shape[1])), -ways[:-1]])
    return np.where(forward[:, None], ways, np.where(before[:, None], back, 0.0))


def _neighbours(q: np.ndarray, known: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """For each position and axis, number and distance of the nearest one where the axis stands elsewhere, (m, n_axes) each.

    Of the nearest above and the nearest below one is taken at random. The distance is infinite where there is none.
    """
    m, n = q.shape
    near, far = np.zeros((m, n), dtype=int), np.full((m, n), np.inf)
    for block in np.array_split(np.arange(m), -(-m // MOST_NEIGHBOURS)):
        difference = known[None, :, :] - q[block, None, :]
        distance = np.sum(difference**2, axis=2)
        for axis in range(n):
            sides = [np.where(s * difference[:, :, axis] > SAME, distance, np.inf) for s in (1.0, -1.0)]
            found = np.stack([side.argmin(axis=1) for side in sides])
            away = np.stack([side.min(axis=1) for side in sides])
            side = np.where(np.isinf(away).any(axis=0), away.argmin(axis=0), rng.integers(2, size=len(block)))
            near[block, axis] = np.take_along_axis(found, side[None], axis=0)[0]
            far[block, axis] = np.take_along_axis(away, side[None], axis=0)[0]
    return near, far
