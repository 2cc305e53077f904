"""Where a table has its points: a fixed step, at most so many points, or the fewest that keep the interpolation error in bounds.

A control interpolates linearly; between nodes a smooth function f is then off by up to h² max|f''| / 8. Here the largest
difference is found on a dense sampling of the function itself, reversal included, so that it holds for any function.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from volid.backend.even_points import evenly, every_step, number_of_steps
from volid.exceptions import InputError
from volid.model.requests import ask_bound, checked_number

POINTS = 21  # of a table when nothing is asked for
DENSE = 601  # points of the dense sampling: its own interpolation is good to (POINTS / DENSE)² of that of a table
CANDIDATES = 241  # of free spacing
LARGEST = 2000  # points per table
EQUAL, FREE = "equal", "free"


@dataclass(frozen=True)
class Sampling:
    """How tables are sampled.

    `step` [mm or °]: distance of the points. `max_points`: largest number of points. `max_error`: largest error of the linear
    interpolation [mm]. `spacing`: "equal" (most controls) or "free". `offset`: distance at which rotations are compared with
    `max_error` [mm], such as a tool offset or the reach of the machine; None: the reach of each axis. `together`: all functions
    of an axis at the same points. `even`: equal steps are a must, because the control knows no others: a step that does not
    divide the range is taken a little smaller. Raises `InputError` for numbers that make no table.
    """

    step: float | None = None
    max_points: int | None = None
    max_error: float | None = None
    spacing: str = EQUAL
    offset: float | None = None
    together: bool = False
    even: bool = False

    def __post_init__(self) -> None:
        if self.step is not None and (self.max_points is not None or self.max_error is not None):
            raise InputError("`step` stands alone; take it, or `max_points` and `max_error`")
        for name in ("step", "max_error", "offset"):
            value = getattr(self, name)
            if value is not None:
                checked_number(name, value, above=0.0)
        if self.max_error is not None:
            ask_bound("max_error", self.max_error)
        if self.max_points is not None and not 2 <= self.max_points <= LARGEST:
            raise InputError(f"`max_points={self.max_points}`: expected 2 … {LARGEST}")
        if self.spacing not in (EQUAL, FREE):
            raise InputError(f"`spacing={self.spacing}`: expected {EQUAL} or {FREE}")


def stepped(travel: tuple[float, float], step: float) -> np.ndarray:
    """Every `step` from the lower end, and the upper end."""
    low, high = travel
    found = number_of_steps(low, high, step)
    if found > LARGEST:
        raise InputError(
            f"`step={step:g}`: {found:,.0f} points over {low:g} … {high:g}, more than {LARGEST} of a table; take a larger step"
        )
    return every_step(low, high, step)


def interpolation_error(dense: np.ndarray, values: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Largest difference of each column (m, c) from linear interpolation between `nodes`, (c,)."""
    interpolated = np.stack([np.interp(dense, nodes, np.interp(nodes, dense, v)) for v in values.T], axis=1)
    return np.asarray(np.abs(values - interpolated).max(axis=0))


def choose_nodes(
    name: str, dense: np.ndarray, values: np.ndarray, sampling: Sampling, default: np.ndarray | None = None
) -> np.ndarray:
    """Nodes of one table, from `values` (m, c) at `dense` positions (m,), both [mm] or scaled to it.

    Raises `InputError` naming the table, when the points allowed do not keep the stated error: "table limit too small".
    """
    travel = (float(dense[0]), float(dense[-1]))
    if sampling.even and default is not None:
        default = _evened(default)
    if sampling.step is not None:
        found = stepped(travel, sampling.step)
        return evenly(*travel, len(found)) if sampling.even else found
    if sampling.max_error is None:
        n = sampling.max_points
        if n is None:
            return evenly(*travel, POINTS) if default is None else default
        if default is not None and len(default) <= n:
            return default
        return evenly(*travel, n) if sampling.spacing == EQUAL else _best_free(dense, values, n)
    fewest = _fewest(dense, values, sampling.max_error, sampling.spacing)
    limit = LARGEST if sampling.max_points is None else sampling.max_points
    if fewest is None or len(fewest) > limit:
        best = evenly(*travel, limit) if sampling.spacing == EQUAL else _best_free(dense, values, limit)
        left = interpolation_error(dense, values, best).max()
        needed = f"{len(fewest)} points" if fewest is not None else f"more than {LARGEST} points"
        raise InputError(
            f"{name}: {needed} needed to interpolate within {1e3 * sampling.max_error:.3g} µm; the limit of {limit} leaves "
            f"{1e3 * left:.3g} µm. Allow more points, a larger error, or `spacing={FREE}`"
        )
    return fewest


def _evened(knots: np.ndarray) -> np.ndarray:
    """The knots where their steps are equal, else equal steps as short as the shortest of theirs."""
    steps = np.diff(knots)
    if np.allclose(steps, steps[0], rtol=1e-9):
        return knots
    count = math.ceil((knots[-1] - knots[0]) / steps.min() - 1e-9) + 1
    return evenly(float(knots[0]), float(knots[-1]), min(count, LARGEST))


def _fewest(dense: np.ndarray, values: np.ndarray, bound: float, spacing: str) -> np.ndarray | None:
    """Fewest nodes within the bound, None when `LARGEST` are too few."""
    if spacing == FREE:
        return _fewest_free(dense, values, bound)
    for n in range(2, len(dense)):
        nodes = evenly(dense[0], dense[-1], n)
        if interpolation_error(dense, values, nodes).max() <= bound:
            return nodes
    return None


def _chords(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Largest deviation of the values from the chord between points i < j, (k, k)."""
    k = len(x)
    worst = np.zeros((k, k))
    for i in range(k - 2):
        slope = (y[i + 1 :] - y[i]) / (x[i + 1 :] - x[i])[:, None]  # (j, c)
        off = np.abs(y[None, i + 1 :] - y[i] - slope[:, None] * (x[i + 1 :] - x[i])[None, :, None])  # (j, points, c)
        inside = np.arange(i + 1, k)[None, :] < np.arange(i + 1, k)[:, None]
        worst[i, i + 1 :] = np.where(inside, off.max(axis=2), 0.0).max(axis=1)
    return worst


def _candidates(dense: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x = evenly(dense[0], dense[-1], CANDIDATES)
    y = np.stack([np.interp(x, dense, v) for v in values.T], axis=1)
    return x, y, _chords(x, y)


def _shortest(allowed: np.ndarray) -> list[int]:
    """Fewest steps i -> j over `allowed` from the first to the last candidate; neighbours are always allowed."""
    k = len(allowed)
    count, before = np.full(k, k + 1), np.zeros(k, dtype=int)
    count[0] = 0
    for i in range(k - 1):
        reach = np.flatnonzero(allowed[i]) + 0
        reach = reach[reach > i]
        better = reach[count[reach] > count[i] + 1]
        count[better], before[better] = count[i] + 1, i
    path = [k - 1]
    while path[-1]:
        path.append(int(before[path[-1]]))
    return path[::-1]


def _fewest_free(dense: np.ndarray, values: np.ndarray, bound: float) -> np.ndarray | None:
    x, _, worst = _candidates(dense, values)
    for share in (1.0, 0.95, 0.9, 0.8, 0.6, 0.4):  # between the candidates the curve may bend more than at them
        nodes = x[_shortest(worst <= share * bound)]
        if interpolation_error(dense, values, nodes).max() <= bound:
            return np.asarray(nodes)
    return None


def _best_free(dense: np.ndarray, values: np.ndarray, n: int) -> np.ndarray:
    """The n nodes with the least largest error, by bisection over the bound."""
    x, _, worst = _candidates(dense, values)
    bounds = np.unique(worst[np.triu_indices(len(x), 1)])
    low, high = 0, len(bounds) - 1
    while low < high:
        middle = (low + high) // 2
        if len(_shortest(worst <= bounds[middle])) <= n:
            high = middle
        else:
            low = middle + 1
    return np.asarray(x[_shortest(worst <= bounds[low])])
