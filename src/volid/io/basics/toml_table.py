"""TOML read strictly and written in a plain form: every key is read by name and type, and messages name file and key."""

from __future__ import annotations

import difflib
import json
import math
import re
import stat
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from volid.exceptions import InputError, cut
from volid.io.basics.toml_mistakes import explained
from volid.io.basics.toml_values import checked, refuse_control, refuse_long_keys, too_deep

REQUIRED: Any = object()
_NO_TEXT = {
    b"\x89HDF": "an HDF5 file",
    b"PK\x03\x04": "a workbook or archive (ZIP)",
    b"\xd0\xcf\x11\xe0": "a workbook of an old office program",
    b"%PDF": "a PDF document",
    b"\x1f\x8b": "a compressed file (gzip)",
}
LARGEST_LENGTH = 1e8  # mm or degrees: 100 km, or what controls call an endless axis
LARGEST_NUMBER = 1e12
LARGEST_TEXT = 1 << 30  # bytes
LARGEST_TOML = 1 << 23  # bytes; read in some seconds
FILE_TYPES = {  # format tag without version: (what it is, where it comes from)
    "volid-machine": ("a machine file", "written by hand (TOML) or copied from models/"),
    "volid-campaign": ("a campaign", "a manifest (TOML) or the HDF5 file that `volid.save_campaign` writes"),
    "volid-solution": ("a solution", "which `volid.fit` makes of a campaign"),
    "volid-truth": ("a truth", "which `volid.simulate` makes beside a campaign"),
    "volid-study": ("a study", "written by hand (TOML)"),
    "volid-study-results": ("results of a study", "which `volid.study.run_study` makes of a study"),
    "volid-grid": ("a grid", "which `volid.save_grid` writes"),
}


def read_text(path: str | Path, largest: int = LARGEST_TEXT) -> str:
    """Text of a UTF-8 file of at most `largest` bytes, without byte order mark and with plain line ends.

    Raises `InputError` when the file is missing, too large, not UTF-8, or a folder, pipe or device, which may never end.
    """
    data = _read_bytes(Path(path), largest)
    for beginning, what in _NO_TEXT.items():
        if data.startswith(beginning):
            raise InputError(f"{path}: this is {what}; expected a text file in UTF-8")
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        found = f"byte 0x{data[error.start]:02x}"
        raise InputError(f"{path}, line {line}: {found} is not UTF-8 text; save the file in UTF-8") from None


def _read_bytes(path: Path, largest: int) -> bytes:
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            folder = stat.S_ISDIR(found.st_mode)
            what = (
                "a folder; name a file in it"
                if folder
                else "a pipe or device; expected a file, so save the text as one"
            )
            raise InputError(f"{path}: cannot be read: it is {what}")
        if found.st_size > largest:
            raise InputError(f"{path}: {found.st_size >> 20} MiB; expected a text file of at most {largest >> 20} MiB")
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; check the name and the folder") from None
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{path}: cannot be read: {reason}; expected a readable file") from None


def read_toml(path: str | Path) -> dict[str, Any]:
    """The top table of a TOML file. Raises `InputError` as `read_text` and `parse_toml` do."""
    return parse_toml(read_text(path, LARGEST_TOML), str(path))


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """The top table of a TOML text; dates become ISO 8601 text.

    Raises `InputError` naming the line of a mistake, or the key of a value that volid cannot hold (`toml_values`).
    """
    refuse_long_keys(text, source)
    try:
        found: dict[str, Any] = checked(tomllib.loads(text), source)
        return found
    except RecursionError:
        raise too_deep(source) from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{source}, {explained(str(error), text)}") from None
    except ValueError:  # Python converts no more than 4300 digits
        long = re.search(r"[\d_]{4300,}", text)
        where = f", line {text.count(chr(10), 0, long.start()) + 1}" if long else ""
        raise InputError(f"{source}{where}: a number of thousands of digits; expected less than 19 digits") from None


def nearest(name: str, known: Iterable[str]) -> str:
    """ "; did you mean 'travel'?" for a misspelt name, or nothing when none is like it."""
    exact = {item.casefold(): item for item in known}
    match = difflib.get_close_matches(name.casefold(), list(exact), n=1, cutoff=0.65)
    return f"; did you mean '{exact[match[0]]}'?" if match else ""


def check_format(table: Table, tag: str) -> None:
    """The key `format` must be `tag`. Raises `InputError` for another file type or version."""
    found = table.text("format")
    if found != tag:
        raise wrong_format(table.where, found, tag)


def wrong_format(where: str, found: str, tag: str) -> InputError:
    """The `InputError` for a file of another type, saying what it is and what makes the wanted one, or of another version."""
    other, wanted = found.split("/")[0], tag.split("/")[0]
    if other == wanted or other not in FILE_TYPES:
        return InputError(f"{where}: format is '{found}'; this volid reads '{tag}'")
    return InputError(
        f"{where}: this is {FILE_TYPES[other][0]} ('{found}'); expected {FILE_TYPES[wanted][0]}, {made_by(tag)}"
    )


def made_by(tag: str) -> str:
    """Where files of format `tag` come from: "which `volid.fit` makes of a campaign"."""
    return FILE_TYPES[tag.split("/")[0]][1]


@dataclass(frozen=True)
class Table:
    """A TOML table with the place it came from, `where` = "machine.toml, [axis.X]"; every getter checks the type."""

    data: Mapping[str, Any]
    where: str

    def only(self, known: Iterable[str]) -> None:
        """Raises `InputError` for a key that is not in `known`, naming the nearest one."""
        known = tuple(known)
        for key in self.data:
            if key not in known:
                hint = nearest(key, known)
                raise InputError(f"{self.where}: unknown key '{key}'{hint or ';'} known keys: {', '.join(known)}")

    def get(self, key: str, default: Any = REQUIRED) -> Any:
        """The value of `key` as it stands. Raises `InputError` when a required key is missing."""
        if key in self.data:
            return self.data[key]
        if default is REQUIRED:
            others = [k for k in self.data if nearest(k, [key])]
            hint = f"; found '{others[0]}', which looks like it" if others else ""
            raise InputError(f"{self.where}: key '{key}' is missing{hint}; add it")
        return default

    def wrong(self, key: str, expected: str) -> InputError:
        """The `InputError` for a value of the wrong kind."""
        return InputError(f"{self.where}: {key} is {cut(format_value(self.data[key]))}; expected {expected}")

    def text(self, key: str, default: Any = REQUIRED, choices: Iterable[str] = (), one_line: bool = True) -> Any:
        """A text, one of `choices` when there are any, without control characters and, unless not `one_line`, line ends."""
        value = self.get(key, default)
        choices = tuple(choices)
        if key not in self.data or (isinstance(value, str) and (value in choices if choices else value.strip())):
            refuse_control(value if key in self.data else "", f"{self.where}: {key}", one_line)
            return value
        if choices:
            hint = nearest(value, choices) if isinstance(value, str) else ""
            raise self.wrong(key, "one of " + ", ".join(f'"{c}"' for c in choices) + hint)
        raise self.wrong(key, "a text in quotes")

    def number(self, key: str, default: Any = REQUIRED, *, above: float = -math.inf, least: float = -math.inf) -> Any:
        """A finite number, greater than `above` and not less than `least`."""
        value = self.get(key, default)
        if key not in self.data:
            return value
        limit = f" > {above:g}" if above > -math.inf else f" >= {least:g}" if least > -math.inf else ""
        if not is_finite(value) or value <= above or value < least:
            raise self.wrong(key, f"a finite number{limit}")
        if abs(value) > LARGEST_NUMBER:
            raise self.wrong(key, f"a number of at most {LARGEST_NUMBER:g}")
        return float(value)

    def vector(self, key: str, size: int, default: Any = REQUIRED) -> Any:
        """A list of `size` finite numbers, as a tuple."""
        value = self.get(key, default)
        if key not in self.data:
            return value
        numbers = isinstance(value, list) and all(map(is_finite, value))
        if not numbers or len(value) != size:
            commas = isinstance(value, list) and len(value) == 2 * size and size > 1
            raise self.wrong(key, f"a list of {size} finite numbers" + (", with decimal points" if commas else ""))
        if max(map(abs, value)) > LARGEST_LENGTH:
            raise self.wrong(key, f"numbers of at most {LARGEST_LENGTH:g}")
        return tuple(float(v) for v in value)

    def flag(self, key: str, default: Any = REQUIRED) -> Any:
        """true or false."""
        value = self.get(key, default)
        if key in self.data and not isinstance(value, bool):
            raise self.wrong(key, "true or false")
        return value

    def table(self, key: str, default: Any = REQUIRED) -> Table:
        """A table inside this one."""
        value = self.get(key, default)
        if not isinstance(value, Mapping):
            raise self.wrong(key, f"a table [{key}]")
        return Table(value, f"{self.where}, [{key}]")

    def tables(self, key: str, title: str = "name") -> list[Table]:
        """The entries of an array of tables [[key]], each place named by its key `title` or else its number."""
        value = self.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, Mapping) for item in value):
            raise self.wrong(key, f"tables headed [[{key}]]")
        labels = [repr(v[title]) if isinstance(v.get(title), str) else str(i) for i, v in enumerate(value, start=1)]
        return [Table(item, f"{self.where}, {key} {label}") for item, label in zip(value, labels, strict=True)]


def is_number(value: Any) -> bool:
    """True for int and float, not for bool."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def is_finite(value: Any) -> bool:
    """True for a number that a float can hold, but for infinity and NaN."""
    try:
        return is_number(value) and math.isfinite(value)
    except OverflowError:  # a whole number of 400 digits, from a file that is not TOML
        return False


def format_value(value: Any) -> str:
    """A value in TOML: text in quotes, true/false, numbers with all digits, lists and inline tables.

    Raises `TypeError` for anything that TOML cannot hold.
    """
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if is_number(value):
        return repr(value)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(format_value(item) for item in value) + "]"
    if isinstance(value, Mapping):
        items = ", ".join(f"{format_key(k)} = {format_value(v)}" for k, v in value.items())
        return f"{{ {items} }}" if items else "{}"
    raise TypeError(f"{value!r} cannot be written in TOML")


def format_key(key: str) -> str:
    """A bare key, in quotes where TOML needs them."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else format_value(key)


def format_lines(items: Mapping[str, Any]) -> list[str]:
    """Lines "key = value"; keys with value None are left out."""
    return [f"{format_key(key)} = {format_value(value)}" for key, value in items.items() if value is not None]
