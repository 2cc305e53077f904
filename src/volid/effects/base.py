"""Systematic effects (`[[set.effect]]`): errors that readings share, as nuisance parameters known to within their u.

    reading = prediction(tool + Σ τ, …) + Σ a ξ,   ξ, τ of mean 0 and standard uncertainty u, one for each scope (`per`)

| type | a, or what it acts on | unit of u |
|---|---|---|
| scale | the reading itself (refractive index); each of its `components` ("XYZ", sensor scale) with a factor of its own | 1 |
| offset | 1, for every component of a reading on its own | the reading's |
| drift, form = "linear" | time since the scope's first reading [h], in all sets that share it | the reading's per hour |
| drift, form = "random walk" | increments between `NODES` instants, straight in between | the reading's per √h |
| tool_length | tool vector, `components` of it ("Z" by default, "XYZ" for all) | mm |
| temperature | expansion · length for the temperature; (temperature - 20 °C) · length for `u_expansion` [1/K, normal] | K |
| repeatability | axis positions (linear axes, or those of `axes` = { X = 0.001, … }), anew at every reading | mm |

An effect is one unknown of the fit per scope, with its u as prior knowledge: what the data say of it lowers its u, the rest
goes into every result, and closures determine drift. The length that expands is the reading less its dead path. With `per` =
"point" (always for repeatability) an effect is drawn anew for every reading and adds to its u, see `random_effects`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, Effect, ObservationSet
from volid.effects.distributions import NORMAL
from volid.exceptions import InputError
from volid.model.machine import Machine
from volid.observations import KINDS
from volid.observations.base import Group, NuisanceTable

TYPES = ("scale", "offset", "drift", "tool_length", "repeatability", "temperature")
SCOPES = ("campaign", "set", "station", "segment", "tool", "point")
POINT = "point"
FORMS = ("linear", "random walk")
NODES = 12  # instants of a random walk after its first reading
REFERENCE_TEMPERATURE = 20.0  # °C, ISO 1
HOUR = 3600.0  # s
COMPONENTS = "XYZ"
EXPANSION = "expansion"


class Form(NamedTuple):
    """Static part of a group of readings: kind, settings, readings per row, tool components and additive terms of effects."""

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


class _Term(NamedTuple):
    """One additive term: factors a (m, k), and the number of its nuisance parameter for every row, (m,)."""

    factor: np.ndarray
    slot: np.ndarray


def predict_readings(machine: Machine, form: Form, q: Any, tool: Any, errors: Any, slots: Any, constants: Any) -> Any:
    """Predicted readings (k, m) of one group, effects included."""
    k, n = form.n_readings, form.additive
    own = len(slots) - len(form.tool) - n
    own_constants = len(constants) - n * k
    vector = list(tool)
    for i, component in enumerate(form.tool):
        vector[component] = vector[component] + slots[own + i]
    predict = KINDS[form.kind].predict
    values = predict(machine, form.settings, q, tuple(vector), errors, slots[:own], constants[:own_constants])
    first = own + len(form.tool)
    for j in range(n):
        factors = constants[own_constants + j * k : own_constants + (j + 1) * k]
        values = in_rows([v + f * slots[first + j] for v, f in zip(values, factors, strict=True)], np.shape(q[0]))
    return values


def groups_of(
    observations: ObservationSet, campaign: Campaign, table: NuisanceTable, *, effects: bool = True
) -> list[Extended]:
    """Groups of a set with the nuisance parameters of its kind and, unless `effects` is False, of its effects."""
    kind = KINDS[observations.kind]
    k = observations.readings.shape[1]
    found: list[Group] = kind.groups(observations, campaign, table)
    shared = [e for e in observations.effects if not is_random(e)] if effects else []
    tools = [(c, s) for e in shared if e.type == "tool_length" for c, s in _tool_slots(observations, e, table)]
    terms = [t for e in shared if e.type != "tool_length" for t in _terms(observations, campaign, e, table)]
    result = []
    for group in found:
        slots = [group.slots, *(s[None, group.rows] for _, s in tools), *(t.slot[None, group.rows] for t in terms)]
        constants = [group.constants, *(t.factor[group.rows].T for t in terms)]
        form = Form(observations.kind, group.settings, k, tuple(c for c, _ in tools), len(terms))
        result.append(Extended(group.rows, form, np.concatenate(slots), np.concatenate(constants)))
    return result


def effect_samples(campaign: Campaign) -> dict[str, tuple[float, ...]]:
    """Values that effects with `distribution` = "samples" draw from, by the effect's name."""
    effects = [e for s in campaign.sets for e in s.effects]
    return {e.name: tuple(e.options["samples"]) for e in effects if "samples" in e.options}


def check_effects(observations: ObservationSet) -> None:
    """Raises `InputError` for a scope or components that the kind does not have, or drift without times."""
    names = {name.upper() for name in KINDS[observations.kind].readings}
    for effect in observations.effects:
        if effect.type == "scale" and not set(str(effect.options.get("components", ""))) <= names:
            raise InputError(
                f"set '{observations.name}', effect '{effect.name}': components = \"{effect.options['components']}\", but a "
                f"'{observations.kind}' reading has {', '.join(sorted(names))}; leave components out to scale the whole reading"
            )
        if not is_random(effect):
            _scopes(observations, effect)
        if effect.type == "drift":
            _hours(observations, effect)


def is_random(effect: Effect) -> bool:
    """True for what is drawn anew for every reading; see `random_effects`."""
    return effect.per == POINT or effect.type == "repeatability"


# ------------------------------------------------------------------------------------------------- effects that are shared


def _scopes(observations: ObservationSet, effect: Effect) -> list[tuple[str, np.ndarray]]:
    """Name and rows of every scope of an effect in a set."""
    m = len(observations)
    if effect.per == "campaign":
        return [("", np.arange(m))]
    if effect.per == "set":
        return [(observations.name, np.arange(m))]
    if effect.per == "tool":
        tools, index = np.unique(np.round(observations.tool, 6), axis=0, return_inverse=True)
        vectors = [f"tool ({t[0]:g}, {t[1]:g}, {t[2]:g})" for t in tools]
        return [(n, np.flatnonzero(np.ravel(index) == i)) for i, n in enumerate(vectors)]
    if "station" not in observations.labels or (effect.per == "segment" and "segment" not in observations.labels):
        raise InputError(
            f"set '{observations.name}', effect '{effect.name}': per = \"{effect.per}\", but a '{observations.kind}' set has no "
            f"{effect.per}s; expected campaign, set, tool or point"
        )
    names = observations.labels["station"].astype(str)
    if effect.per == "segment":
        names = np.char.add(np.char.add(names, " segment "), observations.labels["segment"].astype(str))
    return [(str(n), np.flatnonzero(names == n)) for n in dict.fromkeys(names)]


def _index(table: NuisanceTable, effect: Effect, scope: str, what: str, unit: str, u: float) -> int:
    """Number of the parameter of one scope. Raises `InputError` when two sets say different things of one effect."""
    name = " ".join(part for part in (effect.name, scope, what) if part)
    distribution = NORMAL if what == EXPANSION else str(effect.options.get("distribution", NORMAL))
    number = table.index(
        ("effect", effect.name, scope, what),
        name,
        unit,
        prior_u=u,
        distribution=distribution,
        effect=effect.name,
    )
    if table.entries[number].prior_u != u:
        raise InputError(
            f"effect '{effect.name}': u is {effect.u:g} in one set and another in the next, but its scope {effect.per} spans "
            "both; give the effects different names or the same u"
        )
    return number


def _tool_slots(observations: ObservationSet, effect: Effect, table: NuisanceTable) -> list[tuple[int, np.ndarray]]:
    result = []
    for letter in str(effect.options.get("components", "Z")):
        slot = np.zeros(len(observations), dtype=np.int64)
        for scope, rows in _scopes(observations, effect):
            slot[rows] = _index(table, effect, scope, letter, "mm", effect.u)
        result.append((COMPONENTS.index(letter), slot))
    return result


def lengths_of(observations: ObservationSet) -> np.ndarray:
    """The readings a scale acts on, (m, k): lengths; angles of a polar reading have no scale."""
    return np.where(_is_angle(observations), 0.0, observations.readings)


def _is_angle(observations: ObservationSet) -> np.ndarray:
    names = KINDS[observations.kind].readings
    return np.array([name in ("azimuth", "elevation") for name in names])


def _temperature(observations: ObservationSet, effect: Effect) -> np.ndarray:
    """Temperature minus 20 °C for every row, from the column, else from the key `temperature`."""
    given = float(effect.options.get("temperature", REFERENCE_TEMPERATURE))
    if observations.temperature is None:
        return np.full(len(observations), given - REFERENCE_TEMPERATURE)
    return np.where(np.isnan(observations.temperature), given, observations.temperature) - REFERENCE_TEMPERATURE


def _hours(observations: ObservationSet, effect: Effect) -> np.ndarray:
    if observations.time is None or not np.all(np.isfinite(observations.time)):
        raise InputError(
            f"set '{observations.name}', effect '{effect.name}': drift needs a time (s) for every row; add a column time"
        )
    return np.asarray(observations.time) / HOUR


def _terms(observations: ObservationSet, campaign: Campaign, effect: Effect, table: NuisanceTable) -> list[_Term]:
    """Additive terms of one effect on all rows of a set."""
    kind = KINDS[observations.kind]
    if effect.type == "scale":
        return _scale(observations, effect, table)
    if effect.type == "temperature":
        expansion = float(effect.options["expansion"])
        lengths = lengths_of(observations) - _dead_paths(observations, table)
        terms = [_term(observations, effect, table, expansion * lengths, "K")]
        u = float(effect.options.get("u_expansion", 0.0))
        if u > 0.0:
            factor = _temperature(observations, effect)[:, None] * lengths
            slot = np.full(len(observations), _index(table, effect, "", EXPANSION, "1/K", u))
            terms.append(_Term(factor, slot))
        return terms
    terms = []
    for c in range(len(kind.readings)):
        column = np.zeros((len(observations), len(kind.readings)))
        column[:, c] = 1.0
        what = kind.readings[c] if len(kind.readings) > 1 else ""
        if effect.type == "offset":
            terms.append(_term(observations, effect, table, column, kind.unit_of(c), what))
        else:
            terms += _drift(observations, campaign, effect, table, column, what)
    return terms


def _scale(observations: ObservationSet, effect: Effect, table: NuisanceTable) -> list[_Term]:
    """One factor for the whole reading, or one for each of its `components`."""
    lengths, names = lengths_of(observations), KINDS[observations.kind].readings
    if "components" not in effect.options:
        return [_term(observations, effect, table, lengths, "1")]
    letters = str(effect.options["components"])
    own = [(c, np.array([name.upper() == c for name in names])) for c in letters]
    return [_term(observations, effect, table, np.where(column, lengths, 0.0), "1", c) for c, column in own]


def _dead_paths(observations: ObservationSet, table: NuisanceTable) -> np.ndarray:
    """Start values of the dead paths in relative distances, (m, 1); 0 for readings without."""
    if observations.kind != "distance" or not observations.options.get("relative", True):
        return np.zeros((len(observations), 1))
    beams = zip(observations.labels["station"], observations.labels["segment"], strict=True)
    return np.array([[table.starts.get(("dead path", str(s), str(g)), 0.0)] for s, g in beams])


def _term(
    observations: ObservationSet, effect: Effect, table: NuisanceTable, factor: np.ndarray, unit: str, what: str = ""
) -> _Term:
    slot = np.zeros(len(observations), dtype=np.int64)
    for scope, rows in _scopes(observations, effect):
        slot[rows] = _index(table, effect, scope, what, unit, effect.u)
    return _Term(factor, slot)


def _span(campaign: Campaign, effect: Effect, scope: str) -> tuple[float, float]:
    """First and last time [h] of a scope in all sets that the effect acts on; sets of a campaign share one clock."""
    hours = [
        _hours(s, e)[rows]
        for s in campaign.sets
        for e in s.effects
        if (e.name, e.type) == (effect.name, effect.type)
        for name, rows in _scopes(s, e)
        if name == scope
    ]
    whole = np.concatenate(hours)
    return float(whole.min()), float(whole.max())


def _drift(
    observations: ObservationSet,
    campaign: Campaign,
    effect: Effect,
    table: NuisanceTable,
    column: np.ndarray,
    what: str,
) -> list[_Term]:
    hours, kind = _hours(observations, effect), KINDS[observations.kind]
    unit = kind.unit_of(kind.readings.index(what) if what else 0)
    scopes = [(name, rows, *_span(campaign, effect, name)) for name, rows in _scopes(observations, effect)]
    since = np.zeros(len(observations))
    if effect.options.get("form", FORMS[0]) == FORMS[0]:
        for _, rows, first, _ in scopes:
            since[rows] = hours[rows] - first
        return [_term(observations, effect, table, column * since[:, None], f"{unit}/h", what)]
    terms = []
    for node in range(NODES):
        ramp, slot = np.zeros(len(observations)), np.zeros(len(observations), dtype=np.int64)
        for scope, rows, first, last in scopes:
            step = (last - first) / NODES
            if step > 0.0:
                ramp[rows] = np.clip((hours[rows] - first) / step - node, 0.0, 1.0)
            u = effect.u * np.sqrt(max(step, 1e-9))
            slot[rows] = _index(table, effect, scope, f"{what} step {node + 1}".strip(), unit, u)
        terms.append(_Term(column * ramp[:, None], slot))
    return terms
