"""Where something is largest within the working volume: a search along the axes, from the largest of many places.

From each of a few places with the largest values, one axis after the other goes to the best of its positions, ends included, and
of both approach directions where they matter, until nothing becomes larger; then to the best one close by. A peak narrower than a
sixteenth of a travel can be missed.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from volid.fitting.prediction.determination import known_deviations
from volid.fitting.prediction.deviations import deviation_values
from volid.fitting.prediction.working_volume import POINTS, border_positions, spread_positions
from volid.fitting.solution import Solution
from volid.model.error_model import REVERSAL, ErrorModel
from volid.model.machine import Machine

STARTS = 4  # for each value
NODES = 17  # per axis, ends included
CLOSE = (1.0 / 16.0, 1.0 / 64.0)  # of the travel: how far the last rounds look
CLOSE_NODES = 9
ROUNDS = 4  # at most, over all axes

Values = Callable[[np.ndarray, np.ndarray], np.ndarray]


class Places(NamedTuple):
    """Where the deviation in the working volume is evaluated: positions and approach directions, (m, n_axes).

    `n_even`: so many of the first ones are spread evenly, and means, quantiles and rigid motions refer to them; None: all.
    """

    positions: np.ndarray
    directions: np.ndarray
    n_even: int | None = None

    @property
    def even(self) -> slice:
        """The places that are spread evenly."""
        return slice(self.n_even)

    def and_also(self, more: Places) -> Places:
        """These places, followed by more that means, quantiles and rigid motions do not refer to."""
        n_even = len(self.positions) if self.n_even is None else self.n_even
        positions = np.concatenate([self.positions, more.positions])
        return Places(positions, np.concatenate([self.directions, more.directions]), n_even)


_FOUND: WeakKeyDictionary[Solution, dict[bytes, Places]] = WeakKeyDictionary()
ManyValues = Callable[[Sequence[Places | None]], Sequence[np.ndarray | None]]


def axes_with_reversal(model: ErrorModel) -> tuple[int, ...]:
    """The axes, by number, whose errors depend on the direction of approach."""
    directed = {
        t.basis.directed for f, t in zip(model.functions, model.layout.terms, strict=True) if f.part == REVERSAL
    }
    return tuple(sorted(directed - {-1}))


def whole_volume(model: ErrorModel, seed: int = 0, *, still: bool = False) -> Places:
    """1024 places spread evenly, and a grid with corners, edges and faces.

    Approach directions are at random, or 0 if `still`: the mean of both. Where the model has reversal, the even places are there
    twice, with opposite directions, so that these do not add up to a motion of the workpiece.
    """
    machine, rng = model.machine, np.random.default_rng(seed)
    q = spread_positions(machine, POINTS, seed)
    way = rng.choice([-1.0, 1.0], q.shape)
    if axes_with_reversal(model) and not still:
        q, way = np.concatenate([q, q]), np.concatenate([way, -way])
    border = border_positions(machine)
    both = Places(q, way).and_also(Places(border, rng.choice([-1.0, 1.0], border.shape)))
    return both._replace(directions=np.zeros_like(both.positions)) if still else both


def with_largest(solution: Solution, tool: np.ndarray) -> Places:
    """Places of `whole_volume`, and where the deviation in the stated datum, mean of both directions, is largest in length and in
    the range of each component; `tool` (3,) [mm]. Searched for once in a solution with each tool vector."""
    known = _FOUND.setdefault(solution, {})
    key = np.asarray(tool, dtype=float).tobytes()
    if key not in known:
        known[key] = _with_largest(solution, tool)
    return known[key]


def _with_largest(solution: Solution, tool: np.ndarray) -> Places:
    theta, start = np.asarray(solution.parameters), whole_volume(solution.model, still=True)

    def values(q: np.ndarray, way: np.ndarray) -> np.ndarray:
        found = deviation_values(solution.model, theta, q, np.broadcast_to(tool, (len(q), 3)), way)
        return np.column_stack([np.linalg.norm(found[:, :3], axis=1), found, -found])

    return start.and_also(largest_places(solution.machine, values, start))


def values_at(solution: Solution, places: Places, tool: np.ndarray) -> np.ndarray:
    """Values of `Solution.evaluate` for a tool vector (3,) [mm], without u: (m, 6) [mm, rad], NaN where not determined."""
    q, way = places.positions, places.directions
    tools, theta = np.broadcast_to(tool, (len(q), 3)), np.asarray(solution.parameters)
    values, _, _ = known_deviations(solution.model, theta, None, np.asarray(solution.null_space), q, tools, way)
    return np.where(solution.model.holds(q)[:, None], values, np.nan)


def largest_places(machine: Machine, values: Values, start: Places, directed: Sequence[int] = ()) -> Places:
    """Places near which each of k values is largest, at most `STARTS` for each.

    Args:
        machine: whose travels are searched.
        values: of positions and directions (m, n_axes): the values, (m, k).
        start: where to begin; the largest of them are taken.
        directed: axes, by number, whose direction of approach matters and is chosen too.
    """

    def only(asked: Sequence[Places | None]) -> list[np.ndarray | None]:
        return [values(places.positions, places.directions) for places in asked if places is not None]

    (worst,) = largest_places_of_all(machine, only, start, [values(start.positions, start.directions)], directed)
    return worst


def largest_places_of_all(
    machine: Machine, values: ManyValues, start: Places, found: Sequence[np.ndarray], directed: Sequence[int] = ()
) -> list[Places]:
    """The same in several searches side by side, so that what their values share is evaluated for all of them at once.

    Args:
        machine: whose travels are searched.
        values: of the places that each search asks for, None where it has ended: the values of each.
        start: where all begin.
        found: values of each search there, (m, k).
        directed: axes, by number, whose direction of approach matters and is chosen too.
    """
    searches = [_searched(machine, _Search(start, own, tuple(directed))) for own in found]
    result: list[Places] = [start] * len(searches)
    asked: list[Places | None] = [next(search) for search in searches]
    while any(places is not None for places in asked):
        for i, own in enumerate(values(asked)):
            if own is None:
                continue
            try:
                asked[i] = searches[i].send(own)
            except StopIteration as end:
                asked[i], result[i] = None, end.value
    return result


def _searched(machine: Machine, search: _Search) -> Generator[Places, np.ndarray, Places]:
    """Where a search arrives; it asks for values of places and is sent them."""
    moving = np.arange(len(search.own))
    for _ in range(ROUNDS):
        before = search.sizes.copy()
        for axis in range(len(machine.axes)):
            yield from search.along(axis, np.linspace(*machine.axes[axis].travel, NODES)[None], moving)
        moving = np.flatnonzero(search.sizes > before)  # what no axis has moved stays where it is
        if not len(moving):
            break
    for share in CLOSE:
        for axis, a in enumerate(machine.axes):
            near = search.positions[:, [axis]] + share * a.length * np.linspace(-1.0, 1.0, CLOSE_NODES)
            yield from search.along(axis, np.clip(near, *a.travel))
    found = np.unique(np.hstack([search.positions, search.directions]), axis=0)
    positions, directions = np.hsplit(found, 2)
    return Places(positions, directions)


class _Search:
    """Places under way, STARTS for each of k values: `positions`, `directions` (c, n_axes), and what each has reached, (c,)."""

    def __init__(self, start: Places, found: np.ndarray, directed: tuple[int, ...]) -> None:
        rows = np.argsort(-found, axis=0, kind="stable")[:STARTS]
        self.directed = directed
        self.own = np.broadcast_to(np.arange(found.shape[1]), rows.shape).ravel()
        self.positions, self.directions = start.positions[rows.ravel()], start.directions[rows.ravel()]
        self.sizes = found[rows.ravel(), self.own]

    def along(
        self, axis: int, nodes: np.ndarray, rows: np.ndarray | None = None
    ) -> Generator[Places, np.ndarray, None]:
        """Each place, or those of some `rows`, to the best of `nodes` (c or 1, g) of an axis, where that is larger."""
        rows = np.arange(len(self.own)) if rows is None else rows
        c, g = len(rows), nodes.shape[1]
        ways = np.array([1.0, -1.0]) if axis in self.directed else np.array([0.0])
        shape = (c, g, len(ways), self.positions.shape[1])
        q, way = (np.broadcast_to(a[rows][:, None, None], shape).copy() for a in (self.positions, self.directions))
        q[..., axis] = np.broadcast_to(nodes, (c, g))[:, :, None]
        if axis in self.directed:
            way[..., axis] = ways
        q, way = q.reshape(c, -1, shape[3]), way.reshape(c, -1, shape[3])
        found = yield Places(q.reshape(-1, shape[3]), way.reshape(-1, shape[3]))
        own = np.take_along_axis(found.reshape(c, q.shape[1], -1), self.own[rows][:, None, None], axis=2)[:, :, 0]
        row, best = np.arange(c), np.argmax(own, axis=1)
        better = own[row, best] > self.sizes[rows]
        for kept, offered in ((self.positions, q), (self.directions, way)):
            kept[rows[better]] = offered[row, best][better]
        self.sizes[rows] = np.where(better, own[row, best], self.sizes[rows])
