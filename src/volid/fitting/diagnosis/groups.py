"""Groups of readings whose residuals are tested together: sets, stations, tools, places, directions, times."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from volid.campaign import SAME_TOOL, Campaign, ObservationSet
from volid.model.machine import Axis
from volid.observations import KINDS

BINS = 6
SET = "set"


class Grouping(NamedTuple):
    """Sort and name of a group of readings, and its rows: bool (m,), or (m, k) for the columns of the readings (directions of the
    sensor, coordinates)."""

    sort: str
    what: str
    rows: np.ndarray


def groupings(campaign: Campaign, observations: ObservationSet, like: ObservationSet) -> Iterator[Grouping]:
    """Every group of a set: itself, stations, segments' tools, positions, regions, directions, time.

    `like`: the set, or a sample of it, which decides what groups there are.
    """
    m = len(observations)
    yield Grouping(SET, f"set '{observations.name}'", np.ones(m, dtype=bool))
    for label, value in KINDS[observations.kind].groups_by(like):
        yield Grouping(label, f"{label} {value}", observations.labels[label] == value)
    columns = KINDS[observations.kind].readings
    for k, name in enumerate(columns if len(columns) > 1 else ()):
        yield Grouping("direction", f"direction {name}", np.tile(np.arange(len(columns)) == k, (m, 1)))
    tools = np.unique(np.round(like.tool, SAME_TOOL), axis=0)
    for tool in tools if 1 < len(tools) <= 12 else ():
        with_tool = np.all(np.round(observations.tool, SAME_TOOL) == tool, axis=1)
        yield Grouping("tool", f"tool vector ({tool[0]:g}, {tool[1]:g}, {tool[2]:g}) mm", with_tool)
    yield from _position_groups(campaign, observations, like)
    for i, axis in enumerate(campaign.machine.axes):
        for sign in (1, -1):
            rows = like.directions[:, i] == sign
            if rows.any() and not rows.all():
                what = f"{axis.letter} approached in {'+' if sign > 0 else '-'}"
                yield Grouping(_sort_of(axis), what, observations.directions[:, i] == sign)
    if like.time is not None and observations.time is not None and np.all(np.isfinite(like.time)):
        edges = np.quantile(like.time, np.linspace(0, 1, BINS + 1))
        yield from _bins("time", "time", "s", observations.time, edges)


def _position_groups(campaign: Campaign, observations: ObservationSet, like: ObservationSet) -> Iterator[Grouping]:
    for i, axis in enumerate(campaign.machine.axes):
        yield from _bins(
            _sort_of(axis), axis.letter, axis.unit, observations.positions[:, i], np.linspace(*axis.travel, BINS + 1)
        )
    middle = np.array([0.5 * sum(axis.travel) for axis in campaign.machine.axes])
    octants = observations.positions > middle
    for corner in np.unique(like.positions > middle, axis=0):
        name = ", ".join(
            f"{a.letter} {'high' if c else 'low'}" for a, c in zip(campaign.machine.axes, corner, strict=True)
        )
        yield Grouping("region", f"region {name}", np.all(octants == corner, axis=1))


def _sort_of(axis: Axis) -> str:
    return "linear" if axis.is_linear else "rotary"


def _bins(sort: str, name: str, unit: str, values: np.ndarray, edges: np.ndarray) -> Iterator[Grouping]:
    index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    for k in range(len(edges) - 1):
        yield Grouping(sort, f"{name} {round(edges[k], 1):g} … {round(edges[k + 1], 1):g} {unit}", index == k)
