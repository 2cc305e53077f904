"""Numbers in text files of instruments: decimal points or commas, one sign in the whole file, and nothing else."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

from volid.io.basics import csv_cells

_INTEGER = re.compile(r"\d{1,9}")
_PLAIN = re.compile(r"[+\-−]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+\-]?\d{1,3})?")


def decimal_of(tokens: Iterable[str]) -> str | None:
    """The decimal sign of numbers, "." or ","; None where both occur, so that one of them parts thousands."""
    text = " ".join(tokens)
    if "," not in text:
        return "."
    return None if "." in text else ","


def number(token: str, decimal: str) -> float | None:
    """A finite number with that decimal sign; None for anything else."""
    if not _PLAIN.fullmatch(token) or (decimal == "," and "." in token) or (decimal == "." and "," in token):
        return None
    value, _ = csv_cells.number(token, decimal, None)
    return value if math.isfinite(value) else None


def integer(token: str) -> int | None:
    """A whole number of at most nine digits; None for anything else."""
    return int(token) if _INTEGER.fullmatch(token) and token.isascii() else None
