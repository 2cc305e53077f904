"""What every type of systematic effect declares, so that files, fit, budget and simulation treat all types alike."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from volid.campaign import SAME_TOOL, Campaign, Effect, ObservationSet
from volid.effects.distributions import NORMAL
from volid.exceptions import InputError
from volid.model.machine import Machine
from volid.observations import KINDS
from volid.observations.base import NuisanceTable

CAMPAIGN, SET, TOOL, POINT = "campaign", "set", "tool", "point"
COMPONENTS = "XYZ"


# ------------------------------------------------------------------------------------ keys of a [[set.effect]] of one type


@dataclass(frozen=True)
class Number:
    """A number: `above` or at `least` a bound; with a `default` of None it is left out where it is not given."""

    above: float | None = None
    least: float | None = None
    required: bool = False


@dataclass(frozen=True)
class Choice:
    """One of several texts; the first is the default."""

    texts: tuple[str, ...]


@dataclass(frozen=True)
class Letters:
    """One or more of the letters of `COMPONENTS`, each at most once."""


@dataclass(frozen=True)
class PerAxis:
    """A number for some axes of the machine, { X = 0.001, … }, at `least` a bound."""

    least: float = 0.0


FileKey = Number | Choice | Letters | PerAxis


# ------------------------------------------------------------------------------------------------------- what an effect does


class Term(NamedTuple):
    """One additive term a·ξ of all readings of a set: factors a (m, k), and the number of ξ for every row, (m,)."""

    factor: np.ndarray
    slot: np.ndarray


class ToolShift(NamedTuple):
    """One component of the tool vector with an unknown error: its number 0, 1 or 2 (3, 4, 5 at a second end), and the unknown's
    number by row, (m,)."""

    component: int
    slot: np.ndarray


class Sensitivity(NamedTuple):
    """∂reading/∂(axis position) (ends·n_axes, m, k) and ∂reading/∂(tool vector) (ends·3, m, k) at the nominal machine."""

    by_axis: np.ndarray
    by_tool: np.ndarray


class EffectType(ABC):
    """One type of systematic effect. Each type has one final class that says what it does; its only instance is in the table.

    `keys`: keys of the file besides those that all types have. `always_random`: the effect is drawn anew for every reading,
    whatever `per` says; `never_random`: it never is. `spans_campaign`: it needs all readings of the campaign at once.
    """

    name: str
    keys: Mapping[str, FileKey] = {}
    always_random: bool = False
    never_random: bool = False
    spans_campaign: bool = False

    def terms(
        self, effect: Effect, observations: ObservationSet, campaign: Campaign, table: NuisanceTable
    ) -> list[Term]:
        """Additive terms on all rows of a set."""
        return []

    def tool_shifts(self, effect: Effect, observations: ObservationSet, table: NuisanceTable) -> list[ToolShift]:
        """The unknown errors of the tool vectors of a set."""
        return []

    @abstractmethod
    def variance(
        self, effect: Effect, observations: ObservationSet, machine: Machine, sensitivity: Sensitivity
    ) -> np.ndarray:
        """Variance (m, k) that the effect adds where it is drawn anew for every reading."""

    def check(self, effect: Effect, observations: ObservationSet) -> None:
        """Raises `InputError` for options that do not fit the readings."""
        return

    def scopes(self, labelled: tuple[str, ...]) -> tuple[str, ...]:
        """What `per` may be; `labelled`: the scopes that kinds make from their labels."""
        if self.always_random:
            return (POINT,)
        return (CAMPAIGN, SET, *labelled, TOOL, *(() if self.never_random else (POINT,)))


# ------------------------------------------------------------------------------------------------- tools for the types


def labelled_scopes() -> tuple[str, ...]:
    """Scopes that any kind makes from its labels: station, segment, …"""
    return tuple(dict.fromkeys(scope for kind in KINDS.values() for scope in kind.scopes))


def lengths_of(observations: ObservationSet) -> np.ndarray:
    """The lengths that a scale acts on, (m, k), with 0 for angles, which have no scale."""
    return KINDS[observations.kind].lengths(observations)


def scopes_of(observations: ObservationSet, effect: Effect) -> Iterator[tuple[str, np.ndarray]]:
    """Name and rows of every scope of an effect in a set. Raises `InputError` for a scope that the kind does not have."""
    m = len(observations)
    if effect.per in (CAMPAIGN, SET):
        yield "" if effect.per == CAMPAIGN else observations.name, np.arange(m)
        return
    if effect.per == TOOL:
        tools, index = np.unique(np.round(observations.tool, SAME_TOOL), axis=0, return_inverse=True)
        for i, t in enumerate(tools):
            yield f"tool ({t[0]:g}, {t[1]:g}, {t[2]:g})", np.flatnonzero(np.ravel(index) == i)
        return
    labels = KINDS[observations.kind].scopes.get(effect.per)
    if labels is None:
        raise InputError(
            f"set '{observations.name}', effect '{effect.name}': per = \"{effect.per}\", but a '{observations.kind}' set has no "
            f"{effect.per}s; expected {', '.join((CAMPAIGN, SET, *KINDS[observations.kind].scopes, TOOL))} or {POINT}"
        )
    names = observations.labels[labels[0]].astype(str)
    for label in labels[1:]:
        names = np.char.add(np.char.add(names, f" {label} "), observations.labels[label].astype(str))
    for name in dict.fromkeys(names):
        yield str(name), np.flatnonzero(names == name)


def unknown_of(
    table: NuisanceTable,
    effect: Effect,
    scope: str,
    what: str,
    unit: str,
    u: float,
    distribution: str | None = None,
) -> int:
    """Number of the unknown of one scope. Raises `InputError` when two sets state one effect differently."""
    number = table.index(
        ("effect", effect.name, scope, what),
        " ".join(part for part in (effect.name, scope, what) if part),
        unit,
        prior_u=u,
        distribution=distribution or str(effect.options.get("distribution", NORMAL)),
        effect=effect.name,
    )
    if table.entries[number].prior_u != u:
        raise InputError(
            f"effect '{effect.name}': u is {effect.u:g} in one set and another in the next, but its scope {effect.per} spans "
            "both; give the effects different names or the same u"
        )
    return number


def slots_of(
    observations: ObservationSet, effect: Effect, table: NuisanceTable, unit: str, what: str = ""
) -> np.ndarray:
    """Numbers of the unknowns of all scopes by row, (m,), each with the effect's u."""
    slot = np.zeros(len(observations), dtype=np.int64)
    for scope, rows in scopes_of(observations, effect):
        slot[rows] = unknown_of(table, effect, scope, what, unit, effect.u)
    return slot


def columns_of(observations: ObservationSet) -> Iterator[tuple[np.ndarray, str, str]]:
    """For every component of a reading: 1 in its column (m, k), its name (empty when there is only one), and its unit."""
    kind = KINDS[observations.kind]
    for c, name in enumerate(kind.readings):
        column = np.zeros((len(observations), len(kind.readings)))
        column[:, c] = 1.0
        yield column, name if len(kind.readings) > 1 else "", kind.unit_of(c)
