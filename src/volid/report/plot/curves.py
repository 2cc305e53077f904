"""Error motions as curves in the units of figures: µm and µrad over mm or degrees, by direction of approach, with U."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from volid.fitting.solution import Solution
from volid.fitting.tabulation import points_with_waves
from volid.model.error_functions import reference_of
from volid.model.error_model import MEAN
from volid.model.iso230 import DIRECTIONS, motion, parse
from volid.model.linear_maps import function_rows
from volid.model.machine import Axis

if TYPE_CHECKING:
    from jaxtyping import Float

K = 2.0
POINTS = 201


@dataclass(frozen=True, eq=False)
class Way:
    """A curve of one direction of approach.

    Args:
        direction: +1, -1, or 0 for a function without reversal.
        values, u: With standard uncertainty, shape (m,) [µm or µrad]; NaN where not determined.
    """

    direction: int
    values: Float[np.ndarray, " m"]
    u: Float[np.ndarray, " m"]


@dataclass(frozen=True, eq=False)
class Curve:
    """An error motion over its axis.

    Args:
        name: ISO 230-1 symbol.
        axis: The axis that moves.
        positions: Shape (m,) [mm or degrees].
        ways: One for each direction of approach.
        beside: The other axis of a cross effect, None where there is none.
        at: Where that axis stands [mm or degrees].
    """

    name: str
    axis: Axis
    positions: Float[np.ndarray, " m"]
    ways: tuple[Way, ...]
    beside: Axis | None = None
    at: float = 0.0

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return parse(self.name).report_unit

    @property
    def known(self) -> float:
        """Share of the steps at both of whose ends the data determine the value: 0 where only the reference is, which is 0."""
        ends = [np.isfinite(way.values) for way in self.ways]
        return float(np.mean([np.mean(known[1:] & known[:-1]) for known in ends]))

    @property
    def span(self) -> tuple[float, float]:
        """Lowest and highest value with U, zero included [µm or µrad]."""
        edges = [way.values + sign * K * way.u for way in self.ways for sign in (-1.0, 1.0)]
        finite = np.concatenate([[0.0], *(edge[np.isfinite(edge)] for edge in edges)])
        return float(finite.min()), float(finite.max())


def scale_of(name: str) -> float:
    """Factor from mm to µm, or from rad to µrad."""
    return 1e6 if parse(name).is_rotation else 1e3


def curve(solution: Solution, name: str, points: int = POINTS) -> Curve:
    """An error motion of the model over the travel of its axis, as `Solution.motion` has it.

    Args:
        solution: The solution.
        name: ISO 230-1 symbol of an error motion in the model.
        points: At least so many positions; more where short waves of a stated pitch need them.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> found = curve(solution, "EXX")
    >>> found.unit, [way.direction for way in found.ways], found.known
    ('µm', [1, -1], 1.0)
    """
    axis = solution.machine.axis(parse(name).axis)
    x = np.linspace(*axis.travel, points_with_waves(solution, name, points))
    rows, factor = solution.motion(name, x), scale_of(name)
    ways = []
    for direction in dict.fromkeys(row.direction for row in rows):
        own = [row for row in rows if row.direction == direction]
        values, u = (factor * np.array([getattr(row, key) for row in own]) for key in ("value", "u"))
        ways.append(Way(direction, values, u))
    beside = other_axis(solution, name)
    at = 0.0 if beside is None else reference_of(solution.machine, solution.datum, beside.letter)
    return Curve(name, axis, x, tuple(ways), beside, at)


def shown_axes(solution: Solution, letters: Iterable[str] = DIRECTIONS) -> list[Axis]:
    """The axes among `letters` that have error motions in the model, in the order X, Y, Z, A, B, C."""
    moved = {parse(name).axis for name, part in solution.model.by_name if part == MEAN}
    found = [axis for axis in solution.machine.axes if axis.letter in letters and axis.letter in moved]
    return sorted(found, key=lambda axis: DIRECTIONS.index(axis.letter))


def curves(solution: Solution, axes: Sequence[Axis], points: int = POINTS) -> dict[str, Curve]:
    """The error motions of `axes` that are in the model, by symbol, axis by axis."""
    names = [motion(direction, axis.letter) for axis in axes for direction in DIRECTIONS]
    return {name: curve(solution, name, points) for name in names if (name, MEAN) in solution.model.by_name}


def missing(axes: Sequence[Axis], found: Iterable[str]) -> list[str]:
    """Symbols of the error motions of `axes` that the model does not have."""
    have = set(found)
    names = [motion(direction, axis.letter) for axis in axes for direction in DIRECTIONS]
    return [name for name in names if name not in have]


def limits(found: Iterable[Curve]) -> dict[str, tuple[float, float]]:
    """Ends of the scale by unit, so that all curves with U fit with a little room; those of sizes 0 get ± 1."""
    ends: dict[str, tuple[float, float]] = {}
    for own in found:
        low, high = ends.get(own.unit, (0.0, 0.0))
        ends[own.unit] = min(low, own.span[0]), max(high, own.span[1])
    return {unit: _with_room(*span) for unit, span in ends.items()}


def _with_room(low: float, high: float) -> tuple[float, float]:
    room = 0.06 * (high - low) or 1.0
    return low - room, high + room


def other_axis(solution: Solution, name: str) -> Axis | None:
    """The second axis that an error motion depends on (a cross effect), None where there is none."""
    splines = solution.model.by_name[name, MEAN].splines
    return solution.machine.axes[splines[1].axis] if len(splines) > 1 else None


def cross_effect(solution: Solution, name: str, points: int = 61) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An error motion of two axes: positions of its own axis, of the other axis, and its values, shape (m, m) [µm or µrad].

    The mean of both directions of approach; NaN where the data do not determine it. `values[i, j]` is at the i-th position of
    its own axis.
    """
    machine, other = solution.machine, other_axis(solution, name)
    if other is None:
        raise ValueError(f"{name} depends on one axis alone")
    own = machine.axis(parse(name).axis)
    x, y = (np.linspace(*axis.travel, points) for axis in (own, other))
    q = np.tile([[reference_of(machine, solution.datum, a.letter)] for a in machine.axes], points * points)
    q[machine.index(own.letter)], q[machine.index(other.letter)] = np.repeat(x, points), np.tile(y, points)
    rows = function_rows(solution.model, name, q, np.zeros_like(q))
    values = scale_of(name) * rows @ np.asarray(solution.parameters)
    return x, y, np.where(solution.is_not_determined(rows), np.nan, values).reshape(points, points)
