"""Approximate coordinates of a distance network from its distances alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from volid.backend.rms import rms
from volid.exceptions import InputError
from volid.multilateration.equations import Equations, descend
from volid.multilateration.trilateration import trilaterate

_ATTEMPTS = 40  # random starts; enough for a dozen points all measured against each other
_GOOD = 20.0  # root mean square residual / u above which a solution is not taken for a start

Distances = dict[str, dict[str, float]]  # point -> other point -> reading


def starting_coordinates(
    points: Sequence[str],
    observations: Sequence[tuple[str, str, float]],
    u: float,
    known: Mapping[str, ArrayLike] | None = None,
    dimension: int = 3,
) -> dict[str, Float[np.ndarray, " d"]]:
    """Coordinates near the least-squares solution, for every point of a distance network.

    Points with readings to enough known ones are trilaterated, one after the other. When no point is known, the frame is
    arbitrary and the result may be a mirror image. Where every station sees every target, s_i·t_j = -(D² doubly centred) / 2
    has rank 3 and gives both up to one linear map, which is found from |t_j|² (linear in its square). Otherwise random
    starts are tried.

    Args:
        points: Names, p of them.
        observations: (from, to, distance), any one unit.
        u: Standard uncertainty of the distances, same unit; it tells a solution from a local minimum.
        known: Coordinates, shape (dimension,), by the name of each point that has some.
        dimension: 2 or 3.

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
    distances: Distances = {name: {} for name in points}
    for start, end, distance in observations:
        distances[start][end] = distances[end][start] = distance
    if known:
        placed = {name: np.asarray(known[name], float) for name in points if name in known}
        return _chained(distances, placed, dimension)
    found = _unfolded(distances, dimension)
    x = None if found is None else _polished(points, observations, u, np.array([found[name] for name in points]))
    if x is None:
        x = _random(points, observations, u, dimension)
    return dict(zip(points, x, strict=True))


def _chained(distances: Distances, placed: dict[str, np.ndarray], dimension: int) -> dict[str, np.ndarray]:
    """Trilaterate whatever sees most placed points, until all are placed."""
    ambiguous: dict[str, np.ndarray] = {}
    while missing := [name for name in distances if name not in placed]:
        missing.sort(key=lambda name: -sum(other in placed for other in distances[name]))
        for name in missing:
            position, other = _placed(distances[name], placed, dimension)
            if position is not None and other is None:
                placed[name] = position
                break
            if other is not None:
                ambiguous[name] = other
        else:
            raise InputError(_why_not(missing[0], ambiguous, dimension))
    return placed


def _placed(readings: dict[str, float], placed: dict[str, np.ndarray], dimension: int):
    """Position from readings to placed points and a second possible one; None, None if there are too few."""
    seen = [name for name in readings if name in placed]
    if len(seen) < dimension:
        return None, None
    try:
        found = trilaterate([placed[name] for name in seen], [readings[name] for name in seen], None, relative=False)
    except InputError:
        return None, None
    return found.position, found.alternative


def _why_not(name: str, ambiguous: dict[str, np.ndarray], dimension: int) -> str:
    """Message for points that cannot be placed."""
    if ambiguous:
        name, other = next(iter(ambiguous.items()))
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
        x - x.mean(axis=0), np.ones(len(x), bool), start, end, readings, np.full(readings.size, float(u))
    )
    try:
        x = descend(equations, equations.approximate)
    except InputError:
        return None
    return x if rms(equations.residuals(x)) < _GOOD else None


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
