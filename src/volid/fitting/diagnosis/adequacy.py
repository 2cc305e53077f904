"""Adequacy of the model: chi-square overall and by group, and the normalised residual test.

When the model is wrong (cross effects, drift, outliers, too few segments, instruments worse than stated), the residuals
show it. The verdict is part of every solution and is given before any table is written. ISO/TR 16907 11.3.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtrc

from volid.campaign import SAME_TOOL, Campaign, ObservationSet
from volid.fitting.diagnosis.robust import critical_value
from volid.model.machine import Axis
from volid.observations import KINDS

REJECT = 1e-3
BINS = 6
WORST = 4  # groups named in the verdict
SET = "set"


@dataclass(frozen=True)
class GroupTest:
    """Chi-square of one group of readings: `what` ("station S1"), readings, unit weight, probability if the model holds.

    `sort`: what the group has in common with others ("set", "linear", "region", a label such as "station"); empty where a
    file of an earlier version does not say it.
    """

    what: str
    n: int
    unit_weight: float
    probability: float
    sort: str = ""


@dataclass(frozen=True)
class SuspectReading:
    """A reading whose normalised residual exceeds the critical value: where, residual in its `unit`, normalised."""

    where: str
    label: str
    residual: float
    normalised: float
    unit: str = "mm"


@dataclass(frozen=True)
class Adequacy:
    """Verdict on a fit.

    `chi_square`, `degrees_of_freedom`, `unit_weight` = sqrt(chi²/dof) (NaN without redundancy); `probability` of a chi-square
    at least this large if the model holds. `groups`: all group tests, least probable first. `suspects`: readings beyond
    the critical value. `rejected`: the model, with the stated uncertainties, is rejected by the data.
    """

    chi_square: float
    degrees_of_freedom: int
    unit_weight: float
    probability: float
    groups: tuple[GroupTest, ...]
    suspects: tuple[SuspectReading, ...]
    rejected: bool
    verdict: str


class _Grouping(NamedTuple):
    """Sort and name of a group of readings, and its rows: bool (m,), or (m, k) for the columns of the readings (directions of the
    sensor, coordinates)."""

    sort: str
    what: str
    rows: np.ndarray


def _groupings(campaign: Campaign, observations: ObservationSet, like: ObservationSet) -> Iterator[_Grouping]:
    """Every group of a set: itself, stations, segments' tools, positions, regions, directions, time.

    `like`: the set, or a sample of it, which decides what groups there are.
    """
    m = len(observations)
    yield _Grouping(SET, f"set '{observations.name}'", np.ones(m, dtype=bool))
    for label, value in KINDS[observations.kind].groups_by(like):
        yield _Grouping(label, f"{label} {value}", observations.labels[label] == value)
    columns = KINDS[observations.kind].readings
    for k, name in enumerate(columns if len(columns) > 1 else ()):
        yield _Grouping("direction", f"direction {name}", np.tile(np.arange(len(columns)) == k, (m, 1)))
    tools = np.unique(np.round(like.tool, SAME_TOOL), axis=0)
    for tool in tools if 1 < len(tools) <= 12 else ():
        with_tool = np.all(np.round(observations.tool, SAME_TOOL) == tool, axis=1)
        yield _Grouping("tool", f"tool vector ({tool[0]:g}, {tool[1]:g}, {tool[2]:g}) mm", with_tool)
    yield from _position_groups(campaign, observations, like)
    for i, axis in enumerate(campaign.machine.axes):
        for sign in (1, -1):
            rows = like.directions[:, i] == sign
            if rows.any() and not rows.all():
                what = f"{axis.letter} approached in {'+' if sign > 0 else '-'}"
                yield _Grouping(_sort_of(axis), what, observations.directions[:, i] == sign)
    if like.time is not None and observations.time is not None and np.all(np.isfinite(like.time)):
        edges = np.quantile(like.time, np.linspace(0, 1, BINS + 1))
        yield from _bins("time", "time", "s", observations.time, edges)


def _position_groups(campaign: Campaign, observations: ObservationSet, like: ObservationSet) -> Iterator[_Grouping]:
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
        yield _Grouping("region", f"region {name}", np.all(octants == corner, axis=1))


def _sort_of(axis: Axis) -> str:
    return "linear" if axis.is_linear else "rotary"


def _bins(sort: str, name: str, unit: str, values: np.ndarray, edges: np.ndarray) -> Iterator[_Grouping]:
    index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    for k in range(len(edges) - 1):
        yield _Grouping(sort, f"{name} {edges[k]:g} … {edges[k + 1]:g} {unit}", index == k)


def _test(sort: str, what: str, total: float, dof: float, n: float) -> GroupTest | None:
    if dof < 1.0:
        return None
    return GroupTest(what, int(n), float(np.sqrt(total / dof)), float(chdtrc(dof, total)), sort)


def reading_label(observations: ObservationSet, i: int, k: int) -> str:
    """What a reading belongs to, in words; where a row's readings have different units, with the name of reading `k`."""
    kind = KINDS[observations.kind]
    texts = [f"{label} {observations.labels[label][i]}" for label in kind.named_by]
    return ", ".join([*texts, *(kind.readings[k : k + 1] if kind.units else ())])


def suspect(observations: ObservationSet, i: int, k: int, whitened: float, normalised: float) -> SuspectReading:
    """Reading `k` of row `i` with its whitened residual, named."""
    return SuspectReading(
        observations.where(i),
        reading_label(observations, i, k),
        whitened * float(observations.u[i, k]),
        normalised,
        KINDS[observations.kind].unit_at(observations, i, k),
    )


def assess(
    campaign: Campaign,
    residuals: list[np.ndarray],
    leverages: list[np.ndarray],
    active: list[np.ndarray],
    degrees_of_freedom: int,
    prior_chi_square: float = 0.0,
) -> Adequacy:
    """Test the whitened residuals (reading - predicted)/u, leverages h and active readings, each (m, k) per set."""
    tally = Tally(campaign, sum(int(a.sum()) for a in active))
    tally.add(campaign, residuals, leverages, active)
    return tally.adequacy(degrees_of_freedom, prior_chi_square)


class Tally:
    """Sums of squared residuals and redundancies by groups, over all readings or part by part.

    `like`: the campaign, or a sample of it, which decides what groups there are. `n`: number of all readings that take part.
    """

    def __init__(self, like: Campaign, n: int) -> None:
        self._like = {s.name: s for s in like.sets}
        self._limit = critical_value(n)
        self._total = 0.0
        self._groups: dict[tuple[str, str], np.ndarray] = {}  # sum of squares, of redundancies, readings
        self._suspects: list[SuspectReading] = []

    def add(
        self, campaign: Campaign, residuals: list[np.ndarray], leverages: list[np.ndarray], active: list[np.ndarray]
    ) -> None:
        """Count the whitened residuals (reading - predicted)/u, leverages h and active readings, each (m, k) per set."""
        squares = [np.where(a, r**2, 0.0) for r, a in zip(residuals, active, strict=True)]
        redundancy = [np.where(a, 1.0 - h, 0.0) for h, a in zip(leverages, active, strict=True)]
        self._total += sum(float(s.sum()) for s in squares)
        for s, sq, re in zip(campaign.sets, squares, redundancy, strict=True):
            for sort, what, rows in _groupings(campaign, s, self._like[s.name]):
                found = np.array([sq[rows].sum(), re[rows].sum(), re[rows].size])
                self._groups[sort, what] = self._groups.get((sort, what), 0.0) + found
        self._suspects += _suspects(campaign, residuals, redundancy, active, self._limit)

    def adequacy(self, dof: int, prior_chi_square: float = 0.0) -> Adequacy:
        """The verdict on what was counted."""
        total = self._total + prior_chi_square
        probability = float(chdtrc(dof, total)) if dof > 0 else float("nan")
        found = [_test(*key, *sums) for key, sums in self._groups.items()]
        groups = tuple(sorted((g for g in found if g), key=lambda g: (g.probability, -g.unit_weight)))
        suspects = tuple(sorted(self._suspects, key=lambda x: -abs(x.normalised)))
        worst = groups[0].probability * len(groups) if groups else 1.0
        rejected = dof > 0 and (probability < REJECT or worst < REJECT)
        weight = float(np.sqrt(total / dof)) if dof > 0 else float("nan")
        verdict = _verdict(rejected, weight, probability, groups, suspects, dof)
        return Adequacy(total, dof, weight, probability, groups, suspects, rejected, verdict)


def _suspects(
    campaign: Campaign,
    residuals: list[np.ndarray],
    redundancy: list[np.ndarray],
    active: list[np.ndarray],
    limit: float,
) -> list[SuspectReading]:
    result = []
    for s, r, f, a in zip(campaign.sets, residuals, redundancy, active, strict=True):
        normalised = np.where(a & (f > 1e-6), r / np.sqrt(np.maximum(f, 1e-6)), 0.0)
        for i, k in zip(*np.nonzero(np.abs(normalised) > limit), strict=True):
            result.append(suspect(s, int(i), int(k), float(r[i, k]), float(normalised[i, k])))
    return result


def _verdict(rejected: bool, weight: float, probability: float, groups: Any, suspects: Any, dof: int) -> str:
    if dof <= 0:
        return "no redundancy: the readings cannot test the model"
    if not rejected:
        if weight < 0.8 and dof > 30:
            return f"model accepted by the data; unit weight {weight:.2f}: the stated uncertainties are pessimistic"
        return "model accepted by the data"
    where = "; ".join(f"{g.what} (unit weight {g.unit_weight:.2f})" for g in _worst(groups))
    chance = f"probability {probability:.1e}" if probability > 0.0 else "probability below 1e-300"
    text = f"model rejected by the data (unit weight {weight:.2f}, {chance}); worst: {where}"
    if suspects:
        text += f"; {len(suspects)} reading(s) beyond the critical value, first {suspects[0].where}"
    return text


def _worst(groups: tuple[GroupTest, ...]) -> list[GroupTest]:
    """The least probable groups, one of each sort: region, linear positions, angles, direction, station, …; entire sets last."""
    found: dict[str, GroupTest] = {}
    for group in sorted(groups, key=lambda g: g.sort == SET):
        found.setdefault(group.sort, group)
    return list(found.values())[:WORST]
