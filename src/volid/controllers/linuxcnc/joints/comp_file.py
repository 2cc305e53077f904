"""COMP_FILE of LinuxCNC: the text of one table, written so that the program reads all of it, and read as the program would.

LinuxCNC reads line by line until one does not begin with three numbers, and does not say that it stopped: a heading, a blank
line or a decimal comma empties or cuts the table in silence. A row that does not rise and every row beyond the 256th are left
out. What follows the third number of a line is not looked at.
"""

from __future__ import annotations

import re

import numpy as np

from volid.controllers.base import text_of
from volid.exceptions import InputError

ROWS, LINE = 256, 254  # most rows, most characters of a line
DIGITS = 9  # decimals: 1e-9 mm, or degrees
LARGEST = 1e6  # mm or degrees: beyond it nothing is the position of a machine
SHARE = 0.1  # of the range: larger deviations are none, the type of the file is another one
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,2})?")
_BETWEEN = re.compile(r"[ \t]+")
_EMPTY = "LinuxCNC would take the table for empty, correct nothing by it, and use BACKLASH instead, without a word"


def lines_of(what: str, positions: np.ndarray, columns: np.ndarray) -> str:
    """Three numbers a line: positions (n,), columns (n, 2) for motion in + and in - [unit of the joint].

    Raises `InputError` naming `what` for numbers that are not finite, or positions that do not rise once they are rounded.
    """
    if not (np.isfinite(positions).all() and np.isfinite(columns).all()):
        raise InputError(f"{what} is not finite everywhere; take `ranges` in which the data determine it")
    kept = np.concatenate([[True], np.diff(np.round(positions, DIGITS)) > 0.0])
    same = ~kept
    if same.any() and np.abs(columns[same] - columns[np.flatnonzero(same) - 1]).max() > 10.0**-DIGITS:
        at = positions[int(np.argmax(same))]
        raise InputError(f"{what} has two values at {at:.{DIGITS}f}; LinuxCNC wants positions that rise")
    rows = np.column_stack([positions, columns])[kept]
    return "".join(" ".join(_written(v) for v in row) + "\n" for row in rows)


def plain(text: str) -> float | None:
    """A number as LinuxCNC's files have it, with a decimal point, of at most 1e6; None for anything else."""
    if not (text.isascii() and _NUMBER.fullmatch(text)):
        return None
    return value if abs(value := float(text)) <= LARGEST else None


def _written(value: float) -> str:
    """A number with a decimal point, without exponent and without zeros that say nothing."""
    text = f"{value:.{DIGITS}f}".rstrip("0")
    text += "0" if text.endswith(".") else ""
    return "0.0" if text == "-0.0" else text


def rows_of(name: str, content: str | bytes) -> np.ndarray:
    """The rows of a file, shape (n, 3). Raises `InputError` with the line for what LinuxCNC would leave out in silence."""
    if content[:1] == "\ufeff" or (isinstance(content, bytes) and content.startswith(b"\xef\xbb\xbf")):
        raise InputError(f"{name}, line 1: a byte order mark stands before the first number; {_EMPTY}. Save it without")
    lines = [line.removesuffix("\r") for line in text_of(name, content).split("\n")]
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise InputError(f"{name}: no row; {_EMPTY}")
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        row = _row(f"{name}, line {number}", line, len(rows))
        if rows and row[0] <= rows[-1][0]:
            raise InputError(
                f"{name}, line {number}: position {row[0]:g} after {rows[-1][0]:g}; LinuxCNC says 'compensation values must "
                "increase' and leaves the row out. Sort the rows, each position once"
            )
        rows.append(row)
    if len(rows) > ROWS:
        raise InputError(
            f"{name}, line {ROWS + 1}: {len(rows)} rows; LinuxCNC holds {ROWS} and leaves out the others. Take fewer positions"
        )
    return np.array(rows)


def _row(where: str, line: str, before: int) -> list[float]:
    """The three numbers of a line; `before`: rows that LinuxCNC would use if it stopped here."""
    found = _BETWEEN.split(line.strip(" \t"))[:3]
    stops = (
        _EMPTY
        if before == 0
        else f"LinuxCNC would stop reading here and use the {before} row(s) before, without a word"
    )
    if len(line) > LINE:
        raise InputError(f"{where}: {len(line)} characters; LinuxCNC reads at most {LINE} of a line")
    values = [plain(v) for v in found]
    if len(values) < 3 or None in values:
        shown = line.strip()[:60] or "blank"
        raise InputError(
            f"{where}: '{shown}'; expected three numbers with a decimal point, of at most {LARGEST:g}, and nothing before "
            f"them. {stops}"
        )
    return [v for v in values if v is not None]


def errors_of(name: str, rows: np.ndarray, kind: int) -> np.ndarray:
    """Error values (n, 2) of rows (n, 3), both in the unit of the joint. `kind`: COMP_FILE_TYPE, 0 or 1.

    Raises `InputError` where they are as large as positions: the file is of the other type.
    """
    errors = rows[:, 1:] - rows[:, :1] if kind == 0 else -rows[:, 1:]
    largest, span = float(np.abs(errors).max()), float(np.ptp(rows[:, 0]))
    if largest > SHARE * max(span, 1.0):
        raise InputError(
            f"{name}: deviations of up to {largest:g} over a range of {span:g}, read as COMP_FILE_TYPE {kind}; a file of the "
            f"other type? State `comp_file_type={1 - kind}`"
        )
    return np.asarray(errors)


def looks_like_one(content: str | bytes) -> bool:
    """Whether a file begins with three numbers, and nothing else in its first line."""
    first = text_of("", content[:400]).split("\n", 1)[0].split()
    return len(first) == 3 and all(plain(v) is not None for v in first)
