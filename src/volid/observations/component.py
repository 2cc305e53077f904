"""`component`: one of the six components of the deviation (interferometer, level, autocollimator, straightedge, square).

value = component of the deviation + offset of the line, plus slope · (moving axis - its first position) when the
artefact's alignment is unknown. CONVENTIONS 6; ISO 230-1 8, 9, 10.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import Vector
from volid.model.iso230 import DIRECTIONS, ROTATIONS
from volid.model.kinematics import deviation
from volid.model.machine import Machine
from volid.observations.base import Group, Kind, NuisanceTable

SPREAD = {"mm": 0.01, "rad": 1e-4}  # of a line's offset; a virtual instrument draws from it
SLOPE_SPREAD = {"mm": 1e-4, "rad": 1e-7}  # per mm of travel


class ComponentSettings(NamedTuple):
    """Static part: the row of the deviation that is read, and whether the artefact's slope is unknown."""

    component: int
    slope: bool


def predict(
    machine: Machine, settings: ComponentSettings, q: Any, tool: Vector, errors: Any, slots: Any, constants: Any
) -> Any:
    """Predicted values, shape (1, m) [mm or rad]."""
    value = deviation(machine, q, tool, errors)[settings.component] + slots[0]
    if settings.slope:
        value = value + slots[1] * constants[0]
    return in_rows([value], np.shape(q[0]))


def _arm(observations: ObservationSet, rows: np.ndarray) -> np.ndarray:
    """Position of the moving axis from its first value on one line, shape (m,)."""
    positions = observations.positions[rows]
    moving = int(np.argmax(np.ptp(positions, axis=0)))
    return positions[:, moving] - positions[0, moving]


def groups(observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
    """Rows of a set by component, with one offset (and slope) per line. Raises `InputError` for an unknown component."""
    components, lines = observations.labels["component"], observations.labels["line"]
    wrong = np.flatnonzero(~np.isin(components, DIRECTIONS))
    if wrong.size:
        i = int(wrong[0])
        raise InputError(
            f"{observations.where(i)}: component '{components[i]}' is none of X, Y, Z (mm) and A, B, C (rad)"
        )
    slope = bool(observations.options.get("slope", False))
    result = []
    for component in dict.fromkeys(components):
        rows = np.flatnonzero(components == component)
        slots = np.zeros((2 if slope else 1, len(rows)), dtype=np.int64)
        arm = np.zeros((1, len(rows)))
        unit = "rad" if component in ROTATIONS else "mm"
        for line in dict.fromkeys(lines[rows]):
            here = lines[rows] == line
            key, name = (observations.name, line, component), f"{observations.name} line {line} {component}"
            slots[0, here] = table.index(("offset", *key), f"offset {name}", unit, spread=SPREAD[unit])
            if slope:
                spread = SLOPE_SPREAD[unit]
                slots[1, here] = table.index(("slope", *key), f"slope {name}", f"{unit}/mm", spread=spread)
                arm[0, here] = _arm(observations, rows[here])
        settings = ComponentSettings(DIRECTIONS.index(component), slope)
        result.append(Group(rows, settings, slots, arm))
    return result


COMPONENT = Kind(
    name="component",
    readings=("value",),
    labels={"component": None, "line": "1"},
    options={"slope": False},
    predict=predict,
    groups=groups,
    doc="component of the deviation + offset of the line (+ slope of the artefact) [mm or rad]",
    unit="mm or rad",
)
