"""A campaign: what was read on which machine, from where, and under which conditions. NumPy only, immutable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from volid.model.machine import WORKPIECE, Machine

ROW_ARRAYS = (
    "positions",
    "directions",
    "tool",
    "readings",
    "u",
    "time",
    "temperature",
    "rows",
)  # of a set, one entry a row


@dataclass(frozen=True)
class Station:
    """Where an instrument (or a ball-bar socket) stands.

    `body`: the body it stands on. `position`: shape (3,) [mm] in that body's frame; None when nothing is known of it.
    `known`: the position is exact, in the stations' common frame; with `frame` = "machine" in the machine's.
    """

    name: str
    body: str = WORKPIECE
    position: tuple[float, float, float] | None = None
    known: bool = False
    frame: str = "stations"

    @property
    def is_placed(self) -> bool:
        """Whether the position is known in a frame that all such stations share and whose place in the machine is unknown."""
        return self.known and self.frame != "machine"


@dataclass(frozen=True, eq=False)
class Effect:
    """A systematic effect on the readings of a set: name, type, standard uncertainty `u`, scope `per`, free options."""

    name: str
    type: str
    u: float
    per: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ObservationSet:
    """Readings of one kind taken with one instrument.

    `positions`: (m, n_axes), machine axis order [mm or degrees]. `directions`: (m, n_axes), +1, -1 or 0 (unknown).
    `tool`: (m, 3) [mm]. `readings`: (m, k), NaN in a plan. `u`: (m, k), standard uncertainty of each reading.
    `labels`: text columns of the kind, each (m,). `time` [s], `temperature` [°C]: (m,), NaN where not recorded.
    `options`: the set's other keys, as the kind defines them. `source`: file; `rows`: (m,) line numbers in it.
    """

    name: str
    kind: str
    positions: np.ndarray
    directions: np.ndarray
    tool: np.ndarray
    readings: np.ndarray
    u: np.ndarray
    labels: Mapping[str, np.ndarray] = field(default_factory=dict)
    time: np.ndarray | None = None
    temperature: np.ndarray | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    effects: tuple[Effect, ...] = ()
    source: str = ""
    rows: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.positions)

    def rows_of(self, numbers: np.ndarray) -> ObservationSet:
        """The set with some of its rows, in the order of `numbers`."""
        given = {name: getattr(self, name) for name in ROW_ARRAYS}
        cut: dict[str, Any] = {name: None if values is None else values[numbers] for name, values in given.items()}
        return replace(self, labels={name: values[numbers] for name, values in self.labels.items()}, **cut)

    def where(self, i: int) -> str:
        """File and row of reading `i`, for messages: "volume.csv, row 412"."""
        row = i + 1 if self.rows is None else int(self.rows[i])
        return f"{self.source or self.name}, row {row}"


def standard_uncertainty(u: float | Mapping[str, float], readings: np.ndarray) -> np.ndarray:
    """Standard uncertainty of readings: u = sqrt(constant² + (proportional · |reading|)²), in the unit of the readings.

    `u`: one number (the constant part), or {"constant": …, "proportional": …}, each 0 when left out. `readings`: any
    shape; where a reading is NaN (a plan), a proportional part makes u NaN.
    """
    parts = u if isinstance(u, Mapping) else {"constant": u}
    constant, proportional = parts.get("constant", 0.0), parts.get("proportional", 0.0)
    if proportional == 0.0:
        return np.full(np.shape(readings), float(constant))
    return np.hypot(constant, proportional * np.abs(readings))


@dataclass(frozen=True, eq=False)
class Campaign:
    """A measuring campaign, complete in itself: machine, stations, sets, and the record of conditions (ISO/TR 16907 9.1)."""

    machine: Machine
    stations: tuple[Station, ...] = ()
    sets: tuple[ObservationSet, ...] = ()
    title: str = ""
    conditions: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    source: str = ""

    def station(self, name: str) -> Station:
        """The station called `name` (KeyError when there is none)."""
        return {station.name: station for station in self.stations}[name]

    @property
    def n_readings(self) -> int:
        """Number of scalar readings in all sets."""
        return sum(int(s.readings.size) for s in self.sets)
