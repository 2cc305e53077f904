"""Least-squares adjustment of distance networks and its result.

Adjusting a free network is model-free multilateration: all stations and targets are unknown, only the distances relate them
to each other, and inner constraints keep the coordinates as near to the approximate ones as the distances allow.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from scipy.special import gammaincc, ndtri

from volid.exceptions import InputError
from volid.multilateration.blunders import inseparable, without_blunders
from volid.multilateration.equations import Equations, decomposition, descend, nearest, normalised, part, undetermined


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
        undetermined: Names of the points that the other combinations, which are not determined, move.
        degrees_of_freedom: Number of observations kept minus `rank`.
        unit_weight: sqrt(Σ (residual/u)² / degrees of freedom): near 1 when the stated u is right, NaN without redundancy.
        residuals: Reading - predicted, shape (m,).
        normalised_residuals: Residuals over their own standard deviation, shape (m,); NaN where no other reading checks one.
        critical_value: Normalised residual beyond which a reading is suspected.
        blunders: Indices of the observations that the robust adjustment left out.
        inseparable: For each blunder and suspect, the observations that would show the same residuals if the blunder were theirs.

    Example:
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
    blunders: tuple[int, ...] = ()
    inseparable: Mapping[int, tuple[int, ...]] = field(default_factory=dict)

    def position(self, point: str) -> Float[np.ndarray, " d"]:
        """Adjusted coordinates of one point by its name, shape (d,), in the unit of the distances."""
        return self.coordinates[self.points.index(point)]

    @property
    def standard_uncertainty(self) -> Float[np.ndarray, "p d"]:
        """A priori standard uncertainty of every coordinate, shape (p, d), 0 for fixed points.

        Multiplied by `unit_weight` it is the a posteriori one.
        """
        u = np.zeros_like(self.coordinates)
        rows = [self.points.index(point) for point in self.unknown]
        u[rows] = np.sqrt(np.diag(self.covariance)).reshape(len(rows), -1)
        return u

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


def adjust_network(
    points: Sequence[str],
    fixed: Collection[str],
    observations: Sequence[tuple[str, str, float]],
    u: ArrayLike,
    approximate: Mapping[str, ArrayLike] | ArrayLike,
    dimension: int = 3,
    *,
    robust: bool = False,
    significance: float = 0.01,
) -> NetworkSolution:
    """Least-squares coordinates of a distance network, free (inner constraints) or with fixed points.

    Minimises Σ ((d_i - |x_to - x_from|) / u_i)² by Gauss-Newton with the pseudo-inverse of the Jacobian J / u (singular
    value decomposition, rank decided at 1e-9 of the largest singular value). What J does not determine is chosen by inner
    constraints: of all solutions the one whose corrections to the approximate coordinates have the least sum of
    squares, x = x0 + J⁺ (r + J (x - x0)), iterated. The covariance is J⁺ J⁺ᵀ. Fixed coordinates are taken as exact.

    With `robust`, readings are reweighted to least absolute residuals; those whose normalised residual then exceeds the
    critical value are left out one by one (and taken back when they fit), and named in `blunders`. The critical value
    holds for all readings together: quantile 1 - significance / (2 m) of the normal distribution. If the stated u is too
    small, good readings would count as blunders; therefore the test uses u times the unit weight when that exceeds 1.

    Args:
        points: Names, in the order the results shall have.
        fixed: Names of the points that keep their approximate coordinates.
        observations: (from, to, distance), m of them, any one unit.
        u: Standard uncertainty of the distances, number or shape (m,), same unit.
        approximate: Name -> coordinates, or Array, shape (p, dimension), in the order of `points`.
            `volid.multilateration.starting_coordinates` finds missing ones.
        dimension: 2 or 3.
        robust: Find blunders and leave them out.
        significance: Probability of calling at least one good reading a blunder.

    Raises:
        InputError: unknown names, impossible numbers, missing coordinates, or coordinates too wrong to converge from.

    References:
        Koch, Parameter Estimation and Hypothesis Testing in Linear Models, 1999, 3.2.6 (rank defect) and 4.2.4;
        Baarda, A Testing Procedure for Use in Geodetic Networks, 1968 (normalised residuals); Schlossmacher, J. Am.
        Stat. Assoc. 68 (1973) 857 (least absolute residuals by reweighting).

    Example:
        >>> corners = {"A": (0, 0), "B": (400, 0), "P": (210, 290)}
        >>> solution = adjust_network("ABP", "AB", [("A", "P", 360.5551), ("B", "P", 360.5551)], 0.001, corners, 2)
        >>> solution.position("P").round(3)
        array([200., 300.])
    """
    equations, given = _equations(points, fixed, observations, u, approximate, dimension)
    critical = float(ndtri(1 - significance / (2 * len(observations))))
    kept = without_blunders(equations, critical) if robust else np.ones(equations.u.size, bool)
    used = part(equations, kept)
    x = nearest(used, descend(used, used.approximate))
    solution = _solution(equations, x, kept, tuple(points), critical)
    return replace(
        solution,
        coordinates=np.where(equations.free[:, None], x + given.mean(axis=0), given),
        observations=tuple((str(start), str(end), float(distance)) for start, end, distance in observations),
        inseparable=inseparable(equations, x, solution.blunders + solution.suspects),
    )


def _solution(
    equations: Equations,
    x: Float[np.ndarray, "p d"],
    kept: Bool[np.ndarray, " m"],
    points: tuple[str, ...],
    critical: float,
) -> NetworkSolution:
    """Everything that follows from the adjusted coordinates and the observations kept."""
    _, sizes, axes = decomposed = decomposition(equations, x, kept)
    residuals, dof = equations.residuals(x), int(kept.sum()) - sizes.size
    datum_defect, open_points = undetermined(equations, x, axes)
    return NetworkSolution(
        points=points,
        unknown=tuple(name for name, is_free in zip(points, equations.free, strict=True) if is_free),
        observations=(),
        u=equations.u,
        coordinates=x,
        covariance=(axes.T / sizes**2) @ axes,
        rank=sizes.size,
        defect=axes.shape[1] - sizes.size,
        datum_defect=datum_defect,
        undetermined=tuple(points[i] for i in open_points),
        degrees_of_freedom=dof,
        unit_weight=float(np.sqrt((residuals[kept] ** 2).sum() / dof)) if dof > 0 else float("nan"),
        residuals=residuals * equations.u,
        normalised_residuals=normalised(equations, x, kept, decomposed),
        critical_value=critical,
        blunders=tuple(int(i) for i in np.flatnonzero(~kept)),
    )


def _equations(points, fixed, observations, u, approximate, dimension) -> tuple[Equations, Float[np.ndarray, "p d"]]:
    """The network in numbers, checked, its coordinates minus their mean; and the coordinates as given."""
    index = {name: i for i, name in enumerate(points)}
    if len(index) != len(points) or not observations or dimension not in (2, 3):
        raise InputError("expected different point names, at least one observation, and dimension 2 or 3")
    if strangers := [name for name in fixed if name not in index]:
        raise InputError(f"fixed point {strangers[0]} is not among the points {_listed(index)}")
    free = np.array([name not in fixed for name in points])
    if not free.any():
        raise InputError("all points are fixed; expected at least one unknown point")
    x = _coordinates(points, approximate, dimension)
    readings = np.array([float(distance) for _, _, distance in observations])
    sigma = np.broadcast_to(np.asarray(u, float), readings.shape).copy()
    _check_observations(observations, sigma, index)
    start, end = (np.array([index[row[k]] for row in observations]) for k in (0, 1))
    return Equations(x - x.mean(axis=0), free, start, end, readings, sigma), x


def _check_observations(observations, sigma: Float[np.ndarray, " m"], index: Collection[str]) -> None:
    """Known names, possible numbers, or InputError."""
    for i, (start, end, distance) in enumerate(observations):
        what = f"observation {i + 1} ({start} to {end}, {distance:g})"
        if start not in index or end not in index or start == end:
            raise InputError(f"{what}: expected two different names out of the points {_listed(index)}")
        if not (0 < distance < np.inf and 0 < sigma[i] < np.inf):
            raise InputError(f"{what}: distance {distance:g}, u {sigma[i]:g}; expected both finite and above 0")


def _coordinates(points, approximate, dimension: int) -> Float[np.ndarray, "p d"]:
    """Approximate coordinates in the order of `points`."""
    if isinstance(approximate, Mapping):
        if missing := [name for name in points if name not in approximate]:
            raise InputError(
                f"no approximate coordinates for {_listed(missing)}; expected {dimension} numbers for every point"
            )
        approximate = [approximate[name] for name in points]
    try:
        x = np.array(approximate, float)
    except ValueError:
        x = np.empty(0)
    if x.shape != (len(points), dimension) or not np.isfinite(x).all():
        raise InputError(
            f"approximate coordinates: expected {dimension} finite numbers for each of {len(points)} points"
        )
    return x


def _listed(names: Collection[str], most: int = 8) -> str:
    """Names for a message, cut short."""
    shown = list(names)[:most]
    return ", ".join(map(str, shown)) + (f" … ({len(names)})" if len(names) > most else "")
