"""Units of lengths: readings in metres, micrometres or inches instead of mm, recognised by their scale against the machine.

A distance reading is d = k·|target - station| + dead path with k = 1 when all is in mm, 0.001 for readings in metres,
1000 for readings in micrometres or positions in metres, and so on. k is looked for in three ways, for each station:
1. with an approximate position s of the station, k is the slope of d over |target - s|; judged only when the two go
   together, the distances differ enough (on a ball-bar circle they do not), and k = 1 fits no station nearby;
2. otherwise by trial: the station is located from d / k for every k; k = 1 must fail and another k succeed;
3. otherwise by the triangle inequality, |d_i - d_j| <= |p_i - p_j|, when half of the readings break it tenfold.
A legitimate set passes whatever its shape, because k = 1 fits it. What cannot be judged passes: distances that are too
small seen from a station of unknown position with all targets in a plane, relative readings of a circle, rotary axes
off zero.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.machine import Machine
from volid.multilateration.trilateration import trilaterate
from volid.observations import KINDS
from volid.observations.beams import Beam

_INCH = 25.4  # mm
SCALES = {1e-3: "metres", 1e3: "micrometres", 1 / _INCH: "inches", _INCH: "inches"}  # the last: positions in inches
_LEAST_SPREAD = 0.2  # of the targets' extent: nearer to a sphere around the station, the slope says nothing
_LEAST_CORRELATION = 0.99
_SLOPE_TOLERANCE = 0.25
FITS = 0.002  # of the targets' extent, 2 mm per metre: more than any machine's deviations
_BETTER = 0.02  # residual of the right scale over that of k = 1, at most
_IMPOSSIBLE = 10.0  # |d_i - d_j| <= |p_i - p_j|: half of the readings cannot span ten times the targets' extent
_CLEAR_EXTENT = 20.0  # mm
_LEAST_EXTENT = 0.1  # mm added to it, so that drift at one place is no wrong unit
_SPARE = 4  # readings beyond the unknowns for a trial location
TRIAL_ROWS = 1000
_FEW_TRAVELS = 0.02  # positions in metres span less than this share of the travels


def check_lengths(readings: ObservationSet, campaign: Campaign) -> None:
    """Raises `InputError` when the distances, or the axis positions, of a set are not in mm."""
    verdicts = [found for beam in beams(readings, campaign) if (found := _scale(beam)) is not None]
    wrong = [k for k in verdicts if k != 1.0]
    if len(wrong) * 2 <= len(verdicts):
        return
    k = max(set(wrong), key=wrong.count)
    where = readings.file_and_set
    if k == _INCH or (k > 1.0 and _positions_are_small(readings, campaign.machine)):
        unit = "metres" if k == 1e3 else SCALES[k]
        raise InputError(f"{where}: axis positions seem to be in {unit}, {k:g} times too small; expected mm")
    size = f"{k:g} times too large" if k > 1.0 else f"{1 / k:g} times too small"
    raise InputError(f"{where}: distances seem to be in {SCALES[k]}, {size} for the positions; expected mm")


def _positions_are_small(readings: ObservationSet, machine: Machine) -> bool:
    """The linear axes span a tiny share of their travels, and lie near zero."""
    return all(
        np.abs(readings.all_ends.positions[:, i]).max() <= _FEW_TRAVELS * max(axis.length, *np.abs(axis.travel))
        for i, axis in enumerate(machine.axes)
        if axis.is_linear
    )


def positions_look_small(readings: ObservationSet, machine: Machine) -> bool:
    """True when all linear positions would fit the travels in metres as well (for a warning)."""
    return (
        bool(machine.linear) and np.ptp(readings.all_ends.positions) > 0.0 and _positions_are_small(readings, machine)
    )


def beams(readings: ObservationSet, campaign: Campaign) -> Iterable[Beam]:
    """Readings that are lengths, station by station; none for other kinds, or when a rotary axis is off zero."""
    rotary = [i for i, axis in enumerate(campaign.machine.axes) if not axis.is_linear]
    if readings.positions[:, rotary].any():
        return ()
    return KINDS[readings.kind].beams(readings, campaign)


def _scale(beam: Beam) -> float | None:
    """k, one of `SCALES` or 1, or None when the readings do not determine it."""
    if beam.extent == 0.0:
        return None
    slope = _slope(beam)
    for k in (1.0, *SCALES):
        if slope is not None and abs(np.log(slope / k)) < np.log1p(_SLOPE_TOLERANCE):
            return 1.0 if k == 1.0 or _unclear(beam, k) or _fits_nearby(beam.thinned(TRIAL_ROWS)) else k
    return _scale_by_trial(beam.thinned(TRIAL_ROWS)) or _impossible_scale(beam)


def _unclear(beam: Beam, k: float) -> bool:
    """Targets in so small a box, seen from so far, that any scale but 1000 (positions in metres) may fit by chance."""
    return beam.extent < _CLEAR_EXTENT and k < 1e3


def _impossible_scale(beam: Beam) -> float | None:
    """k > 1 nearest to the readings' middle range over the targets' extent, when that is beyond the possible."""
    lower, upper = np.percentile(beam.centred(beam.distances), (25, 75))
    ratio = (upper - lower) / (beam.extent + _LEAST_EXTENT)
    large = [k for k in SCALES if k > 1.0]
    return min(large, key=lambda k: abs(np.log(k / ratio))) if ratio > _IMPOSSIBLE else None


def _fits_nearby(beam: Beam) -> bool:
    """k = 1 fits with a station less than one extent from where it is said to be."""
    found = trial(beam, 1.0)
    if found is None or found[0] > FITS * beam.extent:
        return False
    return bool(np.linalg.norm(found[1] - np.array(beam.station.position)) < beam.extent)


def _slope(beam: Beam) -> float | None:
    """Slope of the readings over the distances from the station's approximate position, when that is meaningful."""
    if beam.station.position is None:
        return None
    ranges = beam.centred(np.linalg.norm(beam.targets - np.array(beam.station.position), axis=1))
    readings = beam.centred(beam.distances)
    if np.ptp(ranges) < _LEAST_SPREAD * beam.extent or not readings.any():
        return None
    correlation = ranges @ readings / np.sqrt((ranges @ ranges) * (readings @ readings))
    return float(ranges @ readings / (ranges @ ranges)) if correlation > _LEAST_CORRELATION else None


def _scale_by_trial(beam: Beam) -> float | None:
    given = trial(beam, 1.0)
    if given is None:
        return None
    if given[0] <= FITS * beam.extent:
        return 1.0
    scales = [k for k in SCALES if not _unclear(beam, k)]
    better = {k: t[0] for k in scales if (t := trial(beam, k)) is not None and t[0] < _BETTER * given[0]}
    return min(better, key=lambda k: better[k]) if better else None


def trial(beam: Beam, k: float) -> tuple[float, np.ndarray] | None:
    """Station located from d / k: robust standard deviation of the readings [mm], position; None if not redundant."""
    unknowns = 3 + (len(np.unique(beam.segments)) if beam.relative else 0)
    if len(np.unique(beam.targets, axis=0)) < unknowns + _SPARE:
        return None
    try:
        found = trilaterate(beam.targets, beam.distances / k, beam.segments, beam.relative, beam.station.position)
    except InputError:
        return None
    return k * found.scale, found.position
