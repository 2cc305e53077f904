"""A campaign: what was read on which machine, from where, and under which conditions. NumPy only, immutable.

Facts that follow from the readings' places alone (measured ranges, tool vectors, distinct positions) are methods of `Campaign`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from volid.model.machine import WORKPIECE, Machine

if TYPE_CHECKING:
    from jaxtyping import Float, Int

ROW_ARRAYS = (
    "positions",
    "directions",
    "tool",
    "readings",
    "u",
    "time",
    "temperature",
    "as_read",
    "rows",
)  # one entry a row
HENE = 632.991  # nm, vacuum wavelength of a helium-neon laser without stabilisation, within 1.5e-6 (recommended values of 2007)
CO2 = 450.0  # ppm, of air in rooms
HOUR = 3600.0  # s
TIME = "time"
AIR = ("air_temperature_C", "pressure_hPa", "humidity_percent")  # columns of a log that tell the refractive index
SAME_PLACE = 1e-4  # of the travel: commanded positions of an axis nearer than this are one
SAME_TOOL = 6  # decimal places of a tool vector's components [mm] that count
SAME_ANGLE = 1e-3  # degrees: rotary positions nearer than this are one


@dataclass(frozen=True)
class Station:
    """Where an instrument (or a ball-bar socket) stands.

    Args:
        name: The name by which the readings call it.
        body: the body it stands on: "workpiece", "bed", "tool" or the letter of the axis that moves it.
        position: (x, y, z) in that body's frame, all axes at 0 [mm]; None when nothing is known of it.
        known: whether the position is exact. It is then in the common frame of the stations, or in that of the machine.
        frame: The frame of a known position: "stations" (their common frame) or "machine".

    Source: CONVENTIONS 6.

    >>> Station("S1", position=(-300.0, 100.0, 250.0)).body
    'workpiece'
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


@dataclass(frozen=True)
class Alignment:
    """A placement that several lines of readings share: of a square, a granite, a plate that was clamped once.

    Its three rotations and three translations are unknown.

    Args:
        name: The name by which sets call it.
        body: The body that the artefact stands on: "workpiece", "bed" or the letter of the axis that moves it.
        artefact: The artefact, whose form and angle are the same in all its placements; "" for one of the alignment's name.

    >>> Alignment("square").artefact_name
    'square'
    """

    name: str
    body: str = WORKPIECE
    artefact: str = ""

    @property
    def artefact_name(self) -> str:
        """The artefact's name."""
        return self.artefact or self.name


@dataclass(frozen=True)
class Expansion:
    """How a body expands: the scales of a machine, or an artefact that was calibrated at 20 °C.

    Args:
        expansion: Coefficient of linear expansion [1/K].
        u: Its standard uncertainty [1/K].
        material: Column of the environment's log with the body's temperature, such as "material_1"; "" for the only one there
            is; "temperature": the column of the readings' own file.

    >>> Expansion(11.5e-6, u=1e-6).material
    ''
    """

    expansion: float
    u: float = 0.0
    material: str = ""


@dataclass(frozen=True, eq=False)
class Environment:
    """The air and the temperatures at which sets were read, and what is to be made of them.

    Args:
        name: The name by which messages and unknowns call it.
        log: Columns of equal length: `time` [s], `air_temperature_C`, `pressure_hPa`, `humidity_percent`, `material_1_C`, …;
            NaN where a column has no entry. Without `time` there is one row, which always holds.
        sets: Names of the sets it holds for; none: all sets that are read in light, or, with `artefact`, against an artefact.
        corrected: Whether the readings hold the refractive correction already; None where the log knows no air.
        at: The air that the instrument assumed, as in `log`, or its `refractive_index`; its correction is undone first.
        wavelength: Vacuum wavelength of the light [nm].
        co2: Carbon dioxide in the air [ppm].
        group: Whether the group index counts: of modulated light, as of an absolute distance meter.
        dead_path: Path in air besides that from the station, or at the first reading of a line [mm]; negative where the beam
            comes from the positive side.
        u: Standard uncertainty of columns of the log, such as {"air_temperature_C": 0.1}; shared by all readings.
        machine: Expansion of the machine's scales: readings are reduced to 20 °C.
        artefact: Expansion of the artefact whose lengths at 20 °C are read.
        longest_gap: Time between two entries of the log that is interpolated over [s].
        beyond: Time before its first and after its last entry for which that entry holds [s].
        source: File of the log.

    Source: INTERFACES, "Further keys".

    >>> import numpy as np
    >>> air = {"air_temperature_C": 21.0, "pressure_hPa": 1002.0, "humidity_percent": 40.0}
    >>> room = Environment("room", {name: np.array([value]) for name, value in air.items()}, corrected=False)
    >>> room.has_air, room.materials
    (True, ())
    """

    name: str
    log: Mapping[str, np.ndarray]
    sets: tuple[str, ...] = ()
    corrected: bool | None = None
    at: Mapping[str, float] = field(default_factory=dict)
    wavelength: float = HENE
    co2: float = CO2
    group: bool = False
    dead_path: float = 0.0
    u: Mapping[str, float] = field(default_factory=dict)
    machine: Expansion | None = None
    artefact: Expansion | None = None
    longest_gap: float = HOUR
    beyond: float = 0.0
    source: str = ""

    @property
    def has_air(self) -> bool:
        """Whether the log knows the air."""
        return AIR[0] in self.log

    @property
    def materials(self) -> tuple[str, ...]:
        """Columns of the log with temperatures of bodies."""
        return tuple(name for name in self.log if name not in (TIME, *AIR))


@dataclass(frozen=True, eq=False)
class Effect:
    """A systematic effect on the readings of a set.

    Args:
        name: sets that use the same name share the effect.
        type: one of the types of `volid.effects`.
        u: standard uncertainty, in the unit of the type.
        per: its scope, such as "campaign", "set" or "station".
        options: other keys of the type, such as the distribution.
    """

    name: str
    type: str
    u: float
    per: str
    options: Mapping[str, Any] = field(default_factory=dict)


class End(NamedTuple):
    """Functional points that the rows of a set see, one a row.

    Args:
        positions: Commanded axis positions, shape (m, n_axes) [mm or degrees].
        directions: How they were approached, shape (m, n_axes): +1, -1 or 0 (unknown).
        tool: Tool vectors, shape (m, 3) [mm].

    >>> import numpy as np
    >>> still, tool = np.zeros((2, 3)), np.tile([0.0, 0.0, -150.0], (2, 1))
    >>> first, second = End(still, still, tool), End(still + [[300.0, 0.0, 0.0], [300.0, 400.0, 0.0]], still, tool)
    >>> bar = ObservationSet("bar", "length", *first, np.array([[300.01], [500.02]]), np.full((2, 1), 1e-3), to=second)
    >>> len(bar.ends), bar.side_by_side.positions.shape
    (2, (2, 6))
    """

    positions: np.ndarray
    directions: np.ndarray
    tool: np.ndarray

    def rows_of(self, numbers: np.ndarray | slice) -> End:
        """Those of some rows."""
        return End(*(values[numbers] for values in self))


@dataclass(frozen=True, eq=False)
class ObservationSet:
    """Readings of one kind taken with one instrument: m rows of k readings.

    Args:
        name: The name by which messages and tables call the set.
        kind: A kind of `volid.observations`, such as "distance".
        positions: commanded axis positions, shape (m, n_axes), machine axis order [mm or degrees].
        directions: approach directions, shape (m, n_axes): +1, -1 or 0 (unknown).
        tool: tool vectors, shape (m, 3) [mm].
        readings: The readings, shape (m, k), in the unit of the kind; NaN in a plan.
        u: standard uncertainty of each reading, shape (m, k).
        labels: text columns of the kind, such as "station", each of shape (m,).
        time: Time of each row, shape (m,) [s]; NaN where it is not recorded, None when no row has one.
        temperature: Temperature of each row, shape (m,) [°C]; NaN where it is not recorded, None when no row has one.
        as_read: The readings before they were corrected for air and temperature, shape (m, k); None where nothing was.
        options: the set's other keys, as the kind defines them.
        effects: systematic effects on the readings.
        source: File that the set was read from.
        rows: Line number of each row in that file, shape (m,).
        to: The second functional point of every row, of a kind that sees two; None for all others.

    Source: CONVENTIONS 6.

    >>> import numpy as np
    >>> still, tool = np.zeros((2, 3)), np.tile([0.0, 0.0, -150.0], (2, 1))
    >>> labels = {"station": np.array(["S1", "S1"]), "segment": np.array(["1", "1"])}
    >>> readings = np.array([[812.4321], [790.1234]])
    >>> places = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]])
    >>> s = ObservationSet("tracker", "distance", places, still, tool, readings, 0.0 * readings + 5e-4, labels)
    >>> len(s), s.where(1)
    (2, 'tracker, row 2')
    """

    name: str
    kind: str
    positions: Float[np.ndarray, "rows axes"]
    directions: Float[np.ndarray, "rows axes"]
    tool: Float[np.ndarray, "rows 3"]
    readings: Float[np.ndarray, "rows columns"]
    u: Float[np.ndarray, "rows columns"]
    labels: Mapping[str, np.ndarray] = field(default_factory=dict)
    time: Float[np.ndarray, " rows"] | None = None
    temperature: Float[np.ndarray, " rows"] | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    effects: tuple[Effect, ...] = ()
    source: str = ""
    rows: Int[np.ndarray, " rows"] | None = None
    to: End | None = None
    as_read: Float[np.ndarray, "rows columns"] | None = None

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def ends(self) -> tuple[End, ...]:
        """The functional points of every row: one, or two."""
        first = End(self.positions, self.directions, self.tool)
        return (first,) if self.to is None else (first, self.to)

    @property
    def all_ends(self) -> End:
        """The functional points of all rows: all first ones, then all second ones."""
        return End(*(np.concatenate(parts) for parts in zip(*self.ends, strict=True)))

    @property
    def side_by_side(self) -> End:
        """The functional points of every row beside each other: (m, n_axes · ends), and (m, 3 · ends) for the tool."""
        return End(*(np.hstack(parts) for parts in zip(*self.ends, strict=True)))

    def moved(
        self, change: Callable[[np.ndarray], np.ndarray], way: Callable[[np.ndarray], np.ndarray]
    ) -> ObservationSet:
        """The set with its positions changed by one function, (m, n_axes) -> (m, n_axes), and its directions by another."""
        first, *others = (End(change(e.positions), way(e.directions), e.tool) for e in self.ends)
        return replace(self, positions=first.positions, directions=first.directions, to=others[0] if others else None)

    @property
    def file_and_set(self) -> str:
        """The set in messages: "volume.csv, set 'volume'"."""
        return f"{self.source or self.name}, set '{self.name}'"

    def rows_of(self, numbers: Int[np.ndarray, " k"]) -> ObservationSet:
        """The set with the rows of these `numbers` only, shape (k,), in their order."""
        given = {name: getattr(self, name) for name in ROW_ARRAYS}
        cut: dict[str, Any] = {name: None if values is None else values[numbers] for name, values in given.items()}
        if self.rows is None:  # messages go on to name the row that it was
            cut["rows"] = np.asarray(numbers) + 1
        cut["to"] = None if self.to is None else self.to.rows_of(numbers)
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
class ActiveFiles:
    """Files of a control that were loaded while a campaign was measured: what was active, in full (ISO/TR 16907 9.1, 10.5).

    Args:
        text: What [conditions] `active_compensations` says of them: types, names, control and hash.
        cnc: Name of the control, one of `volid.CONTROLS`, or "volid" for volid's own tables and grids.
        files: Content by the name under which the control knows the file.
        sign: Sense of the values where the control leaves it open; "" where it does not.
        options: Options of the control.

    >>> ActiveFiles("L-POS: x.comp for linuxcnc", "linuxcnc", {"x.comp": b"0 0 0\\n"}).types
    ('L-POS',)
    """

    text: str
    cnc: str
    files: Mapping[str, bytes]
    sign: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def types(self) -> tuple[str, ...]:
        """Types of ISO/TR 16907 that they hold, as `text` names them."""
        return tuple(self.text.split(": ")[0].split(" + "))


@dataclass(frozen=True, eq=False)
class Campaign:
    """A measuring campaign, complete in itself: machine, stations, sets of readings, and the record of conditions.

    Args:
        machine: the machine that was measured, with its datum and the settings of its error model.
        stations: The stations, where the instruments stand.
        sets: the readings.
        title: A title in words.
        conditions: the record of conditions, as ISO/TR 16907 9.1 asks for it.
        warnings: Messages about what looked odd when it was read or planned.
        source: file that it was read from.
        alignments: Placements of artefacts that lines of readings share.
        environments: The air and the temperatures at which sets were read.
        active_files: Files of a control that were active while measuring; [conditions] `active_compensations` names them.

    >>> import volid
    >>> campaign = volid.load_campaign("datasets/vertical_multilateration/campaign.toml")
    >>> campaign.n_readings, campaign.distinct_positions()["X"] > 20
    (2400, True)
    >>> campaign.machine.letters, campaign.measured_range()[1].tolist()
    (('Y', 'X', 'Z'), [0.0, 1000.0])
    """

    machine: Machine
    stations: tuple[Station, ...] = ()
    sets: tuple[ObservationSet, ...] = ()
    title: str = ""
    conditions: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    source: str = ""
    alignments: tuple[Alignment, ...] = ()
    environments: tuple[Environment, ...] = ()
    active_files: tuple[ActiveFiles, ...] = ()

    def station(self, name: str) -> Station:
        """The station called `name` (KeyError when there is none)."""
        return {station.name: station for station in self.stations}[name]

    @property
    def n_readings(self) -> int:
        """Number of scalar readings in all sets."""
        return sum(int(s.readings.size) for s in self.sets)

    def alignment(self, name: str) -> Alignment:
        """The alignment called `name` (KeyError when there is none)."""
        return {alignment.name: alignment for alignment in self.alignments}[name]

    @property
    def positions(self) -> Float[np.ndarray, "rows axes"]:
        """Commanded positions of all functional points of all sets [mm or degrees]."""
        return np.concatenate([s.all_ends.positions for s in self.sets])

    def measured_range(self) -> Float[np.ndarray, "axes 2"]:
        """Lowest and highest measured position of every axis [mm or degrees]."""
        positions = self.positions
        return np.stack([positions.min(axis=0), positions.max(axis=0)], axis=1)

    def distinct_positions(self) -> dict[str, int]:
        """Number of distinct commanded positions of every axis, equal within 1e-4 of the travel."""
        axes, columns = self.machine.axes, self.positions.T
        steps = (np.round((q - a.travel[0]) / (SAME_PLACE * a.length)) for a, q in zip(axes, columns, strict=True))
        return {a.letter: len(np.unique(numbers)) for a, numbers in zip(axes, steps, strict=True)}

    def rotary_poses(self) -> list[Int[np.ndarray, " rows"]]:
        """Number of the combination of rotary positions of every row, by set; 0 everywhere without rotary axes."""
        columns = [i for i, axis in enumerate(self.machine.axes) if not axis.is_linear]
        ends = [(s.positions, s.positions if s.to is None else s.to.positions) for s in self.sets]
        angles = np.round(np.concatenate([np.hstack([a[:, columns], b[:, columns]]) for a, b in ends]) / SAME_ANGLE)
        _, pose = np.unique(angles, axis=0, return_inverse=True)
        return np.split(np.asarray(pose).ravel(), np.cumsum([len(s) for s in self.sets])[:-1])

    def tool_vectors(self) -> Float[np.ndarray, "tools 3"]:
        """The distinct tool vectors of all sets [mm], in ascending order."""
        return np.unique(np.round(np.concatenate([s.all_ends.tool for s in self.sets]), SAME_TOOL), axis=0)
