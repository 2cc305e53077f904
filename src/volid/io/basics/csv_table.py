"""A CSV file as named columns of text, converted to numbers on request; messages name file, line and column.

The plain form has a header row, commas between the cells, decimal points and UTF-8 text. Lines that begin with `#` are comments,
and empty lines are skipped. Other forms are read as they are stated (`volid.io.basics.csv_form`) or else recognised, and `notes`
say how. Numbers are converted column by column; only when that fails, the wrong line is looked for.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from volid.exceptions import InputError
from volid.io.basics import csv_cells
from volid.io.basics.cells import original
from volid.io.basics.csv_form import PLAIN, CsvForm
from volid.io.basics.csv_names import NO_NAME, check_names, missing_column, unknown_column
from volid.io.basics.csv_rows import Rows, read_rows, shown
from volid.io.basics.encodings import UTF8, decode, read_bytes
from volid.io.basics.units import conversion, split_unit

LARGEST = 1e9  # mm, degrees, rad, °C: a thousand kilometres, more than anything that is measured
LARGEST_TIME = 1e12  # s: thirty thousand years
_T = TypeVar("_T")


@dataclass(frozen=True)
class CsvTable:
    """`columns`: name -> cells as text, each (m,). `rows`: (m,) line numbers in the file, the first line being 1.

    `form`: the form of the file, decimal sign and all; `units`: name -> unit that the file or its manifest gives; `said`: what
    was recognised or stated, in words, which grows as columns are converted; `underscores`: whether cells hold some; `remarks`:
    what else there is to say of the file.
    """

    source: str
    columns: dict[str, tuple[str, ...]]
    rows: np.ndarray
    form: CsvForm = PLAIN
    units: Mapping[str, str] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    underscores: bool = False
    remarks: tuple[str, ...] = ()

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def notes(self) -> tuple[str, ...]:
        """How the file was read, where it has not the plain form, and what else there is to say; else nothing."""
        said = list(dict.fromkeys(self.said))
        how = (f"{self.source}: read with {'; '.join(said)}",) if said else ()
        return (*how, *(f"{self.source}: {remark}" for remark in self.remarks))

    def renamed(self, columns: Mapping[str, str], ignored: Iterable[str], where: str) -> CsvTable:
        """The table with other names: `columns`, name -> what stands in the header; `ignored` ones are left out.

        A column whose header ends in a unit goes by the name before it too. Raises `InputError` for a name that the header lacks,
        one given to two columns, or a column given two names; `where` names the keys' place.
        """
        ignored = tuple(ignored)
        check_names(self.source, tuple(self.columns), columns, ignored, where)
        known = {found: name for name, found in columns.items()}
        result: dict[str, tuple[str, ...]] = {}
        units: dict[str, str] = {}
        for found, cells in self.columns.items():
            if found in ignored or not (self.form.header or found in known):
                continue
            name = known.get(found) or self._without_unit(found, (*columns, *result))
            if name in result or (name != found and name in self.columns and name not in (*known, *ignored)):
                raise InputError(f"{where}: columns would give {self.source} two columns '{name}'; ignore one of them")
            result[name] = cells
            if unit := self._unit_of(found, name):
                units[name] = unit
        return replace(self, columns=result, units=self._with_stated(units, result, known))

    def _without_unit(self, found: str, taken: Iterable[str]) -> str:
        """The name before the unit in a header, unless a column has it already."""
        name, _ = split_unit(found)
        return found if name in self.columns or name in taken else name

    def _unit_of(self, found: str, name: str) -> str | None:
        return self.units.get(found) or self.units.get(name) or split_unit(found)[1]

    def _with_stated(
        self, units: dict[str, str], result: Mapping[str, object], known: Mapping[str, str]
    ) -> dict[str, str]:
        """Units of the columns, those that `[csv]` states before those of the file."""
        for key, unit in self.form.units.items():
            if key in self.columns or key in result:
                self.form.used.add(key)
            if (name := known.get(key, key)) in result:
                units[name] = unit
        return units

    def only(self, known: Iterable[str]) -> None:
        """Raises `InputError` for a column that is not in `known`, naming the nearest one."""
        known = tuple(known)
        for name in self.columns:
            if name in known:
                continue
            raise unknown_column(self.source, name, known, tuple(self.columns))

    def require(self, names: Iterable[str], purpose: str, known: Sequence[str] = ()) -> None:
        """Raises `InputError` when one of the columns `names` is missing; `known` ones cannot be its misspelling."""
        for name in names:
            if name not in self.columns:
                raise missing_column(self.source, name, purpose, [c for c in self.columns if c not in known])

    def numbers(self, name: str, unit: str, purpose: str, gaps: bool = False) -> np.ndarray:
        """Column `name` as finite numbers in `unit`, shape (m,); with `gaps`, an empty cell or "nan" means not recorded (NaN).

        Raises `InputError` naming the first line that holds no finite number, or one beyond anything measured, `purpose` saying
        why it is needed.
        """
        cells: Sequence[str] = self.columns[name]
        if gaps:
            cells = [cell if cell.strip() else "nan" for cell in cells]
        try:
            values = csv_cells.numbers(cells, self.form.decimal or ".")
            if self.underscores and any("_" in cell for cell in cells):
                raise ValueError
        except ValueError:
            values = self._one_by_one(name, cells, unit, purpose)
        if (np.isinf(values) if gaps else ~np.isfinite(values)).any():
            i = int(np.argmax(np.isinf(values) if gaps else ~np.isfinite(values)))
            raise self._not_a_number(name, i, cells[i], unit, purpose)
        return self._within_reason(name, self._in_unit(name, values, unit), unit)

    def times(self, name: str, purpose: str) -> np.ndarray:
        """Column `name` as times [s], (m,); NaN for an empty cell. Dates count from 1970-01-01 UTC, times of day from midnight.

        Raises `InputError` naming the first line that holds no time.
        """
        cells = self.columns[name]
        form = self.form.time or csv_cells.time_form(cells)
        if form == csv_cells.SECONDS:
            return self.numbers(name, "s", purpose, gaps=True)
        self.said.append(f"{name} as {'date and time' if form == csv_cells.ISO else form}")
        values = np.array(
            self._each(cells, lambda cell: csv_cells.seconds(cell, form), name, form, purpose), dtype=float
        )
        return csv_cells.over_midnight(values) if form == csv_cells.CLOCK else values

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

    def _one_by_one(self, name: str, cells: Sequence[str], unit: str, purpose: str) -> np.ndarray:
        decimal, thousands = self.form.decimal or ".", self.form.thousands
        found = self._each(cells, lambda cell: csv_cells.number(cell, decimal, thousands), name, unit, purpose)
        if any(grouped for _, grouped in found):
            self.said.append(f"separated thousands in {name}")
        return np.array([value for value, _ in found], dtype=float)

    def _each(self, cells: Sequence[str], convert: Callable[[str], _T], name: str, unit: str, purpose: str) -> list[_T]:
        result = []
        for i, cell in enumerate(cells):
            try:
                result.append(convert(cell))
            except ValueError:
                raise self._not_a_number(name, i, cell, unit, purpose) from None
        return result

    def _in_unit(self, name: str, values: np.ndarray, wanted: str) -> np.ndarray:
        unit = self.units.get(name)
        if unit is None or not _is_unit(wanted):
            return values
        found = conversion(unit, wanted)
        if found is None:
            raise InputError(
                f"{self.source}, header: {name} is in {unit}; expected {wanted}, or a unit that leads there; mend `units`"
            )
        if found != (1.0, 0.0):
            self.said.append(f"{name} in {unit}")
            return values * found[0] + found[1]
        return values

    def _within_reason(self, name: str, values: np.ndarray, unit: str) -> np.ndarray:
        limit = LARGEST_TIME if unit == "s" else LARGEST
        far = np.abs(values) > limit
        if far.any():
            i = int(np.argmax(far))
            found, what = shown(self.columns[name][i].strip()), f" {unit}" if _is_unit(unit) else ""
            raise InputError(
                f"{self.where(i)}: {name} is {found}; expected at most {limit:g}{what}, more than anything that is measured"
            )
        return values

    def _not_a_number(self, name: str, i: int, cell: str, unit: str, purpose: str) -> InputError:
        cell = cell.strip()
        found = f"'{shown(cell)}'" if cell else "empty"
        example = csv_cells.EXAMPLES.get(unit)
        expected = f"a time such as {example}" if example else f"a finite number{self._hint(cell)} in {unit}"
        return InputError(f"{self.where(i)}: {name} is {found}; expected {expected}; {purpose}")

    def _hint(self, cell: str) -> str:
        if self.form.decimal == csv_cells.UNCLEAR and "," in cell:
            return ' whose comma is clear: state decimal = "," or "." in [csv],'
        if self.form.decimal == "," and "." in cell:
            return ' with a decimal comma like the others (state thousands = "." in [csv] if it parts thousands)'
        return " with a decimal point" if "," in cell else ""


def _is_unit(wanted: str) -> bool:
    return any(part in ("mm", "degrees", "rad", "s", "°C") for part in wanted.split(" or "))


def read_csv(path: str | Path, form: CsvForm = PLAIN) -> CsvTable:
    """Read a CSV file; `form`: what is known of how it is written.

    Raises `InputError` when it is missing, empty or no text, rows differ in length, a column name stands twice, or its form is
    not clear.
    """
    path = Path(path)
    text, encoding = decode(read_bytes(path), path, form.encoding)
    with _uncollected():
        found = read_rows(text, path, form)
        columns = dict(zip(found.header, zip(*found.rows, strict=True), strict=True))
    columns = {
        name: cells for name, cells in columns.items() if not name.startswith(NO_NAME) or any(map(str.strip, cells))
    }
    decimal = _decimal(columns, found, text, form)
    said = [f"encoding {encoding}"] if encoding != UTF8 and form.encoding is None else []
    said += [*found.said, *({",": ["decimal commas"]}.get(decimal, []) if form.decimal is None else [])]
    said += form.stated
    known = replace(form, delimiter=found.delimiter, decimal=decimal)
    return CsvTable(str(path), columns, np.array(found.numbers), known, found.units, said, found.underscores)


@contextmanager
def _uncollected() -> Iterator[None]:
    """Without the garbage collector, which would look through millions of new rows again and again; none is in a circle."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _decimal(columns: dict[str, tuple[str, ...]], found: Rows, text: str, form: CsvForm) -> str:
    if form.decimal is not None:
        return form.decimal
    if form.thousands in (".", ","):
        return "," if form.thousands == "." else "."
    if (found.delimiter == "," and '"' not in text) or "," not in text:
        return "."
    return csv_cells.decimal_sign(columns, found.delimiter)
