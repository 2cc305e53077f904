"""The rows of a CSV file, whoever wrote it: delimiter, quotes, comments, empty and repeated rows, a row of units.

Unstated delimiters are recognised: tabs, semicolons, commas or blanks, the one that gives header and rows the same number of
cells, and no cell that holds numbers parted by another one. Two that both do are not guessed.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

from volid.exceptions import InputError
from volid.io.basics.csv_form import BLANKS, CsvForm, in_words
from volid.io.basics.csv_titles import titles
from volid.io.basics.units import spelled

MOST_COLUMNS = 2000
NO_NAME = "column "  # and its number: what a column without a name is called
_SAMPLE = 40  # rows by which the delimiter is recognised
_CANDIDATES = ("\t", ";", ",")
_LONGEST = csv.field_size_limit()  # characters of a cell
_SHOWN = 80  # characters of a cell in messages


@dataclass
class Rows:
    """`header`: names of the columns. `rows`: the rows below it, each as long. `numbers`: their line numbers, from 1.

    `units`: a row of units by column; `said`: what was recognised; `underscores`: whether some stand below the header.
    """

    delimiter: str
    header: list[str]
    rows: list[list[str]]
    numbers: list[int]
    units: dict[str, str] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    underscores: bool = False


def shown(text: str) -> str:
    """Text of a file as messages show it: control characters escaped, and at most 80 characters."""
    safe = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text[: 2 * _SHOWN])
    return safe if len(safe) <= _SHOWN and len(text) <= 2 * _SHOWN else f"{safe[: _SHOWN - 1]}…"


def names_shown(names: Sequence[str]) -> str:
    """Names in a list, the first 40 of them."""
    listed = ", ".join(shown(name) for name in names[:40])
    return listed if len(names) <= 40 else f"{listed} and {len(names) - 40} more"


def read_rows(text: str, path: Path, form: CsvForm) -> Rows:
    """Header and rows of a CSV text. Raises `InputError` naming the row that does not fit."""
    lines = text.split("\n")
    stated, form = _excel_hint(lines, form)
    kept = _kept(lines, form)
    if not kept:
        raise InputError(f"{path}: the file is empty; expected a header row and rows below it")
    above = 0 if form.skip or not form.header else titles([lines[i] for i in kept[:_SAMPLE]], _possible(form))
    del kept[:above]
    delimiter = form.delimiter or _recognised([lines[i] for i in kept[: _SAMPLE + 1]], path, kept[0] + 1, form)
    _check_width(lines[kept[0]], delimiter, f"{path}, row {kept[0] + 1}")
    cells = _parsed(lines, kept, delimiter, path)
    found = _with_header(cells, kept, delimiter, path) if form.header else _numbered(cells, kept, delimiter)
    if not found.rows:
        raise InputError(f"{path}: there is a header but no row below it")
    found.underscores = text.rfind("_") >= text.find(lines[kept[0]]) + len(lines[kept[0]])
    _tidy(found, path)
    if stated or (delimiter != "," and form.delimiter is None):
        found.said.insert(0, f"cells separated by {in_words(delimiter)}")
    if above:
        found.said.append(f"{above} line{'s' if above > 1 else ''} above the header left out")
    return found


def _possible(form: CsvForm) -> tuple[str, ...]:
    return _CANDIDATES if form.delimiter is None else (form.delimiter,)


def _excel_hint(lines: list[str], form: CsvForm) -> tuple[bool, CsvForm]:
    """The line "sep=;" that spreadsheets understand, emptied, and the form with its delimiter."""
    first = lines[0].strip().strip('"')
    if not (first.lower().startswith("sep=") and len(lines[0].rstrip("\n")) <= 7):
        return False, form
    sign = lines[0].strip('"')[4:5] or "\t"
    lines[0] = ""
    return form.delimiter is None, form if form.delimiter else replace(form, delimiter=sign)


def _kept(lines: list[str], form: CsvForm) -> list[int]:
    """Numbers of the lines that hold cells; a spreadsheet puts comments that hold its delimiter in quotes."""
    signs = (form.comment, f'"{form.comment} ')
    digit_first = not form.comment[0].isdecimal()  # then no comment begins as most lines do, which is seen quickly

    def holds(line: str) -> bool:
        return bool(line.strip()) and not line.lstrip().startswith(signs)

    return [
        i
        for i, line in enumerate(lines)
        if i >= form.skip and line and ((digit_first and line[0].isdecimal()) or holds(line))
    ]


def _recognised(sample: list[str], path: Path, row: int, form: CsvForm) -> str:
    """The delimiter of header and first rows. Raises `InputError` where two fit alike."""
    for delimiter in _CANDIDATES:
        _check_width(sample[0], delimiter, f"{path}, row {row}")
    candidates = [c for c in _CANDIDATES if not (c == "," and form.decimal == "," and '"' not in "".join(sample))]
    tables = {c: _trimmed_sample(sample, c) for c in candidates}
    fits = {c: len(rows[0]) for c, rows in tables.items() if _fits(rows, c)}
    best = [c for c, n in fits.items() if n == max(fits.values())]
    if len(best) == 1:
        return best[0]
    if len(best) > 1:
        both = " or ".join(in_words(c) for c in best)
        raise InputError(f"{path}, row {row}: the cells may be separated by {both}; state the delimiter in [csv]")
    if all(len(rows[0]) == 1 for rows in tables.values()) and _fits(_trimmed_sample(sample, BLANKS), BLANKS):
        return BLANKS
    widest = max(candidates, key=lambda c: (len(tables[c][0]), c == ","))
    return widest if len(tables[widest][0]) > 1 else ","


def _check_width(line: str, delimiter: str, where: str) -> None:
    """Raises `InputError` for more columns than a table of readings has."""
    n = line.rstrip(f"{delimiter} ").count(delimiter) + 1
    if n > MOST_COLUMNS:
        raise InputError(f"{where}: {n} columns; expected at most {MOST_COLUMNS}, one quantity in each")


def _trimmed_sample(sample: list[str], delimiter: str) -> list[list[str]]:
    try:
        return [_trimmed(row) for row in _reader(sample, delimiter)]
    except csv.Error:
        return [[""]]


def _fits(rows: list[list[str]], delimiter: str) -> bool:
    """Whether no row is longer than the header of several cells, and no cell holds numbers that another delimiter parts."""
    width = len(rows[0])
    if width < 2 or any(len(row) > width for row in rows) or all(len(row) < 2 for row in rows[1:]):
        return False
    others = [c for c in ("\t", ";") if c != delimiter]
    return not any(_parts_numbers(cell, other) for row in rows[1:] for cell in row for other in others) and not (
        delimiter != "," and any(cell.count(",") > 1 and _parts_numbers(cell, ",") for row in rows[1:] for cell in row)
    )


def _parts_numbers(cell: str, delimiter: str) -> bool:
    pieces = cell.split(delimiter)
    return any(a[-1:].isdigit() and b.lstrip()[:1].isdigit() for a, b in pairwise(pieces))


def _trimmed(row: list[str]) -> list[str]:
    """A row without the empty cells at its end."""
    n = len(row)
    while n > 1 and not row[n - 1].strip():
        n -= 1
    return row[:n]


def _reader(lines: Sequence[str], delimiter: str):  # type: ignore[no-untyped-def]
    if delimiter == BLANKS:
        return csv.reader((line.strip().replace("\t", " ") for line in lines), delimiter=" ", skipinitialspace=True)
    return csv.reader(lines, delimiter=delimiter)


def _parsed(lines: list[str], kept: list[int], delimiter: str, path: Path) -> list[list[str]]:
    """The cells of every line that is kept; lines of a header that holds line breaks become one, and leave `kept`."""
    try:
        cells = list(_reader([lines[i] for i in kept], delimiter))
    except csv.Error:
        cells = []
    if len(cells) == len(kept):
        _end_of_row(lines, kept, len(kept) - 1, delimiter, path)  # nothing follows that a last quote could swallow
        return cells
    end = _end_of_row(lines, kept, 0, delimiter, path)
    if end:  # a header with line breaks, as spreadsheets have them in tall cells
        lines[kept[0]] = " ".join(lines[i] for i in kept[: end + 1])
        del kept[1 : end + 1]
        return _parsed(lines, kept, delimiter, path)
    for place in range(len(kept)):
        if _end_of_row(lines, kept, place, delimiter, path):
            raise InputError(
                f"{path}, row {kept[place] + 1}: a cell in quotes runs over several lines, or its quote is not closed; expected "
                "one line per row"
            )
    raise InputError(f"{path}: the quotes around cells do not match; expected one line per row")


def _end_of_row(lines: list[str], kept: list[int], start: int, delimiter: str, path: Path) -> int:
    """How many further lines the row takes that begins at place `start`. Raises `InputError` for a quote that is never closed."""
    where = f"{path}, row {kept[start] + 1}"
    longest = max(map(len, lines[kept[start]].split(delimiter)))
    if longest > _LONGEST:
        raise InputError(f"{where}: a cell of {longest} characters; expected cells of at most {_LONGEST} characters")
    if '"' not in lines[kept[start]]:
        return 0
    rest = csv.reader((lines[i] for i in kept[start:]), delimiter=delimiter, strict=True)
    try:
        next(rest)
    except csv.Error as error:
        if "end of data" in str(error) or "field limit" in str(error):
            raise InputError(f"{where}: a quote is opened and not closed; close it, or remove it") from None
        raise InputError(
            f"{where}: text stands behind a closed quote; put the whole cell in quotes, or none of it"
        ) from None
    return rest.line_num - 1


def _numbered(cells: list[list[str]], kept: list[int], delimiter: str) -> Rows:
    """Columns named by their numbers, where there is no header."""
    width = max(len(_trimmed(row)) for row in cells[:_SAMPLE])
    return Rows(delimiter, [str(i + 1) for i in range(width)], cells, [i + 1 for i in kept])


def _with_header(cells: list[list[str]], kept: list[int], delimiter: str, path: Path) -> Rows:
    header = [" ".join(name.split()) for name in cells[0]]
    named = len(_trimmed(header))
    if len(header) > named:  # columns without a name behind the others: padding, unless something stands in them
        n = len(header) if any(cell.strip() for row in cells[1:] for cell in row[named:]) else named
        header = header[:n]
        cells[1:] = [row + [""] * (n - len(row)) if named <= len(row) < n else row for row in cells[1:]]
    twice = [name for name, n in Counter(header).items() if n > 1 and name]
    if twice:
        raise InputError(f"{path}, row {kept[0] + 1}: column '{shown(twice[0])}' stands twice; name every column once")
    return Rows(delimiter, header, cells[1:], [i + 1 for i in kept[1:]])


def _tidy(found: Rows, path: Path) -> None:
    """Cut empty cells behind the last column, drop empty and repeated rows, take the row of units, name the rest."""
    width, firsts = len(found.header), [row[0] for row in found.rows]
    if set(map(len, found.rows)) != {width} or found.header[0] in firsts or not all(map(str.strip, firsts)):
        _drop(found)
    _take_units(found)
    if not found.rows:
        raise InputError(f"{path}: there is a header but no row below it")
    for number, row in zip(found.numbers, found.rows, strict=True) if set(map(len, found.rows)) != {width} else ():
        if len(row) != width:
            hint = _hint(found, row)
            raise InputError(f"{path}, row {number}: {len(row)} cells; expected {width}, as in the header{hint}")
    found.header = [name or f"{NO_NAME}{i}" for i, name in enumerate(found.header, start=1)]


def _drop(found: Rows) -> None:
    width, header = len(found.header), found.header
    rows, numbers, repeated = [], [], 0
    for number, row in zip(found.numbers, found.rows, strict=True):
        if len(row) > width and not any(cell.strip() for cell in row[width:]):
            row = row[:width]
        if not any(cell.strip() for cell in row):
            continue
        if row[0].strip() == header[0] and [" ".join(cell.split()) for cell in row] == header:
            repeated += 1
            continue
        rows.append(row)
        numbers.append(number)
    if repeated:
        found.said.append(f"the header repeated {repeated} times within the file and left out there")
    found.rows, found.numbers = rows, numbers


def _take_units(found: Rows) -> None:
    """A row of units below the header: no cell that is anything else, and at least one unit."""
    cells = [cell.strip() for cell in found.rows[0]] if found.rows else []
    units = [spelled(cell) if cell not in ("", "-", "[-]", "[]", "()") else "" for cell in cells]
    if len(cells) == len(found.header) and any(units) and None not in units:
        found.units = {name: unit for name, unit in zip(found.header, units, strict=True) if unit}
        found.said.append(f"units from row {found.numbers[0]}")
        found.rows, found.numbers = found.rows[1:], found.numbers[1:]


def _hint(found: Rows, row: list[str]) -> str:
    """What may explain a row of another length."""
    width = len(found.header)
    if found.delimiter == "," and width < len(row) <= 2 * width:
        return "; where numbers have decimal commas, expected ';' or tabs between the cells, or numbers in quotes"
    usual, _ = Counter(map(len, found.rows)).most_common(1)[0]
    if usual == len(row):
        return "; where lines stand above the header, state skip in [csv], the number of these lines"
    return ""
