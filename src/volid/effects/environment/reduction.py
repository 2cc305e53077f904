"""Readings as they would be in vacuum and with everything at 20 °C: one pure function before any problem is built.

With V = given · reading the reading in vacuum wavelengths, f its factor (`factors`), and f̄ the factor at the mean of the log,

    reduced = V / f + (c - d) · (f̄ / f - 1)

d is the dead path that the reading contains: a reading of `distance` is path + d, with d unknown but constant while the beam is
not interrupted. Only the path feels the air. Of d the formula takes what follows from the readings themselves (each station
placed with the nominal machine, after a first division by f); an error of 1 mm in it is multiplied by the change of f since the
mean of the log, some 1e-6, and stays below some nm. What is constant, f̄ d, belongs to the unknown dead path of the fit. c is
the key `dead_path`: path in air that no reading shows, such as that from beam splitter to reflector at the first reading of a
line.

Not modelled: a correction by the instrument itself that changes with time also changes the dead path, and is taken as right;
gradients along the beam; bending and gradients within bodies; a station that does not move with the machine when that expands.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from volid.campaign import AIR, Campaign, Effect, ObservationSet
from volid.effects.environment.checks import check_environments
from volid.effects.environment.factors import REFERENCE_TEMPERATURE, Factors, factors_of, u_of_index
from volid.effects.environment.matching import Matched, column_of, matched
from volid.effects.environment.remarks import remarks_on
from volid.observations import KINDS
from volid.observations.base import LIGHT

PASSES = 2  # dead paths follow from readings, and readings from dead paths; each pass leaves some 1e-4 of the error
TEMPERATURE, SCALE = "temperature", "scale"


def reduced(campaign: Campaign, starts: Mapping[Any, float] | None = None) -> Campaign:
    """The campaign with its readings reduced, and what was read beside them; effects of the environment's u are added.

    `starts`: start values of the dead paths by key, of a campaign of which this one is a part; None: they follow from the
    readings. Sets that are reduced already, or lack readings, stay as they are. Raises `InputError` naming what is wrong in
    an environment.
    """
    if not campaign.environments:
        return campaign
    check_environments(campaign)
    matches = {n: m for n, m in matched(campaign).items() if _is_open(m.observations)}
    if not matches:
        return campaign
    factors = {name: factors_of(match) for name, match in matches.items()}
    starts = _starts(campaign, matches, factors) if starts is None else starts
    found = _with(campaign, matches, factors, starts)
    sets = tuple(with_effects(s, matches[s.name], factors[s.name]) if s.name in matches else s for s in found.sets)
    return replace(found, sets=sets, warnings=tuple(dict.fromkeys((*campaign.warnings, *remarks_on(campaign)))))


def _is_open(observations: ObservationSet) -> bool:
    return observations.as_read is None and bool(np.isfinite(observations.readings).all())


def _with(
    campaign: Campaign, matches: Mapping[str, Matched], factors: Mapping[str, Factors], starts: Mapping[Any, float]
) -> Campaign:
    sets = []
    for s in campaign.sets:
        if s.name in matches:
            length = KINDS[s.kind].lengths(s)
            change = _reduced_lengths(length, matches[s.name], factors[s.name], starts) - length
            s = replace(s, readings=s.readings + change, as_read=s.readings)
        sets.append(s)
    return replace(campaign, sets=tuple(sets))


def _reduced_lengths(length: np.ndarray, match: Matched, factors: Factors, starts: Mapping[Any, float]) -> np.ndarray:
    """By the formula of the module, (m, k); angles, whose length is 0, stay."""
    f = factors.factor[:, None]
    return np.asarray(factors.given * length / f + _still(match, starts) * (factors.mean / f - 1.0))


def _still(match: Matched, starts: Mapping[Any, float]) -> np.ndarray:
    """c - d of every reading, (m, k) [mm]."""
    kind = KINDS[match.observations.kind]
    outside = match.environment.dead_path if match.medium == LIGHT else 0.0
    return np.asarray(np.where(kind.is_angle, 0.0, outside - kind.dead_paths(match.observations, starts)))


def starts_of(campaign: Campaign) -> dict[Any, float]:
    """Start values of dead paths by key, as `reduced` takes them for the parts of a campaign of which this is a sample."""
    matches = {n: m for n, m in matched(campaign).items() if _is_open(m.observations)}
    return _starts(campaign, matches, {name: factors_of(match) for name, match in matches.items()})


def _starts(campaign: Campaign, matches: Mapping[str, Matched], factors: Mapping[str, Factors]) -> dict[Any, float]:
    """Start values that the kinds of the matched sets find from reduced readings, dead paths among them."""
    kinds = dict.fromkeys(match.observations.kind for match in matches.values())
    found: dict[Any, float] = {}
    for _ in range(PASSES):
        rough = _with(campaign, matches, factors, found)
        found = {key: value for name in kinds for key, value in KINDS[name].starts(rough).items()}
    return found


def as_read(campaign: Campaign) -> Campaign:
    """The campaign as it was before it was reduced: the readings as they were read, without the environment's effects."""
    added = {e for environment in campaign.environments for e in effect_names(environment.name).values()}
    sets = []
    for s in campaign.sets:
        if s.as_read is not None:
            effects = tuple(e for e in s.effects if e.name not in added)
            s = replace(s, readings=s.as_read, as_read=None, effects=effects)
        sets.append(s)
    return replace(campaign, sets=tuple(sets))


def in_air(campaign: Campaign, starts: Mapping[Any, float]) -> Campaign:
    """The readings that an instrument shows in its environment where reduced ones are given: the inverse of `reduced`.

    `starts`: values of the dead paths by key. The environment's effects are left out, as `reduced` adds them.
    """
    sets, matches = [], matched(campaign)
    for s in campaign.sets:
        if s.name in matches:
            factors, length = factors_of(matches[s.name]), KINDS[s.kind].lengths(s)
            f = factors.factor[:, None]
            still = _still(matches[s.name], starts) * (factors.mean / f - 1.0)
            s = replace(s, as_read=s.readings + f * (length - still) / factors.given - length)
        sets.append(s)
    return as_read(replace(campaign, sets=tuple(sets)))


# ------------------------------------------------------------------------------------------------ what the log does not know


def effect_names(environment: str) -> dict[str, str]:
    """Names of the effects that an environment adds, by what they are of."""
    return {what: f"{what} of environment {environment}" for what in ("air", "machine", "artefact")}


def with_shared_effects(campaign: Campaign) -> Campaign:
    """The campaign with the effects that the environments' u add to its sets, which need no readings yet."""
    campaign = as_read(campaign)
    check_environments(campaign)
    matches = matched(campaign)
    sets = (
        with_effects(s, matches[s.name], factors_of(matches[s.name])) if s.name in matches else s for s in campaign.sets
    )
    return replace(campaign, sets=tuple(sets))


def with_effects(observations: ObservationSet, match: Matched, factors: Factors) -> ObservationSet:
    """The set with the effects of the u that its environment states, unless it states effects of that type itself.

    The air adds a `scale`, shared by all sets of the environment; a body adds a `temperature`, its u of temperature and of
    expansion. Where both bodies expand, the artefact's part is a `scale` with its mean temperature, as a set has one
    temperature a row.
    """
    environment, names = match.environment, effect_names(match.environment.name)
    stated = {e.type for e in observations.effects}
    effects: list[Effect] = []
    if factors.refractivity is not None and any(column in environment.u for column in AIR):
        effects.append(Effect(names["air"], SCALE, u_of_index(environment, environment.u), "campaign"))
    temperature = observations.temperature
    for body, known in match.bodies.items() if TEMPERATURE not in stated else ():
        u = environment.u.get(column_of(environment, known), 0.0)
        if not u:
            continue
        options = {"expansion": known.expansion, "u_expansion": known.u}
        if not any(e.type == TEMPERATURE for e in effects):
            effects.append(Effect(names[body], TEMPERATURE, u, "campaign", options))
            temperature = factors.temperatures[body] if temperature is None else temperature
        else:
            away = float(np.sqrt(np.mean((factors.temperatures[body] - REFERENCE_TEMPERATURE) ** 2)))
            effects.append(Effect(names[body], SCALE, float(np.hypot(known.expansion * u, known.u * away)), "campaign"))
    return replace(observations, effects=(*observations.effects, *effects), temperature=temperature)
