"""Lattices of nodes over the linear axes, on which the deviation field of a report is drawn, and rotary positions beside them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from volid.model.iso230 import LINEAR_AXES
from volid.model.machine import Axis, Machine

if TYPE_CHECKING:
    from jaxtyping import Float, Int

MOST, FEWEST = 9, 3  # nodes along the longest axis and along the others, at most and at least
CLEAR = 280  # nodes through which one still sees into the volume
QUARTERS = (90.0, 180.0, 270.0)  # degrees: where a rotary axis of a full turn is looked at
MOST_PLACES = 7  # rotary positions


@dataclass(frozen=True, eq=False)
class Lattice:
    """Nodes of a lattice over the linear axes of a machine, the rotary axes standing still.

    Args:
        machine: The machine, whose travels the lattice fills.
        nodes: Positions along X, Y, Z, ascending; one, at 0, for an axis that the machine does not have [mm].

    >>> import volid
    >>> lattice = lattice_of(volid.load_machine("models/wYXbZt_vertical.toml"), 9)
    >>> lattice.shape, lattice.points.shape, lattice.points[-1].tolist()
    ((9, 6, 5), (270, 3), [1000.0, 600.0, 0.0])
    """

    machine: Machine
    nodes: tuple[Float[np.ndarray, " i"], Float[np.ndarray, " j"], Float[np.ndarray, " k"]]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of nodes along X, Y, Z."""
        x, y, z = self.nodes
        return len(x), len(y), len(z)

    @property
    def points(self) -> Float[np.ndarray, "m 3"]:
        """Commanded X, Y, Z of every node, Z changing fastest, shape (m, 3) [mm]."""
        return np.stack([a.ravel() for a in np.meshgrid(*self.nodes, indexing="ij")], axis=1)

    def positions(self, rotary: dict[str, float]) -> Float[np.ndarray, "m axes"]:
        """Positions of all axes at the nodes, shape (m, n_axes), machine axis order [mm or degrees].

        Args:
            rotary: Position of every rotary axis by its letter [degrees].
        """
        q = np.zeros((np.prod(self.shape), len(self.machine.axes)))
        points = self.points
        for i, axis in enumerate(self.machine.axes):
            q[:, i] = points[:, LINEAR_AXES.index(axis.letter)] if axis.is_linear else rotary[axis.letter]
        return q

    @property
    def lines(self) -> list[Int[np.ndarray, " n"]]:
        """Numbers of the nodes along every line of the lattice."""
        number = np.arange(np.prod(self.shape)).reshape(self.shape)
        rows = [np.moveaxis(number, k, -1).reshape(-1, n) for k, n in enumerate(self.shape) if n > 1]
        return [line for block in rows for line in block]

    @property
    def spacing(self) -> float:
        """Smallest distance of neighbouring nodes [mm]."""
        return min((float(np.diff(a).min()) for a in self.nodes if len(a) > 1), default=1.0)


def lattice_of(machine: Machine, most: int = MOST) -> Lattice:
    """A lattice over the travels of the linear axes, with cells about as wide as they are high.

    Args:
        machine: The machine.
        most: Nodes along the longest axis, at most: fewer where the volume is near to a cube.
    """
    travels = {a.letter: a for a in machine.axes if a.is_linear}
    longest = max((a.length for a in travels.values()), default=0.0)
    for along in range(most, FEWEST - 1, -1):
        x, y, z = (_nodes(travels.get(letter), longest, along) for letter in LINEAR_AXES)
        if len(x) * len(y) * len(z) <= CLEAR:
            break
    return Lattice(machine, (x, y, z))


def _nodes(axis: Axis | None, longest: float, most: int) -> np.ndarray:
    if axis is None or axis.length <= 0.0:
        return np.array([0.0 if axis is None else axis.travel[0]])
    n = int(np.clip(round(1 + (most - 1) * axis.length / longest), min(FEWEST, most), most))
    return np.linspace(*axis.travel, n)


def rotary_places(machine: Machine) -> list[dict[str, float]]:
    """A few positions of the rotary axes by letter [degrees]: all at 0 (or the nearest end), then one of them elsewhere.

    An axis of a full turn goes to its quarters, another one to the ends of its travel. Without rotary axes there is one place,
    that of none.

    >>> import volid
    >>> rotary_places(volid.load_machine("models/wCAYXbZt_trunnion.toml"))[:2]
    [{'C': 0.0, 'A': 0.0}, {'C': 90.0, 'A': 0.0}]
    """
    turning = [a for a in machine.axes if not a.is_linear]
    rest = {a.letter: float(np.clip(0.0, *a.travel)) for a in turning}
    others = [{**rest, a.letter: angle} for a in turning for angle in _elsewhere(a, rest[a.letter])]
    return [rest, *others][:MOST_PLACES]


def _elsewhere(axis: Axis, rest: float) -> list[float]:
    low, high = axis.travel
    if axis.is_full_turn:
        return [low + angle for angle in QUARTERS]
    return [end for end in (low, high) if abs(end - rest) > 1.0]


def grouped(lines: list[np.ndarray]) -> list[tuple[int, int]]:
    """Pairs of neighbouring nodes along lines, each pair once."""
    return [(int(a), int(b)) for line in lines for a, b in pairwise(line.tolist())]
