"""Axis positions that a foreign file does not hold: a CSV of them, named by the key `positions`, matched by name or by order.

The CSV has the columns of a set: axis letters, optional X_dir …, tool_x, tool_y, tool_z, station or sphere, and, to match by
name, the names that the foreign file gives its points or tool paths. The CSV of a plan is such a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.csv_form import CsvForm
from volid.io.basics.csv_names import missing_column
from volid.io.basics.csv_rows import names_shown
from volid.io.basics.csv_table import CsvTable, read_csv
from volid.io.instruments.base import Request
from volid.observations import KINDS

KEY = "positions"
_TOOL = ("tool_x", "tool_y", "tool_z")
_TEXTS = tuple(sorted({label for kind in KINDS.values() for label in kind.labels}))
_FEW = 0.5  # share of names that must be found; fewer is another file


class Positions(NamedTuple):
    """`csv`: the rows. `units`: unit by numeric column that a set takes. `where`: the place of the key."""

    csv: CsvTable
    units: dict[str, str]
    where: str

    def columns(self, rows: np.ndarray) -> dict[str, list[Any]]:
        """The columns that a set takes, for some of the rows. Raises `InputError` naming a cell that is no number."""
        purpose = "every row of positions needs one"
        found: dict[str, list[Any]] = {
            name: self.csv.numbers(name, unit, purpose)[rows].tolist() for name, unit in self.units.items()
        }
        return found | {t: self.csv.labels(t, purpose)[rows].tolist() for t in _TEXTS if t in self.csv}


def read_positions(request: Request, letters: Sequence[str]) -> Positions | None:
    """The CSV that the set names, with columns of at least the axes `letters`; None where it names none."""
    table = request.table
    if KEY not in table.data:
        return None
    csv = read_csv(Path(request.folder) / table.text(KEY), CsvForm())
    csv = csv.renamed({}, (), table.where)
    for letter in letters:
        if letter not in csv:
            raise missing_column(csv.source, letter, "positions say where every axis stood", list(csv.columns))
    units = {a.letter: a.unit for a in request.machine.axes if a.letter in csv}
    units |= {f"{a.letter}_dir": "steps of one" for a in request.machine.axes if f"{a.letter}_dir" in csv}
    return Positions(csv, units | {name: "mm" for name in _TOOL if name in csv}, table.where)


def by_order(positions: Positions, n: int, what: str) -> np.ndarray:
    """Rows of the positions, one for each of `n` readings. Raises `InputError` where there are more or fewer."""
    if len(positions.csv) != n:
        raise InputError(
            f"{positions.csv.source}: {len(positions.csv)} positions for {n} {what}; expected as many, in the "
            "same order, or a column "
            "of names in both"
        )
    return np.arange(n)


def by_name(positions: Positions, column: str, names: Sequence[str]) -> tuple[np.ndarray, tuple[str, ...]]:
    """Row of the positions for each name, -1 where there is none, and what did not match, in words.

    Raises `InputError` for a name that stands twice among the positions, or where hardly any name is among them.
    """
    given = positions.csv.labels(column, "every row of positions needs a name").tolist()
    name, count = Counter(given).most_common(1)[0]
    if count > 1:
        raise InputError(f"{positions.csv.source}: {column} '{name}' stands twice; name every position once")
    place = {name: i for i, name in enumerate(given)}
    rows = np.array([place.get(name, -1) for name in names], dtype=int)
    if (rows >= 0).sum() < max(_FEW * min(len(names), len(given)), 1):
        raise InputError(
            f"{positions.csv.source}: {int((rows >= 0).sum())} of {len(names)} names of the file are in column "
            f"{column}; the file has "
            f"{names_shown(names)}, the column {names_shown(given)}"
        )
    return rows, _unmatched(names, rows, given, column)


def _unmatched(names: Sequence[str], rows: np.ndarray, given: Sequence[str], column: str) -> tuple[str, ...]:
    unknown = [name for name, row in zip(names, rows, strict=True) if row < 0]
    read = set(names)
    lost = [name for name in given if name not in read]
    notes = []
    if unknown:
        notes.append(f"{len(unknown)} without a position left out: {names_shown(unknown)}")
    if lost:
        notes.append(f"{len(lost)} positions have no reading, by {column}: {names_shown(lost)}")
    return tuple(notes)
