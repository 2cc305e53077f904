"""How far a manifest reaches: it came from somebody, and may name only files below its own folder.

Otherwise a campaign that was sent could make any file of the reader's machine appear in messages and results. The machine file
may stand elsewhere, as campaigns of one machine share it: of what is no machine file nothing is told.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from volid.exceptions import InputError
from volid.io.basics.toml_table import LARGEST_TOML, Table, format_value, read_text
from volid.io.machines import FORMAT, parse_machine
from volid.model.machine import Machine

_FILES = ("file", "points", "covariance", "positions")  # keys that name files of readings, samples or coordinates
_FREE = ("conditions",)  # tables of records, whose keys mean nothing to volid
_TAGGED = re.compile(rf"""^\s*format\s*=\s*["']{FORMAT.split("/")[0]}/""", re.MULTILINE)


def refuse_outside(top: Table, folder: Path) -> None:
    """Raises `InputError` for a file of readings that does not stand below `folder`, links followed."""
    for key, name in _names(top):
        refuse_far(top.where, key, name, folder)


def refuse_far(where: str, key: str, name: str, folder: Path) -> None:
    """Raises `InputError` for a `name` that does not stand below `folder`; `key` of the manifest `where` names it."""
    if not _is_below(folder, folder / name):
        raise InputError(
            f"{where}: {key} is {format_value(name)}, which is outside the manifest's folder; move the file there, or pass "
            "`allow_outside=True` if you trust the manifest"
        )


def refuse_other_types(top: Table) -> None:
    """Raises `InputError` where a machine file is named for readings, or readings for the machine."""
    for key, name in _names(top):
        if name.lower().endswith(".toml"):
            raise InputError(f"{top.where}: {key} is {format_value(name)}; expected a table (CSV), not a TOML file")
    name = top.text("machine")
    if name.lower().endswith((".csv", ".txt", ".h5", ".hdf5")):
        raise InputError(
            f"{top.where}: machine is {format_value(name)}; expected a machine file (TOML), such as machine.toml"
        )


def read_machine_of(top: Table, folder: Path) -> Machine:
    """The machine that a manifest in `folder` names. Raises `InputError`, without a word of a file that is no machine file."""
    path = folder / top.text("machine")
    text = read_text(path, LARGEST_TOML)
    if not (_is_below(folder, path) or _TAGGED.search(text)):
        raise InputError(f"{path}: is no machine file; expected one with format = {format_value(FORMAT)}")
    return parse_machine(text, str(path))


def _names(top: Table) -> Iterator[tuple[str, str]]:
    return _named({key: value for key, value in top.data.items() if key not in _FREE})


def _named(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Keys and names of files within a table."""
    if isinstance(value, Mapping):
        for inner, item in value.items():
            yield from _named(item, inner)
    elif isinstance(value, list):
        for item in value:
            yield from _named(item, "" if key in _FILES else key)
    elif isinstance(value, str) and key in _FILES:
        yield key, value


def _is_below(folder: Path, path: Path) -> bool:
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))
