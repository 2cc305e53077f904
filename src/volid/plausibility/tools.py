"""Tool vectors and approximate stations in metres among positions in mm, recognised by where the readings put the stations.

A station is located from its distances to the nominal functional points, without its approximate position. Then
- tool vectors below 2 mm are tried a thousand times longer. They were in metres when only then one position per station fits all
  its readings, or when all stations are found displaced from their stated positions by just that tool vector;
- stations found a thousand times farther from the machine's origin than stated were given in metres, and stations found nearer
  by a constant factor show that everything else is not in mm.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.observations.beams import Beam
from volid.plausibility.units import FITS, TRIAL_ROWS, beams, trial

_METRE = 1000.0
SHORT = 2.0  # mm: a tool vector in metres is no longer
_BETTER = 0.1  # residual with longer tools over that with the given ones, at most
_NEAR = 0.2  # of a length: agreement that cannot be chance at factors of 25 to 1000
_AGREES = 0.05  # of the targets' extent: distances agree with the approximate station, nothing to be looked for
_SCALES = {_METRE: "metres", 25.4: "inches"}
_LEAST_STATIONS = 2


def check_tools(readings: ObservationSet, campaign: Campaign) -> Iterator[str]:
    """A warning when all tool vectors are shorter than 2 mm; raises `InputError` when the distances show them to be in metres."""
    length = np.linalg.norm(readings.tool, axis=1).max()
    if not 0.0 < length < SHORT:
        return
    where = readings.file_and_set
    if _fits_only_longer(readings, campaign) or _displaced(readings, campaign):
        raise InputError(
            f"{where}: tool vectors seem to be in metres: the longest is {length:g} mm, but the distances agree with one that is "
            "1000 times longer; expected mm. Multiply tool_x, tool_y, tool_z (or the set's `tool`) by 1000"
        )
    yield f"{where}: all tool vectors are shorter than {SHORT:g} mm, the longest {length:g}; are they in mm?"


def _fits_only_longer(readings: ObservationSet, campaign: Campaign) -> bool:
    """Most stations have no place with the tool vectors as given, and have one when they are in metres."""
    longer = replace(readings, tool=_METRE * readings.tool)
    votes = []
    for given, tried in zip(beams(readings, campaign), beams(longer, campaign), strict=True):
        before, after = trial(given.thinned(TRIAL_ROWS), 1.0), trial(tried.thinned(TRIAL_ROWS), 1.0)
        if before is not None and after is not None:
            fits = after[0] <= FITS * tried.extent
            votes.append(fits and before[0] > FITS * given.extent and after[0] < _BETTER * before[0])
    return 2 * sum(votes) > len(votes)


def _displaced(readings: ObservationSet, campaign: Campaign) -> bool:
    """All stations are found displaced by the same tool vector, the given one in metres: found - stated = -(1000 - 1) tool."""
    expected = -(_METRE - 1.0) * np.median(readings.tool, axis=0)
    shifts = [found - np.array(beam.station.position) for beam, found in _located(readings, campaign)]
    if len(shifts) < _LEAST_STATIONS:
        return False
    return bool(np.linalg.norm(shifts - expected, axis=1).max() < _NEAR * np.linalg.norm(expected))


def _located(readings: ObservationSet, campaign: Campaign) -> Iterator[tuple[Beam, np.ndarray]]:
    """Beams of stations with an approximate position in the machine's frame, and where the readings put the station."""
    for beam in beams(readings, campaign):
        if beam.station.position is None or (beam.station.known and beam.station.frame != "machine"):
            continue
        found = trial(beam.thinned(TRIAL_ROWS), 1.0)
        if found is not None and found[0] <= FITS * beam.extent:
            yield beam, found[1]


def check_stations(readings: ObservationSet, campaign: Campaign) -> None:
    """Raises `InputError` when the stations' positions and the rest of a set are not in the same unit.

    Not judged: known stations in their common frame, whose place in the machine is unknown.
    """
    if not _any_disagrees(readings, campaign):
        return
    places = [(beam.station, found) for beam, found in _located(readings, campaign)]
    where = readings.file_and_set
    for scale, unit in _SCALES.items():
        small = [(s, f) for s, f in places if _same(scale * np.array(s.position), f)]
        large = [(s, f) for s, f in places if _same(np.array(s.position), scale * f)]
        named = ", ".join(f"{s.name} at ({', '.join(f'{v:.4g}' for v in f)})" for s, f in (small or large)[:3])
        if len(small) >= max(_LEAST_STATIONS, 0.5 * len(places)):
            s = small[0][0]
            raise InputError(
                f"{campaign.source or 'campaign'}: [[station]] positions seem to be in {unit}: the distances put {named}, and "
                f"position of {s.name} is [{', '.join(f'{v:g}' for v in s.position or ())}]; expected mm. Multiply by {scale:g}"
            )
        if len(large) >= max(_LEAST_STATIONS, 0.5 * len(places)):
            raise InputError(
                f"{where}: axis positions, tool vectors and distances seem to be in {unit}: they put station {named}, {scale:g} "
                "times nearer to the origin than the manifest does; expected mm"
            )


def _any_disagrees(readings: ObservationSet, campaign: Campaign) -> bool:
    """Whether at least one station is not at its stated position: each is located directly, without a search."""
    return any(b.misfit > _AGREES * b.extent for b in beams(readings, campaign) if b.station.position is not None)


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(np.linalg.norm(one - other) < _NEAR * min(np.linalg.norm(one), np.linalg.norm(other)))
