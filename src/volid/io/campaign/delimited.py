"""Delimited text of any program, `as = "text"`: read like a CSV by a declared map of its columns, which is remembered.

The map is the keys of a set: `kind`, `columns`, `ignore`, `[csv]` (delimiter, decimal, encoding, skip, units, time), `tool`,
`u` and the options of the kind. It comes from a file of these keys, or from an earlier campaign: from a `[[set]]` that states
`columns`, or from what a campaign remembers of its imported files. Axis positions that the text does not hold come from
another CSV, named by `positions`, by order or by a column of names, `match`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.csv_names import missing_column
from volid.io.basics.csv_table import CsvTable
from volid.io.basics.toml_table import Table
from volid.io.campaign.foreign import AS, ENCODING
from volid.io.instruments.base import Request
from volid.io.instruments.positions import KEY, by_name, by_order, read_positions
from volid.model.machine import Machine

TEXT = "text"  # value of `as`
MATCH = "match"
WORDS = "delimited text by a declared map of its columns"
ABOUT = (
    'any table, such as exports of trackers and touch probes: kind, columns = { x = "X_mm", … }, ignore = '
    '["…"], csv = { delimiter = '
    '";", decimal = ",", units = { x = "m" } '
    "}, touches = true for touches of spheres; positions = a CSV of axis positions, by order or "
    "by match = a column of names. A map is a file of these keys, or an earlier campaign, which remembers its own."
)
KEYS = ("kind", "columns", "ignore", "csv", KEY, MATCH)
OF_THE_FILE = ("name", "file")


def is_text(table: Table) -> bool:
    """Whether the set says that its file is delimited text."""
    return table.data.get(AS) == TEXT


def as_csv(table: Table) -> tuple[Table, dict[str, Any]]:
    """The set as one of a CSV, and what is remembered of it. Raises `InputError` for an encoding that is stated twice."""
    data = {key: value for key, value in table.data.items() if key not in (AS, ENCODING)}
    if ENCODING in table.data:
        csv = table.table("csv", {})
        if ENCODING in csv.data:
            raise InputError(f"{table.where}: encoding stands in the set and in its csv; keep one of them")
        data["csv"] = {**csv.data, ENCODING: table.text(ENCODING)}
    kept = {key: value for key, value in data.items() if key not in (*OF_THE_FILE, "effect")}
    return Table(data, table.where), {"file": Path(table.text("file")).name, AS: TEXT, **kept}


def joined(table: Table, csv: CsvTable, folder: Path, machine: Machine) -> tuple[Table, CsvTable]:
    """The rows with axis positions from the CSV that `positions` names, if it names one; and the set without these keys.

    Raises `InputError` where rows and positions do not match.
    """
    positions = read_positions(Request(machine, table, folder), machine.letters)
    if positions is None:
        if MATCH in table.data:
            raise InputError(
                f"{table.where}: match without positions; name the CSV that holds the positions, or remove match"
            )
        return table, csv
    notes: tuple[str, ...] = ("positions were matched by their order",)
    rows = np.arange(len(csv))
    if MATCH in table.data:
        column = table.text(MATCH)
        for source in (csv, positions.csv):
            if column not in source:
                raise missing_column(source.source, column, "it holds the names to match by", list(source.columns))
        rows, notes = by_name(positions, column, csv.labels(column, "every row needs a name").tolist())
    else:
        by_order(positions, len(csv), "rows")
    kept = np.flatnonzero(rows >= 0)
    return _without_keys(table), _with_columns(csv, kept, positions.columns(rows[kept]), table.data.get(MATCH), notes)


def _without_keys(table: Table) -> Table:
    return Table({key: value for key, value in table.data.items() if key not in (KEY, MATCH)}, table.where)


def _with_columns(
    csv: CsvTable, kept: np.ndarray, added: Mapping[str, list[Any]], match: Any, notes: tuple[str, ...]
) -> CsvTable:
    """Some rows of the table with further columns, whose numbers are written as the table has them."""
    both = [name for name in added if name in csv]
    if both:
        raise InputError(
            f"{csv.source}, header: column '{both[0]}' stands here and among the positions; ignore it here"
        )
    sign = csv.form.decimal or "."
    columns = {name: tuple(cells[i] for i in kept) for name, cells in csv.columns.items() if name != match}
    for name, values in added.items():
        columns[name] = tuple(repr(v).replace(".", sign) if isinstance(v, float) else str(v) for v in values)
    units = {name: unit for name, unit in csv.units.items() if name in columns and name not in added}
    return replace(csv, columns=columns, rows=csv.rows[kept], units=units, remarks=(*csv.remarks, *notes))
