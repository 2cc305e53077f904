"""Slips around rotary axes: positions in radians, an axis that counts the other way, a sphere out of reach, no rotary motion.

R-test readings say where the sphere stands: every row gives its place on the workpiece through the nominal chain, and these
places differ only by the machine's errors. Distances say how far the target is from a station whose place is roughly known. When
they disagree by millimetres, something nominal is wrong; trials tell what. Centres from a control that knows the rotary positions
itself agree whatever they are taken for: there, radians are recognised by being whole degrees.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.error_functions import location_names, motion_names
from volid.model.iso230 import parse
from volid.model.kinematics import nominal_point, transform
from volid.model.machine import Machine
from volid.observations.displacement import RANGE
from volid.observations.distance import sees_tool, target_body, target_place

SCATTER = 2.0  # mm, of the sphere's places: more than location errors and a roughly known `point` explain
_BETTER = 0.1  # scatter after a trial over scatter before, at most
_TURN = 2.0 * np.pi * (1.0 + 1e-6)  # rad
_LEAST_TRAVEL = 30.0  # degrees: an axis that travels less may well stay within ±2π degrees
_SLIP = 1.0  # mm of scatter, below which radians are not suspected
_SLIP_OF_LENGTHS = 0.3  # mm, the same for absolute distances: a ball bar swings about its pivot whatever the angles
_WHOLE = 0.006  # degrees: radians with four decimals of a whole number of degrees lie within
_ENOUGH = 3  # different whole degrees, which by chance all numbers are once in a million


def check_displacements(readings: ObservationSet, campaign: Campaign) -> None:
    """Raises `InputError` for readings beyond the sensor's range."""
    del campaign
    _check_range(readings)


def check_radians(readings: ObservationSet, campaign: Campaign) -> None:
    """Raises `InputError` when positions of one or several rotary axes of a set are in radians."""
    machine, q = campaign.machine, readings.positions
    small = [
        i
        for i in _rotary_columns(machine)
        if machine.axes[i].length > _LEAST_TRAVEL and np.ptp(q[:, i]) > 0.0 and np.abs(q[:, i]).max() <= _TURN
    ]
    before = _misfit(readings, campaign, q) if small else None
    absolute = readings.kind == "distance" and not readings.options.get("relative", True)
    if before is not None and before > (_SLIP_OF_LENGTHS if absolute else _SLIP):
        trials = [chosen for n in range(1, len(small) + 1) for chosen in combinations(small, n)]
        after = {chosen: _misfit(readings, campaign, _in_degrees(q, list(chosen))) or 0.0 for chosen in trials}
        best = min(trials, key=lambda chosen: after[chosen])
        if after[best] < _BETTER * before:
            what = "the sphere's places scatter" if readings.kind == "displacement" else "distances differ from nominal"
            said = f"{what} by {before:.3g} mm, but by {after[best]:.2g} mm when they are taken for radians"
            _say_radians(readings, machine, list(best), said)
    whole = [i for i in small if _whole_degrees(q[:, i])]
    if whole:
        _say_radians(readings, machine, whole, "they are whole degrees when taken for radians")


def _say_radians(readings: ObservationSet, machine: Machine, columns: list[int], why: str) -> None:
    letters = " and ".join(machine.letters[i] for i in columns)
    raise InputError(
        f"{_where(readings)}: positions of {letters} seem to be in radians: all lie within ±2π, and {why}; expected degrees"
    )


def _whole_degrees(q: np.ndarray) -> bool:
    """Whether positions are whole degrees as radians, and not as degrees; enough different ones, so that it is no chance."""
    different = np.unique(q[q != 0.0])
    turned = np.rad2deg(different)
    return len(different) >= _ENOUGH and bool(np.all(np.abs(turned - np.round(turned)) < _WHOLE))


def _misfit(readings: ObservationSet, campaign: Campaign, positions: np.ndarray) -> float | None:
    """How far readings and nominal chain disagree [mm]; None for a kind, or a set, that cannot tell."""
    if readings.kind == "displacement":
        return scatter(readings, campaign.machine, positions)
    if readings.kind == "distance" and all(campaign.station(n).position for n in set(readings.labels["station"])):
        return _distance_misfit(readings, campaign, positions)
    return None


def _distance_misfit(readings: ObservationSet, campaign: Campaign, positions: np.ndarray) -> float:
    """RMS of readings minus nominal distances [mm], less what dead paths and another place of the station explain."""
    machine, squares = campaign.machine, np.zeros(len(readings))
    for name in np.unique(readings.labels["station"]):
        station = campaign.station(str(name))
        rows = np.flatnonzero(readings.labels["station"] == name)
        place = tuple(readings.tool[rows].T) if sees_tool(readings) else target_place(readings)
        ends = machine.body_index(target_body(readings)), machine.body_index(station.body)
        target = transform(machine, positions[rows].T, None, place, start=ends[0], stop=ends[1])  # type: ignore[arg-type]
        arm = np.stack([c - p for c, p in zip(target, station.position or (0.0,) * 3, strict=True)], axis=1)
        length = np.maximum(np.linalg.norm(arm, axis=1), 1e-9)
        segments = readings.labels["segment"][rows]
        design = arm / length[:, None]
        if readings.options.get("relative", True):
            design = np.hstack([design, segments[:, None] == np.unique(segments)])
        difference = readings.readings[rows, 0] - length
        squares[rows] = (difference - design @ np.linalg.lstsq(design, difference, rcond=1e-9)[0]) ** 2
    return float(np.sqrt(np.mean(squares)))


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
