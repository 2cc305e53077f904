"""What a reader has to know of a circular test: how it was evaluated, what it does not tell, what needs a second look."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from volid.exceptions import InputError
from volid.standards.circular.geometry import decompose

if TYPE_CHECKING:
    from volid.standards.circular.evaluation import CircularDetails

_POOR = (110.0, 200.0)  # degrees
_SCATTERED = 2.0  # u: more is worth a remark
_WIDER = 15.0  # degrees: with so much more the geometry is tried again
WIDEST = 45.0  # degrees: half of a quadrant is left for the geometry
_LEAST_CHANGE = 5e-4  # mm: a reversal value that changes less is the same
_SEEN = 3.0  # u: a spike that counts
_ALIKE, _SURE, _FEWEST = 0.5, 4.0, 12  # correlation, its standard deviations from 0, angles that it needs
_LEAST_WAVE = 1e-4  # mm: smaller ones are of no matter
_MUCH = 1.5  # U by which noise makes a range larger: less is usual, and U tells of its size
_NUMBERS = 1_000_000  # that are drawn to see what noise does
_OF_THIS_PATH = (
    "squareness and scale are those of this path: straightness and angular errors at its place are part of them, and only a fit "
    "of more paths tells them apart"
)
_NO_U = "no u of the readings is known: U of the geometry is from the residuals, ISO quantities have none"
_NO_LENGTH_U = "no u of the bar's length is known: U of F_max, F_min, D and diameter is that of the readings alone"
_ONE_SENSE = "one sense only: no bidirectional quantities, and squareness cannot be told from a lag of the axes"
_WAVES_HARDLY_SEEN = (
    "in simulations U of squareness was too small by a quarter on such arcs, which hardly show waves of the path"
)


def remarks(details: CircularDetails, blank: list[str], window: float, setup_centre: bool) -> tuple[str, ...]:
    """Remarks; `blank`: symbols of what is not determined."""
    test = details.test
    x, y = 1e3 * details.circle.centre
    found = [
        f"{len(test.runs)} {'run' if len(test.runs) == 1 else 'runs'} of {test.arc:.0f}° with radius {test.radius:g} mm"
        f"{f', feed {test.feed:g} mm/min' if test.feed else ''}; anticlockwise is from +{test.plane[0]} to +{test.plane[1]}",
        f"by the least-squares circle of all readings, spikes with them, the socket stands {x:.1f} µm in {test.plane[0]} and "
        f"{y:.1f} µm in {test.plane[1]} from the centre of the path, which the machine's errors move too"
        f"{', which the radial deviations contain' if setup_centre else ', which is taken out of the radial deviations'}",
        f"geometry is taken from the readings outside {window:g}° behind changes of quadrant, spikes from those within",
    ]
    return (*found, *(text for holds, text in _cases(details, blank) if holds))


def _cases(details: CircularDetails, blank: list[str]) -> list[tuple[bool, str]]:
    """What holds in some tests only, each with whether it does."""
    test, ratio, arc = details.test, details.geometry.ratio, details.test.arc
    symbol, larger, U = by_noise(details)
    return [
        (not test.is_calibrated, "the length of the bar is unknown: F_max, F_min and D are not determined"),
        (True, _OF_THIS_PATH),
        (
            ratio > _SCATTERED,
            f"residuals scatter by {ratio:.1f} times the stated u of the readings; U of the geometry has it",
        ),
        (
            larger > _MUCH * U,
            f"noise of the readings makes {symbol} about {1e3 * larger:.1f} µm larger than that of the path: the definition "
            "takes the extremes of what was read, and U does not contain it",
        ),
        (len(test.senses) == 1, _ONE_SENSE),
        (
            not test.is_full,
            f"the arc of {arc:.0f}° is no full circle: D is not determined, and centre, radius and shape of the path can "
            "exchange",
        ),
        (_POOR[0] < arc < _POOR[1], _WAVES_HARDLY_SEEN),
        (test.u is None, _NO_U),
        (test.u is not None and test.length_u == 0.0, _NO_LENGTH_U),
        (bool(blank), f"not determined: {', '.join(blank)}"),
    ]


def by_noise(details: CircularDetails) -> tuple[str, float, float]:
    """Symbol of the last circular deviation, by how much noise makes it larger than that of the path, and its U [mm].

    The path outside the windows is taken as fitted; noise of the readings' u is drawn upon it anew, and the mean range
    about the centre of the minimum zone compared. Spikes stand as they were read. U is infinite where no u is known.
    """
    test, geometry = details.test, details.geometry
    symbol, zone = list(details.zones.items())[-1]
    if test.u is None:
        return symbol, 0.0, np.inf
    smooth = np.where(geometry.masked, details.circle.deviation, geometry.fitted)
    level = (
        smooth
        - details.circle.direction @ zone.centre
        - (0.0 if test.is_calibrated else details.circle.radius[test.parts])
    )
    u = np.where(geometry.masked, 0.0, test.u)
    rng = np.random.default_rng(0)
    draws = int(np.clip(_NUMBERS // len(test), 20, 200))
    ranges = [np.ptp(level + u * rng.standard_normal(len(test))) for _ in range(draws)]
    return symbol, float(np.mean(ranges) - np.ptp(level)), float(2.0 * np.sqrt(np.sum((zone.weights * test.u) ** 2)))


def attention(details: CircularDetails, window: float) -> tuple[str, ...]:
    """Why the numbers need a second look: pulses that outlast the window, waves that are too short for the model."""
    return (*_of_window(details, window), *_short_waves(details))


def _short_waves(details: CircularDetails) -> Iterator[str]:
    """What the geometry leaves of both senses alike: waves, as of a screw or scale, that U of the geometry takes for noise.

    At the ends of an axis such a wave stands still, and before a change of quadrant alone it looks like reversal and lag.
    """
    r, n, size = senses_alike(details)
    if size > _LEAST_WAVE and r > _ALIKE and np.arctanh(min(r, 1.0 - 1e-12)) * np.sqrt(max(n - 3, 0)) > _SURE:
        yield (
            f"{details.test.plane}: the path has waves of about {1e3 * size:.1f} µm that are too short for the geometry and "
            "alike in both senses, as a pitch error of a screw or scale makes them; reversal, lag and spikes may be wrong by as "
            "much, and more than their U; test with smaller steps, and the axes alone (ISO 230-2)"
        )


def senses_alike(details: CircularDetails) -> tuple[float, int, float]:
    """Correlation of what is left in both senses at the same angles outside the windows, number of angles, amplitude [mm]."""
    test, geometry = details.test, details.geometry
    place = np.round(test.angle % 360.0 / test.step).astype(int) % max(round(360.0 / test.step), 1)
    size = int(place.max()) + 1
    means = []
    for sense in (1, -1):
        rows = (test.sense == sense) & ~geometry.masked
        count = np.bincount(place[rows], minlength=size)
        total = np.bincount(place[rows], weights=geometry.residual[rows], minlength=size)
        means.append(np.where(count > 0, total / np.maximum(count, 1), np.nan))
    there, back = (m[np.isfinite(means[0] + means[1])] for m in means)
    if len(there) < _FEWEST or not (np.ptp(there) > 0.0 and np.ptp(back) > 0.0):
        return 0.0, len(there), 0.0
    r = float(np.corrcoef(there, back)[0, 1])
    return r, len(there), float(np.sqrt(2.0 * max(np.cov(there, back)[0, 1], 0.0)))


def _of_window(details: CircularDetails, window: float) -> tuple[str, ...]:
    """Reversal values that a wider window changes: pulses last longer than the window, and are taken for reversal."""
    test, narrow = details.test, details.geometry.terms
    wide = min(window + _WIDER, WIDEST)
    if wide <= window or not any(abs(s.height) > _SEEN * s.u for s in details.geometry.spikes):
        return ()
    try:
        other = decompose(test, details.circle, wide).terms
    except InputError:  # a wider window leaves too little
        return ()
    found = []
    for term, letter in (("reversal aa", test.plane[0]), ("reversal bb", test.plane[1])):
        before, after = narrow[term], other[term]
        if abs(after.value - before.value) > _SEEN * max(after.u, _LEAST_CHANGE / _SEEN):
            values = f"{1e3 * before.value:.1f} µm behind {window:g}°, {1e3 * after.value:.1f} µm behind {wide:g}°"
            found.append(
                f"{test.plane}: B_E{letter}{letter} depends on the window, {values}: reversal spikes last longer, "
                "and bend scale and reversal; choose a wider `spike_window`"
            )
    return tuple(found)
