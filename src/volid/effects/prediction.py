"""Readings with their systematic effects (`[[set.effect]]`): errors that readings share, as unknowns known to within their u.

    reading = prediction(tool + Σ τ, …) + Σ a ξ,   ξ, τ of mean 0 and standard uncertainty u, one for each scope (`per`)

The file of each type says what a and τ are. An effect is one unknown of the fit per scope, with its u as prior knowledge: the
data may reduce this u, and what remains of it contributes to the uncertainty of every result. With `per` = "point" (always for
repeatability) an effect is drawn anew for every reading and adds to its u, see `random`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, Effect, ObservationSet
from volid.effects import TYPES
from volid.effects.base import POINT, scopes_of
from volid.model.machine import Machine
from volid.observations import KINDS
from volid.observations.base import NuisanceTable


class Form(NamedTuple):
    """Static part of a group of readings: kind, settings, readings per row, tool components (those of a second end are 3, 4, 5)
    and additive terms of effects."""

    kind: str
    settings: Any
    n_readings: int
    tool: tuple[int, ...] = ()
    additive: int = 0


class Extended(NamedTuple):
    """A group of rows with its effects: like `Group`, `slots` and `constants` hold those of the effects after its own."""

    rows: np.ndarray
    form: Form
    slots: np.ndarray
    constants: np.ndarray


def predict_readings(machine: Machine, form: Form, q: Any, tool: Any, errors: Any, slots: Any, constants: Any) -> Any:
    """Predicted readings (k, m) of one group, effects included."""
    k, n = form.n_readings, form.additive
    before = len(slots) - len(form.tool) - n
    constants_before = len(constants) - n * k
    vector = list(tool)
    for i, component in enumerate(form.tool):
        vector[component] = vector[component] + slots[before + i]
    predict = KINDS[form.kind].predict
    values = predict(machine, form.settings, q, tuple(vector), errors, slots[:before], constants[:constants_before])
    first = before + len(form.tool)
    for j in range(n):
        factors = constants[constants_before + j * k : constants_before + (j + 1) * k]
        values = in_rows([v + f * slots[first + j] for v, f in zip(values, factors, strict=True)], np.shape(q[0]))
    return values


def groups_of(
    observations: ObservationSet, campaign: Campaign, table: NuisanceTable, *, effects: bool = True
) -> list[Extended]:
    """Groups of a set with the nuisance parameters of its kind and, unless `effects` is False, of its effects."""
    found = KINDS[observations.kind].groups(observations, campaign, table)
    shared = [e for e in observations.effects if not is_random(e)] if effects else []
    tools = [t for e in shared for t in TYPES[e.type].tool_shifts(e, observations, table)]
    terms = [t for e in shared for t in TYPES[e.type].terms(e, observations, campaign, table)]
    result = []
    for group in found:
        slots = [group.slots, *(t.slot[None, group.rows] for t in tools), *(t.slot[None, group.rows] for t in terms)]
        constants = [group.constants, *(t.factor[group.rows].T for t in terms)]
        components = tuple(t.component for t in tools)
        form = Form(observations.kind, group.settings, observations.readings.shape[1], components, len(terms))
        result.append(Extended(group.rows, form, np.concatenate(slots), np.concatenate(constants)))
    return result


def effect_samples(campaign: Campaign) -> dict[str, tuple[float, ...]]:
    """Values that effects with `distribution` = "samples" draw from, by the effect's name."""
    effects = [e for s in campaign.sets for e in s.effects]
    return {e.name: tuple(e.options["samples"]) for e in effects if "samples" in e.options}


def check_effects(observations: ObservationSet) -> None:
    """Raises `InputError` for a scope that the kind does not have, or options that do not fit the readings."""
    for effect in observations.effects:
        TYPES[effect.type].check(effect, observations)
        if not is_random(effect):
            list(scopes_of(observations, effect))


def is_random(effect: Effect) -> bool:
    """True for an effect that is drawn anew for every reading; see `random`."""
    return effect.per == POINT or TYPES[effect.type].always_random
