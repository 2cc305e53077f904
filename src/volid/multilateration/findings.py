"""What an adjusted network has beside coordinates: offsets, second solutions, parts without a common point."""

from __future__ import annotations

from collections.abc import Collection, Hashable
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from volid.multilateration.determination import VISIBLE, determine, movement
from volid.multilateration.equations import Equations, part
from volid.multilateration.mirrors import EQUAL, second_solutions
from volid.multilateration.network_solution import Alternative, NetworkSolution, Offset

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

AS_FLAT = 0.01  # of chi-square, a tenth of a standard deviation: below, a network given as flat is left so
_CLEARLY = (
    0.9  # how far the approximate coordinates are from the solution, over how far from another: below, they decide
)


def offsets_of(
    equations: Equations, x: Float[np.ndarray, "p d"], kept: Bool[np.ndarray, " m"], labels: list[Hashable]
) -> dict[Hashable, Offset]:
    """Offset of each group: mean of reading - distance, weighted by 1/u²; its variance 1/Σw + a C aᵀ, a the mean derivative."""
    if not labels:
        return {}
    used = part(equations, kept)
    found = determine(used, x)
    motions = movement(used, found)[equations.free]
    motions = motions.reshape(found.axes.shape[1], motions.shape[2])
    difference = used.readings - used.beams(x).lengths
    derivatives, offsets = used.uncentred_jacobian(x) * used.u[:, None], {}
    for i, label in enumerate(labels):
        rows = np.flatnonzero(used.group == i)
        if not rows.size:
            offsets[label] = Offset(float("nan"), float("nan"), 0)
            continue
        weight = used.u[rows] ** -2.0
        mean = weight @ derivatives[rows] / weight.sum()
        u = float(np.sqrt(1 / weight.sum() + mean @ found.covariance @ mean))
        lost = np.linalg.norm(mean @ motions) > VISIBLE * u
        offsets[label] = Offset(float(weight @ difference[rows] / weight.sum()), float("nan") if lost else u, rows.size)
    return offsets


def alternatives_of(
    equations: Equations,
    x: Float[np.ndarray, "p d"],
    given: Float[np.ndarray, "p d"],
    solution: NetworkSolution,
    guessed: Collection[str],
) -> tuple[Alternative, ...]:
    """Other solutions that the distances cannot tell from x, in the frame of the given coordinates.

    Without those of points that move freely anyway, and without the lower minimum of a network that is left flat.
    """
    found, points = [], solution.points
    open_points = set(solution.undetermined) - set(solution.second_order)
    for second in second_solutions(equations, x, np.nan_to_num(solution.unit_weight, nan=1.0)):
        moved, names = list(second.points), tuple(points[i] for i in second.points)
        if open_points & set(names) or -AS_FLAT <= second.worse < -EQUAL * (1 + equations.cost(x)):
            continue
        if solution.datum_defect and np.allclose(_gaps(x), _gaps(second.coordinates), rtol=0, atol=np.min(equations.u)):
            continue  # the whole network in another place, or its mirror image
        here, there = (np.linalg.norm(place[moved] - equations.approximate[moved]) for place in (x, second.coordinates))
        decided = bool(here < _CLEARLY * there) and not set(names) & set(guessed)
        found.append(Alternative(names, second.coordinates[moved] + given.mean(axis=0), second.worse, decided))
    return tuple(found)


def _gaps(x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "p p"]:
    """Distances of all points from each other."""
    return np.linalg.norm(x[:, None] - x, axis=2)


def parts_of(equations: Equations, points: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """Points of the parts without a common point, empty when there is but one; fixed points, in one frame, join theirs."""
    fixed = np.flatnonzero(~equations.free)
    start = np.concatenate([equations.start, fixed[:-1]])
    end = np.concatenate([equations.end, fixed[1:]])
    graph = coo_array((np.ones(start.size), (start, end)), shape=(len(points), len(points)))
    count, labels = connected_components(graph, directed=False)
    if count == 1:
        return ()
    return tuple(tuple(points[i] for i in np.flatnonzero(labels == label)) for label in range(count))
