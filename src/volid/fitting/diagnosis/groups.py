"""Groups of readings whose residuals are tested together: sets, stations, tools, places, directions, times."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from volid.campaign import SAME_TOOL, Campaign, ObservationSet
from volid.model.machine import Axis
from volid.observations import KINDS

BINS = 6
SET = "set"
_ENGLISH = {
    "set": "set '{0}'",
    "label": "{0} {1}",
    "direction": "direction {0}",
    "tool": "tool vector ({0:g}, {1:g}, {2:g}) mm",
    "range": "{0} {1:g} … {2:g} {3}",
}


class Grouping(NamedTuple):
    """Sort of a group of readings, what they have in common, and its rows: bool (m,), or (m, k) for the columns of the readings
    (directions of the sensor, coordinates).

    `facts`: what names the group in any language. ("set", name); ("label", label, value); ("direction", reading);
    ("tool", x, y, z) [mm]; ("approach", axis, +1 or -1); ("range", axis or "time", low, high, unit); ("region", (axis, whether
    high), …).
    """

    sort: str
    facts: tuple[Any, ...]
    rows: np.ndarray

    @property
    def what(self) -> str:
        """Its name in English: "station S1"."""
        return in_english(self.facts)


def in_english(facts: tuple[Any, ...]) -> str:
    """The name of a group.

    >>> in_english(("range", "Z", -166.7, -83.3, "mm")), in_english(("region", ("Y", True), ("X", False)))
    ('Z -166.7 … -83.3 mm', 'region Y high, X low')
    """
    key, *values = facts
    if key == "region":
        return "region " + ", ".join(f"{letter} {'high' if high else 'low'}" for letter, high in values)
    if key == "approach":
        return f"{values[0]} approached in {'+' if values[1] > 0 else '-'}"
    return _ENGLISH[key].format(*values)


def groupings(campaign: Campaign, observations: ObservationSet, like: ObservationSet) -> Iterator[Grouping]:
    """Every group of a set: itself, stations, segments' tools, positions, regions, directions, time.

    `like`: the set, or a sample of it, which decides what groups there are.
    """
    m = len(observations)
    yield Grouping(SET, ("set", observations.name), np.ones(m, dtype=bool))
    for label, value in KINDS[observations.kind].groups_by(like):
        yield Grouping(label, ("label", label, value), observations.labels[label] == value)
    columns = KINDS[observations.kind].readings
    for k, name in enumerate(columns if len(columns) > 1 else ()):
        yield Grouping("direction", ("direction", name), np.tile(np.arange(len(columns)) == k, (m, 1)))
    tools = np.unique(np.round(like.tool, SAME_TOOL), axis=0)
    for tool in tools if 1 < len(tools) <= 12 else ():
        with_tool = np.all(np.round(observations.tool, SAME_TOOL) == tool, axis=1)
        yield Grouping("tool", ("tool", *tool.tolist()), with_tool)
    yield from _position_groups(campaign, observations, like)
    for i, axis in enumerate(campaign.machine.axes):
        for sign in (1, -1):
            rows = like.directions[:, i] == sign
            if rows.any() and not rows.all():
                yield Grouping(_sort_of(axis), ("approach", axis.letter, sign), observations.directions[:, i] == sign)
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
        halves = zip(campaign.machine.letters, corner.tolist(), strict=True)
        yield Grouping("region", ("region", *halves), np.all(octants == corner, axis=1))


def _sort_of(axis: Axis) -> str:
    return "linear" if axis.is_linear else "rotary"


def _bins(sort: str, name: str, unit: str, values: np.ndarray, edges: np.ndarray) -> Iterator[Grouping]:
    index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    for k in range(len(edges) - 1):
        low, high = (round(float(edge), 1) for edge in edges[k : k + 2])
        yield Grouping(sort, ("range", name, low, high, unit), index == k)
