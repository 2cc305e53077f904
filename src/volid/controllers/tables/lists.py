"""Neutral lists of numbers for controls whose files have no public layout: a table that a person types in, or a program sends.

Lines that begin with # say what the numbers are, the next line names the columns, and each further line is one row. Read back,
the columns may stand in any order, further ones are left alone, and , ; or a tab may separate them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from volid.exceptions import InputError

_SEPARATORS = (",", ";", "\t")
_LARGEST = 1e9  # of a number of these lists


class Row(NamedTuple):
    """A row of a list: where it stands, for messages, and its cells by column."""

    place: str
    cells: Mapping[str, str]

    def number(self, column: str) -> float:
        """The number in a column. Raises `InputError` for another cell."""
        try:
            value = float(self.cells[column])
        except ValueError:
            value = math.nan
        if not abs(value) < _LARGEST:
            raise InputError(f"{self.place}: {column} is '{self.cells[column]}'; expected a number")
        return value

    def whole(self, column: str) -> int:
        """The whole number in a column. Raises `InputError` for another cell."""
        value = self.number(column)
        if value != round(value):
            raise InputError(f"{self.place}: {column} is '{self.cells[column]}'; expected a whole number")
        return round(value)


def number(value: float) -> str:
    """A number in plain digits, from which the same double-precision number is read."""
    return np.format_float_positional(float(value) + 0.0, trim="0")


def list_text(lines: Iterable[str], columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A list as text; numbers with as many digits as they need."""
    head = [*(f"# {line}" for line in lines), ",".join(columns)]
    return "\n".join([*head, *(",".join(map(_cell, row)) for row in rows), ""])


def _cell(value: object) -> str:
    return f"{round(value, 9) + 0.0:.12g}" if isinstance(value, float) else str(value)


def read_list(name: str, text: str, columns: Sequence[str]) -> list[Row]:
    """Rows of a list that has at least these columns. Raises `InputError` naming file and line for anything else."""
    lines = [(i, line.strip()) for i, line in enumerate(text.splitlines(), 1)]
    kept = [(i, line) for i, line in lines if line.strip(",;\t ") and not line.startswith(("#", '"#'))]
    if not kept:
        raise InputError(f"{name}: has no rows; expected a list with the columns {', '.join(columns)}")
    at, head = kept[0]
    separator = max(_SEPARATORS, key=head.count)
    names = _cells(head, separator)
    missing = [c for c in columns if c not in names]
    if missing or len(set(names)) < len(names):
        raise InputError(
            f"{name}, line {at}: the columns are {', '.join(names)}; expected {', '.join(columns)}, each once"
        )
    return [_row(f"{name}, line {i}", names, _cells(line, separator)) for i, line in kept[1:]]


def _cells(line: str, separator: str) -> list[str]:
    return [cell.strip().strip('"') for cell in line.split(separator)]


def _row(place: str, names: Sequence[str], cells: Sequence[str]) -> Row:
    if len(cells) != len(names):
        raise InputError(f"{place}: has {len(cells)} cells; expected {len(names)}, one per column")
    return Row(place, dict(zip(names, cells, strict=True)))


def the_list(files: Mapping[str, str | bytes], ending: str | tuple[str, ...], control: str) -> str:
    """Name of the one file of this ending, or one of these. Raises `InputError` where there is none or several."""
    found = [name for name in files if name.lower().endswith(ending)]
    if len(found) != 1:
        have, ends = ", ".join(files) or "no file", ending if isinstance(ending, str) else " or ".join(ending)
        raise InputError(f"{control}: expected one file whose name ends in {ends}; got {have}")
    return found[0]


def same_sign(name: str, text: str, sign: str) -> None:
    """Raises `InputError` where a list states another sense of its values than `sign`."""
    stated = next((line[10:].strip() for line in text.splitlines() if line.startswith("# values: ")), sign)
    if stated != sign:
        raise InputError(f"{name}: its values are '{stated}' values, and `sign={sign}`; state what the file states")
