"""Tables of HEIDENHAIN controls as files: BEGIN, a line of column names that fixes the columns' places, rows, [END].

    BEGIN XAXIS.COM MM
    NR      AXISPOS     BACKLASH    X           Z
    0       0.0000      0.0020      0.0000      0.0000
    [END]

Cells begin below the name of their column; a cell may be empty. Some controls write a description of the structure between the
first line and the names (#STRUCTBEGIN … #STRUCTEND, TableDescription ( … )); it is passed over.

Source: pyLSV2 (github.com/drunsinn/pyLSV2), its reader and writer of tables, and HEIDENHAIN's own RemoTools examples ("BEGIN
TOOLEXT.T MM"), for tables of tools and datums; that .COM and .CMA files have this frame is inferred, their last line [END] is
documented.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from volid.exceptions import InputError

FRAME = "pyLSV2 (github.com/drunsinn/pyLSV2) and HEIDENHAIN RemoTools examples, for tables of tools and datums"
TEXT = ("DOC", "NAME")  # columns whose cells may have blanks
_BEGIN = re.compile(r"BEGIN\s+([\w ]*)\.(\w{1,4})(?:\s+(MM|INCH))?(?:\s+VERSION\b.*)?(?:\s+U)?", re.IGNORECASE)
_PREAMBLES = {"#STRUCTBEGIN": "#", "TABLEDESCRIPTION": ")"}
LARGEST_NUMBER = 1e6


@dataclass(frozen=True)
class Row:
    """One row: cells by column, an empty cell is "". `where`: file and line."""

    cells: Mapping[str, str]
    where: str

    def number(self, column: str) -> float:
        """A cell as a number. Raises `InputError` for an empty cell, and for anything else."""
        text = self.cells[column]
        try:
            found = float(text)
        except ValueError:
            found = float("nan")
        if not abs(found) < LARGEST_NUMBER:
            raise InputError(f"{self.where}: {column} is '{text}'; expected a number in mm or °")
        return found


@dataclass(frozen=True)
class NcTable:
    """A table. `ending`: of its name, such as COM; `unit`: MM, INCH or nothing."""

    name: str
    ending: str
    unit: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]

    def filled(self, column: str) -> bool:
        """Whether any row has something in a column."""
        return column in self.columns and any(row.cells[column] for row in self.rows)

    @property
    def length(self) -> float:
        """Millimetres of one unit of length."""
        return 25.4 if self.unit == "INCH" else 1.0


def head_of(content: str | bytes) -> str:
    """The beginning of a file, in capitals: first line and names of columns."""
    return (content[:2000] if isinstance(content, str) else content[:2000].decode("latin-1")).upper()


def begins(content: str | bytes, *endings: str) -> bool:
    """Whether a table of one of these endings begins."""
    found = _BEGIN.fullmatch(head_of(content).partition("\n")[0].strip())
    return found is not None and found[2] in endings


def has_columns_c(content: str | bytes) -> bool:
    """Whether one of the columns C1 … C6 is named."""
    return re.search(r"\sC[1-6]\s", head_of(content)) is not None


def parse(name: str, text: str) -> NcTable:
    """The table of a file. Raises `InputError` that names file and line."""
    lines = text.splitlines()
    begin = _BEGIN.fullmatch(lines[0].strip()) if lines else None
    if begin is None:
        first = lines[0] if lines else ""
        raise InputError(f"{name}, line 1: '{first}' begins no table; expected a line such as BEGIN XAXIS.COM MM")
    at = _after_preamble(lines)
    if at >= len(lines) or not lines[at].strip() or lines[at].startswith("[END]"):
        raise InputError(f"{name}, line {at + 1}: no names of columns; expected a line such as NR AXISPOS BACKLASH X")
    starts = {m.group().upper(): m.start() for m in re.finditer(r"\S+", lines[at])}
    rows: list[Row] = []
    for number, line in enumerate(lines[at + 1 :], at + 2):
        if line.strip().upper() == "[END]":
            return NcTable(begin[1].strip(), begin[2].upper(), (begin[3] or "").upper(), tuple(starts), tuple(rows))
        if line.strip():
            rows.append(_row(line, starts, f"{name}, line {number}"))
    raise InputError(f"{name}: the last line, [END], is missing; the file is cut off")


def _after_preamble(lines: Sequence[str]) -> int:
    """Number of the line of names, from 0."""
    for begin, end in _PREAMBLES.items():
        if len(lines) > 1 and lines[1].strip().upper().startswith(begin):
            return next((i + 1 for i in range(2, len(lines)) if lines[i].startswith(end)), len(lines))
    return 1


def _row(line: str, starts: Mapping[str, int], where: str) -> Row:
    """Cells by their places; where they do not stand there, one after the other, if every column has one."""
    words, names = line.split(), tuple(starts)
    places = [*starts.values(), max(len(line), max(starts.values())) + 1]
    cells = [line[a:b].strip() for a, b in pairwise(places)]
    torn = any(len(line[p - 1 : p + 1].strip()) == 2 for p in places[1:-1])
    crowded = any(" " in c for name, c in zip(names, cells, strict=True) if name not in TEXT)
    if not (torn or crowded or line[: places[0]].strip()):
        return Row(dict(zip(names, cells, strict=True)), where)
    if len(words) == len(names):
        return Row(dict(zip(names, words, strict=True)), where)
    raise InputError(f"{where}: {len(words)} cells do not stand below their {len(names)} columns, {' '.join(names)}")


def written(name: str, unit: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table as a file: cells left-aligned below the names, two blanks between columns at least."""
    widths = [max(8, 2 + max(map(len, (c, *(r[i] for r in rows))))) for i, c in enumerate(columns)]
    lines = ["".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip() for line in (columns, *rows)]
    begin = f"BEGIN {name.upper()} {unit}".strip()
    return "\n".join([begin, *lines, "[END]", ""])


def fixed(value: float, digits: int) -> str:
    """A number with fixed decimals; no minus before zero."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"
