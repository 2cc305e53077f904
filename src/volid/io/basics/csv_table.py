"""A CSV file as named columns of text, converted to numbers on request; messages name file, line and column.

The file has a header row, commas between the cells, and UTF-8 text. Lines that begin with `#` are comments, and empty lines are
skipped. Numbers are converted column by column; only when that fails, the wrong line is looked for.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.cells import original
from volid.io.basics.toml_table import nearest, read_text


@dataclass(frozen=True)
class CsvTable:
    """`columns`: name -> cells as text, each (m,). `rows`: (m,) line numbers in the file, the first line being 1."""

    source: str
    columns: dict[str, tuple[str, ...]]
    rows: np.ndarray

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        return len(self.rows)

    def renamed(self, columns: Mapping[str, str], ignored: Iterable[str], where: str) -> CsvTable:
        """The table with other names: `columns`, name -> what stands in the header; `ignored` ones are left out.

        Raises `InputError` for a name that the header lacks, or one given to two columns; `where` names the keys' place.
        """
        ignored = tuple(ignored)
        for key, name in [*(("columns", c) for c in columns.values()), *(("ignore", c) for c in ignored)]:
            if name not in self.columns:
                hint = nearest(name, self.columns) or ";"
                raise InputError(
                    f"{where}: {key} names '{name}', which is no column of {self.source}{hint} its columns: "
                    f"{', '.join(self.columns)}"
                )
        known = {found: name for name, found in columns.items()}
        result: dict[str, tuple[str, ...]] = {}
        for found, cells in self.columns.items():
            name = known.get(found, found)
            if found in ignored:
                continue
            if name in result or (name != found and name in self.columns and name not in (*known, *ignored)):
                raise InputError(f"{where}: columns would give {self.source} two columns '{name}'; ignore one of them")
            result[name] = cells
        return replace(self, columns=result)

    def only(self, known: Iterable[str]) -> None:
        """Raises `InputError` for a column that is not in `known`, naming the nearest one."""
        known = tuple(known)
        for name in self.columns:
            if name not in known:
                hint = nearest(name, [k for k in known if k not in self.columns])
                raise InputError(
                    f"{self.source}, header: unknown column '{name}'{hint or ';'} known columns: {', '.join(known)}; "
                    "`columns` of the set renames others, `ignore` leaves them out"
                )

    def require(self, names: Iterable[str], purpose: str, known: Sequence[str] = ()) -> None:
        """Raises `InputError` when one of the columns `names` is missing; `known` ones cannot be its misspelling."""
        for name in names:
            if name not in self.columns:
                strangers = [c for c in self.columns if c not in known and nearest(c, [name])]
                hint = f"; found '{strangers[0]}', which looks like it" if strangers else ""
                raise InputError(f"{self.source}, header: column '{name}' is missing{hint}; {purpose}")

    def numbers(self, name: str, unit: str, purpose: str, gaps: bool = False) -> np.ndarray:
        """Column `name` as finite numbers, shape (m,); with `gaps`, an empty cell or "nan" means not recorded (NaN).

        Raises `InputError` naming the first line that holds no finite number, `purpose` saying why it is needed.
        """
        cells: Sequence[str] = self.columns[name]
        if gaps:
            cells = [cell if cell.strip() else "nan" for cell in cells]
        try:
            values = np.fromiter(map(float, cells), float, len(cells))
        except ValueError:
            raise self._not_a_number(name, cells, unit, purpose, gaps) from None
        if (np.isinf(values) if gaps else ~np.isfinite(values)).any():
            raise self._not_a_number(name, cells, unit, purpose, gaps)
        return values

    def labels(self, name: str, purpose: str) -> np.ndarray:
        """Column `name` as text without surrounding blanks, shape (m,). Raises `InputError` for an empty cell."""
        values = np.char.strip(np.array(self.columns[name], dtype=str))
        if np.char.startswith(values, "'").any():
            values = np.array([original(cell) for cell in values.tolist()], dtype=str)
        empty = values == ""
        if empty.any():
            raise InputError(f"{self.where(int(np.argmax(empty)))}: {name} is empty; {purpose}")
        return values

    def where(self, i: int) -> str:
        """File and line of row `i`: "volume.csv, row 412"."""
        return f"{self.source}, row {int(self.rows[i])}"

    def _not_a_number(self, name: str, cells: Sequence[str], unit: str, purpose: str, gaps: bool) -> InputError:
        i = next(i for i, cell in enumerate(cells) if not _acceptable(cell, gaps))
        cell = cells[i].strip()
        found = f"'{cell}'" if cell else "empty"
        hint = " with a decimal point" if "," in cell else ""
        return InputError(f"{self.where(i)}: {name} is {found}; expected a finite number{hint} in {unit}; {purpose}")


def _acceptable(cell: str, gaps: bool) -> bool:
    try:
        value = float(cell)
    except ValueError:
        return False
    return math.isfinite(value) or (gaps and math.isnan(value))


def read_csv(path: str | Path) -> CsvTable:
    """Read a CSV file. Raises `InputError` when it is missing or empty, rows differ in length, or a column name stands twice."""
    lines = read_text(Path(path)).split("\n")
    kept = [i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")]
    if not kept:
        raise InputError(f"{path}: the file is empty; expected a header row and rows below it")
    rows = list(csv.reader(lines[i] for i in kept))
    header = [name.strip() for name in rows[0]]
    if len(header) == 1 and ";" in header[0]:
        comma = any(re.search(r"\d,\d", lines[i]) for i in kept[1:])
        found = "';', and numbers have decimal commas" if comma else "';'"
        raise InputError(
            f"{path}, row {kept[0] + 1}: the cells are separated by {found}; expected commas between the cells and decimal points"
        )
    if len(rows) == 1:
        raise InputError(f"{path}: there is a header but no row below it")
    _check_header(header, f"{path}, row {kept[0] + 1}")
    if len(rows) != len(kept):
        raise InputError(f"{path}: a cell in quotes runs over several lines; expected one line per row")
    if set(map(len, rows)) != {len(header)}:
        i = next(i for i, row in enumerate(rows) if len(row) != len(header))
        raise InputError(f"{path}, row {kept[i] + 1}: {len(rows[i])} cells; expected {len(header)}, as in the header")
    return CsvTable(str(path), dict(zip(header, zip(*rows[1:], strict=True), strict=True)), np.array(kept[1:]) + 1)


def _check_header(header: list[str], where: str) -> None:
    for name in header:
        if not name:
            raise InputError(f"{where}: a column has no name; expected a name over every column")
        if header.count(name) > 1:
            raise InputError(f"{where}: column '{name}' stands twice; name every column once")
