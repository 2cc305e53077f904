"""Unit slips: readings in metres, micrometres or inches where mm belong, recognised by their scale against the machine.

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

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from volid.campaign import Campaign, ObservationSet, Station
from volid.exceptions import InputError
from volid.model.iso230 import ROTATIONS
from volid.model.kinematics import transform
from volid.model.machine import Machine
from volid.multilateration.trilateration import trilaterate
from volid.observations.distance import sees_tool, target_body, target_place

_INCH = 25.4  # mm
SCALES = {1e-3: "metres", 1e3: "micrometres", 1 / _INCH: "inches", _INCH: "inches"}  # the last: positions in inches
LARGEST_VALUE = {False: 1.0, True: 0.01}  # component: mm, rad; far beyond any machine that can still be compensated
_LEAST_SPREAD = 0.2  # of the targets' extent: nearer to a sphere around the station, the slope says nothing
_LEAST_CORRELATION = 0.99
_SLOPE_TOLERANCE = 0.25
FITS = 0.002  # of the targets' extent, 2 mm per metre: more than any machine's deviations
_BETTER = 0.02  # residual of the right scale over that of k = 1, at most
_IMPOSSIBLE = 10.0  # |d_i - d_j| <= |p_i - p_j|: half of the readings cannot span ten times the targets' extent
_CLEAR_EXTENT = 20.0  # mm
_LEAST_EXTENT = 0.1  # mm added to it, so that drift at one place is no slip
_SPARE = 4  # readings beyond the unknowns for a trial location
_TRIAL_ROWS = 1000
_FEW_TRAVELS = 0.02  # positions in metres span less than this share of the travels


@dataclass(frozen=True)
class Beam:
    """Readings of one station: targets (m, 3) [mm] in its body's frame, distances (m,) [mm], segment numbers (m,)."""

    targets: np.ndarray
    distances: np.ndarray
    segments: np.ndarray
    relative: bool
    station: Station

    @property
    def extent(self) -> float:
        """Diagonal of the box around the targets [mm]."""
        return float(np.linalg.norm(np.ptp(self.targets, axis=0)))

    @property
    def misfit(self) -> float:
        """Root mean square disagreement of the readings with the station's approximate position [mm]; 0 without one."""
        if self.station.position is None:
            return 0.0
        ranges = np.linalg.norm(self.targets - np.array(self.station.position), axis=1)
        return float(np.sqrt(np.mean(_centred(self.distances - ranges, self) ** 2)))

    def thinned(self) -> Beam:
        """At most `_TRIAL_ROWS` readings, evenly through the file."""
        step = slice(None, None, -(-len(self.distances) // _TRIAL_ROWS))
        return Beam(self.targets[step], self.distances[step], self.segments[step], self.relative, self.station)


def check_distances(readings: ObservationSet, campaign: Campaign) -> None:
    """Raises `InputError` when the distances, or the axis positions, of a set are not in mm."""
    verdicts = [found for beam in beams(readings, campaign) if (found := _scale(beam)) is not None]
    slips = [k for k in verdicts if k != 1.0]
    if len(slips) * 2 <= len(verdicts):
        return
    k = max(set(slips), key=slips.count)
    where = f"{readings.source or readings.name}, set '{readings.name}'"
    if k == _INCH or (k > 1.0 and _positions_are_small(readings, campaign.machine)):
        unit = "metres" if k == 1e3 else SCALES[k]
        raise InputError(f"{where}: axis positions seem to be in {unit}, {k:g} times too small; expected mm")
    size = f"{k:g} times too large" if k > 1.0 else f"{1 / k:g} times too small"
    raise InputError(f"{where}: distances seem to be in {SCALES[k]}, {size} for the positions; expected mm")


def check_components(readings: ObservationSet, campaign: Campaign) -> None:
    """Raises `InputError` when a value lies more than 1 mm or 10 mrad from the middle of its line."""
    components = readings.labels["component"]
    for line in np.unique(readings.labels["line"]):
        for component in np.unique(components):
            rows = np.flatnonzero((readings.labels["line"] == line) & (components == component))
            if len(rows):
                _check_values(readings, rows, component in ROTATIONS)


def _check_values(readings: ObservationSet, rows: np.ndarray, is_rotation: bool) -> None:
    values = readings.readings[rows, 0]
    offset = np.abs(values - np.median(values))
    i = int(np.argmax(offset))
    if offset[i] <= LARGEST_VALUE[is_rotation]:
        return
    unit, likely, limit = ("rad", "µrad or arcseconds", "10 mrad") if is_rotation else ("mm", "µm", "1 mm")
    raise InputError(
        f"{readings.where(int(rows[i]))}: value {values[i]:g} lies more than {limit} from the middle of its line; "
        f"it looks like {likely}, expected {unit}"
    )


def _positions_are_small(readings: ObservationSet, machine: Machine) -> bool:
    """The linear axes span a tiny share of their travels, and lie near zero."""
    return all(
        np.abs(readings.positions[:, i]).max() <= _FEW_TRAVELS * max(axis.length, *np.abs(axis.travel))
        for i, axis in enumerate(machine.axes)
        if axis.is_linear
    )


def positions_look_small(readings: ObservationSet, machine: Machine) -> bool:
    """True when all linear positions would fit the travels in metres as well (for a warning)."""
    return bool(machine.linear) and np.ptp(readings.positions) > 0.0 and _positions_are_small(readings, machine)


def beams(readings: ObservationSet, campaign: Campaign) -> Iterator[Beam]:
    """Readings station by station; none when a rotary axis is off zero."""
    machine = campaign.machine
    rotary = [i for i, axis in enumerate(machine.axes) if not axis.is_linear]
    if readings.positions[:, rotary].any():
        return
    segments = np.unique(readings.labels["segment"], return_inverse=True)[1]
    for name in np.unique(readings.labels["station"]):
        rows = np.flatnonzero(readings.labels["station"] == name)
        station = campaign.station(name)
        q, tool = readings.positions[rows].T, readings.tool[rows].T
        place = (tool[0], tool[1], tool[2]) if sees_tool(readings) else target_place(readings)
        start, stop = machine.body_index(target_body(readings)), machine.body_index(station.body)
        target = transform(machine, q, None, place, start=start, stop=stop)
        points = np.stack([np.broadcast_to(np.asarray(c), len(rows)) for c in target], axis=1)
        yield Beam(points, readings.readings[rows, 0], segments[rows], bool(readings.options["relative"]), station)


def _scale(beam: Beam) -> float | None:
    """k, one of `SCALES` or 1, or None when it cannot be told."""
    if beam.extent == 0.0:
        return None
    slope = _slope(beam)
    for k in (1.0, *SCALES):
        if slope is not None and abs(np.log(slope / k)) < np.log1p(_SLOPE_TOLERANCE):
            return 1.0 if k == 1.0 or _unclear(beam, k) or _fits_nearby(beam.thinned()) else k
    return _scale_by_trial(beam.thinned()) or _impossible_scale(beam)


def _unclear(beam: Beam, k: float) -> bool:
    """Targets in so small a box, seen from so far, that any scale but 1000 (positions in metres) may fit by chance."""
    return beam.extent < _CLEAR_EXTENT and k < 1e3


def _impossible_scale(beam: Beam) -> float | None:
    """k > 1 nearest to the readings' middle range over the targets' extent, when that is beyond the possible."""
    lower, upper = np.percentile(_centred(beam.distances, beam), (25, 75))
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
    ranges = _centred(np.linalg.norm(beam.targets - np.array(beam.station.position), axis=1), beam)
    readings = _centred(beam.distances, beam)
    if np.ptp(ranges) < _LEAST_SPREAD * beam.extent or not readings.any():
        return None
    correlation = ranges @ readings / np.sqrt((ranges @ ranges) * (readings @ readings))
    return float(ranges @ readings / (ranges @ ranges)) if correlation > _LEAST_CORRELATION else None


def _centred(values: np.ndarray, beam: Beam) -> np.ndarray:
    """Values minus the mean of their segment."""
    codes = np.unique(beam.segments, return_inverse=True)[1]
    return values - (np.bincount(codes, values) / np.bincount(codes))[codes]


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
