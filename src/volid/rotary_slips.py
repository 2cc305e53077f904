"""Slips around rotary axes: positions in radians, an axis that counts the other way, a sphere out of reach, no rotary motion.

R-test readings say where the sphere stands: every row gives its place on the workpiece through the nominal chain, and these
places differ only by the machine's errors. When they scatter by millimetres, something nominal is wrong; trials tell what.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.error_functions import location_names, motion_names
from volid.exceptions import InputError
from volid.iso230 import parse
from volid.kinematics import nominal_point
from volid.machine import Machine
from volid.observations.displacement import RANGE

SCATTER = 2.0  # mm, of the sphere's places: more than location errors and a roughly known `point` explain
_BETTER = 0.1  # scatter after a trial over scatter before, at most
_TURN = 2.0 * np.pi * (1.0 + 1e-6)  # rad
_LEAST_TRAVEL = 30.0  # degrees: an axis that travels less may well stay within ±2π degrees
_SLIP = 1.0  # mm of scatter, below which radians are not suspected


def check_displacements(readings: ObservationSet, campaign: Campaign) -> None:
    """Raises `InputError` for readings beyond the sensor's range, or rotary positions in radians."""
    _check_range(readings)
    machine = campaign.machine
    rotary = _rotary_columns(machine)
    turning = [i for i in rotary if machine.axes[i].length > _LEAST_TRAVEL and np.ptp(readings.positions[:, i]) > 0.0]
    if not turning or np.abs(readings.positions[:, rotary]).max() > _TURN:
        return
    before = scatter(readings, machine, readings.positions)
    after = scatter(readings, machine, _in_degrees(readings.positions, rotary))
    if before > _SLIP and after < _BETTER * before:
        letters = " and ".join(machine.letters[i] for i in turning)
        raise InputError(
            f"{_where(readings)}: positions of {letters} seem to be in radians: all lie within ±2π, and the sphere's places "
            f"scatter by {before:.3g} mm, but by {after:.2g} mm when they are taken for radians; expected degrees"
        )


def scattered(readings: ObservationSet, machine: Machine) -> Iterator[str]:
    """A warning when the sphere's places scatter more than errors of a machine explain, with the sign that would mend it."""
    if readings.kind != "displacement" or not _rotary_columns(machine):
        return
    before = scatter(readings, machine, readings.positions)
    if before <= SCATTER:
        return
    hint = "check `point` and `direction` of the rotary axes, the tool vectors and the positions"
    for i in _rotary_columns(machine):
        q = readings.positions * np.where(np.arange(len(machine.axes)) == i, -1.0, 1.0)
        after = scatter(readings, machine, q)
        if after < _BETTER * before:
            hint = (
                f"with {machine.letters[i]} counted the other way it is {after:.2g} mm; "
                f"check `direction` of [axis.{machine.letters[i]}]"
            )
    yield f"{_where(readings)}: the places of a sphere on the workpiece scatter by {before:.3g} mm; {hint}"


def scatter(readings: ObservationSet, machine: Machine, positions: np.ndarray) -> float:
    """Root mean square distance of the sphere's (or nest's) places on the workpiece from their mean [mm], by sphere."""
    if str(readings.options.get("sensor_on", "tool")) == "tool":
        places = nominal_point(machine, positions, readings.tool + readings.readings)
    else:
        places = nominal_point(machine, positions, readings.tool) - readings.readings
    squares = np.zeros(len(places))
    for sphere in np.unique(readings.labels["sphere"]):
        rows = readings.labels["sphere"] == sphere
        squares[rows] = np.sum((places[rows] - places[rows].mean(axis=0)) ** 2, axis=1)
    return float(np.sqrt(np.mean(squares)))


def check_motion(campaign: Campaign) -> None:
    """Raises `InputError` when spheres are probed but no rotary axis ever moves, although its errors are in the model."""
    machine = campaign.machine
    rotary = _rotary_columns(machine)
    turning = [machine.letters[i] for i in rotary]
    modelled = any(parse(n).axis in turning for n in (*motion_names(machine), *location_names(machine)))
    if not modelled or not all(s.kind == "displacement" for s in campaign.sets):
        return
    positions = np.concatenate([s.positions[:, rotary] for s in campaign.sets])
    if np.ptp(positions, axis=0).any():
        return
    found = ", ".join(f"{machine.letters[i]} = {q:g}°" for i, q in zip(rotary, positions[0], strict=True))
    patterns = ", ".join(f'"E*{machine.letters[i]}" = false' for i in rotary)
    raise InputError(
        f"{campaign.source or 'campaign'}: {found} in every row; without rotary motion nothing about the rotary axes is "
        f"determined. Probe the sphere at other rotary positions, or leave their errors out of [model.functions]: {patterns}"
    )


def _rotary_columns(machine: Machine) -> list[int]:
    return [i for i, axis in enumerate(machine.axes) if not axis.is_linear]


def _in_degrees(positions: np.ndarray, columns: list[int]) -> np.ndarray:
    turned = positions.copy()
    turned[:, columns] = np.rad2deg(turned[:, columns])
    return turned


def _check_range(readings: ObservationSet) -> None:
    limit = float(readings.options.get("range", RANGE))
    outside = np.abs(readings.readings) > limit
    if not outside.any():
        return
    row, column = np.argwhere(outside)[0]
    more = f" and {outside.any(axis=1).sum() - 1} more such rows" if outside.any(axis=1).sum() > 1 else ""
    raise InputError(
        f"{readings.where(int(row))}{more}: {'xyz'[column]} = {readings.readings[row, column]:g} mm lies outside the sensor's "
        f"range of ±{limit:g} mm; remove the row, or state the range of your sensor, range = … (mm), in the set"
    )


def _where(readings: ObservationSet) -> str:
    return f"{readings.source or readings.name}, set '{readings.name}'"
