"""Tables of a PLC program for MC_TableBasedPositionCompensation, as declarations and as columns: written and read."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite

import numpy as np

from volid.compensation.grids.interpolation import period_of
from volid.compensation.tables.axis_table import AxisTable
from volid.controllers.base import Job
from volid.controllers.tables.lists import number
from volid.exceptions import InputError
from volid.model.machine import Machine

BOTH, POSITIVE, NEGATIVE = "WorkDirectionBoth", "WorkDirectionPositive", "WorkDirectionNegative"
ENDINGS = {"": BOTH, "_positive": POSITIVE, "_negative": NEGATIVE}
LARGEST = 1e7  # mm or °
WITHIN = 1e-6  # mm or °: the same position

# ------------------------------------------------------------------------------------------------ writing


def values_of(table: AxisTable, job: Job) -> list[np.ndarray]:
    """Values of both directions, in the unit of the axis and the sense of the file."""
    unit = job.factor * (1.0 if job.machine.axis(table.output).is_linear else 180.0 / np.pi)
    return [unit * table.forward, unit * table.reverse]


def declarations(table: AxisTable, values: Sequence[np.ndarray]) -> str:
    """Declarations of the table of an axis: one for both directions, or one for each."""
    letter, x = table.output, table.positions
    wanted = {"_positive": values[0], "_negative": values[1]} if table.has_reversal else {"": values[0]}
    parts = []
    for ending, column in wanted.items():
        rows = ",\n".join(
            f"        (Position := {number(q)}, Compensation := {number(v)})" for q, v in zip(x, column, strict=True)
        )
        parts.append(
            f"    {letter}_parameter{ending} : ST_PositionCompensationTableParameter := (MinPosition := {number(x[0])}, "
            f"MaxPosition := {number(x[-1])}, NoOfTableElements := {len(x)}, Direction := {ENDINGS[ending]}, "
            f"Modulo := {'TRUE' if table.period else 'FALSE'});\n"
            f"    {letter}_table{ending} : ARRAY[0..{len(x) - 1}] OF ST_PositionCompensationTableElement := [\n{rows}];\n"
        )
    return "".join(parts)


def columns(table: AxisTable, values: Sequence[np.ndarray]) -> str:
    """The same numbers as columns with commas."""
    rows = zip(table.positions, *values, strict=True)
    return "position,positive,negative\n" + "".join(",".join(number(v) for v in row) + "\n" for row in rows)


# ------------------------------------------------------------------------------------------------ reading

Part = tuple[str, str, np.ndarray, np.ndarray]  # axis letter, direction, positions, values as in the file
_COMMENT = re.compile(r"\(\*.*?\*\)|//[^\n]*", re.DOTALL)
_ARRAY = re.compile(
    r"(\w+)\s*:\s*ARRAY\s*\[\s*(-?\d+)\s*\.\.\s*(-?\d+)\s*\]\s*OF\s+ST_PositionCompensationTableElement\s*:=\s*\[([^\]]*)\]\s*;",
    re.IGNORECASE,
)
_PARAMETER = re.compile(r"(\w+)\s*:\s*ST_PositionCompensationTableParameter\s*:=\s*\(([^)]*)\)\s*;", re.IGNORECASE)
_ELEMENT = re.compile(
    r"\(\s*Position\s*:=\s*([^\s,()]+)\s*,\s*Compensation\s*:=\s*([^\s,()]+)\s*\)\s*(?:,|$)", re.IGNORECASE
)


def read_declarations(name: str, text: str) -> Iterator[Part]:
    """Tables of declarations. Raises `InputError` that names file and line."""
    plain = _COMMENT.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), text)
    arrays, parameters = list(_ARRAY.finditer(plain)), {m[1].lower(): m for m in _PARAMETER.finditer(plain)}
    mentioned = len(re.findall(r"ST_PositionCompensationTableElement", plain, re.IGNORECASE))
    if mentioned != len(arrays):
        raise InputError(
            f"{name}: {mentioned} tables are named, {len(arrays)} understood; expected X_table : ARRAY[0..n] OF "
            "ST_PositionCompensationTableElement := [(Position := …, Compensation := …), …];"
        )
    for match in arrays:
        where = f"{name}, line {plain.count(chr(10), 0, match.start()) + 1}: {match[1]}"
        x, y = _elements(where, match)
        yield _letter(where, match[1]), _direction(where, match[1], parameters, x), x, y


def _elements(where: str, match: re.Match[str]) -> tuple[np.ndarray, np.ndarray]:
    content, pairs, at = match[4].strip(), [], 0
    while at < len(content):
        element = _ELEMENT.match(content, at)
        if element is None:
            raise InputError(f"{where}: '{content[at : at + 60]}'; expected (Position := …, Compensation := …)")
        pairs.append([_number(element[k], where) for k in (1, 2)])
        at = element.end() + len(content[element.end() :]) - len(content[element.end() :].lstrip())
    count = int(match[3]) - int(match[2]) + 1
    if len(pairs) != count or not pairs:
        raise InputError(f"{where}: {len(pairs)} elements, but the array has {count}; expected as many")
    table = np.array(pairs)
    if np.any(np.diff(table[:, 0]) <= 0):
        raise InputError(f"{where}: positions do not rise; expected rising positions at equal steps")
    return table[:, 0], table[:, 1]


def _number(text: str, where: str) -> float:
    try:
        found = float(text)
    except ValueError:
        found = float("nan")
    if not isfinite(found) or abs(found) > LARGEST:
        raise InputError(f"{where}: '{text[:40]}'; expected a number")
    return found


def _letter(where: str, variable: str) -> str:
    """The axis of a variable such as X_table or aCompensation_X."""
    found = [part for part in variable.upper().split("_") if part in ("X", "Y", "Z", "A", "B", "C")]
    if len(found) != 1:
        raise InputError(
            f"{where}: the name '{variable}' does not say the axis; expected one such as X_table, or x.csv"
        )
    return found[0]


def _direction(where: str, variable: str, parameters: Mapping[str, re.Match[str]], x: np.ndarray) -> str:
    """The direction in which a table acts, as its parameters say. Raises `InputError` where they do not stand or fit."""
    match = parameters.get(variable.lower().replace("table", "parameter"))
    if match is None:
        raise InputError(
            f"{where}: no ST_PositionCompensationTableParameter of that name; expected it, because it says the direction"
        )
    fields = dict(re.findall(r"(\w+)\s*:=\s*([\w.+-]+)", match[2]))
    stated = {k.lower(): v for k, v in fields.items()}
    if stated.get("nooftableelements") != str(len(x)):
        raise InputError(
            f"{where}: {len(x)} elements, but NoOfTableElements is {stated.get('nooftableelements')}; expected as many"
        )
    for end, at in (("MinPosition", x[0]), ("MaxPosition", x[-1])):
        if end.lower() in stated and abs(_number(stated[end.lower()], f"{where}: {end}") - at) > WITHIN:
            raise InputError(
                f"{where}: {end} is {stated[end.lower()]}, but the table has {at:g} there; expected the same, because public "
                "sources do not say what the control does between them"
            )
    way = stated.get("direction", BOTH).split(".")[-1].lower()
    found = [w for w in (BOTH, POSITIVE, NEGATIVE) if w.lower() == way]
    if not found:
        raise InputError(f"{where}: Direction is '{stated['direction']}'; expected {BOTH}, {POSITIVE} or {NEGATIVE}")
    return found[0]


def read_columns(name: str, text: str) -> Iterator[Part]:
    """Both tables of columns; the name of the file says the axis: x.csv. Raises `InputError` that names file and line."""
    stem = re.split(r"[\\/]", name)[-1].rsplit(".", 1)[0]
    rows = []
    for i, line in enumerate(text.splitlines(), 1):
        words = line.strip().split(",")
        if i == 1 or not line.strip():
            continue
        if len(words) != 3:
            raise InputError(f"{name}, line {i}: {len(words)} columns; expected position, value in +, value in -")
        rows.append([_number(w, f"{name}, line {i}") for w in words])
    table = np.array(rows)
    if not rows or np.any(np.diff(table[:, 0]) <= 0):
        raise InputError(
            f"{name}: no rows, or positions that do not rise; expected a header, and rows with rising positions"
        )
    letter = _letter(name, stem)
    yield letter, POSITIVE, table[:, 0], table[:, 1]
    yield letter, NEGATIVE, table[:, 0], table[:, 2]


def table_of(letter: str, parts: Sequence[Part], factor: float, machine: Machine) -> AxisTable:
    """Both directions of an axis. Raises `InputError` for a direction that stands twice; one that does not stand is 0."""
    axis = machine.axis(letter)
    unit = factor * (1.0 if axis.is_linear else np.pi / 180.0)
    own = [(way, x, y) for a, way, x, y in parts if a == letter]
    nodes = np.unique(np.concatenate([x for _, x, _ in own]))
    columns = []
    for way in (POSITIVE, NEGATIVE):
        acting = [(x, y) for w, x, y in own if w in (way, BOTH)]
        if len(acting) > 1:
            raise InputError(f"twincat-nc: {letter} has {len(acting)} tables for {way}; expected one")
        columns.append(unit * np.interp(nodes, *acting[0]) if acting else np.zeros(len(nodes)))
    return AxisTable(letter, letter, nodes, columns[0], columns[1], period=period_of(axis, nodes))
