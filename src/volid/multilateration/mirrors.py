"""Second solutions: a point, or some that hang together, on the other side of what it was measured from.

Distances to points in one plane (in one line, in the plane) are the same on both sides of it; close to a plane they are nearly
so. Descent finds the minimum on the side where it starts, so that both sides are tried.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from volid.exceptions import InputError
from volid.multilateration.descent import descend
from volid.multilateration.equations import ABSOLUTE, Equations

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

INDISTINCT = 9.0  # difference of chi-square (three standard deviations) below which a second solution is possible
EQUAL = 1e-6  # difference of chi-square below which two solutions fit equally well
_ROUNDS = 25  # times that points may change sides
_STEPS = 40  # of one point alone
_FLAT = 0.05  # smallest extent over largest, below which points may have two sides


class Second(NamedTuple):
    """Another solution: numbers of the points that it moves by more than u, all coordinates, how much larger chi-square is."""

    points: tuple[int, ...]
    coordinates: Float[np.ndarray, "p d"]
    worse: float


def best_sides(equations: Equations, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "p d"]:
    """From a minimum x to a lower one, as long as points that change sides lead to one."""
    for _ in range(_ROUNDS):
        better = [equations.cost(x)]
        for start in _candidates(equations, x):
            found = _descended(equations, start)
            if found is not None and equations.cost(found) < better[0] - EQUAL / 2 * (1 + better[0]):
                x = found
                break
        else:
            return x
    return x


def _candidates(equations: Equations, x: Float[np.ndarray, "p d"]):
    """Starts that may lead lower: all points that gain by it on their other side, then the one that gains most, then groups."""
    other, gain = one_by_one(equations, x)
    gaining = np.flatnonzero(gain > EQUAL / 2)
    if gaining.size > 1:
        yield np.where(np.isin(np.arange(len(x)), gaining)[:, None], other, x)
    if gaining.size:
        yield np.where((np.arange(len(x)) == gaining[np.argmax(gain[gaining])])[:, None], other, x)
    for members in groups(equations, x):
        yield mirrored_group(equations, x, members)


def second_solutions(
    equations: Equations, x: Float[np.ndarray, "p d"], unit_weight: float = 1.0, most: int = 12
) -> list[Second]:
    """Other minima that the distances cannot tell from x: by points one by one, then by those that hang together.

    Where they scatter by more than u, the limit grows with the unit weight.
    """
    limit = INDISTINCT * max(unit_weight, 1.0) ** 2
    other, gain = one_by_one(equations, x)
    apart = np.linalg.norm(other - x, axis=1) > 1e-4 * equations.extent
    single = [int(j) for j in np.flatnonzero(apart & (2 * gain > -limit))]
    found: list[Second] = []
    for members in [*([j] for j in single[:most]), *groups(equations, x)[:most]]:
        start = mirrored_group(equations, x, members) if len(members) > 1 else _with(x, members[0], other)
        second = _second(equations, x, _descended(equations, start), limit)
        if second is not None and not any(_same(equations, second, known) for known in found):
            found.append(second)
    return found + [_alone(equations, x, j, other, gain) for j in single[most:]]


def _second(equations: Equations, x: np.ndarray, found: np.ndarray | None, limit: float) -> Second | None:
    """The solution as a second one, if it is another and the distances allow it."""
    if found is None:
        return None
    worse = 2 * (equations.cost(found) - equations.cost(x))
    moved = np.linalg.norm(found - x, axis=1)
    if worse > limit or moved.max() < max(1e-4 * equations.extent, float(np.median(equations.u))):
        return None
    return Second(tuple(np.flatnonzero(moved > float(np.median(equations.u))).tolist()), found, worse)


def _same(equations: Equations, one: Second, other: Second) -> bool:
    return bool(np.abs(one.coordinates - other.coordinates).max() < 1e-4 * equations.extent)


def _with(x: np.ndarray, j: int, other: np.ndarray) -> np.ndarray:
    result = x.copy()
    result[j] = other[j]
    return result


def _alone(equations: Equations, x: np.ndarray, j: int, other: np.ndarray, gain: np.ndarray) -> Second:
    return Second((j,), _with(x, j, other), float(-2 * gain[j]))


def _descended(equations: Equations, start: np.ndarray) -> np.ndarray | None:
    """The minimum below a start, None where none is reached."""
    try:
        return descend(equations, start)
    except InputError:
        return None


# ------------------------------------------------------------------------------------------------- one point at a time


class _Ends(NamedTuple):
    """Every distance twice, once for each end that is free: number of the point, the other end's place, reading, u."""

    own: np.ndarray
    far: np.ndarray
    readings: np.ndarray
    u: np.ndarray


def _ends(equations: Equations, x: Float[np.ndarray, "p d"]) -> _Ends:
    """Distances without offsets; those with some as their offset at x leaves them."""
    lengths = equations.beams(x).lengths
    readings = np.where(equations.group == ABSOLUTE, equations.readings, equations.residuals(x) * equations.u + lengths)
    own = np.concatenate([equations.start, equations.end])
    far = x[np.concatenate([equations.end, equations.start])]
    kept = equations.free[own]
    return _Ends(own[kept], far[kept], np.tile(readings, 2)[kept], np.tile(equations.u, 2)[kept])


def one_by_one(equations: Equations, x: Float[np.ndarray, "p d"]) -> tuple[np.ndarray, np.ndarray]:
    """Each free point's best place on the other side of its neighbours, they held, (p, d); and what it gains, (p,)."""
    ends, free = _ends(equations, x), equations.free
    centres, normals = _planes(equations, ends, x)
    height = np.einsum("pd,pd->p", x - centres, normals)
    other, cost = _refined(ends, x - 2 * height[:, None] * normals)
    gain = np.where(free, _costs(ends, x)[0] - cost, -np.inf)
    return np.where(free[:, None], other, x), gain


def _planes(equations: Equations, ends: _Ends, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre and unit normal of the best plane (line) through the points that each point is measured from, (p, d) each."""
    count, d = x.shape
    number = np.maximum(np.bincount(ends.own, minlength=count), 1)[:, None]
    centres, scatter = np.zeros((count, d)), np.zeros((count, d, d))
    np.add.at(centres, ends.own, ends.far)
    centres /= number
    apart = ends.far - centres[ends.own]
    np.add.at(scatter, ends.own, apart[:, :, None] * apart[:, None, :])
    return centres, np.linalg.eigh(scatter)[1][:, :, 0]


def _costs(ends: _Ends, places: np.ndarray):
    """Half the sum of squares of each point, (p,); residuals over u and unit vectors of its distances."""
    beams = places[ends.own] - ends.far
    lengths = np.linalg.norm(beams, axis=1)
    residuals = (ends.readings - lengths) / ends.u
    directions = beams / np.maximum(lengths, 1e-300)[:, None]
    return np.bincount(ends.own, residuals**2, len(places)) / 2, residuals, directions


def _refined(ends: _Ends, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Levenberg-Marquardt of all points at once, each alone; their places and costs."""
    d = places.shape[1]
    scale = np.maximum(np.bincount(ends.own, ends.u**-2.0, len(places)), 1e-300)
    damping, (cost, residuals, directions) = np.full(len(places), 1e-4), _costs(ends, places)
    for _ in range(_STEPS):
        pull, normal = np.zeros_like(places), np.zeros((len(places), d, d))
        np.add.at(pull, ends.own, (residuals / ends.u)[:, None] * directions)
        np.add.at(normal, ends.own, directions[:, :, None] * directions[:, None, :] / ends.u[:, None, None] ** 2)
        normal += (damping * scale)[:, None, None] * np.eye(d)
        trial = places + np.linalg.solve(normal, pull[:, :, None])[:, :, 0]
        lower = _costs(ends, trial)[0]
        better = lower < cost
        places = np.where(better[:, None], trial, places)
        damping = np.clip(damping * np.where(better, 0.2, 5.0), 1e-12, 1e12)
        if not (cost - lower > 1e-6 * EQUAL * (1 + cost)).any() and not (damping < 1e3)[~better].any():
            break
        cost, residuals, directions = _costs(ends, places)
    return places, _costs(ends, places)[0]


# --------------------------------------------------------------------------------------------- points that hang together


def groups(equations: Equations, x: Float[np.ndarray, "p d"]) -> list[list[int]]:
    """Free points joined by distances, more than one, whose fixed neighbours lie nearly in one plane (line)."""
    free, count = equations.free, len(x)
    between = free[equations.start] & free[equations.end]
    rows = (equations.start[between], equations.end[between])
    labels = connected_components(coo_array((np.ones(rows[0].size), rows), shape=(count, count)), directed=False)[1]
    found = []
    for label in np.unique(labels[free]):
        members = np.flatnonzero((labels == label) & free)
        around = _fixed_neighbours(equations, members)
        if members.size > 1 and around.any() and flatness(x[around]) < _FLAT:
            found.append(members.tolist())
    return found


def _fixed_neighbours(equations: Equations, members: np.ndarray) -> Bool[np.ndarray, " p"]:
    """Which fixed points some of the members are measured from."""
    around = np.zeros(len(equations.free), bool)
    for one, other in ((equations.start, equations.end), (equations.end, equations.start)):
        around[other[np.isin(one, members)]] = True
    return around & ~equations.free


def flatness(places: np.ndarray) -> float:
    """Extent across the best plane (line) over the largest extent."""
    sizes = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return float(sizes[-1] / max(sizes[0], 1e-300)) if len(places) >= places.shape[1] else 0.0


def mirrored_group(equations: Equations, x: Float[np.ndarray, "p d"], members: list[int]) -> Float[np.ndarray, "p d"]:
    """Coordinates with the members on the other side of the best plane through their fixed neighbours."""
    places = x[_fixed_neighbours(equations, np.array(members))]
    centre = places.mean(axis=0)
    normal = np.linalg.svd(places - centre)[2][-1]
    result = x.copy()
    result[members] -= 2 * np.outer((x[members] - centre) @ normal, normal)
    return result


def on_the_fold(equations: Equations, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "p d"]:
    """Points next to the plane (line) of what they are measured from are put into it, where that fits as well.

    The sum of squares is so flat there that descent stops some way off.
    """
    ends = _ends(equations, x)
    centres, normals = _planes(equations, ends, x)
    height = np.einsum("pd,pd->p", x - centres, normals)
    flat = x - height[:, None] * normals
    near = (np.abs(height) > 0) & (np.abs(height) < 0.01 * equations.extent)
    near &= _costs(ends, flat)[0] < _costs(ends, x)[0] + EQUAL / 2
    for j in np.flatnonzero(near & equations.free).tolist():
        trial = _with(x, j, flat)
        x = trial if equations.cost(trial) < equations.cost(x) + EQUAL / 2 else x
    return x
