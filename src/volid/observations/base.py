"""What every observation kind declares, so that files, simulation and fit treat all kinds alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.model.machine import Machine


class Prediction(Protocol):
    """Pure JAX function of one block: (machine, settings, q, tool, errors, slots, constants) -> readings (k, m)."""

    def __call__(
        self, machine: Machine, settings: Any, q: Any, tool: Any, errors: Any, slots: Any, constants: Any
    ) -> Any: ...


class Group(NamedTuple):
    """Rows of a set that one prediction with one static setting serves.

    `rows`: (m,) row numbers in the set. `settings`: hashable, static. `slots`: (n_slots, m) indices into the nuisance
    vector. `constants`: (n_constants, m) numbers that the prediction needs beside positions and tool.
    """

    rows: np.ndarray
    settings: Any
    slots: np.ndarray
    constants: np.ndarray


@dataclass(frozen=True)
class Nuisance:
    """One nuisance parameter: a name for people, its start value, and its prior standard uncertainty.

    `prior_u`: infinite for an unknown, a number for an artefact's calibration, 0 for a value that is known exactly.
    `spread`: how far from `start` a virtual instrument draws an unknown value (uniform); 0 when `start` is the true one.
    `distribution`: of what is known beforehand; `effect`: name of the systematic effect that it belongs to.
    """

    name: str
    unit: str
    start: float
    prior_u: float = np.inf
    spread: float = 0.0
    distribution: str = "normal"
    effect: str = ""


class NuisanceTable:
    """Nuisance parameters by key, each made once: sets that share a station share its parameters."""

    def __init__(self, starts: Mapping[Any, float] | None = None) -> None:
        self.starts: Mapping[Any, float] = starts or {}
        self.keys: dict[Any, int] = {}
        self.entries: list[Nuisance] = []

    def index(
        self,
        key: Any,
        name: str,
        unit: str = "mm",
        start: float = 0.0,
        prior_u: float = np.inf,
        spread: float = 0.0,
        distribution: str = "normal",
        effect: str = "",
    ) -> int:
        """Number of the parameter `key`, made on first use; a start value found from the data wins over `start`."""
        if key not in self.keys:
            self.keys[key] = len(self.entries)
            self.entries.append(
                Nuisance(name, unit, float(self.starts.get(key, start)), prior_u, spread, distribution, effect)
            )
        return self.keys[key]


@dataclass(frozen=True)
class Kind:
    """One kind of observation (CONVENTIONS 6).

    `readings`: columns of a CSV that hold the readings. `labels`: text columns and their default; a default of None means
    that the column is required. `options`: keys of a `[[set]]` of this kind and their default; None means required.
    `optional`: further keys, absent from a set that does not state them, with a value that shows their type.
    `unit`: of the readings and their u, `units` one by one where they differ. `predict`: the prediction. `groups`: takes a set
    apart into groups and names the nuisance parameters it needs. `check`: raises `InputError` for options that do not fit each
    other or the labels. `file_kind`: the `kind` of a `[[set]]` in files of which this one is a form with other columns.
    """

    name: str
    readings: tuple[str, ...]
    predict: Prediction
    groups: Callable[[ObservationSet, Campaign, NuisanceTable], list[Group]]
    labels: Mapping[str, str | None] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    optional: Mapping[str, Any] = field(default_factory=dict)
    doc: str = ""
    unit: str = "mm"
    check: Callable[[ObservationSet], None] | None = None
    units: tuple[str, ...] = ()
    file_kind: str = ""

    def unit_of(self, i: int) -> str:
        """Unit of reading number `i` and its u."""
        return self.units[i] if self.units else self.unit
