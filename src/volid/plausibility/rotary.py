"""What cannot be right around rotary axes: positions in radians, an axis that counts the other way, no rotary motion.

R-test readings show where the sphere stands: every row gives its place on the workpiece through the nominal chain, and these
places differ only by the machine's errors. Distances show how far the target is from a station whose place is roughly known. When
they disagree by millimetres, something nominal is wrong, and trials find out what. Centres from a control that itself uses the
rotary positions agree in either unit; there, radians are recognised because they are integer numbers of degrees.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from volid.backend.rms import rms
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.error_functions import location_names, motion_names
from volid.model.iso230 import parse
from volid.model.machine import Machine
from volid.observations import KINDS
from volid.observations.beams import Beam

SCATTER = 2.0  # mm, of the sphere's places: more than location errors and a roughly known `point` explain
_BETTER = 0.1  # scatter after a trial over scatter before, at most
_TURN = 2.0 * np.pi * (1.0 + 1e-6)  # rad
_LEAST_TRAVEL = 30.0  # degrees: an axis that travels less may well stay within ±2π degrees
_SUSPECT = 1.0  # mm of scatter, below which radians are not suspected
_SUSPECT_LENGTHS = 0.3  # mm, the same for absolute distances: a ball bar swings about its pivot whatever the angles
_INTEGER = 0.006  # degrees: radians with four decimals of a whole number of degrees lie within
_ENOUGH = 3  # different whole degrees, which by chance all numbers are once in a million


def check_radians(readings: ObservationSet, campaign: Campaign) -> None:
    """Raises `InputError` when positions of one or several rotary axes of a set are in radians."""
    machine = campaign.machine
    small = _may_be_radians(machine, readings.all_ends.positions)
    if not small:
        return
    before = _misfit(readings, campaign, readings.positions)
    if before is not None and before > _suspicious_misfit(readings, campaign):
        best, after = _best_in_degrees(readings, campaign, small)
        if after < _BETTER * before:
            places = KINDS[readings.kind].standing
            what = f"the {places}'s places scatter" if places else "distances differ from nominal"
            said = f"{what} by {before:.3g} mm, but by {after:.2g} mm when they are taken for radians"
            _say_radians(readings, machine, best, said)
    integers = [i for i in small if _integer_degrees(readings.all_ends.positions[:, i])]
    if integers:
        _say_radians(readings, machine, integers, "they are whole degrees when taken for radians")


def _may_be_radians(machine: Machine, q: np.ndarray) -> list[int]:
    """Columns of the rotary axes that move and stay within ±2π, although they can travel further."""
    long = [i for i in _rotary_columns(machine) if machine.axes[i].length > _LEAST_TRAVEL]
    return [i for i in long if np.ptp(q[:, i]) > 0.0 and np.abs(q[:, i]).max() <= _TURN]


def _suspicious_misfit(readings: ObservationSet, campaign: Campaign) -> float:
    """Misfit [mm] above which radians are suspected."""
    kind = KINDS[readings.kind]
    absolute = not any(beam.relative for beam in kind.beams(readings, campaign))
    return _SUSPECT_LENGTHS if absolute and not kind.standing else _SUSPECT


def _best_in_degrees(readings: ObservationSet, campaign: Campaign, small: list[int]) -> tuple[list[int], float]:
    """Those of the columns that make the misfit least when they are taken for radians, and that misfit [mm]."""
    trials = [list(chosen) for n in range(1, len(small) + 1) for chosen in combinations(small, n)]
    after = [_misfit(readings, campaign, _in_degrees(readings.positions, chosen)) or 0.0 for chosen in trials]
    best = int(np.argmin(after))
    return trials[best], after[best]


def _say_radians(readings: ObservationSet, machine: Machine, columns: list[int], why: str) -> None:
    letters = " and ".join(machine.letters[i] for i in columns)
    raise InputError(
        f"{readings.file_and_set}: positions of {letters} seem to be in radians: all lie within ±2π, and {why}; expected degrees"
    )


def _integer_degrees(q: np.ndarray) -> bool:
    """Whether positions are integer degrees when taken for radians, but not as they stand; enough of them to exclude chance."""
    different = np.unique(q[q != 0.0])
    turned = np.rad2deg(different)
    return len(different) >= _ENOUGH and bool(np.all(np.abs(turned - np.round(turned)) < _INTEGER))


def _misfit(readings: ObservationSet, campaign: Campaign, positions: np.ndarray) -> float | None:
    """How far readings and nominal chain disagree [mm]; None for a kind, or a set, that cannot tell."""
    scattered = scatter(readings, campaign.machine, positions)
    if scattered is not None:
        return scattered
    beams = list(KINDS[readings.kind].beams(readings, campaign, positions))
    if not beams or not all(beam.station.position for beam in beams):
        return None
    return rms(np.concatenate([_beam_misfit(beam) for beam in beams]))


def _beam_misfit(beam: Beam) -> np.ndarray:
    """Readings minus nominal distances (m,) [mm], less what dead paths and another place of the station explain."""
    arm = beam.targets - np.array(beam.station.position)
    length = np.maximum(np.linalg.norm(arm, axis=1), 1e-9)
    design = arm / length[:, None]
    if beam.relative:
        design = np.hstack([design, beam.segments[:, None] == np.unique(beam.segments)])
    difference = beam.distances - length
    return np.asarray(difference - design @ np.linalg.lstsq(design, difference, rcond=1e-9)[0])


def scattered(readings: ObservationSet, machine: Machine) -> Iterator[str]:
    """A warning when the sphere's places scatter more than a machine's errors explain, with the sign that would correct it."""
    before = scatter(readings, machine, readings.positions) if _rotary_columns(machine) else None
    if before is None or before <= SCATTER:
        return
    hint = "check `point` and `direction` of the rotary axes, the tool vectors and the positions"
    for i in _rotary_columns(machine):
        q = readings.positions * np.where(np.arange(len(machine.axes)) == i, -1.0, 1.0)
        after = scatter(readings, machine, q)
        if after is not None and after < _BETTER * before:
            hint = (
                f"with {machine.letters[i]} counted the other way it is {after:.2g} mm; "
                f"check `direction` of [axis.{machine.letters[i]}]"
            )
    what = KINDS[readings.kind].standing
    yield f"{readings.file_and_set}: the places of a {what} on the workpiece scatter by {before:.3g} mm; {hint}"


def scatter(readings: ObservationSet, machine: Machine, positions: np.ndarray) -> float | None:
    """Root mean square distance [mm] of places on the workpiece from their mean, by what stands there; None for other kinds."""
    kind = KINDS[readings.kind]
    places = kind.places(readings, machine, positions)
    if places is None or not kind.standing:
        return None
    distances = np.zeros(len(places))
    for name in np.unique(readings.labels[kind.standing]):
        rows = readings.labels[kind.standing] == name
        distances[rows] = np.linalg.norm(places[rows] - places[rows].mean(axis=0), axis=1)
    return rms(distances)


def check_motion(campaign: Campaign) -> None:
    """Raises `InputError` when spheres are probed but no rotary axis ever moves, although its errors are in the model."""
    machine = campaign.machine
    rotary = _rotary_columns(machine)
    turning = [machine.letters[i] for i in rotary]
    modelled = any(parse(n).axis in turning for n in (*motion_names(machine), *location_names(machine)))
    if not modelled or not all(KINDS[s.kind].standing for s in campaign.sets):
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
