"""Which readings repeat an earlier one: same labels, commanded positions, tool vector and approach direction.

A label that numbers runs tells visits to one place apart, not places.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from volid.campaign import ObservationSet
from volid.model.machine import Machine
from volid.observations import KINDS

SAME_POSITION = {True: 1e-3, False: 1e-6}  # linear [mm], rotary [degrees]: commanded positions nearer are the same
RUN = "run"  # label that numbers the runs along a line


def centres_as_readings(readings: ObservationSet, machine: Machine) -> ObservationSet:
    """A set of sphere centres with their nominal places as readings and linear positions 0; any other set as it is."""
    places = None if readings.readings.any() else KINDS[readings.kind].places(readings, machine)
    rotary = [not axis.is_linear for axis in machine.axes]
    if places is None or not any(rotary):
        return readings
    return replace(readings, positions=readings.positions * rotary, readings=places)


def repeats(readings: ObservationSet, machine: Machine) -> tuple[np.ndarray, np.ndarray]:
    """Rows that repeat an earlier place, and the earliest row at that place, both (n,)."""
    seen, ends = readings.side_by_side, len(readings.ends)
    tolerance = ([SAME_POSITION[axis.is_linear] for axis in machine.axes] + [SAME_POSITION[True]] * 3) * ends
    places = np.hstack([np.hstack([end.positions, end.tool]) for end in readings.ends])
    clusters = [_cluster(values, t) for values, t in zip(places.T, tolerance, strict=True)]
    ids = combine([*clusters, *seen.directions.T, *place_labels(readings).values()])
    first = first_of(ids, _order(readings))
    later = np.flatnonzero(first != np.arange(len(ids)))
    same = (np.abs(places[later] - places[first[later]]) <= 1.001 * np.array(tolerance)).all(axis=1)
    return later[same], first[later[same]]


def place_labels(readings: ObservationSet) -> dict[str, np.ndarray]:
    """Labels that tell places apart: all but the number of the run."""
    return {name: values for name, values in readings.labels.items() if name != RUN}


def visits(readings: ObservationSet, machine: Machine) -> tuple[np.ndarray, np.ndarray]:
    """For every row the number of its place, which is its earliest row, and of the visit there from 0, both (m,).

    The visit is that of the row's run where runs are numbered, in the order in which they begin.
    """
    later, earliest = repeats(readings, machine)
    place = np.arange(len(readings))
    place[later] = earliest
    order = _order(readings)
    visit = np.zeros(len(readings), dtype=np.int64)
    if RUN in readings.labels:
        begins = dict.fromkeys(readings.labels[RUN][order].tolist())
        number = {name: i for i, name in enumerate(begins)}
        visit[:] = [number[name] for name in readings.labels[RUN].tolist()]
        if len(begins) > 1:
            return place, visit
    by_place = order[np.argsort(place[order], kind="stable")]
    starts = np.flatnonzero(np.r_[True, np.diff(place[by_place]) != 0])
    counts = np.diff(np.r_[starts, len(by_place)])
    visit[by_place] = np.arange(len(by_place)) - np.repeat(starts, counts)
    return place, visit


def _order(readings: ObservationSet) -> np.ndarray:
    """Row numbers in order of time, or of the file when a time is missing."""
    if readings.time is None or np.isnan(readings.time).any():
        return np.arange(len(readings))
    return np.argsort(readings.time, kind="stable")


def _cluster(values: np.ndarray, tolerance: float) -> np.ndarray:
    """Number of the cluster of each value, (m,): sorted neighbours within the tolerance share one."""
    order = np.argsort(values, kind="stable")
    result = np.empty(len(values), dtype=np.int64)
    result[order] = np.concatenate([[0], np.cumsum(np.diff(values[order]) > tolerance)])
    return result


def combine(columns: Iterable[np.ndarray]) -> np.ndarray:
    """Number of the combination of values in each row, (m,); rows have the same number when all columns are equal."""
    ids = np.zeros(1, dtype=np.int64)
    for column in columns:
        codes = np.unique(column, return_inverse=True)[1]
        ids = np.unique(ids * (codes.max() + 1) + codes, return_inverse=True)[1]
    return ids


def first_of(ids: np.ndarray, order: np.ndarray) -> np.ndarray:
    """For each row, the row of the same number that comes first in `order`, (m,)."""
    first = np.zeros(ids.max() + 1, dtype=np.int64)
    first[ids[order[::-1]]] = order[::-1]
    return first[ids]
