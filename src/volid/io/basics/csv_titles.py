"""Lines that spreadsheets and instruments put above a table: a title, a date, a customer; recognised by what stands below.

The header is the first line that fills as many cells as the rows below it, no cell with a number and none twice. Lines above it
are titles when they fill less than half as many cells. Otherwise nothing is recognised, and the first line is the header.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence

from volid.io.basics.csv_cells import looks_like_number

_LINES = 40  # looked at
_FEWEST = 3  # cells of a header that can be told from a title


def titles(lines: Sequence[str], delimiters: Sequence[str]) -> int:
    """How many of the first lines are titles; 0 where that is not clear."""
    found = [_titles(lines[:_LINES], delimiter) for delimiter in delimiters]
    return 0 if 0 in found else min((n for n in found if n is not None), default=0)


def _titles(lines: Sequence[str], delimiter: str) -> int | None:
    """Number of lines above the header where this delimiter parts the cells; None where it gives no header."""
    try:
        cells = [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=delimiter)]
    except csv.Error:
        return None
    filled = [sum(map(bool, row)) for row in cells]
    if len(cells) != len(lines) or len(cells) < 2:
        return None
    usual, _ = Counter(filled[len(filled) // 2 :]).most_common(1)[0]
    for i, (row, n) in enumerate(zip(cells, filled, strict=True)):
        if n >= max(usual, _FEWEST) and _is_header([cell for cell in row if cell]):
            return i
        if 2 * n >= max(usual, _FEWEST):
            return None
    return None


def _is_header(cells: Sequence[str]) -> bool:
    return len(set(cells)) == len(cells) and not any(map(looks_like_number, cells))
