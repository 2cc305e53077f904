"""One `[[set]]` of a campaign manifest with its CSV file, in the same way for every observation kind."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from volid.campaign import Effect, End, ObservationSet, standard_uncertainty
from volid.exceptions import InputError
from volid.io.basics.csv_form import PLAIN, CsvForm
from volid.io.basics.csv_table import CsvTable, read_csv
from volid.io.basics.toml_table import Table, is_number
from volid.io.campaign import calibration, delimited, probe_centres, touches
from volid.io.campaign.effects import read_effect
from volid.io.campaign.foreign import is_foreign, read_foreign
from volid.io.campaign.rules import check_constant, check_unique, find_kind
from volid.model.machine import TOOL, Machine
from volid.observations import KINDS, Kind

TOOL_COLUMNS = ("tool_x", "tool_y", "tool_z")
TO = "to_"  # begins the columns of a second functional point
_SET_KEYS = ("name", "kind", "file", "csv", "columns", "ignore", "tool", "effect")
_RECORDED = {"time": "s", "temperature": "°C"}


class ReadSet(NamedTuple):
    """A set, how its file was read, and what is recorded of a file that another program wrote (nothing for a CSV)."""

    readings: ObservationSet
    notes: tuple[str, ...]
    record: Mapping[str, Any]


def read_set(table: Table, folder: Path, machine: Machine, *, plan: bool, form: CsvForm = PLAIN) -> ReadSet:
    """Readings of one set, keys from `table`, rows from the file that it names in `folder`, a CSV or, with `as`, another one.

    `form`: how the campaign's CSV files are written, as far as it is stated; `[csv]` of the set goes before it.

    With `plan`, the columns of the readings may all be absent. The readings are then NaN, and the key of a proportional
    uncertainty stays in `options`, to be evaluated once there are readings. The key `columns` renames columns of the file, and
    `ignore` leaves columns out. With `centres = true` a set reads centres that a probe found (`probe_centres`), with
    `touches = true` the touches that they are fitted to (`touches`). Raises `InputError` naming file, row or key.
    """
    table, csv, record = _rows(table, folder, machine, form)
    table, csv, fitted = touches.as_centres(table, csv, machine)
    record = {**record, **fitted}
    kind = _form(find_kind(table.text("kind"), table.where), table, csv)
    extra = probe_centres.KEYS if kind.takes_centres else ()
    table.only((*_SET_KEYS, *extra, *uncertainty_keys(kind.readings), *kind.options, *kind.further))
    purpose = f"every row of a '{kind.name}' set needs one"
    content = _centres(table, csv, kind, machine, purpose, plan) or _content(table, csv, kind, machine, purpose, plan)
    u, pending = _uncertainty(table, csv, kind, content.readings)
    first, *second = _ends(table, csv, kind, machine, content)
    found = ObservationSet(
        name=table.text("name"),
        kind=kind.name,
        positions=content.positions,
        directions=first.directions,
        tool=content.tool,
        readings=content.readings,
        u=u,
        labels=content.labels,
        time=_recorded(csv, "time"),
        temperature=_recorded(csv, "temperature"),
        options=_options(table, kind) | content.options | pending,
        effects=_effects(table, folder, machine),
        source=csv.source,
        rows=csv.rows,
        to=second[0] if second else None,
    )
    notes = csv.notes
    if kind.calibrated:
        found, notes = calibration.with_files(found, table, folder, notes)
    return ReadSet(found, notes, record)


def _rows(table: Table, folder: Path, machine: Machine, form: CsvForm) -> tuple[Table, CsvTable, Mapping[str, Any]]:
    """The keys of the set, the rows of its file, and what is recorded of a file that another program wrote."""
    if delimited.is_text(table):
        table, record = delimited.as_csv(table)
        csv = named_csv(table, folder, form.with_stated(table))
        return *delimited.joined(table, csv, folder, machine), record
    if is_foreign(table):
        csv, table, record = read_foreign(table, folder, machine)
        return table, csv, record
    return table, named_csv(table, folder, form.with_stated(table)), {}


def _ends(table: Table, csv: CsvTable, kind: Kind, machine: Machine, content: _Content) -> list[End]:
    """The functional points of the rows: the first, and for a kind with two the second, from columns that begin with "to_".

    The second tool vector is the first one unless its own columns are there.
    """
    first = End(content.positions, read_directions(csv, machine), content.tool)
    if kind.ends == 1:
        return [first]
    purpose = f"every row of a '{kind.name}' set has two ends"
    positions = np.stack([csv.numbers(f"{TO}{a.letter}", a.unit, purpose) for a in machine.axes], axis=1)
    tool = content.tool
    if any(f"{TO}{name}" in csv for name in TOOL_COLUMNS):
        columns = tuple(f"{TO}{name}" for name in TOOL_COLUMNS)
        csv.require(columns, "a tool vector has three coordinates", tuple(csv.columns))
        tool = np.stack([csv.numbers(name, "mm", purpose) for name in columns], axis=1)
    return [first, End(positions, read_directions(csv, machine, TO), tool)]


def _form(kind: Kind, table: Table, csv: CsvTable) -> Kind:
    """The kind itself, or the form of it whose readings, or their u, the set and its file name (`point` as range and angles)."""
    for other in KINDS.values():
        if other.pair_in == kind.name and any(name in csv for name in other.pair):
            return other
        if other.file_kind == kind.name and any(
            n in csv or f"u_{n}" in csv or f"u_{n}" in table.data for n in other.readings
        ):
            both = [n for n in kind.readings if n in csv]
            if both:
                raise InputError(
                    f"{csv.source}, header: {', '.join(both)} beside {', '.join(other.readings)}; expected one of "
                    "the two forms "
                    f"of a '{kind.name}' set"
                )
            if "u" in csv or "u" in table.data:
                keys = ", ".join(f"u_{n} ({other.unit_of(i)})" for i, n in enumerate(other.readings))
                raise InputError(f"{table.where}: one u for readings of different units; expected {keys}")
            return other
    return kind


class _Content(NamedTuple):
    """The contents of the rows: positions (m, n_axes), tool (m, 3), readings (m, k), labels, and options that they imply."""

    positions: np.ndarray
    tool: np.ndarray
    readings: np.ndarray
    labels: dict[str, np.ndarray]
    options: dict[str, Any]


def named_csv(table: Table, folder: Path, form: CsvForm) -> CsvTable:
    """The file that a table names, with its columns named as `columns` says and without those in `ignore`."""
    csv = read_csv(folder / table.text("file"), form)
    columns, ignored = table.table("columns", {}), table.get("ignore", [])
    names = {key: _column(columns, key, form.header) for key in columns.data}
    if not isinstance(ignored, list) or not all(isinstance(name, str) for name in ignored):
        raise table.wrong("ignore", 'a list of column names, such as ["seq"]')
    if not form.header and not names:
        raise InputError(
            f"{table.where}: header = false but no columns; name them by number, such as columns = {{ X = 1 }}"
        )
    found = csv.renamed(names, ignored, table.where)
    form.check_units(table)
    return found


def _column(columns: Table, key: str, header: bool) -> str:
    """What the file calls a column: its header, or its number where there is none."""
    value = columns.get(key)
    if header:
        return str(columns.text(key))
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise columns.wrong(key, "the number of a column from 1, as the file has no header")
    return str(value)


def _content(table: Table, csv: CsvTable, kind: Kind, machine: Machine, purpose: str, plan: bool) -> _Content:
    _check_columns(csv, kind, machine, purpose, plan)
    positions = np.stack([csv.numbers(a.letter, a.unit, purpose) for a in machine.axes], axis=1)
    readings, labels = _readings(csv, kind, purpose), _labels(csv, kind, purpose)
    return _Content(positions, _tool(table, csv, kind, purpose), readings, labels, {})


def _centres(table: Table, csv: CsvTable, kind: Kind, machine: Machine, purpose: str, plan: bool) -> _Content | None:
    """Centres as readings of 0 at their axis positions; None for a set of other readings."""
    if not kind.takes_centres or not probe_centres.asked_for(table):
        return None
    if plan:
        raise InputError(f"{table.where}: centres = true is for centres that were found; a plan holds none, remove it")
    tip = probe_centres.gives_tip(csv, machine, table)
    named = [a.letter for a in machine.axes if not (tip and a.is_linear)]
    required = [*named, *(probe_centres.TIP if tip else ()), *(n for n, d in kind.labels.items() if d is None)]
    known = (*required, *(f"{a}_dir" for a in machine.letters), *TOOL_COLUMNS, *kind.labels, "u", *_RECORDED)
    known = (*known, *(key for key in uncertainty_keys(kind.readings) if key != "u"))
    csv.require(required, "every row of centres needs one", known)
    csv.only(known)
    tool, labels = _tool(table, csv, kind, purpose), _labels(csv, kind, purpose)
    if tip:
        positions = probe_centres.axis_positions(csv, machine, tool, table, purpose)
    else:
        positions = np.stack([csv.numbers(a.letter, a.unit, purpose) for a in machine.axes], axis=1)
    options: dict[str, Any] = {}
    if kind.standing and kind.standing not in table.data:
        options[kind.standing] = probe_centres.places(machine, positions, tool, labels[kind.standing])
    return _Content(positions, tool, np.zeros((len(csv), len(kind.readings))), labels, options)


def uncertainty_keys(readings: tuple[str, ...]) -> tuple[str, ...]:
    """Keys and columns that can hold standard uncertainties: u, and u_<reading> when a row has several readings."""
    return ("u",) if len(readings) == 1 else ("u", *(f"u_{name}" for name in readings))


def uncertainty_key_of(readings: tuple[str, ...], i: int) -> tuple[str, ...]:
    """Keys and columns that can hold the u of reading number `i`; an earlier one takes precedence."""
    return ("u",) if len(readings) == 1 else (f"u_{readings[i]}", "u")


def _check_columns(csv: CsvTable, kind: Kind, machine: Machine, purpose: str, plan: bool) -> None:
    starts = ("", TO)[: kind.ends]
    required = [f"{start}{letter}" for start in starts for letter in machine.letters]
    required += [name for name, default in kind.labels.items() if default is None]
    paired = bool(kind.pair) and any(name in csv for name in kind.pair)
    if paired or not plan or any(name in csv for name in kind.readings):
        required += kind.pair if paired else kind.readings
    optional = [
        f"{start}{name}" for start in starts for name in (*(f"{a}_dir" for a in machine.letters), *TOOL_COLUMNS)
    ]
    optional += [*kind.labels, *uncertainty_keys(kind.readings)]
    optional += () if paired else kind.readings
    known = tuple(dict.fromkeys([*required, *optional, *_RECORDED]))
    csv.require(required, purpose + _centres_hint(csv, kind), known)
    csv.only(known)


def _centres_hint(csv: CsvTable, kind: Kind) -> str:
    if not kind.takes_centres or any(name in csv for name in kind.readings):
        return ""
    return "; where the rows are axis positions of centres that a probe found, add centres = true to the set"


def _readings(csv: CsvTable, kind: Kind, purpose: str) -> np.ndarray:
    """Readings (m, k), NaN where the file has none; one that the file gives as a pair is first minus second."""
    if kind.pair and all(name in csv for name in kind.pair):
        first, second = (csv.numbers(name, kind.unit_of(0), purpose) for name in kind.pair)
        return np.asarray(first - second)[:, None]
    if not any(name in csv for name in kind.readings):
        return np.full((len(csv), len(kind.readings)), np.nan)
    columns = [csv.numbers(name, kind.unit_of(i), purpose) for i, name in enumerate(kind.readings)]
    return np.stack(columns, axis=1)


def read_directions(csv: CsvTable, machine: Machine, start: str = "") -> np.ndarray:
    """Approach directions, shape (m, n_axes): +1, -1, or 0 where the file does not tell; `start`: of the columns' names."""
    result = np.zeros((len(csv), len(machine.axes)))
    for i, letter in enumerate(machine.letters):
        name = f"{start}{letter}_dir"
        if name in csv:
            result[:, i] = csv.numbers(name, "steps of one", "expected +1, -1 or 0")
            wrong = ~np.isin(result[:, i], (-1.0, 0.0, 1.0))
            if wrong.any():
                row = int(np.argmax(wrong))
                raise InputError(f"{csv.where(row)}: {name} is {result[row, i]:g}; expected +1, -1, or 0 for unknown")
    return result


def _tool(table: Table, csv: CsvTable, kind: Kind, purpose: str) -> np.ndarray:
    """Tool vectors, shape (m, 3) [mm], from three columns or from the key `tool` of the set."""
    if any(name in csv for name in TOOL_COLUMNS):
        if "tool" in table.data:
            raise InputError(f"{table.where}: tool stands here and in {csv.source}; keep the key or the columns")
        csv.require(TOOL_COLUMNS, "a tool vector has three coordinates", tuple(csv.columns))
        return np.stack([csv.numbers(name, "mm", purpose) for name in TOOL_COLUMNS], axis=1)
    if "tool" not in table.data and kind.target_body(table.data) != TOOL:
        return np.zeros((len(csv), 3))  # no tool takes part
    if "tool" not in table.data:
        raise InputError(
            f"{table.where}: there is no tool vector; add tool = [x, y, z] in mm here or columns "
            f"{', '.join(TOOL_COLUMNS)} in {csv.source}"
        )
    return np.tile(np.array(table.vector("tool", 3)), (len(csv), 1))


def _labels(csv: CsvTable, kind: Kind, purpose: str) -> dict[str, np.ndarray]:
    return {
        name: csv.labels(name, purpose) if name in csv else np.full(len(csv), default)
        for name, default in kind.labels.items()
    }


def _recorded(csv: CsvTable, name: str) -> np.ndarray | None:
    if name not in csv:
        return None
    purpose = "leave the cell empty where it was not recorded"
    return csv.times(name, purpose) if name == "time" else csv.numbers(name, _RECORDED[name], purpose, gaps=True)


def _uncertainty(table: Table, csv: CsvTable, kind: Kind, readings: np.ndarray) -> tuple[np.ndarray, dict[str, Any]]:
    """Standard uncertainties, shape (m, k), and the keys to be evaluated later because there is no reading yet."""
    columns, pending = [], {}
    for i in range(len(kind.readings)):
        keys = uncertainty_key_of(kind.readings, i)
        column = next((key for key in keys if key in csv), None)
        key = next((key for key in keys if key in table.data), None)
        if column is not None:
            columns.append(_positive(csv.numbers(column, kind.unit_of(i), "every row needs one"), csv, column))
            continue
        if key is None:
            name = keys[0] if kind.units else "u"
            raise InputError(
                f"{table.where}: there is no standard uncertainty; add {name} = … ({kind.unit_of(i)}) or "
                f"{name} = {{ constant = …, proportional = … }} here, or a column {keys[0]} in {csv.source}"
            )
        spec = _specification(table, key)
        if key == "u" and kind.is_length:
            check_constant(spec["constant"] if isinstance(spec, dict) else spec, table.where)
        values = standard_uncertainty(spec, readings[:, i])
        if np.isnan(values).any():
            pending[key] = spec
        columns.append(_positive(values, csv, f"{key} from the set's proportional part"))
    return np.stack(columns, axis=1), pending


def _specification(table: Table, key: str) -> float | dict[str, float]:
    """A number > 0, or constant and proportional parts >= 0 that are not both 0."""
    if not isinstance(table.data[key], Mapping):
        if not is_number(table.data[key]):
            raise table.wrong(key, "a number > 0 or { constant = …, proportional = … }")
        return table.number(key, above=0.0)
    parts = Table(table.data[key], f"{table.where}, {key}")
    parts.only(("constant", "proportional"))
    spec = {name: parts.number(name, 0.0, least=0.0) for name in ("constant", "proportional")}
    if not any(spec.values()):
        raise table.wrong(key, "a constant or proportional part > 0")
    return spec


def _positive(values: np.ndarray, csv: CsvTable, name: str) -> np.ndarray:
    if (values <= 0.0).any():
        row = int(np.argmax(values <= 0.0))
        raise InputError(f"{csv.where(row)}: {name} is {values[row]:g}; expected a standard uncertainty > 0")
    return values


def _options(table: Table, kind: Kind) -> dict[str, Any]:
    """Options of the kind with their defaults; a given one must be of the default's type."""
    stated = {name: default for name, default in kind.further.items() if name in table.data}
    return {name: check_option(table, name, default) for name, default in {**kind.options, **stated}.items()}


def check_option(table: Table, name: str, default: Any) -> Any:
    """Option `name` of a set, of the type of its default; a `default` of None means that it is required, of any type."""
    if default is None:
        return table.get(name)
    if isinstance(default, bool):
        return table.flag(name, default)
    if is_number(default):
        unknown = name.endswith("_u") and table.data.get(name) == math.inf
        return math.inf if unknown else table.number(name, float(default), least=0.0)
    if isinstance(default, str):
        return table.text(name, default)
    return table.get(name, default)


def _effects(table: Table, folder: Path, machine: Machine) -> tuple[Effect, ...]:
    effects = tuple(read_effect(entry, folder, machine) for entry in table.tables("effect"))
    check_unique((effect.name for effect in effects), "effect", table.where)
    return effects
