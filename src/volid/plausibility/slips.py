"""Slips: the one mistake in what a campaign says that makes readings and positions contradict each other by much.

Each slip is the same campaign as it would be without that mistake, with its name and what to write into which file. Whether one
of them makes the readings agree is for others to try: on the nominal chain before a fit (`fitting.nominal`), and with the whole
model after one (`fitting.diagnosis.alternatives.slips`). A slip that cannot occur in a campaign is not tried.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from volid.campaign import SAME_TOOL, Campaign, ObservationSet
from volid.model.machine import Machine
from volid.observations import KINDS
from volid.observations.base import MM, STATION
from volid.plausibility.tools import SHORT

SENSE, COLUMNS, UNITS, TOOL = "sense of an axis", "exchanged columns", "a wrong unit", "a tool vector"
HAND, READINGS, ROWS = "the frame", "sense of the readings", "rows of the readings"
STATIONS, PATHS = "station labels", "dead paths"
METRE, INCH = 1000.0, 25.4
_MOST_LABELS = 60  # exchanged labels that are tried
_MOST_TOOLS = 6
_LEAST_ROWS = 10
_FEW_OUTSIDE = 0.1  # share of the positions that may lie outside the travels once a mistake is mended
NONE: Mapping[str, float] = MappingProxyType({})


class Slip(NamedTuple):
    """Sort of a mistake, itself and its cure in words, and the campaign without it.

    `scales`: by how much the readings of a set are larger without it, by the set's name.
    """

    cause: str
    what: str
    cure: str
    campaign: Campaign
    scales: Mapping[str, float] = NONE


def slips(campaign: Campaign) -> Iterator[Slip]:
    """Every single slip that is known, the ordinary ones first."""
    yield from _axes(campaign)
    yield from _units(campaign)
    yield from _tools(campaign)
    yield from _hands(campaign)
    yield from _paths(campaign)
    yield from _shifted(campaign)
    yield from _stations(campaign)


def _with_sets(campaign: Campaign, change: Callable[[ObservationSet], ObservationSet]) -> Campaign:
    return replace(campaign, sets=tuple(change(s) for s in campaign.sets))


def _with_set(campaign: Campaign, of: ObservationSet, changed: ObservationSet) -> Campaign:
    return replace(campaign, sets=tuple(changed if s is of else s for s in campaign.sets))


def with_unknown_stations(campaign: Campaign) -> Campaign:
    """The campaign with stations whose stated positions are approximate."""
    free = tuple(replace(station, known=False, frame="stations") for station in campaign.stations)
    return replace(campaign, stations=free)


def _covering(campaign: Campaign) -> Campaign:
    """The campaign on its machine with travels that hold all positions, which a slip may have put elsewhere."""
    low, high = campaign.measured_range().T
    ends = {
        axis.letter: (min(axis.travel[0], float(a)), max(axis.travel[1], float(b)))
        for axis, a, b in zip(campaign.machine.axes, low, high, strict=True)
    }
    return replace(campaign, machine=campaign.machine.over(ends))


# ------------------------------------------------------------------------------------------------------------------ positions


def _axes(campaign: Campaign) -> Iterator[Slip]:
    """Axes that count the other way, and exchanged columns."""
    machine = campaign.machine
    for i, axis in enumerate(machine.axes):
        if not campaign.positions[:, i].any():
            continue
        if axis.is_linear:
            yield _counted_the_other_way(campaign, i)
        else:
            yield _turning_the_other_way(campaign, i)
    outside = _outside(campaign, machine)
    for chosen in (True, False):
        for i, j in combinations([i for i, axis in enumerate(machine.axes) if axis.is_linear == chosen], 2):
            slip = _exchanged(campaign, i, j)
            if _outside(slip.campaign, machine) < max(2.0 * outside, _FEW_OUTSIDE):
                yield slip


def _outside(campaign: Campaign, machine: Machine) -> float:
    """Largest share of the positions of an axis that lie outside its travel."""
    low, high = np.array([axis.travel for axis in machine.axes]).T
    return float(np.max(np.mean((campaign.positions < low) | (campaign.positions > high), axis=0)))


def _scaled(campaign: Campaign, factors: np.ndarray) -> Campaign:
    """Positions times one factor for each axis."""
    return _covering(_with_sets(campaign, lambda s: s.moved(lambda q: q * factors, lambda way: way)))


def _counted_the_other_way(campaign: Campaign, i: int) -> Slip:
    """Negated positions of a linear axis, or, where those would lie outside the travel, positions counted from its other end."""
    axis, q = campaign.machine.axes[i], campaign.positions[:, i]
    low, high = axis.travel
    mirrored = np.mean((-q < low) | (-q > high)) > np.mean((q < low) | (q > high))
    own = np.arange(len(campaign.machine.axes)) == i
    offset = low + high if mirrored else 0.0
    cure = f"campaign: negate column {axis.letter}"
    if mirrored:
        x = axis.letter
        cure = f"campaign: {x} counted from the other end, {offset:g} - {x}, or negate column {x} and its travel"
    changed = _with_sets(
        campaign, lambda s: s.moved(lambda p: np.where(own, offset - p, p), lambda way: np.where(own, -way, way))
    )
    return Slip(SENSE, f"axis {axis.letter} counts the other way", cure, _covering(changed))


def _turning_the_other_way(campaign: Campaign, i: int) -> Slip:
    machine, axis = campaign.machine, campaign.machine.axes[i]
    x, y, z = (0.0 - c for c in axis.unit_vector)
    axes = tuple(replace(a, direction=(x, y, z)) if k == i else a for k, a in enumerate(machine.axes))
    cure = f"machine file, [axis.{axis.letter}]: direction = [{x:g}, {y:g}, {z:g}]"
    changed = replace(campaign, machine=replace(machine, axes=axes))
    return Slip(SENSE, f"axis {axis.letter} counts the other way", cure, changed)


def _exchanged(campaign: Campaign, i: int, j: int) -> Slip:
    machine: Machine = campaign.machine
    a, b = machine.letters[i], machine.letters[j]
    columns = [j if k == i else i if k == j else k for k in range(len(machine.axes))]

    changed = _covering(_with_sets(campaign, lambda s: s.moved(lambda q: q[:, columns], lambda way: way[:, columns])))
    return Slip(COLUMNS, f"positions of {a} and {b} are exchanged", f"campaign: exchange columns {a} and {b}", changed)


# ---------------------------------------------------------------------------------------------------------------------- units


def _units(campaign: Campaign) -> Iterator[Slip]:
    """Positions, readings and tool vectors in another unit than mm and degrees, all sets alike or one of them."""
    linear = np.array([axis.is_linear for axis in campaign.machine.axes])
    rotary = [axis.letter for axis in campaign.machine.axes if not axis.is_linear]
    for factor, unit in ((METRE, "metres"), (INCH, "inches"), (1.0 / METRE, "micrometres")):
        moved = _scaled(campaign, np.where(linear, factor, 1.0))
        yield Slip(UNITS, f"axis positions are in {unit}", f"campaign: positions times {factor:g}", moved)
        for s in campaign.sets:
            if MM in (KINDS[s.kind].unit_of(k) for k in range(len(KINDS[s.kind].readings))):
                cure = f"campaign: the readings of this set times {factor:g}"
                what = f"readings of set '{s.name}' are in {unit}"
                yield Slip(UNITS, what, cure, _read_times(campaign, s, factor), {s.name: factor})
    if rotary:
        names, degree = " and ".join(rotary), 180.0 / np.pi
        turned = _scaled(campaign, np.where(linear, 1.0, degree))
        yield Slip(UNITS, f"positions of {names} are in radians", "campaign: give them in degrees", turned)


def _read_times(campaign: Campaign, of: ObservationSet, factor: float) -> Campaign:
    kind = KINDS[of.kind]
    factors = np.array([factor if kind.unit_of(k) == MM else 1.0 for k in range(len(kind.readings))])
    return _with_set(campaign, of, replace(of, readings=of.readings * factors))


# ----------------------------------------------------------------------------------------------------------------- tools, hands


def _tools(campaign: Campaign) -> Iterator[Slip]:
    """Tool vectors negated, one component of them, or in metres."""
    sets = [s for s in campaign.sets if KINDS[s.kind].sees_tool(s)]
    tools = np.concatenate([s.tool for s in sets]) if sets else np.zeros((1, 3))
    if not tools.any():
        return
    for said, factors in (("x", (-1, 1, 1)), ("y", (1, -1, 1)), ("z", (1, 1, -1))):
        if tools[:, "xyz".index(said)].any():
            cure = f"campaign: negate tool_{said}, or the {said} of the key tool"
            yield _tool_slip(campaign, factors, f"tool vectors have the wrong sign in {said}", cure)
    if np.count_nonzero(tools.any(axis=0)) > 1:
        yield _tool_slip(campaign, (-1, -1, -1), "tool vectors are negated", "campaign: negate the tool vectors")
    for i, j in combinations(range(3), 2):
        if (tools[:, i] != tools[:, j]).any():
            columns = [j if k == i else i if k == j else k for k in range(3)]
            a, b = "xyz"[i], "xyz"[j]
            cure = f"campaign: exchange tool_{a} and tool_{b}"
            yield _tool_slip(campaign, (1, 1, 1), f"{a} and {b} of the tool vectors are exchanged", cure, columns)
    metres = (METRE, METRE, METRE)
    if np.linalg.norm(tools, axis=1).max() < SHORT:
        yield _tool_slip(campaign, metres, "tool vectors are in metres", "campaign: tool vectors times 1000")


def _tool_slip(
    campaign: Campaign, factors: tuple[float, float, float], what: str, cure: str, columns: Sequence[int] = (0, 1, 2)
) -> Slip:
    def change(s: ObservationSet) -> ObservationSet:
        to = None if s.to is None else s.to._replace(tool=s.to.tool[:, list(columns)] * np.array(factors))
        return replace(s, tool=s.tool[:, list(columns)] * np.array(factors), to=to)

    return Slip(TOOL, what, cure, _with_sets(campaign, change))


def _hands(campaign: Campaign) -> Iterator[Slip]:
    """Readings of the other sense: lengths negated, coordinates in a frame of the other hand, one direction negated."""
    for s in campaign.sets:
        names = KINDS[s.kind].readings
        if len(names) == 1:
            what = f"readings of set '{s.name}' have the other sign"
            cure = f"campaign: negate column {names[0]} of set '{s.name}'"
            yield Slip(READINGS, what, cure, _read_times(campaign, s, -1.0))
            continue
        for k in (1, 0, 2):  # y first: the usual way to write a left-handed frame
            signs = np.where(np.arange(len(names)) == k, -1.0, 1.0)
            what = f"the frame of set '{s.name}' is of the other hand ({names[k]} has the other sign)"
            changed = _with_set(campaign, s, replace(s, readings=s.readings * signs))
            yield Slip(HAND, what, f"campaign: negate column {names[k]} of set '{s.name}'", changed)


# --------------------------------------------------------------------------------------------------- dead paths and stations


def _shifted(campaign: Campaign) -> Iterator[Slip]:
    """Readings that stand one row too low or too high, as after a cell that was put in or left out."""
    for s in campaign.sets:
        if len(s) < _LEAST_ROWS:
            continue
        for said, ends in (("low", (1, 0)), ("high", (0, 1))):
            kept, moved = np.arange(ends[1], len(s) - ends[0]), np.arange(ends[0], len(s) - ends[1])
            changed = replace(s.rows_of(kept), readings=s.readings[moved], u=s.u[moved])
            what = f"the readings of set '{s.name}' stand one row too {said}"
            cure = f"campaign: move the column of the readings of set '{s.name}' by one row"
            yield Slip(ROWS, what, cure, _with_set(campaign, s, changed))


def _paths(campaign: Campaign) -> Iterator[Slip]:
    """Dead paths left out, or the same through a change of the tool."""
    for s in campaign.sets:
        if "relative" not in KINDS[s.kind].options:
            continue
        if not s.options.get("relative", True):
            changed = _with_set(campaign, s, replace(s, options={**s.options, "relative": True}))
            cure = f"campaign, set '{s.name}': relative = true"
            yield Slip(PATHS, f"the lengths of set '{s.name}' hold dead paths", cure, changed)
        tools = np.unique(np.round(s.tool, SAME_TOOL), axis=0)
        if "segment" in s.labels and 1 < len(tools) <= _MOST_TOOLS:
            yield _by_tool(campaign, s, tools)


def _by_tool(campaign: Campaign, of: ObservationSet, tools: np.ndarray) -> Slip:
    """A new segment, with a dead path of its own, for every tool vector."""
    rounded = np.round(of.tool, SAME_TOOL)
    number = np.argmax((rounded[:, None, :] == tools).all(axis=2), axis=1)
    segments = np.array([f"{a}, tool {n + 1}" for a, n in zip(of.labels["segment"], number.tolist(), strict=True)])
    labels, options = {**of.labels, "segment": segments}, {**of.options, "relative": True}
    changed = _with_set(campaign, of, replace(of, labels=labels, options=options))
    what = f"the beams of set '{of.name}' were broken when the tool vector changed"
    return Slip(PATHS, what, f"campaign, set '{of.name}': a new name in column segment for every tool vector", changed)


def _stations(campaign: Campaign) -> Iterator[Slip]:
    """Known places that are not, and two labels exchanged in the readings with one tool vector."""
    if any(station.known for station in campaign.stations):
        what, cure = "the known positions of stations do not hold", "campaign, [[station]]: known = false"
        yield Slip(STATIONS, what, cure, with_unknown_stations(campaign))
    tried = 0
    for s in campaign.sets:
        for slip in _exchanged_labels(campaign, s):
            tried += 1
            if tried > _MOST_LABELS:
                return
            yield slip


def _exchanged_labels(campaign: Campaign, of: ObservationSet) -> Iterator[Slip]:
    if STATION not in of.labels:
        return
    rounded, names = np.round(of.tool, SAME_TOOL), np.unique(of.labels[STATION]).tolist()
    for tool in np.unique(rounded, axis=0)[:_MOST_TOOLS]:
        rows = (rounded == tool).all(axis=1)
        said = f"with tool vector ({tool[0]:g}, {tool[1]:g}, {tool[2]:g}) mm"
        for a, b in combinations(names, 2):
            labels = of.labels[STATION].copy()
            labels[rows & (of.labels[STATION] == a)], labels[rows & (of.labels[STATION] == b)] = b, a
            if (labels == of.labels[STATION]).all():
                continue
            changed = _with_set(campaign, of, replace(of, labels={**of.labels, STATION: labels}))
            what = f"stations {a} and {b} are exchanged in set '{of.name}' {said}"
            yield Slip(STATIONS, what, f"campaign: exchange {a} and {b} in column station of these rows", changed)
