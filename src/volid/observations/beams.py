"""Lengths from a station to places that are known nominally: what start values and checks of units are found from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from volid.backend.rms import rms
from volid.campaign import Station


@dataclass(frozen=True)
class Beam:
    """Readings of one station in one set: targets (m, 3) [mm] in its body's frame, distances (m,) [mm], segments (m,).

    `segments`: numbers of the uninterrupted beams, whose labels are `names`. `relative`: with one unknown dead path each.
    `rows`: (m,) row numbers in the set.
    """

    targets: np.ndarray
    distances: np.ndarray
    segments: np.ndarray
    relative: bool
    station: Station
    names: tuple[str, ...] = ()
    rows: np.ndarray | None = None

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
        return rms(self.centred(self.distances - ranges))

    def centred(self, values: np.ndarray) -> np.ndarray:
        """Values (m,) minus the mean of their segment."""
        codes = np.unique(self.segments, return_inverse=True)[1]
        return np.asarray(values - (np.bincount(codes, values) / np.bincount(codes))[codes])

    def thinned(self, rows: int) -> Beam:
        """At most `rows` readings, evenly through the file."""
        step = slice(None, None, -(-len(self.distances) // rows))
        return Beam(self.targets[step], self.distances[step], self.segments[step], self.relative, self.station)
