"""Lines of readings in a plan: where axes rest, positions along one of them forward and back, and the set that they make."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from volid.backend.even_points import round_position
from volid.campaign import ObservationSet
from volid.model.iso230 import LINEAR_AXES
from volid.model.machine import Machine

OTHER_RUNS = 2  # forward and back, of every instrument but linear optics


@dataclass(frozen=True)
class Places:
    """Where axes rest, and the positions along one of them. `points`: their number."""

    machine: Machine
    vertical: str
    tool: np.ndarray
    at: Mapping[str, float]
    points: int

    @cached_property
    def horizontal(self) -> tuple[str, str]:
        """The two other linear axes."""
        one, other = (a for a in LINEAR_AXES if a != self.vertical)
        return one, other

    @cached_property
    def resting(self) -> np.ndarray:
        """Positions of all axes at rest, (n_axes,); rotary axes at 0 or the end of their travel next to it."""
        places = []
        for axis in self.machine.axes:
            usual = 0.5 * sum(axis.travel) if axis.is_linear else 0.0
            places.append(float(np.clip(self.at.get(axis.letter, usual), *axis.travel)))
        return np.array(places)

    def along(self, letter: str, runs: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions and directions (m, n_axes) forward and back over the travel of an axis, `runs` times; and the run (m,)."""
        i = self.machine.index(letter)
        forward = round_position(np.linspace(*self.machine.axes[i].travel, self.points))
        there_and_back = np.concatenate([forward, forward[::-1]])
        q = np.tile(self.resting, (runs * len(there_and_back), 1))
        q[:, i] = np.tile(there_and_back, runs)
        directions = np.zeros_like(q)
        directions[:, i] = np.tile(np.repeat([1.0, -1.0], self.points), runs)
        return q, directions, np.repeat(np.arange(1, runs + 1).astype(str), len(there_and_back))


@dataclass(frozen=True)
class Row:
    """Readings of one component along one axis, on a line of that name; `tool`: offset from the plan's tool vector [mm]."""

    component: str
    axis: str
    line: str
    runs: int = OTHER_RUNS
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Readings:
    """Where readings are taken: positions, directions (m, n_axes), tool vectors (m, 3), labels."""

    positions: np.ndarray
    directions: np.ndarray
    tool: np.ndarray
    labels: Mapping[str, np.ndarray]

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions, directions, tool vectors."""
        return self.positions, self.directions, self.tool

    def as_set(self, name: str, kind: str, u: float, options: Mapping[str, Any]) -> ObservationSet:
        """A set to be read, with u [mm or rad]."""
        m = len(self.positions)
        return ObservationSet(
            name, kind, *self.arrays, np.full((m, 1), np.nan), np.full((m, 1), u), self.labels,
            options=dict(options) | {"u": u}, source="direct plan",
        )  # fmt: skip
