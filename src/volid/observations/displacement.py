"""`displacement`: R-test, the position of a sphere relative to the nest of three displacement sensors; touch-probe centres.

Sensor on the tool, sphere on the workpiece: d = S · (sphere in the tool frame - nest origin). Sensor on the workpiece, sphere in
the spindle: d = S · (functional point in the workpiece frame - nest origin). S = (1 + scale) · (identity + small rotation). A
touch probe that finds a sphere's centre gives d = 0 at the axis positions it reports. CONVENTIONS 6; ISO 10791-6 BK; ISO 230-7.

Options of a set: `sensor_on` "tool" or "workpiece"; `sphere`, approximate position of the sphere (or, with the sensor on the
workpiece, of the nest), one for all rows or one per name in the column `sphere`; `nest_u` [mm], `rotation_u` [rad], `scale_u`:
prior u of the sensor's origin, rotation and scale, 0 for known, inf for unknown; `range` [mm] of the sensor to either side.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import Vector, add, rotate_small, subtract
from volid.model.kinematics import functional_point, to_tool_frame, transform
from volid.model.machine import Machine
from volid.observations.base import Group, Kind, NuisanceTable

SPREAD = {"nest": 0.1, "rotation": 5e-3, "scale": 1e-3}  # of what is unknown of a virtual sensor [mm, rad, 1]
RANGE = 2.0  # mm, of a sensor to either side; the option `range` of a set says otherwise


class DisplacementSettings(NamedTuple):
    """Static part: where the sensor sits, and which of its nuisance parameters are in play."""

    on_tool: bool
    nest: bool
    rotation: bool
    scale: bool


def predict(
    machine: Machine, settings: DisplacementSettings, q: Any, tool: Vector, errors: Any, slots: Any, constants: Any
) -> Any:
    """Predicted displacements x, y, z in the sensor frame, shape (3, m) [mm]."""
    n = len(machine.axes)
    place = (slots[0], slots[1], slots[2])
    used = 3
    if settings.nest:
        tool = add(tool, (slots[3], slots[4], slots[5]))
        used = 6
    if settings.on_tool:
        in_tool = to_tool_frame(machine, errors, transform(machine, q, errors, place, start=0, stop=n))
        d = subtract(in_tool, tool)
    else:
        d = subtract(functional_point(machine, q, tool, errors), place)
    if settings.rotation:
        d = rotate_small((slots[used], slots[used + 1], slots[used + 2]), d)
        used += 3
    factor = 1.0 + slots[used] if settings.scale else 1.0
    return in_rows([factor * c for c in d], np.shape(q[0]))


def sphere_places(observations: ObservationSet) -> dict[str, tuple[float, float, float]]:
    """Approximate sphere (or nest) positions by name. Raises `InputError` when a sphere of the readings has none."""
    given = observations.options.get("sphere") or {}
    names = [str(n) for n in dict.fromkeys(observations.labels["sphere"])]
    if not isinstance(given, Mapping):
        given = dict.fromkeys(names, given)
    return {name: _place(observations, name, given.get(name)) for name in names}


def _place(observations: ObservationSet, name: str, given: Any) -> tuple[float, float, float]:
    """Approximate position of one sphere (or nest): three finite numbers, else `InputError`."""
    try:
        x, y, z = (float(c) for c in given)
    except (TypeError, ValueError):
        x = y = z = np.nan
    if not np.all(np.isfinite([x, y, z])):
        found = "has no approximate position" if given is None else f"stands at {given}"
        raise InputError(
            f"set '{observations.name}': sphere '{name}' {found}; give sphere = [x, y, z] in mm, workpiece frame, or "
            f"sphere = {{ {name} = [x, y, z] }}"
        )
    return x, y, z


def _settings(observations: ObservationSet) -> DisplacementSettings:
    on = str(observations.options.get("sensor_on", "tool"))
    if on not in ("tool", "workpiece"):
        raise InputError(f"set '{observations.name}': sensor_on = '{on}'; expected 'tool' or 'workpiece'")
    priors = [float(observations.options.get(k, 0.0)) > 0.0 for k in ("nest_u", "rotation_u", "scale_u")]
    return DisplacementSettings(on == "tool", *priors)


def _sensor_slots(observations: ObservationSet, settings: DisplacementSettings, table: NuisanceTable) -> list[int]:
    """Nest offset, sensor rotation and scale: one each per set, with the stated prior uncertainty (inf: unknown)."""
    name, options = observations.name, observations.options
    slots: list[int] = []
    for used, key, unit, letters in (
        (settings.nest, "nest", "mm", "XYZ"),
        (settings.rotation, "rotation", "rad", "ABC"),
        (settings.scale, "scale", "1", " "),
    ):
        if used:
            prior, spread = float(options[f"{key}_u"]), SPREAD[key]
            slots += [
                table.index((key, name, c), f"{key} {name} {c}".strip(), unit, prior_u=prior, spread=spread)
                for c in letters
            ]
    return slots


def check(observations: ObservationSet) -> None:
    """Raises `InputError` when the sensor's place is neither tool nor workpiece, or a sphere has no position."""
    _settings(observations)
    sphere_places(observations)


def groups(observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
    """All rows of a set as one group: three coordinates per sphere, and what is unknown of the sensor."""
    settings, places = _settings(observations), sphere_places(observations)
    own = list(places) == ["1"]  # an unnamed sphere belongs to its set, a named one to the campaign
    sensor = _sensor_slots(observations, settings, table)
    slots = np.zeros((3 + len(sensor), len(observations)), dtype=np.int64)
    for sphere, place in places.items():
        rows = observations.labels["sphere"] == sphere
        name = f"{observations.name}" if own else sphere
        indices = [table.index(("sphere", name, c), f"sphere {name} {c}", "mm", place[i]) for i, c in enumerate("XYZ")]
        slots[:, rows] = np.array([*indices, *sensor])[:, None]
    return [Group(np.arange(len(observations)), settings, slots, np.zeros((0, len(observations))))]


DISPLACEMENT = Kind(
    name="displacement",
    readings=("x", "y", "z"),
    predict=predict,
    groups=groups,
    labels={"sphere": "1"},
    options={"sensor_on": "tool", "sphere": {}, "nest_u": 0.0, "rotation_u": 0.0, "scale_u": 0.0, "range": RANGE},
    doc="sphere relative to the nest in the sensor frame [mm]",
    check=check,
)
