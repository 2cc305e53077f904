"""What every observation kind declares, so that files, checks, simulation, fit and reports treat all kinds alike."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.model.geometry import Vector
from volid.model.machine import TOOL, Machine
from volid.observations.beams import Beam
from volid.observations.response import UNMOVED, Key, Response

Place = tuple[float, float, float]
DEGREES, MM = "degrees", "mm"
STATION = "station"  # label of the station that a reading is made from
LIGHT, ARTEFACT, EITHER = "light", "artefact", "either"  # lengths: paths in air, in wavelengths; those of a solid body
LARGE_ERRORS = "large_errors"  # option of every set: its user says that the machine's errors are as large as they seem


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
    `distribution`: that of the prior knowledge. `effect`: name of the systematic effect that the parameter belongs to. `key`:
    what the parameter is, for programs. `response`: how it answers a change of datum. `recorded`: its true value is stored with
    the truth of a simulation, although nothing is drawn.
    """

    name: str
    unit: str
    start: float
    prior_u: float = np.inf
    spread: float = 0.0
    distribution: str = "normal"
    effect: str = ""
    key: Key = ()
    response: Response = UNMOVED
    recorded: bool = False


class NuisanceTable:
    """Nuisance parameters by key, each made once: sets that share a station share its parameters."""

    def __init__(self, starts: Mapping[Any, float] | None = None) -> None:
        self.starts: Mapping[Any, float] = starts or {}
        self.keys: dict[Any, int] = {}
        self.entries: list[Nuisance] = []

    @classmethod
    def of(cls, entries: Iterable[Nuisance]) -> NuisanceTable:
        """A table that holds these parameters already."""
        table = cls()
        table.entries = list(entries)
        table.keys = {entry.key: i for i, entry in enumerate(table.entries)}
        return table

    def index(self, key: Key, name: str, unit: str = "mm", start: float = 0.0, **known: Any) -> int:
        """Number of the parameter `key`, made on first use; a start value found from the data wins over `start`.

        `known`: further fields of `Nuisance`. Responses of several sets to the same parameter are joined.
        """
        if key not in self.keys:
            self.keys[key] = len(self.entries)
            self.entries.append(Nuisance(name, unit, float(self.starts.get(key, start)), key=key, **known))
            return self.keys[key]
        number = self.keys[key]
        present, other = self.entries[number].response, known.get("response", UNMOVED)
        if present != other:
            self.entries[number] = replace(self.entries[number], response=present.joined(other))
        return number


class Positioning(NamedTuple):
    """Readings of how far one axis went along or about itself, the others standing still.

    `line`: as the set calls it. `axis`: its number. `rows` (m,): in the set. `deviations` (m,): actual - commanded position
    [mm or degrees], up to a constant; `factor`: ∂deviation/∂reading. `zeros`: how many unknown constants the rows have.
    """

    line: str
    axis: int
    rows: np.ndarray
    deviations: np.ndarray
    factor: float
    zeros: int


class Part(NamedTuple):
    """Part of a set whose readings share a unit: kind in words, unit, and rows (m,) or rows and columns (m, k), bool.

    `readings`: names of its readings where they tell it from other parts: ("azimuth", "elevation"), or components ("X", "Y").
    """

    words: str
    unit: str
    rows: np.ndarray
    readings: tuple[str, ...] = ()


def takes_large_errors(observations: ObservationSet) -> bool:
    """Whether the user of a set says that the machine's errors are as large as they seem."""
    return bool(observations.options.get(LARGE_ERRORS, False))


def with_large_errors(campaign: Campaign) -> Campaign:
    """The campaign whose user says of every set that the machine's errors are as large as they seem."""
    sets = tuple(replace(s, options={**s.options, LARGE_ERRORS: True}) for s in campaign.sets)
    return replace(campaign, sets=sets)


class Kind(ABC):
    """One kind of observation (CONVENTIONS 6). Each kind has one final class that overrides what differs, with one instance.

    `readings`: columns of a CSV that hold the readings. `labels`: text columns and their default; a default of None means
    that the column is required; `choices`: the only texts that a label may have, where they are limited.
    `options`: keys of a `[[set]]` of this kind and their default; None means required. `optional`: further keys, absent from a
    set that does not state them, with a value that shows their type. `unit`: of the readings and their u, `units` one by one
    where they differ. `file_kind`: the `kind` of a `[[set]]` in files of which this one is a form with other columns.
    `scopes`: the scopes of effects besides campaign, set, tool and point, each with the labels that define it.
    `tested_by`: labels whose groups of residuals are tested; `named_by`: labels that name a reading.
    `standing`: label of what stands on the workpiece at an unknown place ("sphere"). `takes_centres`: places found by a probe
    may be given instead of readings; they count as readings of 0. `centres_in`: frame of these readings, "machine" or "tool".
    `calibrated`: sets name a file of calibrated points.
    `pair`: two columns whose difference, first minus second, may stand for the one reading in a file; a set of the kind `pair_in`
    that has one of them is of this kind.
    `ends`: functional points that a reading sees; with two, the set holds the second ones in `to`, and `predict` gets q, tool and
    errors of the second behind those of the first. `still_by`: labels of rows among which an axis that does not move is meant to
    stand still.
    """

    name: str
    readings: tuple[str, ...]
    doc: str
    unit: str = MM
    units: tuple[str, ...] = ()
    labels: Mapping[str, str | None] = {}
    choices: Mapping[str, tuple[str, ...]] = {}
    options: Mapping[str, Any] = {}
    optional: Mapping[str, Any] = {}
    file_kind: str = ""
    scopes: Mapping[str, tuple[str, ...]] = {}
    tested_by: tuple[str, ...] = ()
    named_by: tuple[str, ...] = ()
    standing: str = ""
    takes_centres: bool = False
    pair: tuple[str, ...] = ()
    pair_in: str = ""
    calibrated: bool = False
    centres_in: str = "machine"
    ends: int = 1
    still_by: tuple[str, ...] = ()

    @property
    def further(self) -> Mapping[str, Any]:
        """All keys of a set that it need not state: those of the kind, and those of every kind."""
        return {**self.optional, LARGE_ERRORS: False}

    # ------------------------------------------------------------------------------------- what is read, and from what

    @staticmethod
    @abstractmethod
    def predict(machine: Machine, settings: Any, q: Any, tool: Vector, errors: Any, slots: Any, constants: Any) -> Any:
        """Predicted readings (k, m) of one group: pure, on NumPy and JAX arrays alike."""

    @abstractmethod
    def groups(self, observations: ObservationSet, campaign: Campaign, table: NuisanceTable) -> list[Group]:
        """The set divided into groups. The unknowns that it needs are added to `table`, each with key and response."""

    def starts(self, campaign: Campaign) -> dict[Any, float]:
        """Start values that follow from all readings of this kind, by the unknown's key."""
        return {}

    def target_body(self, options: Mapping[str, Any]) -> str:
        """Body of the machine that carries what is seen; "tool": the functional point."""
        return TOOL

    def stations_of(self, observations: ObservationSet) -> np.ndarray:
        """Name of the station that each row is measured from, (m,); empty for a kind without stations."""
        return observations.labels[STATION] if STATION in self.labels else np.zeros(0, dtype=str)

    def sees_tool(self, observations: ObservationSet) -> bool:
        """Whether the tool vector takes part in the readings of a set."""
        return self.target_body(observations.options) == TOOL

    def is_pinned(self, observations: ObservationSet) -> bool:
        """Whether unknowns of a set belong to its commanded positions, so that other positions would have other unknowns."""
        return False

    def is_whole(self, observations: ObservationSet) -> bool:
        """Whether rows of a set refer to each other, so that it cannot be read part by part."""
        return False

    # ---------------------------------------------------------------------------------------------------- units and parts

    def unit_of(self, i: int) -> str:
        """Unit of reading number `i` and its u."""
        return self.units[i] if self.units else self.unit

    def unit_at(self, observations: ObservationSet, row: int, i: int) -> str:
        """Unit of reading number `i` in a row of a set."""
        return self.unit_of(i)

    @property
    def is_length(self) -> bool:
        """Whether all readings are lengths in mm."""
        return all(self.unit_of(i) == MM for i in range(len(self.readings)))

    @property
    def unit_words(self) -> str:
        """Units of all readings in one text."""
        return ", ".join(self.units) or self.unit

    @property
    def is_angle(self) -> np.ndarray:
        """Which readings are angles in degrees, bool (k,): no scale acts on them."""
        return np.array([self.unit_of(i) == DEGREES for i in range(len(self.readings))])

    def parts(self, observations: ObservationSet) -> Iterator[Part]:
        """Parts of a set whose readings share a unit."""
        words = self.file_kind or self.name
        for unit in dict.fromkeys(self.units):
            columns = [u == unit for u in self.units]
            names = tuple(n for n, used in zip(self.readings, columns, strict=True) if used)
            yield Part(f"{words}, {', '.join(names)}", unit, np.tile(columns, (len(observations), 1)), names)
        if not self.units:
            yield Part(words, self.unit, np.ones(len(observations), dtype=bool))

    def components(self, observations: ObservationSet) -> np.ndarray | None:
        """Row 0 … 5 of the deviation (X … C) that every reading is, (m,), for a kind that reads one directly; else None.

        Such a reading answers to how the axes really stand, although a deviation is no function of where they are commanded to.
        """
        return None

    def points_read(self, observations: ObservationSet) -> tuple[np.ndarray, np.ndarray] | None:
        """Coordinates of the functional point in the station's frame (m, 3) [mm], and their covariance (m, 3, 3) [mm²]; else
        None."""
        return None

    def positioning(self, observations: ObservationSet, campaign: Campaign) -> Iterable[Positioning]:
        """Lines of the set that say how far the one axis that moves has gone; other kinds and lines have none."""
        return ()

    # ------------------------------------------------------------------------------------------------- what must be right

    def check(self, observations: ObservationSet) -> None:
        """Raises `InputError` for options that do not fit each other or the labels."""
        return

    def check_values(self, observations: ObservationSet, campaign: Campaign) -> None:
        """Raises `InputError` for readings that cannot be in the kind's units."""
        return

    def beams(
        self, observations: ObservationSet, campaign: Campaign, positions: np.ndarray | None = None
    ) -> Iterable[Beam]:
        """Readings that are lengths from a station to places that are known nominally; other kinds have none.

        `positions`: (m, n_axes), tried instead of those of the set.
        """
        return ()

    def places(
        self, observations: ObservationSet, machine: Machine, positions: np.ndarray | None = None
    ) -> np.ndarray | None:
        """Place, by the nominal chain, that every row gives for what stands on the workpiece, (m, 3) [mm]; else None."""
        return None

    # --------------------------------------------------------------------------------- systematic effects, simulation, advice

    def lengths(self, observations: ObservationSet) -> np.ndarray:
        """Lengths that a scale of the instrument changes, (m, k) [mm], dead path included; 0 for angles, which have no scale.

        They change with the reading, by as much as it."""
        return np.where(self.is_angle, 0.0, observations.readings)

    def lengths_of(self, observations: ObservationSet) -> str:
        """What lengths are by the set's own keys: `LIGHT`, `ARTEFACT`, `EITHER`; "" where air and heat do not act on them."""
        return ""

    def dead_paths(self, observations: ObservationSet, starts: Mapping[Any, float]) -> np.ndarray:
        """Start values of the part of a length that is not a path in air, (m, 1) [mm]."""
        return np.zeros((len(observations), 1))

    def standing_at(self, observations: ObservationSet) -> Mapping[str, Sequence[float]]:
        """Stated places, by name, of what stands on the workpiece [mm]."""
        return {}

    def approximate(self, observations: ObservationSet, near: Callable[[str, Any], list[float]]) -> ObservationSet:
        """The set with its stated places replaced by `near` (name, place), because a campaign knows them only approximately."""
        return observations

    def groups_by(self, like: ObservationSet) -> Iterator[tuple[str, str]]:
        """Labels and their values whose residuals are tested together."""
        for label in self.tested_by:
            yield from ((label, str(value)) for value in dict.fromkeys(like.labels[label]))

    def runs_by(self, observations: ObservationSet) -> tuple[str, ...]:
        """Labels of a run of readings that share an unknown constant because the beam was not interrupted; () where none is."""
        return ()

    def advice(self, sets: Sequence[ObservationSet], campaign: Campaign) -> list[str]:
        """Facts about all `sets` of this kind because of which error functions are often not determined."""
        return []
