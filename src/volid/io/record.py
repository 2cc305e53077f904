"""The record that all written tables and grids have: the sense of their values, their origin, notes; and how it is read back.

A record is a header of lines "# key: value" in CSV, and a set of attributes in HDF5 (ISO/TR 16907 12).
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.io.basics.cells import original_header
from volid.io.basics.encodings import decode, read_bytes
from volid.io.functions_csv import REJECTED, source_lines

ERROR, COMPENSATION = "error", "compensation"
_UNITS = re.compile(r"\b([munµμ]?m|cm|in(?!\s+[\w°])|inch|inches|mil|[munµμ]?rad|arcsec|arcmin)\b")
SIGN = {ERROR: 1.0, COMPENSATION: -1.0}  # of written values, for error values in memory
_SIGN_IN_WORDS = {
    ERROR: "error value = actual - nominal; the compensation value is minus it",
    COMPENSATION: "compensation value = -(actual - nominal); a control that adds it to the command removes the deviation",
}


def values_lines(values: str) -> dict[str, str]:
    """Which values a file holds, and what their sign means; `values`: "error" or "compensation"."""
    return {"values": values, "sign": _SIGN_IN_WORDS[values]}


def closing_lines(
    solution: Solution, source: str | Path | None, datum: str, command: Sequence[str], notes: Sequence[str]
) -> dict[str, str]:
    """The origin of the numbers, the words of the command line, and the notes.

    A verdict that the model is rejected is one of the notes, which are read back, and is then not stated a second time.
    """
    lines = source_lines(solution, source) | {"datum": datum}
    if command:
        lines["command"] = shlex.join(command)
    if any(note.startswith(REJECTED) for note in notes):
        lines.pop(REJECTED, None)
    return lines | {f"note {i}": note for i, note in enumerate(notes, start=1)}


def read_header(path: str | Path) -> dict[str, str]:
    """The lines "# key: value" of a CSV file."""
    text, _ = decode(read_bytes(Path(path)), Path(path))
    comments = [_unpadded(line)[1:].strip() for line in text.split("\n") if line.startswith(("#", '"#'))]
    return {k: original_header(v) for k, v in (line.split(": ", 1) for line in comments if ": " in line)}


def _unpadded(line: str) -> str:
    """A line of the record as it was before a spreadsheet wrote it again: without quotes and empty cells."""
    bare = line.rstrip(";,\t ")
    return bare[1:-1].replace('""', '"') if bare[:1] == bare[-1:] == '"' else bare


def notes_of(header: Mapping[str, str]) -> tuple[str, ...]:
    """The notes of a header, in order."""
    return tuple(text for key, text in header.items() if re.fullmatch(r"note \d+", key))


def units_named(header: Mapping[str, str]) -> list[str]:
    """Units of lengths and angles that the line "# units" of a record names, without degrees.

    >>> units_named({"units": "X mm; EXX µm, all in words"})
    ['mm', 'µm']
    """
    return _UNITS.findall(header.get("units", ""))


def require_keys(path: str | Path, header: Mapping[str, str], keys: Sequence[str], what: str) -> None:
    """Raises `InputError` when a line is missing; `what`: such as "a grid written by volid, 'volid-grid/1'"."""
    for key in keys:
        if key not in header:
            raise InputError(f"{path}: header '{key}' is missing; expected {what}")
