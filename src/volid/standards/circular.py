"""Circular tests by ISO 230-4 with a double ball bar, and what geometry and dynamics have to do with them.

The definitions used, quoted from memory of ISO 230-4 and said in full, because no clause was at hand:

- circular deviation `G_XY` (anticlockwise, from +X to +Y), `G_YX` (clockwise): the least radial separation of two
  concentric circles that enclose the path of one run; of several runs of a sense, the largest. `G_XY_ls`: the range of the
  radii about the least-squares circle's centre, the variant that the standard allows; it is never smaller.
- bidirectional circular deviation `G_b_XY`: the same of all paths of both senses together.
- radial deviations `F_max`, `F_min`: the largest and the smallest deviation of the radius from the programmed one. They need a
  centre: that of the least-squares circle of all paths together, or the set-up's. They need a bar of known length.
- circular hysteresis `H_XY`: the largest difference of the radii of both senses at one angle, each the mean of its runs.
- mean bidirectional radial deviation `D_XY`: mean radius of both senses less the programmed one, full circles only;
  `diameter_XY` is twice that.

U (k = 2) follows from u of the readings and of the bar's length. A range of noisy radii is larger than that of the path
alone; that is part of these definitions, and U does not take it away. Not modelled: expansion of bar and machine by
temperature, unless the environment of a campaign says it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.standards.circular_geometry import Decomposition, decompose
from volid.standards.circular_readings import CircularReadings
from volid.standards.circular_words import geometry, table
from volid.standards.circular_zone import LeastSquaresCircle, Zone, least_squares_circle, minimum_zone
from volid.standards.results import Evaluation, Quantity

STANDARD = "ISO 230-4"
WINDOW = 15.0  # degrees behind a change of quadrant: pulses of friction last some hundredths of a second
_WIDEST = 45.0  # degrees: half of a quadrant is left for the geometry
_K = 2.0
_WIDER = 15.0  # degrees: with so much more the geometry is tried again
_LEAST_CHANGE = 5e-4  # mm: a reversal value that changes less is the same
_POOR = (110.0, 200.0)  # degrees
_SCATTERED = 2.0  # u: more is worth a remark
_SEEN = 3.0  # u: a spike that counts


@dataclass(frozen=True)
class CircularDetails:
    """What an evaluation was made of: `test`, its least-squares `circle`, `deviation` (m,) of the radii [mm] about the
    centre that was chosen (about the mean circle where the length is unknown), minimum `zones` by the quantity's symbol,
    `geometry`."""

    test: CircularReadings
    circle: LeastSquaresCircle
    deviation: np.ndarray
    zones: dict[str, Zone]
    geometry: Decomposition


def evaluate_circular(test: CircularReadings, spike_window: float = WINDOW, setup_centre: bool = False) -> Evaluation:
    """A circular test in one plane by ISO 230-4, with its geometry told apart from dynamics.

    Symbols and definitions of the standard: see the module. With them stand the terms of
    `volid.standards.circular_geometry`: `scale_XY` (of X less that of Y), `squareness_XY` (angle between +X and +Y less
    90°; that is EC0Y in XY, EA0Z in YZ, -EB0Z in ZX where X is the primary axis), reversal values `B_EXX`, `B_EYX` …,
    `lag_XY`, `bow_EYX`, and the reversal spikes `spike_XY_90` (anticlockwise at 90°, outwards positive). What is not
    determined is left out, and named.

    Args:
        test: Readings of one plane (`volid.standards.circular_readings.circular_readings`).
        spike_window: Angle behind every change of quadrant that the geometry is not taken from [degrees].
        setup_centre: Radial deviations from the centre as it was set up, instead of that of the least-squares circle.

    Returns:
        The evaluation; its `details` are a `CircularDetails`.

    Raises:
        InputError: `spike_window` is below 0 or above 45 degrees.

    References:
        ISO 230-4, circular tests for numerically controlled machine tools; ISO 230-1 for the symbols of the errors.

    Example:
        >>> from volid.standards.circular_readings import circular_readings
        >>> angle = np.concatenate([np.arange(0.0, 361.0, 5.0), np.arange(360.0, -1.0, -5.0)])
        >>> square = 20e-6  # rad
        >>> test = circular_readings("XY", 150.0, angle, -75.0 * square * np.sin(np.deg2rad(2.0 * angle)))
        >>> found = evaluate_circular(test)
        >>> round(found["G_b_XY"].value, 6), round(1e6 * found["squareness_XY"].value, 3)
        (0.003, 20.0)
    """
    if not 0.0 <= spike_window <= _WIDEST:
        raise InputError(f"`spike_window={spike_window:g}`: expected an angle from 0 to {_WIDEST:g} degrees")
    circle = least_squares_circle(test.direction, test.deviation, test.radius, test.parts, test.share)
    about = _about(test, circle, setup_centre)
    zones = _zones(test, circle)
    details = CircularDetails(test, circle, about, zones, decompose(test, circle, spike_window))
    quantities = [*_circular(details), *_radial(details, setup_centre), *_both(details)]
    own, blank = geometry(test, details.geometry)
    return Evaluation(
        STANDARD,
        test.plane,
        (*quantities, *own),
        remarks=_remarks(details, blank, spike_window, setup_centre),
        attention=_attention(details, spike_window),
        table=table(test, about, details.geometry),
        source=test.source,
        details=details,
    )


def _about(test: CircularReadings, circle: LeastSquaresCircle, setup_centre: bool) -> np.ndarray:
    """Deviations of the radii about the centre that was chosen, (m,); less the mean radius where the length is unknown."""
    deviation = test.deviation if setup_centre else circle.deviation
    return deviation if test.is_calibrated else deviation - circle.radius[test.parts]


def _zones(test: CircularReadings, circle: LeastSquaresCircle) -> dict[str, Zone]:
    """Minimum zones: of every sense, that of the run with the largest one, and of all together."""
    level = circle.deviation - (circle.radius[test.parts] if not test.is_calibrated else 0.0)

    def zone(rows: np.ndarray) -> Zone:
        found = minimum_zone(circle.direction[rows], level[rows], test.radius)
        weights = np.zeros(len(test))
        weights[rows] = found.weights
        return replace_weights(found, weights)

    zones = {}
    for sense in test.senses:
        runs = [zone(rows) for rows in test.runs if test.sense[rows[0]] == sense]
        zones[f"G_{test.name(sense)}"] = max(runs, key=lambda z: z.width)
    if len(test.senses) == 2:
        zones[f"G_b_{test.plane}"] = zone(np.arange(len(test)))
    return zones


def replace_weights(zone: Zone, weights: np.ndarray) -> Zone:
    """The zone with weights for all readings of the test."""
    return zone._replace(weights=weights)


def _U(test: CircularReadings, row: np.ndarray, length: bool = False) -> float | None:
    """Expanded uncertainty of a number with derivative `row` (m,) by the readings; with `length`, that of the bar is in it."""
    if test.u is None:
        return None
    return float(_K * np.sqrt(np.sum((row * test.u) ** 2) + (test.length_u**2 if length else 0.0)))


def _circular(details: CircularDetails) -> list[Quantity]:
    """Circular deviations: minimum zones, then ranges about the least-squares centre."""
    test, found = details.test, []
    for symbol, zone in details.zones.items():
        what = "both senses" if "_b_" in symbol else _words(test, symbol)
        text = f"circular deviation, {what}, minimum zone"
        found.append(Quantity(symbol, zone.width, "mm", _U(test, zone.weights), text=text))
    for symbol in details.zones:
        what = "both senses" if "_b_" in symbol else _words(test, symbol)
        value, row = _range(details, symbol)
        text = f"the same, {what}, about the least-squares centre"
        found.append(Quantity(f"{symbol}_ls", value, "mm", _U(test, row), text=text))
    return found


def _words(test: CircularReadings, symbol: str) -> str:
    return "anticlockwise" if symbol.endswith(test.plane) else "clockwise"


def _range(details: CircularDetails, symbol: str) -> tuple[float, np.ndarray]:
    """Range of the radii about the least-squares centre of the path itself, the largest run's, and its derivative."""
    test = details.test
    if "_b_" in symbol:
        groups = [np.arange(len(test))]
    else:
        groups = [rows for rows in test.runs if test.name(int(test.sense[rows[0]])) == symbol[2:]]
    best, derivative, share = -1.0, np.zeros(len(test)), test.share
    for rows in groups:
        part = np.unique(test.parts[rows], return_inverse=True)[1]
        circle = least_squares_circle(test.direction[rows], test.deviation[rows], test.radius, part, share[rows])
        level = circle.deviation - (0.0 if test.is_calibrated else circle.radius[part])
        high, low = int(np.argmax(level)), int(np.argmin(level))
        if level[high] - level[low] > best:
            best, derivative = float(level[high] - level[low]), np.zeros(len(test))
            derivative[rows] = (circle.direction[high] - circle.direction[low]) @ circle.gain[:2]
            derivative[rows[high]] += 1.0
            derivative[rows[low]] -= 1.0
    return best, derivative


def _radial(details: CircularDetails, setup_centre: bool) -> list[Quantity]:
    """Radial deviations; none where the length of the bar is unknown."""
    test = details.test
    if not test.is_calibrated:
        return []
    where = "from the set-up centre" if setup_centre else "from the least-squares centre"
    rows = {"": np.arange(len(test)), **{f"_{test.name(s)}": np.flatnonzero(test.sense == s) for s in test.senses}}
    found = []
    for index, own in rows.items():
        which = f", {_words(test, index)}" if index else ""
        for name, pick, word in (("F_max", np.argmax, "largest"), ("F_min", np.argmin, "smallest")):
            i = int(own[pick(details.deviation[own])])
            derivative = np.zeros(len(test)) if setup_centre else details.circle.direction[i] @ details.circle.gain[:2]
            derivative[i] += 1.0
            text = f"{word} radial deviation{which}, {where}"
            value = float(details.deviation[i])
            found.append(Quantity(f"{name}{index}", value, "mm", _U(test, derivative, length=True), text=text))
    return found


def _both(details: CircularDetails) -> list[Quantity]:
    """Hysteresis of both senses, and their mean radius."""
    test, found = details.test, []
    if len(test.senses) == 2 and (hysteresis := _hysteresis(details)) is not None:
        words = "largest difference of radius of the two senses"
        found.append(Quantity(f"H_{test.plane}", *hysteresis, text=f"circular hysteresis, {words}"))
    if test.is_calibrated and test.is_full and len(test.senses) == 2:
        value, U = float(details.circle.radius[0]), _U(test, details.circle.gain[2], length=True)
        found.append(Quantity(f"D_{test.plane}", value, "mm", U, text="mean bidirectional radial deviation"))
        text = "mean diameter of both senses less the programmed one"
        found.append(Quantity(f"diameter_{test.plane}", 2.0 * value, "mm", None if U is None else 2.0 * U, text=text))
    return found


class MeanPath(NamedTuple):
    """Mean of all runs of a sense: `angle` (k,) [degrees], growing, from the middle of the arc; `deviation` (k,) [mm];
    `number` (k,) readings; `u` (k,) [mm] of their mean, NaN where none is known."""

    angle: np.ndarray
    deviation: np.ndarray
    number: np.ndarray
    u: np.ndarray


def mean_path(details: CircularDetails, sense: int) -> MeanPath:
    """The mean path of a sense."""
    test = details.test
    rows = np.flatnonzero(test.sense == sense)
    angle = np.round(relative_angle(test)[rows], 4)
    angles, number, count = np.unique(angle, return_inverse=True, return_counts=True)
    number = number.ravel()
    mean = np.bincount(number, weights=details.deviation[rows]) / count
    u = (
        np.full(len(angles), np.nan)
        if test.u is None
        else np.sqrt(np.bincount(number, weights=test.u[rows] ** 2)) / count
    )
    return MeanPath(angles, mean, count, u)


def relative_angle(test: CircularReadings) -> np.ndarray:
    """Angles from the middle of the arc, (m,), between -180 and 180 degrees."""
    middle = 0.0
    if not test.is_full:
        places = np.unique(np.round(test.angle % 360.0, 9))
        gaps = np.diff(places, append=places[0] + 360.0)
        widest = int(np.argmax(gaps))
        middle = places[widest] + 0.5 * gaps[widest] + 180.0
    return np.asarray((test.angle - middle + 180.0) % 360.0 - 180.0)


def _hysteresis(details: CircularDetails) -> tuple[float, str, float | None] | None:
    """Value, unit and U of the largest difference; None where the senses have no angle in common."""
    there, back = (mean_path(details, sense) for sense in (1, -1))
    period = 360.0 if details.test.is_full else None
    both = np.ones(len(there.angle), dtype=bool)
    if period is None:
        both = (there.angle >= back.angle[0]) & (there.angle <= back.angle[-1])
    if not both.any():
        return None
    other = np.interp(there.angle, back.angle, back.deviation, period=period)
    difference = np.where(both, np.abs(there.deviation - other), -1.0)
    i = int(np.argmax(difference))
    if details.test.u is None:
        return float(difference[i]), "mm", None
    u = np.hypot(there.u[i], np.interp(there.angle[i], back.angle, back.u, period=period))
    return float(difference[i]), "mm", float(_K * u)


def _remarks(details: CircularDetails, blank: list[str], window: float, setup_centre: bool) -> tuple[str, ...]:
    test = details.test
    x, y = 1e3 * details.circle.centre
    found = [
        f"{len(test.runs)} runs of {test.arc:.0f}° with radius {test.radius:g} mm"
        f"{f', feed {test.feed:g} mm/min' if test.feed else ''}; anticlockwise is from +{test.plane[0]} to +{test.plane[1]}",
        f"the least-squares circle of all readings, spikes with them, says that the socket stands {x:.1f} µm in "
        f"{test.plane[0]} and {y:.1f} µm in {test.plane[1]} from the programmed centre"
        f"{', which the radial deviations contain' if setup_centre else ', which is taken out of the radial deviations'}",
        f"geometry is taken from the readings outside {window:g}° behind changes of quadrant, spikes from those within",
    ]
    if not test.is_calibrated:
        found.append("the length of the bar is unknown: F_max, F_min and D are not determined")
    found.append(
        "squareness and scale are those of this path: straightness and angular errors at its place are part of them, and only "
        "a fit of more paths tells them apart"
    )
    if details.geometry.ratio > _SCATTERED:
        found.append(
            f"the residuals scatter by {details.geometry.ratio:.1f} times the stated u of the readings, and U of the geometry is "
            "enlarged by that"
        )
    if len(test.senses) == 1:
        found.append(
            "one sense only: no bidirectional quantities, and squareness cannot be told from a lag of the axes"
        )
    if not test.is_full:
        found.append(
            f"the arc of {test.arc:.0f}° is no full circle: D is not determined, and centre, radius and shape of the path can "
            "exchange"
        )
    if _POOR[0] < test.arc < _POOR[1]:
        found.append(
            "in simulations U of squareness was too small by a quarter on such arcs, which hardly show waves of the path"
        )
    if test.u is None:
        found.append("no u of the readings is known: U of the geometry is from the residuals, ISO quantities have none")
    if blank:
        found.append(f"not determined: {', '.join(blank)}")
    return tuple(found)


def _attention(details: CircularDetails, window: float) -> tuple[str, ...]:
    """Reversal values that a wider window changes: pulses last longer than the window, and are taken for reversal."""
    test, narrow = details.test, details.geometry.terms
    wide = min(window + _WIDER, _WIDEST)
    if wide <= window or not any(abs(s.height) > _SEEN * s.u for s in details.geometry.spikes):
        return ()
    other, found = decompose(test, details.circle, wide).terms, []
    for term, letter in (("reversal aa", test.plane[0]), ("reversal bb", test.plane[1])):
        before, after = narrow[term], other[term]
        if abs(after.value - before.value) > _SEEN * max(after.u, _LEAST_CHANGE / _SEEN):
            values = f"{1e3 * before.value:.1f} µm behind {window:g}°, {1e3 * after.value:.1f} µm behind {wide:g}°"
            found.append(
                f"{test.plane}: B_E{letter}{letter} depends on the window, {values}: reversal spikes last longer, "
                "and bend scale and reversal; choose a wider `spike_window`"
            )
    return tuple(found)
