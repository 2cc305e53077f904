"""Circular tests by ISO 230-4 with a double ball bar, and what geometry and dynamics have to do with them.

The definitions used, quoted from memory of ISO 230-4 and said in full, because no clause was at hand:

- circular deviation `G_XY` (anticlockwise, from +X to +Y), `G_YX` (clockwise): the least radial separation of two
  concentric circles that enclose the path of one run; of several runs of a sense, the largest. `G_XY_ls`: the range of the
  radii about the least-squares circle's centre, the variant that the standard allows; it is never smaller.
- bidirectional circular deviation `G_b_XY`: the same of all paths of both senses together.
- radial deviations `F_max`, `F_min`: the largest and the smallest deviation of the radius from the programmed one. They need a
  centre: that of the least-squares circle of all paths together, or the set-up's (`setup_centre=True`), which the standard, as
  remembered, asks for on arcs. They need a bar of known length.
- circular hysteresis `H_XY`: the largest difference of the radii of both senses at one angle, each the mean of its runs.
- mean bidirectional radial deviation `D_XY`: mean radius of both senses less the programmed one, full circles only;
  `diameter_XY` is twice that.

U (k = 2) follows from u of the readings and of the bar's length. A range of noisy radii is larger than that of the path
alone; that is part of these definitions, and U does not take it away. Not modelled: expansion of bar and machine by
temperature, unless the environment of a campaign says it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from volid.exceptions import InputError
from volid.standards.circular.geometry import Decomposition, decompose
from volid.standards.circular.paths import hysteresis
from volid.standards.circular.readings import CircularReadings
from volid.standards.circular.remarks import WIDEST, attention, remarks
from volid.standards.circular.words import geometry, table
from volid.standards.circular.zone import LeastSquaresCircle, Zone, least_squares_circle, minimum_zone
from volid.standards.results import Evaluation, Quantity

STANDARD = "ISO 230-4"
WINDOW = 15.0  # degrees behind a change of quadrant: pulses of friction last some hundredths of a second
_K = 2.0


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
    `volid.standards.circular.geometry`: `scale_XY` (of X less that of Y), `squareness_XY` (angle between +X and +Y less
    90°; that is EC0Y in XY, EA0Z in YZ, -EB0Z in ZX where X is the primary axis), reversal values `B_EXX`, `B_EYX` …,
    `lag_XY`, `bow_EYX`, and the reversal spikes `spike_XY_90` (anticlockwise at 90°, outwards positive). What is not
    determined is left out, and named.

    Args:
        test: Readings of one plane (`volid.standards.circular.readings.circular_readings`).
        spike_window: Angle behind every change of quadrant that the geometry is not taken from [degrees].
        setup_centre: Radial deviations from the centre as it was set up, instead of that of the least-squares circle.

    Returns:
        The evaluation; its `details` are a `CircularDetails`.

    Raises:
        InputError: `spike_window` is below 0 or above 45 degrees.

    References:
        ISO 230-4, circular tests for numerically controlled machine tools; ISO 230-1 for the symbols of the errors.

    Example:
        >>> from volid.standards.circular.readings import circular_readings
        >>> angle = np.concatenate([np.arange(0.0, 361.0, 5.0), np.arange(360.0, -1.0, -5.0)])
        >>> square = 20e-6  # rad
        >>> test = circular_readings("XY", 150.0, angle, -75.0 * square * np.sin(np.deg2rad(2.0 * angle)))
        >>> found = evaluate_circular(test)
        >>> round(found["G_b_XY"].value, 6), round(1e6 * found["squareness_XY"].value, 3)
        (0.003, 20.0)
    """
    if not 0.0 <= spike_window <= WIDEST:
        raise InputError(f"`spike_window={spike_window:g}`: expected an angle from 0 to {WIDEST:g} degrees")
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
        remarks=remarks(details, blank, spike_window, setup_centre),
        attention=attention(details, spike_window),
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
        return found._replace(weights=weights)

    zones = {}
    for sense in test.senses:
        runs = [zone(rows) for rows in test.runs if test.sense[rows[0]] == sense]
        zones[f"G_{test.name(sense)}"] = max(runs, key=lambda z: z.width)
    if len(test.senses) == 2:
        zones[f"G_b_{test.plane}"] = zone(np.arange(len(test)))
    return zones


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
    if len(test.senses) == 2 and (found_h := hysteresis(test, details.deviation)) is not None:
        words = "largest difference of radius of the two senses"
        found.append(Quantity(f"H_{test.plane}", *found_h, text=f"circular hysteresis, {words}"))
    if test.is_calibrated and test.is_full and len(test.senses) == 2:
        value, U = float(details.circle.radius[0]), _U(test, details.circle.gain[2], length=True)
        found.append(Quantity(f"D_{test.plane}", value, "mm", U, text="mean bidirectional radial deviation"))
        text = "mean diameter of both senses less the programmed one"
        found.append(Quantity(f"diameter_{test.plane}", 2.0 * value, "mm", None if U is None else 2.0 * U, text=text))
    return found
