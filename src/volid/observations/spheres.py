"""Spheres (or nests) on the workpiece: where a set says that they stand, and what such places do not determine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from volid.campaign import ObservationSet
from volid.exceptions import InputError
from volid.model.geometry import three_numbers
from volid.model.machine import Machine
from volid.observations.base import Place

SAME_SPHERE = 2.0  # mm: nominal points closer than this belong to one sphere; sensors reach about as far


def place_advice(machine: Machine, places: np.ndarray) -> list[str]:
    """Advice for places (n, 3) [mm] that all coincide, or that all lie on the axis of the table."""
    reasons = []
    if np.linalg.norm(places - places[0], axis=1).max() < 2.0 * SAME_SPHERE:
        reasons.append("one sphere place only; use three that do not lie on one line")
    axis = machine.axes[0]  # only the line of the axis next to the workpiece stands still in it
    if not axis.is_linear and axis.primed:
        direction = np.asarray(axis.unit_vector)
        if np.linalg.norm(np.cross(places - np.asarray(axis.point), direction), axis=1).max() < 2.0 * SAME_SPHERE:
            reasons.append(f"every sphere lies on the axis line of {axis.letter}; add one far from it")
    return reasons


def sphere_places(observations: ObservationSet) -> dict[str, Place]:
    """Approximate sphere (or nest) positions by name. Raises `InputError` when a sphere of the readings has none."""
    given = observations.options.get("sphere") or {}
    names = [str(n) for n in dict.fromkeys(observations.labels["sphere"])]
    if not isinstance(given, Mapping):
        given = dict.fromkeys(names, given)
    return {name: _place(observations, name, given.get(name)) for name in names}


def _place(observations: ObservationSet, name: str, given: Any) -> Place:
    """Approximate position of one sphere (or nest): three finite numbers, else `InputError`."""
    place = three_numbers(given)
    if place is None:
        found = "has no approximate position" if given is None else f"stands at {given}"
        raise InputError(
            f"set '{observations.name}': sphere '{name}' {found}; give sphere = [x, y, z] in mm, workpiece frame, or "
            f"sphere = {{ {name} = [x, y, z] }}"
        )
    return place
