"""Axis positions against the travels, and stated uncertainties against the digits: errors that the readings cannot reveal.

A campaign whose positions, tool vectors and readings are all in metres agrees with itself; only the travels show the error.
- Positions that are all far outside the travels: the travel is in metres, or the positions are in micrometres.
- Positions that all lie within a thousandth of the travels, and fill them when taken for metres. A short campaign in one
  corner passes: 1000 times its positions lie outside the travels. So does one along a single axis, and one in which rotary
  axes turn, because the linear ones may then follow a sphere near the rotary axis by tenths of a millimetre.
- A u far below what the rounding of the readings alone contributes, δ/√12 for readings rounded to δ (GUM F.2.2.1).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.machine import Axis, Machine
from volid.observations.base import takes_large_errors

_FAR = 10.0  # travels; positions whose median lies farther outside cannot be meant
_METRE = 1000.0
_SLACK = 0.05  # of the travel: positions in metres may lie that far outside
_FILLED = 0.2  # of the travel, by positions in metres
_MANY, _MOST = 0.1, 0.5  # share of the positions outside: with a slip that explains it, and without one
_LEAST_AXES = 2  # that move and are filled
_DIGITS = range(8)  # decimal places after which readings count as not rounded
_LEAST_READINGS = 10
_CLEARLY = 0.2  # u over δ/√12, below which u cannot be meant


def check_far(readings: ObservationSet, machine: Machine) -> None:
    """Raises `InputError` when the positions of an axis lie, in the median, ten travels and more off its travel."""
    for i, axis in enumerate(machine.axes):
        _check_axis(readings, readings.all_ends.positions[:, i], axis)


def _check_axis(readings: ObservationSet, q: np.ndarray, axis: Axis) -> None:
    lower, upper = axis.travel
    if np.median(np.maximum(lower - q, q - upper)) <= _FAR * axis.length:
        return
    units = "millimetres, not metres, and the positions not micrometres" if axis.is_linear else "degrees"
    raise InputError(
        f"{readings.file_and_set}: positions {axis.letter} = {q.min():g} … {q.max():g} {axis.unit} lie many times its travel "
        f"away from it; [axis.{axis.letter}] of the machine file has travel = [{lower:g}, {upper:g}]. Expected both in "
        f"{axis.unit}: check that the travel is in {units}"
    )


def check_metres(readings: ObservationSet, machine: Machine) -> None:
    """Raises `InputError` when the positions of at least two linear axes fill their travels if they are taken for metres."""
    q = readings.all_ends.positions
    moved = np.ptp(q, axis=0)
    linear = sorted((i for i, axis in enumerate(machine.axes) if axis.is_linear), key=lambda i: machine.letters[i])
    if any(moved[i] for i in range(len(machine.axes)) if i not in linear):
        return
    if not all(_inside(_METRE * q[:, i], machine.axes[i]) for i in linear):
        return
    if sum(_METRE * moved[i] >= _FILLED * machine.axes[i].length for i in linear) < _LEAST_AXES:
        return
    found = ", ".join(f"{machine.letters[i]} = {q[:, i].min():g} … {q[:, i].max():g}" for i in linear)
    travels = ", ".join("{:g} … {:g}".format(*machine.axes[i].travel) for i in linear)
    raise InputError(
        f"{readings.file_and_set}: axis positions seem to be in metres: {found}, where the travels are {travels} mm; expected "
        "mm. Multiply these columns by 1000, and see whether tool vectors and readings need the same"
    )


def check_outside(campaign: Campaign) -> None:
    """Raises `InputError` when many positions of an axis lie outside its travel, naming the slip that would put them all inside.

    A few positions outside, as in an over-travel, are a warning and no more (`checks`).
    """
    if all(takes_large_errors(s) for s in campaign.sets):
        return
    machine, q = campaign.machine, campaign.positions
    outside = [_share_outside(q[:, i], axis) for i, axis in enumerate(machine.axes)]
    if max(outside) < _MANY:
        return
    i = int(np.argmax(outside))
    letter, (low, high) = machine.letters[i], machine.axes[i].travel
    slip = " or ".join(_inside_otherwise(campaign, i))
    if not slip and outside[i] < _MOST:
        return
    what = (
        f"if {slip}, all lie inside"
        if slip
        else f"is the column right, and travel in [axis.{letter}] of the machine file?"
    )
    found = f"positions of {letter} ({q[:, i].min():g} … {q[:, i].max():g})"
    raise InputError(
        f"{campaign.source or 'campaign'}: {100.0 * outside[i]:.0f} % of the {found} lie outside its travel {low:g} … {high:g} "
        f"{machine.axes[i].unit}; {what}. If the positions are right, widen the travel in the machine file"
    )


def _share_outside(q: np.ndarray, axis: Axis) -> float:
    slack = _SLACK * axis.length
    return float(np.mean((q < axis.travel[0] - slack) | (q > axis.travel[1] + slack)))


def _inside_otherwise(campaign: Campaign, i: int) -> Iterator[str]:
    """Slips that put all positions of axis number i inside, and those of the axis that it is exchanged with."""
    machine, q = campaign.machine, campaign.positions
    axes, letters = machine.axes, machine.letters
    if _share_outside(-q[:, i], axes[i]) == 0.0:
        yield f"{letters[i]} counts the other way"
    for j in range(len(axes)):
        alike = j != i and axes[j].is_linear == axes[i].is_linear
        if alike and _share_outside(q[:, j], axes[i]) == 0.0 and _share_outside(q[:, i], axes[j]) == 0.0:
            yield f"columns {letters[i]} and {letters[j]} are exchanged"


def _inside(q: np.ndarray, axis: Axis) -> bool:
    slack = _SLACK * axis.length
    return bool(q.min() >= axis.travel[0] - slack and q.max() <= axis.travel[1] + slack)


def check_digits(readings: ObservationSet) -> None:
    """Raises `InputError` when the u of a reading column is far below the rounding of its readings."""
    for values, u in zip(readings.readings.T, readings.u.T, strict=True):
        step = _resolution(values)
        if step and u.max() < _CLEARLY * step / np.sqrt(12.0):
            raise InputError(
                f"{readings.file_and_set}: u is at most {u.max():.2g}, but the readings are rounded to {step:g}, which alone has "
                f"a standard uncertainty of {step / np.sqrt(12.0):.2g}; expected u in the unit of the readings (mm or rad). "
                "Is it in metres? Mend u, or write the readings with all their digits"
            )


def _resolution(values: np.ndarray) -> float:
    """The power of ten, 1e-7 to 1, that all readings are multiples of; 0 when there is none, or too few to tell."""
    values = np.unique(values[values != 0.0])
    if len(values) < _LEAST_READINGS:
        return 0.0
    for digits in _DIGITS:
        scaled = values * 10.0**digits
        if np.all(np.abs(scaled - np.round(scaled)) <= 4.0 * np.spacing(np.abs(scaled))):
            return float(10.0**-digits)
    return 0.0
