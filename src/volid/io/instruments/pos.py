"""`.pos`: positioning errors of a linear axis as another maker of laser interferometers writes them, in mm.

Known from one public reader only: the sections of a `.rtl` file, but below them tables `Position … Avg Error` with the averages
of the runs forward, back, and of both together. Whether error is actual - nominal or the opposite is not known (that reader turns
its sign, and not that of `.rtl` files), so the user states it.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from volid.exceptions import InputError
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
        runs = _averages(file) if averaged else read_runs(file, sections, request.table)
        runs = runs._replace(value=sign * runs.value)
        return found_on(line, runs, sections, unit_of(request, "mm", "mm"))


def _averages(file: ForeignFile) -> Runs:
    """Forward and back where the file has both, or else the averages that it has. Raises `InputError` naming the line."""
    rows = _rows(file)
    ways = {row.way for row in rows}
    kept = (
        [row for row in rows if row.way]
        if {1, -1} <= ways
        else [row for row in rows if row.way == (1 if 1 in ways else 0)]
    )
    kept = kept or rows
    if len(kept) < 2:
        raise InputError(
            f"{file.path}: {len(kept)} row(s) below 'Position … Avg Error'; expected position and error in two or more"
        )
    position = np.array([row.position for row in kept])
    ahead = [row.position for row in kept if row.way == 1] or position
    way = np.array([row.way for row in kept]) * np.sign(ahead[-1] - ahead[0])
    run, value, line = (np.array([getattr(row, name) for row in kept]) for name in ("run", "value", "line"))
    return Runs(position, run, way, value, line, (_AVERAGED,))


def _rows(file: ForeignFile) -> list[_Row]:
    """The rows of all tables; a table ends where a line holds no two numbers."""
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
        elif table and line.strip():
            cells = [number(token, decimal) for token in line.split()]
            if len(cells) == 2 and cells[0] is not None and cells[1] is not None:
                found.append(_Row(*table, cells[0], cells[1], n))
            elif _BEGINS_AS_ROW.match(line):
                raise file.wrong(n, f"'{line.strip()}'", "position and error, two numbers")
            else:
                table = None
    return found


def _is_row(line: str) -> bool:
    return len(line.split()) == 2 and all(token[-1:].isdigit() for token in line.split())


def _way(file: ForeignFile, n: int, title: str) -> tuple[int, str]:
    for word, way, run in _WAYS:
        if word in title.casefold():
            return way, run
    raise file.wrong(n, f"a table of '{title}'", "Bidirectional, Forward, Backward or Reverse")


POS: Format = Pos()
