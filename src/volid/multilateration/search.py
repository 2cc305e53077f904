"""The lowest minimum of a distance network: from the given start, and from others where that one may not have led to it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.multilateration.descent import descend
from volid.multilateration.determination import RANK_TOLERANCE, determine, first_order_holds
from volid.multilateration.equations import ABSOLUTE, Equations
from volid.multilateration.mirrors import EQUAL, best_sides, flatness
from volid.multilateration.reliability import chi2_quantile
from volid.multilateration.start import distances_of, placed_from

if TYPE_CHECKING:
    from jaxtyping import Float

_REJECTED = 0.001  # probability of chi-square below which other starts are tried
_DOUBTFUL = 0.05  # the same for small networks, where trying costs little,
_SPARE, _LITTLE = 0.3, 3  # and for those with so few degrees of freedom, which reject little
_FEW = 60  # unknown coordinates of a small network
_STARTS = 24  # random starts of a small network
_BENDS = 12  # starts of a small network for each direction that the first order does not determine,
_ROUNDS = 5  # and how often again, from what was found
_FLAT, _FOLDS = 0.02, 24  # smallest extent over largest of a network that is nearly flat; starts with other sides
_TRIES = 3  # starts around the given one, of a large network


class Minima(NamedTuple):
    """Minima, the lowest first, and whether the approximate coordinates alone would have led to a higher one, or to none."""

    places: list[Float[np.ndarray, "p d"]]
    left_start: bool


def search(equations: Equations) -> Minima:
    """Minima from the approximate coordinates and, where that fit is doubtful, from further starts.

    The first is the result: the lowest, and among equal ones that nearest the approximate coordinates. Others are worth a look
    where readings are wrong. Raises `InputError` when no start leads to a minimum.
    """
    found: list[tuple[float, np.ndarray]] = []
    problems: list[InputError | None] = []
    for start in _starts(equations, found):
        try:
            x = descend(equations, start)
            places = [x, best_sides(equations, x)]
        except InputError as error:
            problems.append(error)
            continue
        problems.append(None)
        found += [(equations.cost(x), _aligned(equations, x)) for x in places]
    if not found:
        raise problems[0] or InputError("no start leads to a minimum; expected approximate coordinates")
    least = min(cost for cost, _ in found)
    if problems[0] is None and _hopeless(equations, found):
        least = found[0][0]
    enough = least + EQUAL * (1 + least)
    equal = [x for cost, x in found if abs(cost - least) <= EQUAL * (1 + least)]
    far = [round(float(np.linalg.norm(x - equations.approximate)) / equations.extent, 6) for x in equal]
    others = sorted((one for one in found if abs(one[0] - least) > EQUAL * (1 + least)), key=lambda one: one[0])
    return Minima(
        [equal[int(np.argmin(far))]] + [x for _, x in others], problems[0] is not None or found[0][0] > enough
    )


def _hopeless(equations: Equations, found: list) -> bool:
    """Whether all minima contradict the distances, none much less than that of the given start: then this one is as good."""
    least = min(cost for cost, _ in found)
    return 2 * least > found[0][0] and _doubtful(equations, found, small=False)


def _starts(equations: Equations, found: list):
    """The given start; then, as long as the best of what was found is doubtful, others."""
    yield equations.approximate
    small = equations.free.sum() * equations.approximate.shape[1] <= _FEW
    if _doubtful(equations, found, small):
        yield from _from_distances(equations)
        for i in range(_STARTS if small else _TRIES):
            if i == _TRIES and not _doubtful(equations, found, small):
                return
            yield _shaken(equations, i)
    for i in range(_ROUNDS if small and found else 0):
        cost, x = min(found, key=lambda one: one[0])
        more = [] if first_order_holds(equations, x) else list(_bent(equations, x, i))
        more += list(_folded(equations, x, i)) if flatness(x) < _FLAT else []
        yield from more
        if not more or (i > 0 and min(c for c, _ in found) > cost - EQUAL * (1 + cost)):
            return


def _bent(equations: Equations, x: Float[np.ndarray, "p d"], seed: int):
    """Starts along the directions that the second order limits: each has two sides, and together they have many."""
    found = determine(equations, x)
    reach = np.concatenate([found.weak_reach, found.reach[np.isfinite(found.reach)]])
    generator = np.random.default_rng(seed)
    for _ in range(_BENDS * reach.size):
        size = 10 ** generator.uniform(-0.5, 1.0)
        yield equations.moved(x, size * found.held @ (reach * generator.normal(size=reach.size)))


def _folded(equations: Equations, x: Float[np.ndarray, "p d"], seed: int):
    """Starts of a nearly flat network with its free points on other sides of their common plane (line)."""
    centre = x.mean(axis=0)
    normal = np.linalg.svd(x - centre)[2][-1]
    generator = np.random.default_rng(seed)
    for _ in range(_FOLDS):
        factor = generator.choice([-1.0, 1.0], len(x)) * 10 ** generator.uniform(-0.5, 0.5, len(x))
        height = np.where(equations.free, ((x - centre) @ normal) * (factor - 1), 0.0)
        yield x + height[:, None] * normal


def _doubtful(equations: Equations, found: list, small: bool) -> bool:
    """Whether so large a sum of squares as the least found is unlikely, if model and u are right."""
    if not found:
        return True
    cost, x = min(found, key=lambda one: one[0])
    readings = equations.u.size - equations.offsets
    least = readings - int(equations.free.sum()) * x.shape[1]
    if least > _LITTLE and 2 * cost < chi2_quantile(1 - _DOUBTFUL, least):
        return False
    sizes = np.linalg.svd(equations.jacobian(x), compute_uv=False)
    dof = readings - int((sizes > RANK_TOLERANCE * sizes[0]).sum())
    level = _REJECTED if not small else _SPARE if dof <= _LITTLE else _DOUBTFUL
    return bool(2 * cost > (chi2_quantile(1 - level, dof) if dof > 0 else EQUAL))


def _from_distances(equations: Equations):
    """The start that distances and fixed points give, where there is one; of two places the one nearer the given start."""
    names = list(range(len(equations.free)))
    known = {i: equations.approximate[i] for i in names if not equations.free[i]}
    if known and (equations.group == ABSOLUTE).all():
        rows = zip(equations.start.tolist(), equations.end.tolist(), equations.readings.tolist(), strict=True)
        placed = placed_from(distances_of(names, rows), known, equations.approximate)
        yield np.array([placed.get(i, equations.approximate[i]) for i in names])


def _shaken(equations: Equations, i: int) -> Float[np.ndarray, "p d"]:
    """Coordinates around the given ones, farther with every try, and from the second half on all over the network."""
    generator = np.random.default_rng(i)
    size = np.sqrt(np.mean(equations.readings**2) / equations.approximate.shape[1])
    noise = generator.normal(size=equations.approximate.shape) * equations.free[:, None]
    base = equations.approximate if i < _STARTS // 2 else np.where(equations.free[:, None], 0.0, equations.approximate)
    return base + noise * size * (1.0 if i >= _STARTS // 2 else 0.1 * 2 ** (i % 5))


def _aligned(equations: Equations, x: Float[np.ndarray, "p d"]) -> Float[np.ndarray, "p d"]:
    """A network without fixed points turned, shifted and, where that is nearer, mirrored onto the approximate coordinates."""
    if not equations.free.all():
        return x
    wanted = equations.approximate - equations.approximate.mean(axis=0)
    centred = x - x.mean(axis=0)
    left, _, right = np.linalg.svd(centred.T @ wanted)
    return centred @ (left @ right) + equations.approximate.mean(axis=0)
