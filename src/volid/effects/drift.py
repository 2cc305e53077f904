"""`drift`: readings that wander with time, in all sets that share a scope; sets of a campaign share one clock.

    form = "linear":       reading += ξ · t,        t [h] since the scope's first reading; u in the reading's unit per hour
    form = "random walk":  reading += Σ ξ_j r_j(t), increments between `NODES` instants, straight in between; u per √h

Closures determine it. Not modelled: a drift that is different in the two directions of travel.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from volid.campaign import Campaign, Effect, ObservationSet
from volid.effects.base import (
    Choice,
    EffectType,
    FileKey,
    Sensitivity,
    Term,
    columns_of,
    scopes_of,
    slots_of,
    unknown_of,
)
from volid.exceptions import InputError
from volid.model.machine import Machine
from volid.observations.base import NuisanceTable

LINEAR, RANDOM_WALK = "linear", "random walk"
NODES = 12  # instants of a random walk after its first reading
HOUR = 3600.0  # s


class Drift(EffectType):
    """A function of time."""

    name = "drift"
    keys: Mapping[str, FileKey] = {"form": Choice((LINEAR, RANDOM_WALK))}
    never_random = True
    spans_campaign = True

    def terms(
        self, effect: Effect, observations: ObservationSet, campaign: Campaign, table: NuisanceTable
    ) -> list[Term]:
        """One term for every component, or one for every increment of it."""
        own = _linear if effect.options.get("form", LINEAR) == LINEAR else _random_walk
        spans = [(n, rows, *_span(campaign, effect, n)) for n, rows in scopes_of(observations, effect)]
        result = []
        for column, what, unit in columns_of(observations):
            result += own(effect, observations, spans, table, column, (what, unit))
        return result

    def variance(
        self, effect: Effect, observations: ObservationSet, machine: Machine, sensitivity: Sensitivity
    ) -> np.ndarray:
        """Never asked for: a drift is no property of single readings."""
        raise InputError(f"effect '{effect.name}': drift is not drawn anew for every reading")

    def check(self, effect: Effect, observations: ObservationSet) -> None:
        """Raises `InputError` where a row has no time."""
        _hours(observations, effect)


_Spans = list[tuple[str, np.ndarray, float, float]]  # scope, its rows, its first and last time [h]


def _linear(
    effect: Effect,
    observations: ObservationSet,
    spans: _Spans,
    table: NuisanceTable,
    column: np.ndarray,
    named: tuple[str, str],
) -> list[Term]:
    hours, since = _hours(observations, effect), np.zeros(len(observations))
    for _, rows, first, _ in spans:
        since[rows] = hours[rows] - first
    slot = slots_of(observations, effect, table, f"{named[1]}/h", named[0])
    return [Term(column * since[:, None], slot)]


def _random_walk(
    effect: Effect,
    observations: ObservationSet,
    spans: _Spans,
    table: NuisanceTable,
    column: np.ndarray,
    named: tuple[str, str],
) -> list[Term]:
    hours, terms = _hours(observations, effect), []
    for node in range(NODES):
        ramp, slot = np.zeros(len(observations)), np.zeros(len(observations), dtype=np.int64)
        for scope, rows, first, last in spans:
            step = (last - first) / NODES
            if step > 0.0:
                ramp[rows] = np.clip((hours[rows] - first) / step - node, 0.0, 1.0)
            u = effect.u * np.sqrt(max(step, 1e-9))
            slot[rows] = unknown_of(table, effect, scope, f"{named[0]} step {node + 1}".strip(), named[1], u)
        terms.append(Term(column * ramp[:, None], slot))
    return terms


def _hours(observations: ObservationSet, effect: Effect) -> np.ndarray:
    if observations.time is None or not np.all(np.isfinite(observations.time)):
        raise InputError(
            f"set '{observations.name}', effect '{effect.name}': drift needs a time (s) for every row; add a column time"
        )
    return np.asarray(observations.time) / HOUR


def _span(campaign: Campaign, effect: Effect, scope: str) -> tuple[float, float]:
    """First and last time [h] of a scope in all sets that the effect acts on."""
    hours = [
        _hours(s, e)[rows]
        for s in campaign.sets
        for e in s.effects
        if (e.name, e.type) == (effect.name, effect.type)
        for name, rows in scopes_of(s, e)
        if name == scope
    ]
    whole = np.concatenate(hours)
    return float(whole.min()), float(whole.max())


DRIFT = Drift()
