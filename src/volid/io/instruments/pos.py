"""`.pos`: positioning errors of a linear axis as another maker of laser interferometers writes them, in mm.

Known from one public reader only: the sections of a `.rtl` file, but below them tables `Position … Avg Error` with the averages
of the runs forward, back, and of both together. Whether error is actual - nominal or the opposite is not known (that reader turns
its sign, and not that of `.rtl` files), so the user states it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.toml_table import Table
from volid.io.instruments.base import FROM_DESCRIPTIONS, ForeignFile, Format, Found, ReadingsFormat, Request
from volid.io.instruments.laser_line import KEYS, check_linear, found_on, line_of, unit_of
from volid.io.instruments.numerals import decimal_of, number
from volid.io.instruments.runs import KEYS as RUN_KEYS
from volid.io.instruments.runs import Runs, read_runs
from volid.io.instruments.sections import is_run_file, sections_of
from volid.model.iso230 import TRANSLATIONS

_TABLE = re.compile(r"^[ \t]{0,40}Position[ \t]{1,40}(\w[\w -]{0,60}) Avg\.? Error[ \t]{0,40}$", re.IGNORECASE)
_ANYWHERE = re.compile(_TABLE.pattern, re.IGNORECASE | re.MULTILINE)
_BEGINS_AS_ROW = re.compile(r"\s*[-+−]?[.,]?\d")
_WAYS = (("bidirectional", 0, "both"), ("forward", 1, "forward"), ("backward", -1, "back"), ("reverse", -1, "back"))
_ARRAYS = ("position", "way", "run", "value", "line")
_AVERAGED = "it holds averages of the runs, not the runs: their scatter is not among the readings, so u has to hold it"


class _Row(NamedTuple):
    """A row of a table of averages: `way` ±1 along the positions, 0 for both; `line` in the file."""

    way: int
    run: str
    position: float
    value: float
    line: int


class Pos(ReadingsFormat):
    """Averages of linear readings, or runs, in mm."""

    name = "pos"
    words = "positioning errors in mm of a laser interferometer"
    about = (
        "averages forward and back along a linear axis, or runs, in mm; sign = 1 where error is actual - nominal, -1 where it is "
        f"nominal - actual, has to be stated, as it is not known. {FROM_DESCRIPTIONS}"
    )
    keys = (*KEYS, *RUN_KEYS, "sign")

    def recognises(self, text: str) -> bool:
        """Tables of averages, or runs in a file that calls itself by this name or by none."""
        if _ANYWHERE.search(text):
            return True
        return is_run_file(text) and sections_of(text).file_type in ("", self.name)

    def read(self, file: ForeignFile, request: Request) -> Found:
        """The averages, or every reading of every run. Raises `InputError`."""
        sections = sections_of(file.text)
        line = line_of(request, sections, TRANSLATIONS)
        check_linear(line, request)
        sign = request.table.number("sign")
        if sign not in (1.0, -1.0):
            raise request.table.wrong("sign", "1 where error is actual - nominal, -1 where it is nominal - actual")
        averaged = _ANYWHERE.search(file.text) is not None
        runs = _averages(file, request.table) if averaged else read_runs(file, sections, request.table)
        runs = runs._replace(value=sign * runs.value)
        return found_on(line, runs, sections, unit_of(request, "mm", "mm"))


def _averages(file: ForeignFile, table: Table) -> Runs:
    """Forward and back where the file has both, or else the averages that it has. Raises `InputError` naming the line."""
    tables: dict[int, list[_Row]] = {}
    for row in _rows(file):
        tables.setdefault(row.way, []).append(row)
    _check_tables(file, tables, table)
    ahead = next(tables[way] for way in (1, 0, -1) if way in tables)
    kept = [*tables[1], *tables[-1]] if {1, -1} <= set(tables) else ahead
    position, way, run, value, line = (np.array([getattr(row, name) for row in kept]) for name in _ARRAYS)
    return Runs(position, run, way * np.sign(ahead[-1].position - ahead[0].position), value, line, (_AVERAGED,))


def _check_tables(file: ForeignFile, tables: Mapping[int, list[_Row]], table: Table) -> None:
    """Raises `InputError` where there are no two rows, or tables have other positions than each other."""
    counts = {rows[0].run: len(rows) for rows in tables.values()}
    if max(counts.values(), default=0) < 2:
        raise InputError(f"{file.path}: no two rows below 'Position … Avg Error'; expected position and error in each")
    positions = [sorted(row.position for row in rows) for rows in tables.values()]
    if not table.flag("incomplete", False) and any(p != positions[0] for p in positions):
        said = ", ".join(f"{n} {run}" for run, n in counts.items())
        raise InputError(
            f"{file.path}: the tables differ in their positions ({said}); the file may be damaged; state incomplete = true to "
            "take the averages that are there"
        )


def _rows(file: ForeignFile) -> list[_Row]:
    """The rows of all tables; a table ends at a line that is no row."""
    lines = file.text.split("\n")
    decimal = decimal_of(token for line in lines if _is_row(line) for token in line.split())
    if decimal is None:
        raise InputError(
            f"{file.path}: numbers hold points and commas; expected one decimal sign and no separated thousands"
        )
    found: list[_Row] = []
    table: tuple[int, str] | None = None
    for n, line in enumerate(lines, start=1):
        if heading := _TABLE.match(line):
            table = _way(file, n, heading[1])
        elif table and (_is_row(line) or _BEGINS_AS_ROW.match(line)):
            found.append(_Row(*table, *_cells(file, n, line, decimal), n))
        elif line.strip():
            table = None
    return found


def _is_row(line: str) -> bool:
    return len(line.split()) == 2 and any(c.isdigit() for c in line)


def _cells(file: ForeignFile, n: int, line: str, decimal: str) -> tuple[float, float]:
    """Position and error of a line."""
    cells = [value for token in line.split() if (value := number(token, decimal)) is not None]
    if len(cells) != 2 or len(line.split()) != 2:
        raise file.wrong(n, f"'{line.strip()}'", "position and error, two numbers")
    return cells[0], cells[1]


def _way(file: ForeignFile, n: int, title: str) -> tuple[int, str]:
    for word, way, run in _WAYS:
        if word in title.casefold():
            return way, run
    raise file.wrong(n, f"a table of '{title}'", "Bidirectional, Forward, Backward or Reverse")


POS: Format = Pos()
