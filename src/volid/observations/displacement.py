"""`displacement`: R-test, the position of a sphere relative to the nest of three displacement sensors; touch-probe centres.

With the sensor on the tool and the sphere on the workpiece, d = S · (sphere in the tool frame - nest origin). With the sensor on
the workpiece and the sphere in the spindle, d = S · (functional point in the workpiece frame - nest origin). S = (1 + scale) ·
(identity + small rotation). A touch probe that finds a sphere's centre gives d = 0 at the axis positions that it reports.
CONVENTIONS 6; ISO 10791-6 BK; ISO 230-7.

Options of a set: `sensor_on` is "tool" or "workpiece". `sphere` is the approximate position of the sphere (or, with the sensor on
the workpiece, of the nest), one for all rows or one per name in the column `sphere`. `nest_u` [mm], `rotation_u` [rad] and
`scale_u` are the prior u of the sensor's origin, rotation and scale: 0 when it is known, inf when it is unknown. `range` [mm] is
that of the sensor to either side.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import Vector, add, rotate_small, skew, subtract
from volid.model.kinematics import functional_point, nominal_point, to_tool_frame, transform
from volid.model.machine import Machine
from volid.observations.base import Group, Kind, NuisanceTable
from volid.observations.response import (
    SEVERAL_TOOLS,
    TOOL_VECTORS,
    UNMOVED,
    PlaceOf,
    Remainder,
    Response,
    TurnOf,
    remainder,
)
from volid.observations.spheres import SAME_SPHERE, place_advice, sphere_places

SPREAD = {"nest": 0.1, "rotation": 5e-3, "scale": 1e-3}  # of what is unknown of a virtual sensor [mm, rad, 1]
RANGE = 2.0  # mm, of a sensor to either side; the option `range` of a set says otherwise
_SENSOR_TURNS = (
    "the new datum turns the workpiece frame, and the sensor of set '{name}' on the workpiece is said to be parallel to it "
    "(rotation_u = 0). Set rotation_u = inf and fit again, or fit in that datum: [datum] of the machine file"
)


class DisplacementSettings(NamedTuple):
    """Static part: where the sensor is mounted, and which of its nuisance parameters are used."""

    on_tool: bool
    nest: bool
    rotation: bool
    scale: bool


class Displacement(Kind):
    """R-test readings, as the docstring of the module describes them."""

    name = "displacement"
    readings = ("x", "y", "z")
    doc = "sphere relative to the nest in the sensor frame [mm]"
    labels: Mapping[str, str | None] = {"sphere": "1"}
    options: Mapping[str, Any] = {
        "sensor_on": "tool",
        "sphere": {},
        "nest_u": 0.0,
        "rotation_u": 0.0,
        "scale_u": 0.0,
        "range": RANGE,
    }
    tested_by = ("sphere",)
    standing = "sphere"
    takes_centres = True
    centres_in = "tool"

    @staticmethod
    def predict(
        machine: Machine,
        settings: DisplacementSettings,
        q: Any,
        tool: Vector,
        errors: Any,
        slots: Any,
        constants: Any,
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

    def groups(self, observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
        """All rows of a set as one group: three coordinates per sphere, and what is unknown of the sensor."""
        settings, places = _settings(observations), sphere_places(observations)
        unnamed = list(places) == ["1"]  # an unnamed sphere belongs to its set, a named one to the campaign
        sensor = _sensor_slots(observations, settings, table)
        slots = np.zeros((3 + len(sensor), len(observations)), dtype=np.int64)
        not_followed = _remainder(observations, settings)
        for sphere, place in places.items():
            rows = observations.labels["sphere"] == sphere
            name = f"{observations.name}" if unnamed else sphere
            keys = tuple(("sphere", name, c) for c in "XYZ")
            indices = [
                table.index(
                    keys[i],
                    f"sphere {name} {c}",
                    start=place[i],
                    recorded=True,
                    response=PlaceOf(not_followed=not_followed, of=keys, component=i),
                )
                for i, c in enumerate("XYZ")
            ]
            slots[:, rows] = np.array([*indices, *sensor])[:, None]
        return [Group(np.arange(len(observations)), settings, slots, np.zeros((0, len(observations))))]

    def check(self, observations: ObservationSet) -> None:
        """Raises `InputError` when the sensor's place is neither tool nor workpiece, or a sphere has no position."""
        _settings(observations)
        sphere_places(observations)

    def check_values(self, observations: ObservationSet, campaign: Campaign) -> None:
        """Raises `InputError` for readings beyond the sensor's range."""
        limit = float(observations.options.get("range", RANGE))
        outside = np.abs(observations.readings) > limit
        if not outside.any():
            return
        row, column = np.argwhere(outside)[0]
        more = f" and {outside.any(axis=1).sum() - 1} more such rows" if outside.any(axis=1).sum() > 1 else ""
        found = f"{self.readings[column]} = {observations.readings[row, column]:g} mm"
        raise InputError(
            f"{observations.where(int(row))}{more}: {found} lies outside the sensor's range of ±{limit:g} mm; "
            "remove the row, or state the range of your sensor, range = … (mm), in the set"
        )

    def places(self, observations: ObservationSet, machine: Machine, positions: np.ndarray | None = None) -> np.ndarray:
        """The sphere's (or nest's) place on the workpiece by every row, (m, 3) [mm]."""
        positions = observations.positions if positions is None else positions
        if str(observations.options.get("sensor_on", "tool")) == "tool":
            return nominal_point(machine, positions, observations.tool + observations.readings)
        return np.asarray(nominal_point(machine, positions, observations.tool) - observations.readings)

    def standing_at(self, observations: ObservationSet) -> Mapping[str, Sequence[float]]:
        """Stated places of the spheres."""
        given = observations.options.get("sphere") or {}
        return given if isinstance(given, Mapping) else {observations.name: given}

    def approximate(self, observations: ObservationSet, near: Callable[[str, Any], list[float]]) -> ObservationSet:
        """The set with its spheres (or nests) standing about where they do."""
        given = observations.options.get("sphere")
        if not given:
            return observations
        several = isinstance(given, Mapping)
        spheres = {n: near(n, p) for n, p in given.items()} if several else near(observations.name, given)
        return replace(observations, options={**observations.options, "sphere": spheres})

    def groups_by(self, like: ObservationSet) -> list[tuple[str, str]]:  # type: ignore[override]
        """Spheres, where there are several."""
        found = list(super().groups_by(like))
        return found if len(found) > 1 else []

    def advice(self, sets: Sequence[ObservationSet], campaign: Campaign) -> list[str]:
        """How many spheres there are, where they lie, with which tool vectors, and whether the nest is known."""
        points = np.concatenate([nominal_point(campaign.machine, s.positions, s.tool) for s in sets])
        places = np.unique(np.round(points / SAME_SPHERE), axis=0) * SAME_SPHERE
        reasons = place_advice(campaign.machine, places)
        tools = np.unique(np.round(np.concatenate([s.tool for s in sets]), 3), axis=0)
        if len(tools) == 1:
            single = ", ".join(f"{x:g}" for x in tools[0])
            reasons.append(f"a single tool vector ({single}) mm was used; use three that do not lie on one line")
        unknown = [s.name for s in sets if not np.isfinite(float(s.options.get("nest_u", 0.0)))]
        if unknown:
            reasons.append(f"the place of the nest of set {', '.join(unknown)} is unknown (nest_u = inf); calibrate it")
        return reasons


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
        for i, c in enumerate(letters if used else ""):
            response = _sensor_response(observations, settings, key, i)
            text = f"{key} {name} {c}".strip()
            prior = float(options[f"{key}_u"])
            slots.append(table.index((key, name, c), text, unit, prior_u=prior, spread=SPREAD[key], response=response))
    return slots


def _sensor_response(observations: ObservationSet, settings: DisplacementSettings, key: str, i: int) -> Response:
    """The nest lies at the tool vector and turns with the tool; a sensor turns with what it stands on."""
    if key == "scale":
        return UNMOVED
    keys = tuple((key, observations.name, c) for c in ("XYZ" if key == "nest" else "ABC"))
    if key == "rotation":
        return TurnOf(TOOL_VECTORS if settings.on_tool else "workpiece", of=keys, component=i)
    middle = tuple(observations.tool.mean(axis=0).tolist())
    return PlaceOf(TOOL_VECTORS, of=keys, component=i, offset=middle)


def _remainder(observations: ObservationSet, settings: DisplacementSettings) -> Remainder | None:
    """What places and sensor cannot follow: h × tool for a known nest, ω × d for a sensor parallel to what it stands on."""
    tools = observations.tool - (observations.tool.mean(axis=0) if settings.nest else 0.0)
    d, u = np.nan_to_num(observations.readings), observations.u
    arm = tools if settings.rotation or not settings.on_tool else tools + d
    rows = np.zeros((len(d), 3, 9))
    rows[:, :, 6:] = skew(-arm)
    if not settings.on_tool and not settings.rotation:
        rows[:, :, 3:6] = skew(-d)
    turned = bool(rows[:, :, 3:6].any())
    reason = _SENSOR_TURNS.format(name=observations.name) if turned else SEVERAL_TOOLS
    return remainder(rows.reshape(-1, 9), u.ravel(), reason)


DISPLACEMENT = Displacement()
