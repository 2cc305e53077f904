"""Systematic effects (`[[set.effect]]`): errors that readings share, as nuisance parameters known to within their u.

    reading = prediction(tool + Σ τ, …) + Σ a ξ,   ξ, τ of mean 0 and standard uncertainty u, one for each scope (`per`)

| type | a, or what it acts on | unit of u |
|---|---|---|
| scale | the reading itself (refractive index, sensor scale) | 1 |
| offset | 1, for every component of a reading on its own | the reading's |
| drift, form = "linear" | time since the scope's first reading [h] | the reading's per hour |
| drift, form = "random walk" | increments between `NODES` instants, straight in between | the reading's per √h |
| tool_length | tool vector, `components` of it ("Z" by default, "XYZ" for all) | mm |
| temperature | expansion · reading for the temperature; (temperature - 20 °C) · reading for `u_expansion` [1/K] | K |
| repeatability | axis positions (linear axes, or those of `axes` = { X = 0.001, … }), anew at every reading | mm |

An effect is one unknown of the fit per scope, with its u as prior knowledge: what the data say of it lowers its u, the rest
goes into every result, and closures determine drift. With `per` = "point" (always for repeatability) it is drawn anew for every
reading and adds to the reading's u. Not modelled: correlation between the components of one reading that such an effect makes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from volid.campaign import Campaign, Effect, ObservationSet
from volid.exceptions import InputError
from volid.machine import Machine
from volid.observations import KINDS
from volid.observations.base import Group, NuisanceTable
from volid.observations.distributions import NORMAL

TYPES = ("scale", "offset", "drift", "tool_length", "repeatability", "temperature")
SCOPES = ("campaign", "set", "station", "segment", "tool", "point")
POINT = "point"
FORMS = ("linear", "random walk")
NODES = 12  # instants of a random walk after its first reading
REFERENCE_TEMPERATURE = 20.0  # °C, ISO 1
HOUR = 3600.0  # s
COMPONENTS = "XYZ"


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
        values = values + jnp.stack([factor * slots[first + j] for factor in factors])
    return values


def groups_of(
    observations: ObservationSet, campaign: Campaign, table: NuisanceTable, *, effects: bool = True
) -> list[Extended]:
    """Groups of a set with the nuisance parameters of its kind and, unless `effects` is False, of its effects."""
    kind = KINDS[observations.kind]
    k = observations.readings.shape[1]
    found: list[Group] = kind.groups(observations, campaign, table)
    shared = [e for e in observations.effects if not _is_random(e)] if effects else []
    tools = [(c, s) for e in shared if e.type == "tool_length" for c, s in _tool_slots(observations, e, table)]
    terms = [t for e in shared if e.type != "tool_length" for t in _terms(observations, e, table)]
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
    """Raises `InputError` for a scope that the kind does not have, or drift without times."""
    for effect in observations.effects:
        if not _is_random(effect):
            _scopes(observations, effect)
        if effect.type == "drift":
            _hours(observations, effect)


def _is_random(effect: Effect) -> bool:
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
    number = table.index(
        ("effect", effect.name, scope, what),
        name,
        unit,
        prior_u=u,
        distribution=str(effect.options.get("distribution", NORMAL)),
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


def _lengths(observations: ObservationSet) -> np.ndarray:
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


def _terms(observations: ObservationSet, effect: Effect, table: NuisanceTable) -> list[_Term]:
    """Additive terms of one effect on all rows of a set."""
    kind = KINDS[observations.kind]
    if effect.type == "scale":
        return [_term(observations, effect, table, _lengths(observations), "1")]
    if effect.type == "temperature":
        expansion = float(effect.options["expansion"])
        lengths = _lengths(observations)
        terms = [_term(observations, effect, table, expansion * lengths, "K")]
        u = float(effect.options.get("u_expansion", 0.0))
        if u > 0.0:
            factor = _temperature(observations, effect)[:, None] * lengths
            slot = np.full(len(observations), _index(table, effect, "", "expansion", "1/K", u))
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
            terms += _drift(observations, effect, table, column, what)
    return terms


def _term(
    observations: ObservationSet, effect: Effect, table: NuisanceTable, factor: np.ndarray, unit: str, what: str = ""
) -> _Term:
    slot = np.zeros(len(observations), dtype=np.int64)
    for scope, rows in _scopes(observations, effect):
        slot[rows] = _index(table, effect, scope, what, unit, effect.u)
    return _Term(factor, slot)


def _drift(
    observations: ObservationSet, effect: Effect, table: NuisanceTable, column: np.ndarray, what: str
) -> list[_Term]:
    hours, kind = _hours(observations, effect), KINDS[observations.kind]
    unit = kind.unit_of(kind.readings.index(what) if what else 0)
    scopes = _scopes(observations, effect)
    since = np.zeros(len(observations))
    if effect.options.get("form", FORMS[0]) == FORMS[0]:
        for _, rows in scopes:
            since[rows] = hours[rows] - hours[rows].min()
        return [_term(observations, effect, table, column * since[:, None], f"{unit}/h", what)]
    terms = []
    for node in range(NODES):
        ramp, slot = np.zeros(len(observations)), np.zeros(len(observations), dtype=np.int64)
        for scope, rows in scopes:
            first, step = hours[rows].min(), np.ptp(hours[rows]) / NODES
            if step > 0.0:
                ramp[rows] = np.clip((hours[rows] - first) / step - node, 0.0, 1.0)
            u = effect.u * np.sqrt(max(step, 1e-9))
            slot[rows] = _index(table, effect, scope, f"{what} step {node + 1}".strip(), unit, u)
        terms.append(_Term(column * ramp[:, None], slot))
    return terms


# ------------------------------------------------------------------------------------- effects drawn anew for every reading


@eqx.filter_jit
def _sensitivities(machine: Machine, form: Form, q: Any, tool: Any, slots: Any, constants: Any) -> tuple[Any, Any]:
    """∂reading/∂q (n_axes, k, m) and ∂reading/∂tool (3, k, m) at the nominal machine."""
    errors = jnp.zeros((6 * (len(machine.axes) + 1), q.shape[1]))

    def readings(q: Any, tool: Any) -> Any:
        return predict_readings(machine, form, q, tuple(tool), errors, slots, constants)

    def along(i: int, n: int) -> Any:
        return jnp.ones_like(q[0]) * (jnp.arange(n) == i)[:, None]

    axes = [jax.jvp(lambda x: readings(x, tool), (q,), (along(i, len(q)),))[1] for i in range(len(q))]
    tools = [jax.jvp(lambda x: readings(q, x), (tool,), (along(i, 3),))[1] for i in range(3)]
    return jnp.stack(axes), jnp.stack(tools)


def random_variance(
    observations: ObservationSet, machine: Machine, groups: list[Extended], values: np.ndarray
) -> np.ndarray:
    """Variance (m, k) that effects drawn anew for every reading add; `values`: nuisance parameters, roughly."""
    total = np.zeros(observations.readings.shape)
    random = [e for e in observations.effects if _is_random(e)]
    if not random:
        return total
    by_axis, by_tool = _all_sensitivities(observations, machine, groups, values)
    for effect in random:
        if effect.type == "repeatability":
            given = effect.options.get("axes")
            scatter = given if isinstance(given, Mapping) else {a.letter: effect.u for a in machine.axes if a.is_linear}
            for letter, u in scatter.items():
                total += (float(u) * by_axis[machine.index(letter)]) ** 2
        elif effect.type == "tool_length":
            for letter in str(effect.options.get("components", "Z")):
                total += (effect.u * by_tool[COMPONENTS.index(letter)]) ** 2
        elif effect.type == "offset":
            total += effect.u**2
        else:
            expansion = float(effect.options["expansion"]) if effect.type == "temperature" else 1.0
            total += (effect.u * expansion * _lengths(observations)) ** 2
    return total


def _all_sensitivities(
    observations: ObservationSet, machine: Machine, groups: list[Extended], values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sensitivities of every row, (n_axes, m, k) and (3, m, k)."""
    k = observations.readings.shape[1]
    by_axis = np.zeros((len(machine.axes), len(observations), k))
    by_tool = np.zeros((3, len(observations), k))
    for group in groups:
        arrays = (observations.positions[group.rows].T, observations.tool[group.rows].T, values[group.slots])
        numbers = [jnp.asarray(a, dtype=float) for a in (*arrays, group.constants)]
        chain = Machine(name="", structure="", axes=machine.axes)
        axes, tools = (np.asarray(s).transpose(0, 2, 1) for s in _sensitivities(chain, group.form, *numbers))
        by_axis[:, group.rows], by_tool[:, group.rows] = axes, tools
    return by_axis, by_tool
