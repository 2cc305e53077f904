"""`spatial_analyzer`: points that SpatialAnalyzer exports as text, in its working frame.

A line is `Collection Group Target x y z`, `Group Target x y z`, `Target x y z` or `x y z`, parted by blanks or commas, with
further numbers behind where they were exported; lines with `//` are comments. The coordinates are Cartesian. One frame holds
them all: it is one station."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.units import conversion, spelled
from volid.io.instruments.base import FROM_DESCRIPTIONS, ForeignFile, Format, Found, ReadingsFormat, Request
from volid.io.instruments.numerals import number
from volid.io.instruments.positions import KEY, Positions, by_name, by_order, read_positions

_COMMENT = "//"
_HEADS = ("spatialanalyzer", "spatial analyzer", "new river kinematics")
_NAMES = ("collection", "group", "target")  # from the left; fewer of them are the last ones
_UNITS = {"millimeter": "mm", "millimetre": "mm", "inch": "inch", "meter": "m", "metre": "m", "centimeter": "cm"}
_WORD = re.compile(r"[a-z]+")
_LOOKED_AT = 300  # lines
_STATION = "tracker"


class SpatialAnalyzer(ReadingsFormat):
    """Points of a tracker in one frame, matched to commanded positions."""

    name = "spatial_analyzer"
    words = "points that SpatialAnalyzer exported as text"
    about = (
        "Cartesian x, y, z of targets in the working frame, which counts as one station (station = its name, "
        "tracker by default); "
        "unit = mm, m or inch as chosen at the export; positions = a CSV of commanded positions, matched by its "
        "column target (also "
        f"group, target), or else by order. {FROM_DESCRIPTIONS}"
    )
    keys = (KEY, "unit", "names", "station")

    def recognises(self, text: str) -> bool:
        """Comments that name the program, or lines of names and three numbers under comments with two strokes."""
        lines = [line.strip() for line in text[: 200 * _LOOKED_AT].split("\n")[:_LOOKED_AT] if line.strip()]
        comments = " ".join(line for line in lines if line.startswith(_COMMENT)).casefold()
        rows = [_fields(line) for line in lines if not line.startswith(_COMMENT)]
        points = sum(len(row) >= 3 and _width(row) >= 3 for row in rows)
        named = all(len(row) > _width(row) for row in rows)
        return bool(rows) and points > 0.8 * len(rows) and (bool(comments) or (named and "," not in "".join(lines[:1])))

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
        columns.pop("sphere", None)
        unit = _unit(file, request)
        notes = (*points.notes, f"coordinates in {unit}", *notes)
        return Found("point", columns, [points.rows[i] for i in kept], dict.fromkeys("xyz", unit), notes=notes)


class _Points(NamedTuple):
    """Names by kind, each (n,), coordinates (n, 3), line numbers, and what was left out."""

    names: dict[str, list[str]]
    values: np.ndarray
    rows: list[int]
    notes: tuple[str, ...]


def _fields(line: str) -> list[str]:
    return [cell.strip().strip('"') for cell in line.split(",")] if "," in line else line.split()


def _width(row: Sequence[str]) -> int:
    """How many of the last cells are numbers, up to the first that is none."""
    n = 0
    while n < len(row) and number(row[-1 - n], ".") is not None:
        n += 1
    return n


def _points(file: ForeignFile, request: Request) -> _Points:
    lines = [(i, line.strip()) for i, line in enumerate(file.text.split("\n"), start=1)]
    cells = [(i, _fields(line)) for i, line in lines if line and not line.startswith(_COMMENT)]
    width = len(cells[0][1])
    for i, row in cells:
        if len(row) != width:
            raise file.wrong(
                i, f"{len(row)} cells", f"{width}, as in row {cells[0][0]}; names with blanks need commas as separator"
            )
    first = _first_number(file, [row for _, row in cells], request)
    values = [[_coordinate(file, i, row[first + k]) for k in range(3)] for i, row in cells]
    kinds = _NAMES[len(_NAMES) - first :] if first else ()
    names = {kind: [row[k] for _, row in cells] for k, kind in enumerate(kinds)}
    left = width - first - 3
    notes = (f"{left} columns behind the coordinates were left out",) if left else ()
    return _Points(names, np.array(values), [i for i, _ in cells], notes)


def _coordinate(file: ForeignFile, line: int, cell: str) -> float:
    value = number(cell, ".")
    if value is None:
        raise file.wrong(line, f"a coordinate is '{cell[:40]}'", "a number with a decimal point")
    return value


def _first_number(file: ForeignFile, rows: list[list[str]], request: Request) -> int:
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
    texts = [k for k in range(width) if any(number(row[k], ".") is None for row in rows[:_LOOKED_AT])]
    first = 0
    while first in texts:
        first += 1
    while (
        first < min(3, width - 3)
        and all(row[first].isdigit() for row in rows)
        and any("." in row[first + 1] for row in rows)
    ):
        first += 1
    if first > 3 or width - first < 3:
        raise InputError(
            f"{file.path}: {width} columns, of which the first {first} are names; expected at most three names "
            "(collection, group, "
            "target) and three coordinates behind them"
        )
    return first


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
    if len(set(names)) < len(names):
        twice = next(name for i, name in enumerate(names) if name in names[:i])
        raise InputError(
            f"{positions.csv.source}: target '{twice}' stands in several groups of the points; match by order: "
            "name no column target"
        )
    return by_name(positions, "target", names)


SPATIAL_ANALYZER: Format = SpatialAnalyzer()
