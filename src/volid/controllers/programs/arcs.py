"""Arcs and helices as polylines: G2 and G3 in G17, G18 and G19, with centre (I, J, K) or radius (R).

The first two axes of a plane and its normal are right-handed, (X, Y, Z), (Z, X, Y), (Y, Z, X): G3 turns from the first axis to
the second. In G18 that is from Z to X, so that G3 is clockwise where X is drawn to the right and Z up. ISO 6983-1:2009 A.4;
NISTIR 6556, 3.5.3. A chord of the angle Δ departs from its arc of radius r by at most r Δ²/8, compared at equal shares of the
angle, which for a helix bounds its distance as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

AXES = {170: (0, 1, 2), 180: (2, 0, 1), 190: (1, 2, 0)}  # of a plane: first, second, normal
CENTRE = "IJK"
_SLACK, _SHARE = 0.01, 1e-3  # mm, and of the radius: by how much the radii at both ends may differ
_SAME = 1e-9  # rad: a turn below it is a full circle
_WIDEST = np.pi / 8.0  # rad, of one chord, however coarse the tolerance


class Arc(NamedTuple):
    """An arc about `centre` (2,) [mm] from angle `begin`, over `sweep` [rad], positive from the first to the second axis;
    `radii`: at its ends [mm]."""

    centre: np.ndarray
    begin: float
    sweep: float
    radii: tuple[float, float]

    def points(self, start: np.ndarray, end: np.ndarray, axes: tuple[int, int, int], share: np.ndarray) -> np.ndarray:
        """Places (k, 3) [mm] at shares (k,) of the angle; the ends are `start` and `end` themselves."""
        found = start + share[:, None] * (end - start)
        radius = self.radii[0] + share * (self.radii[1] - self.radii[0])
        angle = self.begin + share * self.sweep
        found[:, axes[0]] = self.centre[0] + radius * np.cos(angle)
        found[:, axes[1]] = self.centre[1] + radius * np.sin(angle)
        found[0], found[-1] = start, end
        return found

    def shares(self, tolerance: float, quadrants: bool) -> np.ndarray:
        """Shares of the angle between which chords stay within `tolerance` [mm]; with `quadrants` also where an axis turns."""
        radius = max(self.radii) + 2.0 * abs(self.radii[1] - self.radii[0]) / abs(self.sweep)
        widest = min(_WIDEST, np.sqrt(8.0 * tolerance / radius))
        even = np.linspace(0.0, 1.0, int(np.ceil(abs(self.sweep) / widest)) + 1)
        if not quadrants:
            return even
        low, high = sorted((self.begin, self.begin + self.sweep))
        turns = np.arange(np.ceil(low / (0.5 * np.pi)), np.floor(high / (0.5 * np.pi)) + 1.0) * 0.5 * np.pi
        inner = (turns - self.begin) / self.sweep
        both = np.union1d(even, inner[(inner > 1e-9) & (inner < 1.0 - 1e-9)])
        return both[np.concatenate([[True], np.diff(both) > 1e-9])]

    def deviation(self, share: np.ndarray) -> float:
        """Largest distance of the chords between the shares from the arc [mm]."""
        radius = max(self.radii) + 2.0 * abs(self.radii[1] - self.radii[0]) / abs(self.sweep)
        return float(radius * (np.diff(share).max() * self.sweep) ** 2 / 8.0)


def arc_of(start: np.ndarray, end: np.ndarray, centre: np.ndarray, clockwise: bool, turns: int = 1) -> Arc | str:
    """The arc between two places of its plane, each (2,) [mm]; what is wrong, in words, where there is none.

    Args:
        start, end: Its ends.
        centre: Its centre.
        clockwise: Seen against the plane's normal.
        turns: How often it passes its end or, of a full circle, its start.
    """
    radii = float(np.hypot(*(start - centre))), float(np.hypot(*(end - centre)))
    if min(radii) == 0.0:
        return "its centre is its start or its end"
    if abs(radii[1] - radii[0]) > max(_SLACK, _SHARE * min(radii)):
        return f"its radius is {radii[0]:.4f} mm at the start and {radii[1]:.4f} mm at the end"
    begin, stop = (float(np.arctan2(p[1] - centre[1], p[0] - centre[0])) for p in (start, end))
    sweep = np.mod(begin - stop if clockwise else stop - begin, 2.0 * np.pi)
    sweep = (sweep if sweep > _SAME else 2.0 * np.pi) + 2.0 * np.pi * (turns - 1)
    return Arc(centre, begin, float(-sweep if clockwise else sweep), radii)


def centre_by_radius(start: np.ndarray, end: np.ndarray, radius: float, clockwise: bool) -> np.ndarray | str:
    """Centre (2,) of the arc with R: of at most half a turn, with a negative R of more; words where there is none."""
    chord = end - start
    length = float(np.hypot(*chord))
    if length == 0.0:
        return "it ends where it starts, and R does not say where its centre is; write I, J, K"
    if length / 2.0 > abs(radius) + _SLACK:
        return f"its ends are {length:.4f} mm apart, more than twice R, {abs(radius):.4f} mm"
    height = np.sqrt(max(radius**2 - length**2 / 4.0, 0.0))
    left = np.array([-chord[1], chord[0]]) / length
    return np.asarray((start + end) / 2.0 + (height if clockwise == (radius < 0.0) else -height) * left)


def centre_by_words(
    words: Mapping[str, float], start: np.ndarray, origin: np.ndarray | None, axes: tuple[int, int, int], unit: float
) -> np.ndarray:
    """Centre (2,) [mm] from I, J, K: counted from the start, or from the `origin` (3,) where centres are absolute (G90.1)."""
    offset = np.array([unit * words.get(CENTRE[a], 0.0) for a in axes[:2]])
    return offset + (start if origin is None else origin[list(axes[:2])])
