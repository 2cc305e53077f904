"""Approximate coordinates of a distance network from its distances alone."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, shortest_path

from volid.backend.rms import rms
from volid.exceptions import InputError
from volid.multilateration.descent import descend
from volid.multilateration.equations import ABSOLUTE, Equations
from volid.multilateration.mirrors import best_sides
from volid.multilateration.trilateration import trilaterate

if TYPE_CHECKING:
    from jaxtyping import Float

_ATTEMPTS = 40  # random starts; enough for a dozen points all measured against each other
_GOOD = 20.0  # root mean square residual / u above which a solution is not taken for a start

Distances = dict[str, dict[str, float]]  # point -> other point -> reading
Name = TypeVar("Name", str, int)


def starting_coordinates(
    points: Sequence[str],
    observations: Sequence[tuple[str, str, float]],
    u: float,
    known: Mapping[str, ArrayLike] | None = None,
    dimension: int = 3,
    *,
    either_side: bool = False,
    groups: Sequence[Hashable] | None = None,
) -> dict[str, Float[np.ndarray, " d"]]:
    """Coordinates near the least-squares solution, for every point of a distance network.

    Points with readings to enough known ones are trilaterated, one after the other. When no point is known, the frame is
    arbitrary and the result may be a mirror image. Where every station sees every target, s_i·t_j = -(D² doubly centred) / 2
    has rank 3 and gives both up to one linear map, which is found from |t_j|² (linear in its square). Otherwise random
    starts are tried, and at first, with the sums of distances along the network for those that are missing, the coordinates
    that fit all of them (classical multidimensional scaling). Points all in one plane, and parts without a common point, are
    no obstacle.

    Args:
        points: Names, p of them.
        observations: (from, to, distance), any one unit.
        u: Standard uncertainty of the distances, same unit; it tells a solution from a local minimum.
        known: Coordinates, shape (dimension,), by the name of each point that has some.
        dimension: 2 or 3.
        either_side: Take one of two possible positions where the points that a point is measured from lie in one plane;
            otherwise such a point is refused.
        groups: Name of the group of each observation that shares an unknown offset, None where absolute. From relative
            distances a position is found where they go from one unknown point to enough known ones.

    Returns:
        Coordinates, shape (dimension,), by name, in the unit of the distances.

    Raises:
        InputError: a point cannot be found; the text names it and what is missing.

    Example:
        >>> known = {"A": (0, 0), "B": (400, 0), "C": (0, 300)}
        >>> readings = [("A", "P", 250.0), ("B", "P", 250.0), ("C", "P", 250.0)]
        >>> starting_coordinates("ABCP", readings, 0.001, known, dimension=2)["P"].round(3)
        array([200., 150.])

    Reference:
        Schönemann, On metric multidimensional unfolding, Psychometrika 35 (1970) 349.
    """
    labels = [None] * len(observations) if groups is None else list(groups)
    distances = distances_of(points, (row for row, label in zip(observations, labels, strict=True) if label is None))
    if known:
        found = {name: np.asarray(known[name], float) for name in points if name in known}
        before = -1
        while before < len(found) < len(points):
            before = len(found)
            found, ambiguous = _chained(distances, found, dimension, {} if either_side else None)
            found |= _by_relative_distances(observations, labels, found)
        if missing := [name for name in points if name not in found]:
            missing.sort(key=lambda name: -sum(other in found for other in distances[name]))
            raise InputError(_why_not(missing[0], ambiguous, dimension))
        return found
    if any(label is not None for label in labels):
        raise InputError(
            "relative distances need some approximate coordinates; give those of the points that stand still"
        )
    for unfolded in (_unfolded(distances, dimension), _unfolded(distances, 2), _scaled(distances, dimension)):
        x = None if unfolded is None else _polished(points, observations, u, _as_rows(unfolded, points, dimension))
        if x is not None:
            return dict(zip(points, x, strict=True))
    return dict(zip(points, _random(points, observations, u, dimension), strict=True))


def distances_of(
    points: Sequence[Name], observations: Iterable[tuple[Name, Name, float]]
) -> dict[Name, dict[Name, float]]:
    """Readings by point and other point."""
    distances: dict[Name, dict[Name, float]] = {name: {} for name in points}
    for start, end, distance in observations:
        distances[start][end] = distances[end][start] = distance
    return distances


def placed_from(
    distances: dict[int, dict[int, float]], known: dict[int, np.ndarray], wishes: Float[np.ndarray, "p d"]
) -> dict[int, np.ndarray]:
    """Positions of the points that can be trilaterated one after the other; of two possible ones that nearer the wish."""
    return _chained(distances, dict(known), wishes.shape[1], dict(enumerate(wishes)))[0]


def _as_rows(found: dict[str, np.ndarray], points: Sequence[str], dimension: int) -> Float[np.ndarray, "p d"]:
    """Coordinates in the order of the points, with zeros where there are too few of them."""
    x = np.array([found[name] for name in points])
    return np.pad(x, ((0, 0), (0, dimension - x.shape[1])))


def _chained(distances: dict, placed: dict, dimension: int, wishes: Mapping | None) -> tuple[dict, dict]:
    """Trilaterate whatever sees most placed points, until no more can be; and second positions of those left out.

    With `wishes`, a point with two possible positions takes the one nearer its wish, or either without one, after all others.
    """
    ambiguous: dict[Any, tuple[np.ndarray, np.ndarray]] = {}
    while missing := [name for name in distances if name not in placed]:
        missing.sort(key=lambda name: -sum(other in placed for other in distances[name]))
        for name in missing:
            position, other = _placed(distances[name], placed, dimension)
            if position is not None and other is None:
                placed[name] = position
                ambiguous.pop(name, None)
                break
            if position is not None and other is not None:
                ambiguous[name] = (position, other)
        else:
            if wishes is None or not ambiguous:
                break
            name, (position, other) = ambiguous.popitem()
            wish = wishes.get(name, position)
            placed[name] = min((position, other), key=lambda place: float(np.linalg.norm(place - wish)))
    return placed, ambiguous


def _by_relative_distances(observations, labels: list, placed: dict) -> dict[str, np.ndarray]:
    """The first point not yet placed that relative distances to placed ones locate; empty when there is none."""
    segments = {label: i for i, label in enumerate(dict.fromkeys(labels))}
    rows: dict[str, list[tuple[np.ndarray, float, int]]] = {}
    for (start, end, reading), label in zip(observations, labels, strict=True):
        if label is not None and start not in placed and end in placed:
            rows.setdefault(start, []).append((placed[end], reading, segments[label]))
    for name, seen in rows.items():
        targets, readings, numbers = zip(*seen, strict=True)
        try:
            return {name: trilaterate(targets, readings, np.array(numbers), relative=True).position}
        except InputError:
            continue
    return {}


def _placed(readings: dict, placed: dict, dimension: int):
    """Position from readings to placed points and a second possible one; None, None if there are too few."""
    seen = [name for name in readings if name in placed]
    if len(seen) < dimension:
        return None, None
    try:
        found = trilaterate([placed[name] for name in seen], [readings[name] for name in seen], None, relative=False)
    except InputError:
        return None, None
    return found.position, found.alternative


def _why_not(name: str, ambiguous: dict[str, tuple[np.ndarray, np.ndarray]], dimension: int) -> str:
    """Message for points that cannot be placed."""
    if ambiguous:
        name, (_, other) = next(iter(ambiguous.items()))
        return (
            f"point {name} has two possible positions, one of them {np.round(other, 3).tolist()}: the points it is "
            f"measured from lie in one {'plane' if dimension == 3 else 'line'}. Give its approximate coordinates"
        )
    return (
        f"point {name} has no approximate coordinates and distances to fewer than {dimension + 1} points that "
        "have some. Give its approximate coordinates"
    )


def _unfolded(distances: Distances, dimension: int) -> dict[str, np.ndarray] | None:
    """Closed-form coordinates when every one of some points sees all the others and nothing else; else None."""
    first = next(iter(distances))
    targets = list(distances[first])
    stations = [name for name in distances if name not in distances[first]]
    if len(stations) > len(targets):
        stations, targets = targets, stations
    if len(stations) <= dimension or any(set(distances[station]) != set(targets) for station in stations):
        return None
    squares = np.array([[distances[station][target] for target in targets] for station in stations]) ** 2
    x = _unfold(squares, dimension)
    return None if x is None else dict(zip(stations + targets, x, strict=True))


def _unfold(squares: Float[np.ndarray, "a b"], dimension: int) -> Float[np.ndarray, "c d"] | None:
    """Stations, then targets, from squared distances; None if there are too few targets or no real solution."""
    products = -(squares - squares[:1] - squares[:, :1] + squares[0, 0])[1:, 1:] / 2
    first, sizes, second = np.linalg.svd(products, full_matrices=False)
    root = np.sqrt(sizes[:dimension])
    p, q = first[:, :dimension] * root, second[:dimension].T * root  # s_i - s_0 = A p_i, t_j - t_0 = A⁻ᵀ q_j
    rows, columns = np.triu_indices(dimension)
    twice = np.where(rows == columns, 1.0, 2.0)
    design = np.hstack([twice * q[:, rows] * q[:, columns], 2 * q])  # |t_j - s_0|² - |t_0 - s_0|² = qᵀ H q + 2 qᵀ b
    solution, _, rank, _ = np.linalg.lstsq(design, squares[0, 1:] - squares[0, 0], rcond=1e-9)
    if rank < design.shape[1]:
        return None
    h = np.zeros((dimension, dimension))
    h[rows, columns] = h[columns, rows] = solution[: rows.size]
    if np.linalg.eigvalsh(h)[0] <= 0:
        return None
    root_h = np.linalg.cholesky(h)  # H = A⁻¹ A⁻ᵀ
    stations = np.vstack([np.zeros(dimension), np.linalg.solve(root_h, p.T).T])
    targets = np.linalg.solve(root_h, solution[rows.size :]) + np.vstack([np.zeros(dimension), q @ root_h])
    return np.vstack([stations, targets])


def _polished(points, observations, u: float, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "p d"] | None:
    """Least-squares coordinates from x, None when they do not fit the distances."""
    index = {name: i for i, name in enumerate(points)}
    start, end = (np.array([index[row[k]] for row in observations]) for k in (0, 1))
    readings = np.array([row[2] for row in observations], float)
    equations = Equations(
        x - x.mean(axis=0),
        np.ones(len(x), bool),
        start,
        end,
        readings,
        np.full(readings.size, float(u)),
        np.full(readings.size, ABSOLUTE),
    )
    try:
        x = best_sides(equations, descend(equations, equations.approximate))
    except InputError:
        return None
    return x if rms(equations.residuals(x)) < _GOOD else None


def _scaled(distances: Distances, dimension: int) -> dict[str, np.ndarray]:
    """Classical multidimensional scaling, each part of the network about the origin; missing distances are sums along it."""
    names = list(distances)
    number = {name: i for i, name in enumerate(names)}
    rows = [(number[a], number[b], d) for a, others in distances.items() for b, d in others.items()]
    start, end, lengths = zip(*rows, strict=True)
    graph = coo_array((lengths, (start, end)), shape=(len(names), len(names))).tocsr()
    count, labels = connected_components(graph, directed=False)
    x = np.zeros((len(names), dimension))
    for label in range(count):
        members = np.flatnonzero(labels == label)
        squares = shortest_path(graph[members][:, members], directed=False) ** 2
        products = -(squares - squares.mean(axis=0) - squares.mean(axis=1)[:, None] + squares.mean()) / 2
        sizes, axes = np.linalg.eigh(products)
        width = min(dimension, members.size)
        x[members, :width] = (axes * np.sqrt(np.maximum(sizes, 0.0)))[:, ::-1][:, :width]
    return dict(zip(names, x, strict=True))


def _random(points, observations, u: float, dimension: int) -> Float[np.ndarray, "p d"]:
    """Least-squares coordinates from random ones of the network's size."""
    size = rms([distance for _, _, distance in observations]) / np.sqrt(2 * dimension)
    generator = np.random.default_rng(0)
    for _ in range(_ATTEMPTS):
        x = _polished(points, observations, u, size * generator.normal(size=(len(points), dimension)))
        if x is not None:
            return x
    raise InputError(
        f"no coordinates found that fit the distances, from {_ATTEMPTS} random starts. Give approximate coordinates"
    )
