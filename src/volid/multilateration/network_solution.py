"""What is known of an adjusted distance network."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import gammainc, gammaincc

from volid.multilateration.reliability import Ellipsoids, Reliability

if TYPE_CHECKING:
    from jaxtyping import Bool, Float


@dataclass(frozen=True)
class Alternative:
    """A second solution: some points elsewhere, most often on the other side of the plane of what they were measured from.

    Attributes:
        points: Names of the points that it moves.
        coordinates: Theirs in it, shape (n, d).
        worse: Its sum of squared residuals over u minus that of the solution; below 9 (three standard deviations).
        decided: Whether the approximate coordinates lie clearly nearer the solution.
    """

    points: tuple[str, ...]
    coordinates: Float[np.ndarray, "n d"]
    worse: float
    decided: bool


@dataclass(frozen=True)
class Offset:
    """The offset (dead path) that relative distances of one group share, and how many they were; u is NaN if not determined."""

    value: float
    u: float
    readings: int


@dataclass(frozen=True)
class NetworkSolution:
    """Adjusted coordinates of a distance network and what is known about them; `adjust_network` makes it.

    Lengths are in the unit of the distances; p points, m observations, k unknown coordinates, d dimensions (2 or 3).

    Attributes:
        points: Names; every array with p rows has them in this order.
        unknown: Names of the points that were adjusted; the others were fixed.
        observations: (from, to, distance) as given, m of them.
        u: Standard uncertainty of the distances as stated, shape (m,).
        coordinates: Adjusted coordinates, shape (p, d).
        covariance: A priori, from the stated u, shape (k, k): coordinates of `unknown` in that order (x, y, z of the first,
            then of the second, …), under inner constraints.
        rank: Number of combinations of coordinates that the distances determine.
        defect: Number of combinations that they do not determine.
        datum_defect: How many of those are rigid motions of the entire network.
        undetermined: Names of the points with a coordinate that is not determined otherwise.
        not_determined: Which coordinates these are, shape (p, d).
        second_order: Those of `undetermined` that depend on the distances by their square alone: points in the plane (line) of
            what they were measured from, or nearer to it than their u. The coordinates are at the minimum; `network_trials`
            gives intervals.
        degrees_of_freedom: Number of observations kept minus `rank`.
        unit_weight: sqrt(Σ (residual/u)² / degrees of freedom): near 1 when the stated u is right, NaN without redundancy.
        residuals: Reading - predicted, shape (m,).
        normalised_residuals: Residuals over their own standard deviation, shape (m,); NaN where no other reading checks one.
        critical_value: Normalised residual beyond which a reading is suspected.
        blunders: Indices of the observations that the robust adjustment left out.
        inseparable: For each blunder and suspect, the observations that would show the same residuals if the blunder were theirs.
        reliability: Redundancy numbers and minimal detectable errors of the observations.
        ellipsoids: Error ellipsoids of the points.
        offsets: Of relative distances, by the name of their group.
        groups: Name of the group of each observation, None without an offset; empty when none has one.
        alternatives: Other solutions that the distances cannot tell from this one.
        parts: Points of the parts of the network, when it falls into several without a common point; fixed points are one.
        left_start: The approximate coordinates led to a worse minimum, and another start to this one.

    Example:
        >>> from volid.multilateration import adjust_network
        >>> corners = {"A": (0, 0), "B": (400, 0), "P": (210, 290)}
        >>> readings = [("A", "P", 360.5551), ("B", "P", 360.5551)]
        >>> solution = adjust_network("ABP", "AB", readings, 0.001, corners, 2)
        >>> solution.standard_uncertainty[2].round(4), solution.rank, solution.defect
        (array([0.0013, 0.0008]), 2, 0)
    """

    points: tuple[str, ...]
    unknown: tuple[str, ...]
    observations: tuple[tuple[str, str, float], ...]
    u: Float[np.ndarray, " m"]
    coordinates: Float[np.ndarray, "p d"]
    covariance: Float[np.ndarray, "k k"]
    rank: int
    defect: int
    datum_defect: int
    undetermined: tuple[str, ...]
    degrees_of_freedom: int
    unit_weight: float
    residuals: Float[np.ndarray, " m"]
    normalised_residuals: Float[np.ndarray, " m"]
    critical_value: float
    not_determined: Bool[np.ndarray, "p d"]
    second_order: tuple[str, ...]
    reliability: Reliability
    ellipsoids: Ellipsoids
    blunders: tuple[int, ...] = ()
    inseparable: Mapping[int, tuple[int, ...]] = field(default_factory=dict)
    offsets: Mapping[Any, Offset] = field(default_factory=dict)
    groups: tuple[Hashable, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    parts: tuple[tuple[str, ...], ...] = ()
    left_start: bool = False

    def position(self, point: str) -> Float[np.ndarray, " d"]:
        """Adjusted coordinates of one point by its name, shape (d,), in the unit of the distances."""
        return self.coordinates[self.points.index(point)]

    @property
    def standard_uncertainty(self) -> Float[np.ndarray, "p d"]:
        """A priori standard uncertainty of every coordinate, shape (p, d), 0 for fixed points, NaN where not determined.

        Multiplied by `unit_weight` it is the a posteriori one.
        """
        u = np.zeros_like(self.coordinates)
        rows = [self.points.index(point) for point in self.unknown]
        u[rows] = np.sqrt(np.diag(self.covariance)).reshape(len(rows), -1)
        return np.where(self.not_determined, np.nan, u)

    @property
    def suspects(self) -> tuple[int, ...]:
        """Indices of observations that were kept although their normalised residual exceeds the critical value.

        Where the other readings scatter more than stated, the critical value is multiplied by their unit weight.
        """
        if self.degrees_of_freedom < 2:
            return ()
        z = np.nan_to_num(self.normalised_residuals)
        squares = self.degrees_of_freedom * self.unit_weight**2 - z**2
        others = np.sqrt(np.maximum(squares, 0) / (self.degrees_of_freedom - 1))
        beyond = np.abs(z) > self.critical_value * np.maximum(others, 1)
        return tuple(int(i) for i in np.flatnonzero(beyond) if i not in self.blunders)

    @property
    def chi_square_probability(self) -> float:
        """Probability of so large a sum of squared residuals, if model and u are right; NaN without redundancy."""
        if self.degrees_of_freedom < 1:
            return float("nan")
        return float(gammaincc(self.degrees_of_freedom / 2, self.degrees_of_freedom * self.unit_weight**2 / 2))

    @property
    def agreement_probability(self) -> float:
        """Probability of so small a sum of squared residuals, if model and u are right; NaN without redundancy."""
        if self.degrees_of_freedom < 1:
            return float("nan")
        return float(gammainc(self.degrees_of_freedom / 2, self.degrees_of_freedom * self.unit_weight**2 / 2))
