"""Cells of foreign tables as numbers: decimal sign, separators of thousands, and times of day.

The sign is recognised by what no other reading allows. "1362,37" has a decimal comma, because thousands come in groups of three;
"1.234,5" has one too, and "1,234.5" a decimal point. "504,542" alone could be either: then the delimiter ";", which
spreadsheets write only where the comma is the decimal sign, decides, and otherwise the file is refused with the key that says it.
Apostrophes and blanks, no-break ones too, can only separate thousands.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

UNCLEAR = "?"  # the comma may be a decimal sign, or separate thousands
_NUMBER = re.compile(r"\s*[+\-−]?[\d.,'’ \xa0\u2009\u202f]*\d[\d.,]*(?:[eE][+\-]?\d+)?\s*")
_COMMA = re.compile(
    r"(?:^|\n)\s*[+-]?(?:0\d*|\d{4,}|),\d|,\d{1,2}(?:[eE\n]|\s*$)|,\d{4,}|,\d*[eE]|\.\d{3},\d|[ '\xa0\u202f]\d{3},\d"
)
_POINT = re.compile(r",\d{3}\.\d|(?:,\d{3}){2}")
_BLANKS = re.compile(r"(?<=\d)['’ \xa0\u2009\u202f](?=\d{3}(?!\d))")
_SIGNED = str.maketrans({"−": "-"})


def decimal_sign(columns: Mapping[str, Sequence[str]], delimiter: str) -> str:
    """The decimal sign of a table whose cells hold commas: ".", "," or `UNCLEAR`; of both, the frequent one."""
    texts = ["\n".join(cells) for cells in columns.values() if _numeric(cells)]
    commas, points = (sum(text.count(sign) for text in texts) for sign in ",.")
    if not commas:
        return "."
    comma = any(_COMMA.search(text) for text in texts)
    if comma or any(_POINT.search(text) for text in texts):
        return "," if comma and commas >= points else "."
    if points:
        return "."
    return "," if delimiter == ";" else UNCLEAR


def _numeric(cells: Sequence[str]) -> bool:
    first = next((cell for cell in cells if cell.strip()), "")
    return looks_like_number(first)


def looks_like_number(cell: str) -> bool:
    """Whether a cell is a number in some country's way of writing."""
    return _NUMBER.fullmatch(cell) is not None


def numbers(cells: Sequence[str], decimal: str) -> np.ndarray:
    """Cells as floats, shape (m,), where all are plain numbers with that decimal sign. Raises `ValueError` else."""
    if decimal in (".", UNCLEAR):
        return np.fromiter(map(float, cells), float, len(cells))
    text = "\n".join(cells)
    if "." in text:
        raise ValueError
    return np.fromiter(map(float, text.replace(",", ".").split("\n")), float, len(cells))


def number(cell: str, decimal: str, thousands: str | None) -> tuple[float, bool]:
    """One cell as a number, and whether thousands are separated in it. Raises `ValueError` for what is none, or could be two.

    `thousands`: the stated sign that separates them; None: only where the cell itself leaves no doubt.

    >>> number("1.234,5", ",", None), number("1 234.5", ".", None), number("1.234", ",", ".")
    ((1234.5, True), (1234.5, True), (1234.0, True))
    """
    signed = cell.strip().translate(_SIGNED)
    plain = _BLANKS.sub("", signed)
    grouped = plain != signed
    if "_" in plain or (decimal == UNCLEAR and "," in plain):
        raise ValueError(cell)
    group, decimal = (".", ",") if decimal == "," else (",", ".")
    if group in plain:
        sure = decimal in plain or plain.count(group) > 1 or thousands == group
        if not sure or not re.fullmatch(rf"[+-]?\d{{1,3}}(\{group}\d{{3}})+(\{decimal}\d*)?", plain):
            raise ValueError(cell)
        plain, grouped = plain.replace(group, ""), True
    return float(plain.replace(decimal, ".")), grouped


ISO, SECONDS, CLOCK = "iso", "s", "hh:mm:ss"
EXAMPLES = {ISO: "2026-03-21T12:30:05", CLOCK: "12:30:05"}
_CLOCK = re.compile(r"(\d{1,3}):(\d{2})(?::(\d{2}(?:[.,]\d+)?))?")
_GERMAN = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})(.*)")
_HALF_A_DAY = 43200.0  # s


def time_form(cells: Iterable[str]) -> str:
    """Which form the first time has: seconds, "hh:mm:ss", or date and time, "iso"; days first where dots part them."""
    first = next((cell.strip() for cell in cells if cell.strip()), "")
    if _CLOCK.fullmatch(first):
        return CLOCK
    return ISO if re.match(r"\d{4}-\d{2}-\d{2}", first) or _GERMAN.fullmatch(first) else SECONDS


def seconds(cell: str, form: str) -> float:
    """A time [s]: since midnight, or since 1970-01-01 UTC for a date (a time without zone counts as UTC); NaN for an empty cell.

    Raises `ValueError` for anything else.

    >>> seconds("00:01:30,5", "hh:mm:ss"), seconds("1970-01-02 00:00", "iso"), seconds("02.01.1970 00:00:01", "iso")
    (90.5, 86400.0, 86401.0)
    """
    text = cell.strip()
    if not text:
        return float("nan")
    if form == CLOCK:
        parts = _CLOCK.fullmatch(text)
        if not parts or int(parts[2]) > 59 or float((parts[3] or "0").replace(",", ".")) >= 60.0:
            raise ValueError(cell)
        return 3600.0 * int(parts[1]) + 60.0 * int(parts[2]) + float((parts[3] or "0").replace(",", "."))
    if german := _GERMAN.fullmatch(text):
        text = f"{german[3]}-{int(german[2]):02d}-{int(german[1]):02d}{german[4]}"
    moment = datetime.datetime.fromisoformat(text.replace(",", "."))
    return moment.replace(tzinfo=moment.tzinfo or datetime.UTC).timestamp()


def over_midnight(times: np.ndarray) -> np.ndarray:
    """Times of day [s] that go on after midnight: one that is more than half a day earlier than the last is of the next day."""
    known = np.flatnonzero(np.isfinite(times))
    days = np.cumsum(np.diff(times[known], prepend=times[known][:1]) < -_HALF_A_DAY)
    result = times.copy()
    result[known] += 2.0 * _HALF_A_DAY * days
    return result
