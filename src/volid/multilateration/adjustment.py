"""Least-squares adjustment of distance networks.

Adjusting a free network is model-free multilateration: all stations and targets are unknown, only the distances relate them
to each other, and inner constraints keep the coordinates as near to the approximate ones as the distances allow.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from volid.backend.threads import one_blas_thread
from volid.exceptions import InputError
from volid.multilateration.blunders import inseparable, without_blunders
from volid.multilateration.descent import descend, within_the_plane
from volid.multilateration.determination import (
    VISIBLE,
    determine,
    first_order_holds,
    held_by_the_datum,
    movement,
    nearest,
    not_determined,
)
from volid.multilateration.equations import ABSOLUTE, Equations, part
from volid.multilateration.findings import AS_FLAT, alternatives_of, offsets_of, parts_of
from volid.multilateration.mirrors import best_sides, on_the_fold
from volid.multilateration.network_solution import NetworkSolution
from volid.multilateration.reliability import ellipsoids, normalised, reliability
from volid.multilateration.search import search

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

_LARGEST = 1e50  # of lengths, and of 1/u; squares of squares still are numbers
_CANDIDATES = 3  # minima from which blunders are looked for


@one_blas_thread()
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
    groups: Sequence[Hashable] | None = None,
    guessed: Collection[str] = (),
) -> NetworkSolution:
    """Least-squares coordinates of a distance network, free (inner constraints) or with fixed points.

    Minimises Σ ((d_i - |x_to - x_from| - δ_g(i)) / u_i)² by damped Newton steps; δ_g is the unknown offset that the relative
    distances of a group share, absent for absolute ones. Where an unknown point lies in the plane of what it is measured from,
    J, the Jacobian divided by u, says nothing of its height: the second derivatives decide whether it stays there. Points and
    groups of points are tried on their other side, and where chi-square is improbable, other starts too; the lowest minimum is
    taken, and second solutions that the distances cannot tell from it are named.

    Then the rank is decided at 1e-9 of the largest singular value of J. What neither J nor the second derivatives determine is
    chosen by inner constraints: of all solutions the one whose corrections to the approximate coordinates have the least sum of
    squares, x = x0 + J⁺ (r + J (x - x0)), iterated. The covariance is J⁺ J⁺ᵀ. Fixed coordinates are taken as exact. A coordinate
    that a direction moves which is not determined to first order has no u.

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
        groups: For each observation the name of the group that shares an unknown offset, such as (station, segment); None:
            absolute.
        guessed: Names of points whose approximate coordinates come from the distances: they do not decide between two sides.

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
    equations, given, labels = _equations(points, fixed, observations, u, approximate, dimension, groups)
    critical = float(ndtri(1 - significance / (2 * len(observations))))
    minima, left_start = search(equations)
    kept, x = np.ones(equations.u.size, bool), minima[0]
    if robust:
        kept, x = without_blunders(equations, critical, minima[:_CANDIDATES])
        x = best_sides(part(equations, kept), x)
    used = part(equations, kept)
    x = _settled(used, x)
    solution = _solution(equations, x, kept, tuple(points), critical)
    return replace(
        solution,
        coordinates=np.where(equations.free[:, None], x + given.mean(axis=0), given),
        observations=tuple((str(start), str(end), float(distance)) for start, end, distance in observations),
        inseparable=inseparable(equations, x, solution.blunders + solution.suspects),
        groups=tuple(groups or ()),
        offsets=offsets_of(equations, x, kept, labels),
        alternatives=alternatives_of(used, x, given, solution, guessed),
        parts=parts_of(equations, tuple(points)),
        left_start=left_start,
    )


OPEN = 1e-6  # share of an orthonormal motion that moves a coordinate


def _settled(equations: Equations, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "p d"]:
    """A minimum refined, as near to the approximate coordinates as the distances allow, and in a plane where it lies at one."""
    if first_order_holds(equations, x):
        return nearest(equations, x)
    x = on_the_fold(equations, descend(equations, nearest(equations, on_the_fold(equations, x))))
    flat = within_the_plane(equations)
    return x if flat is None or equations.cost(flat) > equations.cost(x) + AS_FLAT / 2 else flat


def _solution(
    equations: Equations,
    x: Float[np.ndarray, "p d"],
    kept: Bool[np.ndarray, " m"],
    points: tuple[str, ...],
    critical: float,
) -> NetworkSolution:
    """Everything that follows from the adjusted coordinates and the observations kept."""
    used = part(equations, kept)
    found, residuals = determine(used, x), equations.residuals(x, kept)
    moved, dof = movement(used, found), int(kept.sum()) - found.sizes.size - used.offsets
    lost = not_determined(used, found.covariance, moved)
    held = held_by_the_datum(used, found.covariance) & ~lost
    free = ~np.isfinite(np.concatenate([found.reach, found.weak_reach]))
    limited = (
        lost.any(axis=1) & ~held.any(axis=1) & ~not_determined(used, found.covariance, moved[:, :, free]).any(axis=1)
    )
    lost |= held
    open_points = tuple(points[i] for i in np.flatnonzero(lost.any(axis=1)))
    if not equations.free.all():  # what a frame that is open in spite of fixed points moves is not determined
        moves = np.linalg.norm(found.rigid, axis=1).reshape(-1, lost.shape[1]) > OPEN
        lost[equations.free] |= moves
    return NetworkSolution(
        points=points,
        unknown=tuple(name for name, is_free in zip(points, equations.free, strict=True) if is_free),
        observations=(),
        u=equations.u,
        coordinates=x,
        covariance=found.covariance,
        rank=found.sizes.size,
        defect=found.axes.shape[1] - found.sizes.size,
        datum_defect=found.rigid.shape[1],
        undetermined=open_points,
        not_determined=lost,
        second_order=tuple(points[i] for i in np.flatnonzero(limited)),
        degrees_of_freedom=dof,
        unit_weight=float(np.sqrt((residuals[kept] ** 2).sum() / dof)) if dof > 0 else float("nan"),
        residuals=residuals * equations.u,
        normalised_residuals=normalised(equations, x, kept, (found.vectors, found.sizes, found.axes)),
        critical_value=critical,
        blunders=tuple(int(i) for i in np.flatnonzero(~kept)),
        reliability=reliability(equations, kept, found),
        ellipsoids=ellipsoids(used, found.covariance, moved, VISIBLE),
    )


def _equations(points, fixed, observations, u, approximate, dimension, groups):
    """The network in numbers, checked, its coordinates minus their mean; the coordinates as given; names of the groups."""
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
    numbers, labels = _numbered(groups, readings.size)
    _check_observations(observations, sigma, index, numbers)
    start, end = (np.array([index[row[k]] for row in observations]) for k in (0, 1))
    return Equations(x - x.mean(axis=0), free, start, end, readings, sigma, numbers), x, labels


def _numbered(groups: Sequence[Hashable] | None, count: int) -> tuple[Int[np.ndarray, " m"], list[Hashable]]:
    """Number of the group of each observation, and the groups' names."""
    if groups is None:
        return np.full(count, ABSOLUTE), []
    if len(groups) != count:
        raise InputError(
            f"groups: {len(groups)} names; expected one for each of {count} observations, None where absolute"
        )
    labels = list(dict.fromkeys(name for name in groups if name is not None))
    number = {name: i for i, name in enumerate(labels)}
    return np.array([ABSOLUTE if name is None else number[name] for name in groups]), labels


def _check_observations(observations, sigma: Float[np.ndarray, " m"], index: Collection[str], groups) -> None:
    """Known names, possible numbers, or InputError; relative distances may have any sign."""
    for i, (start, end, distance) in enumerate(observations):
        what = f"observation {i + 1} ({start} to {end}, {distance:g})"
        if start not in index or end not in index or start == end:
            raise InputError(f"{what}: expected two different names out of the points {_listed(index)}")
        least = 0 if groups[i] == ABSOLUTE else -_LARGEST
        if not (least < distance < _LARGEST and 1 / _LARGEST < sigma[i] < _LARGEST):
            expected = "both finite and above 0" if least == 0 else "a finite distance and u above 0"
            raise InputError(f"{what}: distance {distance:g}, u {sigma[i]:g}; expected {expected}")


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
    if x.shape != (len(points), dimension) or not (np.abs(x) < _LARGEST).all():
        raise InputError(
            f"approximate coordinates: expected {dimension} finite numbers for each of {len(points)} points"
        )
    return x


def _listed(names: Collection[str], most: int = 8) -> str:
    """Names for a message, cut short."""
    shown = list(names)[:most]
    return ", ".join(map(str, shown)) + (f" … ({len(names)})" if len(names) > most else "")
