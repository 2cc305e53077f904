"""Sets whose file another program wrote, `as = "rtl"`: read as the columns that a CSV would have, and then like one.

What was done is remembered in the campaign's conditions, under `imported` and the set's name: the file, its type and the keys by
which it was read, beside what the file records of environment and operator.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.csv_table import CsvTable
from volid.io.basics.encodings import UTF8
from volid.io.basics.toml_table import Table
from volid.io.instruments import Format, ReadingsFormat
from volid.io.instruments.base import ForeignFile, Found, Request
from volid.io.instruments.recognition import check_is, format_called, open_foreign, recognised
from volid.model.machine import Machine

AS, ENCODING, IMPORTED = "as", "encoding", "imported"
RECOGNISE = "auto"  # value of `as`: by content
_OF_CSV = ("csv", "columns", "ignore")


class ForeignSet(NamedTuple):
    """`csv`: the columns. `table`: the keys of the set without those of the format, with those that follow from the file.

    `record`: what becomes of it in the campaign's conditions.
    """

    csv: CsvTable
    table: Table
    record: dict[str, Any]


def is_foreign(table: Table) -> bool:
    """Whether the file of a set was written by another program."""
    return AS in table.data


def read_foreign(table: Table, folder: Path, machine: Machine) -> ForeignSet:
    """The readings of a set's foreign file. Raises `InputError` naming file and line, or key."""
    file = open_foreign(folder / table.text("file"), table.text(ENCODING, None))
    known = _format(table, file)
    if not isinstance(known, ReadingsFormat):
        raise InputError(
            f"{file.path}: this is {known.words}, which holds no readings; expected readings, of which a campaign can be made"
        )
    own = {key: value for key, value in table.data.items() if key in known.keys}
    found = known.read(file, Request(machine, table, folder))
    if table.text("kind", found.kind) != found.kind:
        raise table.wrong("kind", f"'{found.kind}', as what {known.words} are")
    rest = {k: v for k, v in table.data.items() if k not in (AS, ENCODING, *known.keys)}
    if strange := [key for key in _OF_CSV if key in rest]:
        raise InputError(
            f"{table.where}: {strange[0]} is for delimited text, and {file.path} is read as '{known.name}'; remove it"
        )
    keys = {**found.keys, "kind": found.kind, **rest}
    record = {"file": str(file.path.name), AS: known.name, **own, **found.conditions}
    return ForeignSet(_columns(file, found), Table(keys, table.where), record)


def _format(table: Table, file: ForeignFile) -> Format:
    name = table.text(AS)
    if name == RECOGNISE:
        return recognised(file)
    known = format_called(name, table.where)
    check_is(file, known)
    return known


def _columns(file: ForeignFile, found: Found) -> CsvTable:
    said = [] if file.encoding == UTF8 else [f"encoding {file.encoding}"]
    columns = {name: tuple(map(_cell, values)) for name, values in found.columns.items()}
    rows = np.array(found.rows)
    return CsvTable(str(file.path), columns, rows, units=found.units, said=said, remarks=found.notes)


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(value)
    return str(value)
