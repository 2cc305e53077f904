"""`simulate`: readings of a virtual machine by virtual instruments, through the predictions that the fit itself uses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from volid.campaign import Campaign, Effect, ObservationSet, Station, standard_uncertainty
from volid.effects.distributions import standardised
from volid.effects.environment.reduction import in_air, with_shared_effects
from volid.effects.prediction import Extended, effect_samples, groups_of
from volid.effects.random import random_parts, split_normal
from volid.exceptions import InputError
from volid.fitting.equations.choice import engine_for_readings
from volid.fitting.equations.engine import Engine
from volid.fitting.equations.sensitivities import sensitivities_of
from volid.model.kinematics import chain_of
from volid.model.machine import Machine
from volid.model.requests import ask_positions, ask_tools
from volid.observations import KINDS
from volid.observations.base import Nuisance, NuisanceTable
from volid.planning.standard import standard_plan
from volid.plausibility.conditions import ACTIVE, active_compensations
from volid.virtual.drives import Drives, errors_of
from volid.virtual.random_truth import generator, random_truth
from volid.virtual.truth import Truth

STATION_ERROR = 5.0  # mm


def simulate(
    plan: Campaign | Machine,
    truth: Truth | None = None,
    *,
    seed: int = 0,
    noise: bool = True,
    station_error: float | None = STATION_ERROR,
    control: Drives | None = None,
) -> tuple[Campaign, Truth]:
    """The campaign that a plan gives on a virtual machine, and everything that is true about it.

    reading = prediction(true errors, true stations, true dead paths) + u·N(0, 1), u constant and proportional to the
    reading as the plan states.

    The plan says where stations and spheres truly stand; where it does not place a station, the truth does. What truth and
    plan leave open is drawn from `seed`: dead paths, offsets, calibrated lengths, the placement of known stations. Systematic
    effects of a set are drawn too, once for each scope. The resolution of an instrument and hidden lines of sight are not
    simulated.

    With a `control`, the drives go where it corrects the programmed positions to, and the instruments see the pose reached
    there; `volid.virtual.drives` says in which direction drives arrive whose axes rest. The campaign holds the programmed
    positions, and under [conditions] `active_compensations` what was active. The truth stays that of the machine itself.

    Args:
        plan: A campaign, whose readings are replaced if it has any; a machine stands for its `standard_plan`.
        truth: What is measured: its machine must have the axes of the plan; None: a `random_truth` from `seed`.
        seed: Of the random numbers, a whole number from 0.
        noise: Whether readings have noise; u is as stated either way.
        station_error: Standard deviation of each coordinate of the approximate positions of unknown stations and of spheres
            that the campaign holds [mm]; None: stations without position, spheres where they truly are.
        control: A control that compensates, such as a `volid.Control` of the same machine; None: nothing is compensated.

    Returns:
        The campaign with readings, and the truth with `stations` and `instruments` filled in.

    Raises:
        InputError: the axes differ, a station has no position, the u of a set cannot be known, the control lacks what it needs,
            or tool vectors or positions look like another unit than mm (see `volid.accept_unusual`).

    Example:
        >>> from volid.io import read_machine
        >>> machine = read_machine("models/wYXbZt_vertical.toml")
        >>> campaign, truth = simulate(machine, seed=1)
        >>> campaign.n_readings, len(truth.stations)
        (2400, 6)
    """
    plan = standard_plan(plan) if isinstance(plan, Machine) else plan
    truth = random_truth(plan.machine, seed) if truth is None else truth
    plan = with_shared_effects(on_machine(plan, truth.machine))
    _ask(plan)
    real = replace(plan, stations=tuple(_true_station(s, truth, plan) for s in plan.stations))
    engine = engine_for_readings(plan)
    moved = _moved(engine, real, truth, control)
    drawn = _draw_instruments(moved, real, truth, seed)
    sets = tuple(
        _about(_measure(given, _exact(at, read, found, drawn.values), seed, noise), seed, station_error)
        for given, at, read, found in zip(plan.sets, moved, drawn.sets, drawn.groups, strict=True)
    )
    record = {"simulated": True, "simulation_seed": seed, "simulation_truth": truth.source or "given"}
    record |= _active(plan, control)
    approximate = tuple(_approximate(s, seed, station_error) for s in real.stations)
    files = () if plan.conditions.get("simulated") else plan.active_files
    conditions = {**plan.conditions, **record}
    campaign = replace(plan, sets=sets, stations=approximate, conditions=conditions, active_files=files)
    campaign = in_air(campaign, drawn.table.starts)
    stations = {s.name: s.position for s in real.stations if s.position is not None}
    instruments = {**truth.instruments, **drawn.recorded()}
    return campaign, replace(truth, stations={**truth.stations, **stations}, instruments=instruments)


def _ask(plan: Campaign) -> None:
    """Raises `InputError` for a plan whose tool vectors or positions look like another unit than mm."""
    for planned in plan.sets:
        ask_tools(plan.machine, planned.tool, name=f"{planned.file_and_set}: tool")
        columns = dict(zip(plan.machine.letters, planned.positions.T, strict=True))
        ask_positions(plan.machine, columns, f"{planned.file_and_set}, positions")


def _active(plan: Campaign, control: Drives | None) -> dict[str, Any]:
    """What [conditions] say of compensations: those that the plan states, and those of the control.

    What a simulated campaign, used as a plan, says of itself is over.
    """
    stated = [] if plan.conditions.get("simulated") else active_compensations(plan.conditions)
    if control is None and ACTIVE not in plan.conditions:
        return {}
    return {ACTIVE: [*stated, *(() if control is None else control.active)]}


class _At(NamedTuple):
    """The machine as a set sees it: what computes, and its errors at the programmed positions, (ends · 6 · (n_axes + 1), m)."""

    engine: Engine
    machine: Machine
    errors: np.ndarray


def _moved(engine: Engine, real: Campaign, truth: Truth, control: Drives | None) -> list[_At]:
    """The machine under each set of a campaign. Raises `InputError` for a control of other axes."""
    if control is not None and control.machine.letters != truth.machine.letters:
        raise InputError(
            f"`control`: it moves the axes {', '.join(control.machine.letters)} of '{control.machine.name}', but "
            f"'{truth.machine.name}' has {', '.join(truth.machine.letters)}; expected a control of this machine"
        )
    return [_At(engine, truth.machine, errors_of(truth, readings, control)) for readings in real.sets]


class _Drawn(NamedTuple):
    """Instruments with their true nuisance parameters: `sets` with readings without
    effects, `groups` and `values` with them."""

    sets: list[ObservationSet]
    groups: list[list[Extended]]
    table: NuisanceTable
    values: np.ndarray

    def recorded(self) -> dict[str, float]:
        """What was left to chance, and what a truth always records, by name."""
        entries = zip(self.table.entries, self.values.tolist(), strict=True)
        return {e.name: value for e, value in entries if e.recorded or _is_open(e)}


def _draw_instruments(moved: list[_At], real: Campaign, truth: Truth, seed: int) -> _Drawn:
    """Nuisance parameters of a campaign whose stations stand where they truly do."""
    table = NuisanceTable()
    own = [groups_of(readings, real, table, effects=False) for readings in real.sets]
    values = np.array([_true_value(entry, truth, seed) for entry in table.entries])
    plain = [_predict(at, s, found, values) for at, s, found in zip(moved, real.sets, own, strict=True)]
    read = [replace(s, readings=exact) for s, exact in zip(real.sets, plain, strict=True)]
    table.starts = dict(zip(table.keys, values.tolist(), strict=True))
    groups = [groups_of(readings, real, table) for readings in read]  # what an effect does may depend on the reading
    samples = effect_samples(real)
    _require_own_names(table)
    values = np.array([_true_value(entry, truth, seed, samples) for entry in table.entries])
    return _Drawn(read, groups, table, values)


def on_machine(plan: Campaign, machine: Machine) -> Campaign:
    """The plan for another machine with the same axes, whatever their order.

    Raises `InputError` when the axes differ.
    """
    if sorted(plan.machine.letters) != sorted(machine.letters):
        raise InputError(
            f"{plan.source or 'plan'}: made for machine '{plan.machine.name}' with axes {', '.join(plan.machine.letters)}, "
            f"but '{machine.name}' has {', '.join(machine.letters)}; expected the same axes"
        )
    order = [plan.machine.index(letter) for letter in machine.letters]
    sets = tuple(s.moved(lambda q: q[:, order], lambda way: way[:, order]) for s in plan.sets)
    return replace(plan, machine=machine, sets=sets)


def _true_station(station: Station, truth: Truth, plan: Campaign) -> Station:
    position = station.position or truth.stations.get(station.name)
    if position is None:
        raise InputError(
            f"{plan.source or 'plan'}, station '{station.name}': there is no position; a simulation needs the true one, "
            "position = [x, y, z] in mm"
        )
    return replace(station, position=position)


def _approximate(station: Station, seed: int, error: float | None) -> Station:
    """What the campaign says about a station: nothing but the truth when it is known, else about where it stands."""
    if station.known or station.position is None or error == 0.0:
        return station
    if error is None:
        return replace(station, position=None)
    offset = error * generator(seed, "approximate position", station.name).standard_normal(3)
    x, y, z = np.round(np.array(station.position) + offset, 3).tolist()
    return replace(station, position=(x, y, z))


def _about(readings: ObservationSet, seed: int, error: float | None) -> ObservationSet:
    """The set with what stands on the workpiece (spheres, nests) standing about where it does."""
    if not error:
        return readings

    def near(name: str, place: Any) -> list[float]:
        offset = error * generator(seed, "approximate sphere", name).standard_normal(3)
        return [float(c) for c in np.round(np.asarray(place, dtype=float) + offset, 3)]

    return KINDS[readings.kind].approximate(readings, near)


class _Exact(NamedTuple):
    """Readings without noise (m, k), and effects drawn anew for every reading with the variance (m, k) they add."""

    readings: np.ndarray
    random: list[tuple[Effect, np.ndarray]]


def _exact(at: _At, readings: ObservationSet, groups: list[Extended], values: np.ndarray) -> _Exact:
    exact = _predict(at, readings, groups, values)
    sensitivities = partial(sensitivities_of, at.engine, readings, at.machine, groups, values)
    return _Exact(exact, random_parts(readings, at.machine, sensitivities))


def _is_open(entry: Nuisance) -> bool:
    """True for what the plan leaves to chance: an unknown with a spread, or a calibrated value."""
    return entry.prior_u > 0.0 and (entry.spread > 0.0 or np.isfinite(entry.prior_u))


def _require_own_names(table: NuisanceTable) -> None:
    """Raises `InputError` when two of the values that a truth holds have one name."""
    names = [e.name for e in table.entries if e.recorded or _is_open(e)]
    twice = sorted({n for n in names if names.count(n) > 1}) if len(set(names)) < len(names) else []
    if twice:
        raise InputError(
            f"two unknowns of the plan are called '{twice[0]}', and a truth holds its values by name; give their sets or "
            "stations other names"
        )


def _true_value(
    entry: Nuisance, truth: Truth, seed: int, samples: Mapping[str, tuple[float, ...]] | None = None
) -> float:
    """Value of an unknown: by its name, because truth files are written and edited by people, else drawn from name and seed."""
    if not _is_open(entry):
        return entry.start
    if entry.name in truth.instruments:
        return truth.instruments[entry.name]
    rng = generator(seed, entry.name)
    if np.isfinite(entry.prior_u):
        drawn = standardised(entry.distribution, rng, 1, (samples or {}).get(entry.effect, ()))
        return entry.start + entry.prior_u * float(drawn[0])
    return entry.start + float(rng.uniform(-entry.spread, entry.spread))


def _predict(at: _At, readings: ObservationSet, groups: list[Extended], values: np.ndarray) -> np.ndarray:
    """Readings without noise, shape (m, k)."""
    seen = readings.side_by_side
    result = np.full(readings.readings.shape, np.nan)
    chain = chain_of(at.machine)
    for group in groups:
        rows = group.rows
        numbers = (seen.positions[rows].T, seen.tool[rows].T, at.errors[:, rows], values[group.slots])
        result[rows] = at.engine.readings(chain, group.form, *numbers, group.constants).T
    return result


def _measure(readings: ObservationSet, exact: _Exact, seed: int, noise: bool) -> ObservationSet:
    """The set with readings: exact ones plus noise of the stated u and of effects drawn anew for every reading."""
    variance, others = split_normal(exact.random)
    u = np.sqrt(_uncertainty(readings, exact.readings) ** 2 + variance)
    rng = generator(seed, "noise", readings.name)
    measured = exact.readings + u * rng.standard_normal(u.shape) if noise else exact.readings
    for part in others if noise else []:
        drawn = standardised(part.distribution, rng, u.size, part.samples)
        measured = measured + part.deviation * drawn.reshape(u.shape)
    return replace(readings, readings=measured, u=_uncertainty(readings, measured))


def _uncertainty(readings: ObservationSet, values: np.ndarray) -> np.ndarray:
    """Standard uncertainties (m, k): those of the plan, and where they depend on the reading, of `values`.

    Raises `InputError` when neither is there.
    """
    names = KINDS[readings.kind].readings
    columns = []
    for i, name in enumerate(names):
        given = readings.u[:, i]
        own = readings.options.get("u" if len(names) == 1 else f"u_{name}", readings.options.get("u"))
        if own is not None:
            given = standard_uncertainty(own, values[:, i])
        if np.isnan(given).any():
            raise InputError(f"set '{readings.name}': u is not known for every row; state it in the plan")
        columns.append(given)
    return np.stack(columns, axis=1)
