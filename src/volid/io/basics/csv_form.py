"""How a CSV file is written: what its manifest states in `[csv]`, and what was recognised where nothing is stated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from volid.exceptions import InputError
from volid.io.basics.csv_cells import CLOCK, ISO, SECONDS
from volid.io.basics.toml_table import Table, format_value
from volid.io.basics.units import NAMES, spelled

KEYS = ("delimiter", "decimal", "thousands", "encoding", "skip", "header", "units", "time")
BLANKS = " "
_DELIMITERS = {
    "tab": "\t",
    "\\t": "\t",
    "blank": BLANKS,
    "space": BLANKS,
    "blanks": BLANKS,
    "comma": ",",
    "semicolon": ";",
}
_WORDS = {"\t": "tabs", BLANKS: "blanks"}


@dataclass(frozen=True)
class CsvForm:
    """The form of a CSV file; None where it is not stated and has to be recognised.

    `delimiter`: one character, " " for any number of blanks. `decimal`, `thousands`: the signs in numbers. `encoding`: as Python
    names it. `skip`: rows above the header. `comment`: what lines to leave out begin with. `header`: whether there is one;
    columns go by their numbers without it. `units`: unit by column, `time`: "iso", "s" or "hh:mm:ss". `used`: keys of `units`
    that named a column of a file that was read.
    """

    delimiter: str | None = None
    decimal: str | None = None
    thousands: str | None = None
    encoding: str | None = None
    skip: int = 0
    comment: str = "#"
    header: bool = True
    units: Mapping[str, str] = field(default_factory=dict)
    time: str | None = None
    used: set[str] = field(default_factory=set, compare=False)

    def with_stated(self, table: Table) -> CsvForm:
        """This form with what `[csv]` of `table` states instead. Raises `InputError` naming a key that is wrong."""
        if "csv" not in table.data:
            return self
        given = table.table("csv")
        given.only(KEYS)
        stated = {name: read(given, name) for name, read in _READ.items() if name in given.data}
        skip = stated.pop("skip", None)
        if skip is not None:
            stated["comment" if isinstance(skip, str) else "skip"] = skip
        if "units" in stated:
            stated["units"] = {**self.units, **stated["units"]}
        form = replace(self, **stated)
        if form.decimal is not None and form.decimal == form.thousands:
            key = "thousands" if "thousands" in given.data else "decimal"
            raise given.wrong(key, "another sign for decimals than for thousands")
        return form

    @property
    def stated(self) -> list[str]:
        """What is stated, in words."""
        given = [f.name for f in fields(self) if f.compare and getattr(self, f.name) != getattr(PLAIN, f.name)]
        return [f"{name} = {format_value(getattr(self, name))} as stated" for name in given]

    def check_units(self, table: Table) -> None:
        """Raises `InputError` for a unit of `[csv]` in `table` that no column had."""
        stated = table.table("csv", {}).data.get("units", {})
        for name in stated:
            if name not in self.used:
                raise InputError(
                    f"{table.where}, [csv]: units names '{name}', which is no column that was read; mend the name"
                )


PLAIN = CsvForm()


def in_words(delimiter: str) -> str:
    """A delimiter in messages."""
    return _WORDS.get(delimiter, f"'{delimiter}'")


def _delimiter(table: Table, key: str) -> str:
    text = table.data[key]
    found = _DELIMITERS.get(text, text) if isinstance(text, str) else ""
    if len(found) != 1 or found.isalnum() or found in '."\n\r+-':
        raise table.wrong(key, 'one character, such as ",", ";", "|" or "\\t", or " " for any number of blanks')
    return found


def _sign(table: Table, key: str) -> str:
    known = (".", ",") if key == "decimal" else (".", ",", "'", " ")
    if table.data[key] not in known:
        raise table.wrong(key, " or ".join(format_value(sign) for sign in known))
    return str(table.data[key])


def _text(table: Table, key: str) -> str:
    return str(table.text(key))


def _skip(table: Table, key: str) -> int | str:
    value = table.data[key]
    rows = isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= 100_000
    if not rows and not (isinstance(value, str) and value.strip()):
        raise table.wrong(
            key, 'a number of rows above the header, or the sign with which lines to leave out begin, such as "%"'
        )
    return value.strip() if isinstance(value, str) else int(value)


def _header(table: Table, key: str) -> bool:
    return bool(table.flag(key))


def _units(table: Table, key: str) -> dict[str, str]:
    given = table.table(key)
    found = {name: spelled(given.text(name)) for name in given.data}
    for name, unit in found.items():
        if unit is None:
            raise given.wrong(name, f"a unit: {', '.join(NAMES)}")
    return {name: unit for name, unit in found.items() if unit is not None}


def _time(table: Table, key: str) -> str:
    return str(table.text(key, choices=(ISO, SECONDS, CLOCK)))


_READ: dict[str, Any] = {
    "delimiter": _delimiter,
    "decimal": _sign,
    "thousands": _sign,
    "encoding": _text,
    "skip": _skip,
    "header": _header,
    "units": _units,
    "time": _time,
}
