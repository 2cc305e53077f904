"""Cells that a spreadsheet would run: a text that begins with =, +, -, @, a tab or a return is written behind an apostrophe.

Names come from files of others, and a spreadsheet takes such a text for a formula, which can start programs. Numbers stay
numbers. The readers of volid take the apostrophe away again, so that every text reads back as it was.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from typing import Any, TextIO

from volid.exceptions import shown

_STARTS = re.compile(r"'*[=+\-@\t\r]")
# In a header line, which a spreadsheet also cuts into cells. Numbers with their unit are left, and what calls nothing, so that
# tool vectors can be read and commands copied.
_NUMBER = r"""[\d.]+(?:[eE][+-]?\d+)?(?:\s\w+)?\s*(?:[,;\t]|$)"""
_RUNS = rf"""(?=[=@]|[+-](?!{_NUMBER}).*(?:[|!]|\w\())"""
_INNER = re.compile(rf"""([,;\t]["']?\s*){_RUNS}""")
_NEUTRALISED = re.compile(rf"""([,;\t]["']?\s*)'{_RUNS}""")


def neutral(cell: Any) -> Any:
    """The cell as it is written: `'=1+1` for the text `=1+1`; what is no text as it is.

    >>> neutral("=1+1"), neutral("-3.5"), neutral(-3.5), neutral("S1")
    ("'=1+1", '-3.5', -3.5, 'S1')
    """
    return f"'{cell}" if isinstance(cell, str) and _STARTS.match(cell) and not _is_number(cell) else cell


def original(cell: str) -> str:
    """The text that `neutral` made the cell of.

    >>> original("'=1+1"), original("'S1'")
    ('=1+1', "'S1'")
    """
    return cell[1:] if cell.startswith("'") and _STARTS.match(cell) else cell


def header_line(key: str, text: str) -> str:
    """A line "# key: text" of the record above a table, in one line, without what a terminal or a spreadsheet would obey.

    >>> header_line("note", "a, =1+1, -3 mm")
    "# note: a, '=1+1, -3 mm"
    """
    return f"# {key}: {_INNER.sub(_behind_apostrophe, shown(' '.join(text.split())))}".rstrip()


def original_header(text: str) -> str:
    """The text that `header_line` was given, but for line breaks and control characters."""
    return _NEUTRALISED.sub(lambda match: match[1], text)


class CellWriter:
    """Writes rows like the writer of the module csv, lines ending in one character, texts such that no spreadsheet runs them."""

    def __init__(self, stream: TextIO) -> None:
        self._writer = csv.writer(stream, lineterminator="\n")

    def writerow(self, row: Iterable[Any]) -> None:
        """Write one row."""
        self._writer.writerow([neutral(cell) for cell in row])

    def writerows(self, rows: Iterable[Iterable[Any]]) -> None:
        """Write rows."""
        self._writer.writerows([neutral(cell) for cell in row] for row in rows)


def _behind_apostrophe(match: re.Match[str]) -> str:
    return f"{match[1]}'"


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
