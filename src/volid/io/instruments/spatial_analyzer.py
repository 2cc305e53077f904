"""`spatial_analyzer`: points that SpatialAnalyzer exports as text, in its working frame.

A line is `Collection Group Target x y z`, `Group Target x y z`, `Target x y z` or `x y z`, parted by blanks or commas, with
further numbers behind where they were exported; lines with `//` are comments. The coordinates are Cartesian. One frame holds
them all: it is one station."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.units import conversion, spelled
from volid.io.instruments.base import FROM_DESCRIPTIONS, ForeignFile, Format, Found, ReadingsFormat, Request
from volid.io.instruments.numerals import number
from volid.io.instruments.positions import KEY, Positions, by_name, by_order, read_positions
from volid.observations import KINDS

_COMMENT = "//"
_NAMES = ("collection", "group", "target")  # from the left; fewer of them are the last ones
_UNITS = {"millimeter": "mm", "millimetre": "mm", "inch": "inch", "meter": "m", "metre": "m", "centimeter": "cm"}
_WORD = re.compile(r"[a-z]+")
_POINT = re.compile(r"\d\.\d")
_DECIMAL_COMMAS = re.compile(
    r"(?:\s[+-]?\d+,\d+){2}(?:\s|$)"
)  # two numbers with decimal commas and blanks between them
_LOOKED_AT = 300  # lines
_STATION = "tracker"
_OTHER_LABELS = {label for kind in KINDS.values() for label in kind.labels} - set(KINDS["point"].labels)


class SpatialAnalyzer(ReadingsFormat):
    """Points of a tracker in one frame, matched to commanded positions."""

    name = "spatial_analyzer"
    words = "points that SpatialAnalyzer exported as text"
    about = (
        "Cartesian x, y, z of targets in the working frame, which counts as one station (station = its name, "
        "tracker by default); "
        "unit = mm, m or inch as chosen at the export; positions = a CSV of commanded positions, matched by its "
        "column target, or "
        f"else by order; names = how many names stand before the coordinates, where that is not clear. {FROM_DESCRIPTIONS}"
    )
    keys = (KEY, "unit", "names", "station")

    def recognises(self, text: str) -> bool:
        """Comments that name the program, or lines of names and three numbers under comments with two strokes."""
        lines = [line.strip() for line in text[: 200 * _LOOKED_AT].split("\n")[:_LOOKED_AT] if line.strip()]
        comments = " ".join(line for line in lines if line.startswith(_COMMENT)).casefold()
        layout = _layout(kept := [line for line in lines if not line.startswith(_COMMENT)])
        rows = [layout.cells(line) for line in kept]
        points = sum(layout.numbers(row) >= 3 for row in rows)
        named = layout.separator == " " and all(len(row) > layout.numbers(row) for row in rows)
        begins = bool(rows) and layout.numbers(rows[0]) >= 3  # no header
        return begins and points > 0.8 * len(rows) and (bool(comments) or named)

    def read(self, file: ForeignFile, request: Request) -> Found:
        """Every point that a position belongs to. Raises `InputError`."""
        points = _points(file, request)
        positions = read_positions(request, request.machine.letters)
        if positions is None:
            raise InputError(
                f"{request.table.where}: {file.path} does not hold axis positions; expected positions = a CSV "
                "with columns target,"
                f"{','.join(request.machine.letters)}, or without target in the order of the points"
            )
        rows, notes = _matched(points, positions)
        kept = np.flatnonzero(rows >= 0)
        columns: dict[str, Any] = positions.columns(rows[kept])
        if "station" not in columns:
            columns["station"] = [request.table.text("station", _STATION)] * len(kept)
        columns |= {c: points.values[kept, i].tolist() for i, c in enumerate("xyz")}
        columns = {name: values for name, values in columns.items() if name not in _OTHER_LABELS}
        unit = _unit(file, request)
        notes = (*points.notes, f"coordinates in {unit}", *notes)
        return Found("point", columns, [points.rows[i] for i in kept], dict.fromkeys("xyz", unit), notes=notes)


class _Points(NamedTuple):
    """Names by kind, each (n,), coordinates (n, 3), line numbers, and what was left out."""

    names: dict[str, list[str]]
    values: np.ndarray
    rows: list[int]
    notes: tuple[str, ...]


class _Layout(NamedTuple):
    """How the lines are written: what parts the cells, " " for any number of blanks, and the decimal sign."""

    separator: str
    decimal: str

    def cells(self, line: str) -> list[str]:
        """The cells of a line."""
        return line.split() if self.separator == " " else [c.strip().strip('"') for c in line.split(self.separator)]

    def numbers(self, row: Sequence[str]) -> int:
        """How many of the last cells are numbers, up to the first that is none."""
        n = 0
        while n < len(row) and number(row[-1 - n], self.decimal) is not None:
            n += 1
        return n


def _layout(lines: Sequence[str]) -> _Layout:
    """The layout of lines: semicolons or tabs, else commas, else blanks; decimal commas where no point stands."""
    pointed = _POINT.search("\n".join(lines)) is not None
    separator = next((sign for sign in (";", "\t") if all(sign in line for line in lines)), None)
    if separator is None:
        blanks = not pointed and all(_DECIMAL_COMMAS.search(line) for line in lines)
        separator = "," if not blanks and all("," in line for line in lines) else " "
    return _Layout(separator, "," if separator != "," and not pointed and any("," in line for line in lines) else ".")


def _points(file: ForeignFile, request: Request) -> _Points:
    lines = [(i, line.strip()) for i, line in enumerate(file.text.split("\n"), start=1)]
    kept = [(i, line) for i, line in lines if line and not line.startswith(_COMMENT)]
    layout = _layout([line for _, line in kept])
    cells = [(i, layout.cells(line)) for i, line in kept]
    width = len(cells[0][1])
    for i, row in cells:
        if len(row) != width:
            expected = f"{width}, as in row {cells[0][0]}; names with blanks need commas as separator"
            raise file.wrong(i, f"{len(row)} cells", expected)
    first = _first_number(file, [row for _, row in cells], layout.decimal, request)
    values = [[_coordinate(file, i, cell, layout.decimal) for cell in row[first : first + 3]] for i, row in cells]
    kinds = _NAMES[len(_NAMES) - first :] if first else ()
    names = {kind: [row[k] for _, row in cells] for k, kind in enumerate(kinds)}
    left = width - first - 3
    notes = (f"{left} columns behind the coordinates were left out",) if left else ()
    return _Points(names, np.array(values), [i for i, _ in cells], notes)


def _coordinate(file: ForeignFile, line: int, cell: str, decimal: str) -> float:
    value = number(cell, decimal)
    if value is None:
        sign = "comma" if decimal == "," else "point"
        raise file.wrong(line, f"a coordinate is '{cell[:40]}'", f"a number with a decimal {sign}, like the others")
    return value


def _first_number(file: ForeignFile, rows: list[list[str]], decimal: str, request: Request) -> int:
    """In which column the coordinates begin: as `names` says, or behind the last text or whole number.

    Raises `InputError` where there are not three numbers, or a name of digits and further columns could both be meant.
    """
    width = len(rows[0])
    if "names" in request.table.data:
        names = request.table.data["names"]
        if names not in range(min(4, width - 2)) or isinstance(names, bool):
            raise request.table.wrong(
                "names", f"how many names stand before the coordinates, 0 to 3, in {width} columns"
            )
        return int(names)
    texts = [k for k in range(width) if _is_name([row[k] for row in rows[:_LOOKED_AT]], decimal)]
    first = 0
    while first in texts:
        first += 1
    while (
        first < min(3, width - 3)
        and all(row[first].isdigit() for row in rows)
        and any(decimal in row[first + 1] for row in rows)
    ):
        first += 1
    if first > 3 or width - first < 3:
        raise InputError(
            f"{file.path}: {width} columns, of which the first {first} are names; expected at most three names "
            "(collection, group, "
            "target) and three coordinates behind them"
        )
    return first


def _is_name(cells: Sequence[str], decimal: str) -> bool:
    """Whether a column holds names: mostly texts, or some texts among whole numbers; a damaged coordinate is none."""
    numbers = [cell for cell in cells if number(cell, decimal) is not None]
    whole = not any(decimal in cell for cell in numbers)
    return len(numbers) < len(cells) and (whole or 2 * len(numbers) < len(cells))


def _unit(file: ForeignFile, request: Request) -> str:
    """The unit as stated, or as the comments name it. Raises `InputError` where it is neither, or both differ."""
    comments = " ".join(
        line for line in file.text.split("\n")[:_LOOKED_AT] if line.strip().startswith(_COMMENT)
    ).casefold()
    written = {
        unit
        for word in _WORD.findall(comments)
        if (unit := _UNITS.get(word) or _UNITS.get(word[:-1]) or _UNITS.get(word[:-2]))
    }
    if "unit" not in request.table.data:
        if len(written) != 1:
            raise InputError(
                f"{request.table.where}: key 'unit' is missing, and {file.path} does not name it; add that of the "
                "export, such as mm"
            )
        return written.pop()
    unit = spelled(request.table.text("unit"))
    if unit is None or conversion(unit, "mm") is None:
        raise request.table.wrong("unit", "a unit of length, such as mm, m or inch")
    if written and unit not in written:
        raise request.table.wrong("unit", f"{' or '.join(sorted(written))}, as the comments of the file say")
    return unit


def _matched(points: _Points, positions: Positions) -> tuple[np.ndarray, tuple[str, ...]]:
    """Row of the positions for each point, -1 where there is none, and what did not match."""
    columns = [kind for kind in points.names if kind in positions.csv]
    if "target" not in columns:
        return by_order(positions, len(points.rows), "points"), ("positions were matched by their order",)
    names = points.names["target"]
    twice, count = Counter(names).most_common(1)[0]
    if count > 1:
        raise InputError(
            f"{positions.csv.source}: target '{twice}' stands in several groups of the points; match by order: "
            "name no column target"
        )
    return by_name(positions, "target", names)


SPATIAL_ANALYZER: Format = SpatialAnalyzer()
