"""The layouts that ISO/TR 16907 prints: Table 1 for one function, Tables 2 and 3 for spatial grids.

    X, EXX(+), EXX(-)                        Table 1; instead of the last column EXX(-)-EXX(+), the reversal that is added for
                                             motion in - (9.2.3)
    n, X, Y, Z, ΔX, ΔY, ΔZ, ΔA, ΔB, ΔC       Table 2, X running fastest
    n, A, C, ΔX, ΔY, ΔZ, ΔA, ΔB, ΔC          Table 3, C running fastest

Lengths are in mm, ΔA, ΔB, ΔC in degrees. Below lines "# key: value" the tables have nothing beside these columns. A table of
others is read too, once such lines say what it does not: `values` (error or compensation), for Table 2 the `tool vector`, for
Table 3 the `side` and the `reference point`, for Table 1 of a rotary axis the `period` (360, or none). Rotations of a Table 1
have their unit in the column's name, ECC(+) [°].
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from volid.compensation.tables.error_table import ITSELF, MODEL
from volid.exceptions import InputError
from volid.io.basics.csv_table import CsvTable
from volid.model.iso230 import DIRECTIONS, LINEAR_AXES, ROTARY_AXES, parse

VOLID, ISO = "volid", "iso"
LAYOUTS = (VOLID, ISO)
_NUMBERS = ("n", "no.", "no", "nr.", "nr")  # of the points
_UNKNOWN = "not stated"
_NOT_STATED = {"datum": _UNKNOWN, "zero": _UNKNOWN, "frame": "machine", "rows": "absolute", "period": "none"}
_GREEK = str.maketrans("∆", "Δ")  # the increment sign and the letter look alike


def check_layout(layout: str) -> None:
    """Raises `InputError` for a layout that there is not."""
    if layout not in LAYOUTS:
        raise InputError(f"`layout={layout}`: expected {' or '.join(LAYOUTS)}")


def is_as_printed(header: Mapping[str, str]) -> bool:
    """Whether a record says that its table has the columns of the Technical Report alone."""
    return header.get("layout") == ISO


def plain_names(table: CsvTable) -> CsvTable:
    """A grid's columns under the names of volid: ΔX, in whatever unit, as dX; without the numbers of the points."""
    known = {f"d{letter}": name for letter in DIRECTIONS for name in table.columns if _is_delta(name, letter)}
    ignored = [name for name in table.columns if name.strip().casefold() in _NUMBERS]
    return table.renamed(known, ignored, table.source)


def _is_delta(name: str, letter: str) -> bool:
    return name.translate(_GREEK).split(" ")[0].split("[")[0].split("(")[0] == f"Δ{letter}"


def is_published_grid(names: Iterable[str]) -> bool:
    """Whether columns are those of Tables 2 or 3."""
    return any(_is_delta(name, "X") or name == "dX" for name in names)


def function_of(names: Iterable[str]) -> str | None:
    """The error function of a Table 1, from its columns; None for no such table."""
    for name in names:
        symbol = name.split("(")[0].strip()
        try:
            parse(symbol)
        except InputError:
            continue
        return symbol
    return None


def grid_record(header: Mapping[str, str], axes: tuple[str, ...]) -> dict[str, str]:
    """The record of a grid: as the file states it, with what a published layout may leave out."""
    if "format" in header:
        return dict(header)
    linear = bool(axes) and axes[0] in LINEAR_AXES
    other = {} if linear else {"period": ", ".join(f"{axis} 0" for axis in axes) + " degrees"}
    return {"type": "L-VOL" if linear else "R-VOL", **_NOT_STATED, **other, **header}


def table_record(header: Mapping[str, str], path: str | Path, table: CsvTable) -> dict[str, str]:
    """The record of a table, likewise. Raises `InputError` where no column tells the function or a rotation's unit."""
    if "format" in header:
        return dict(header)
    function = header.get("function") or function_of(table.columns)
    if function is None:
        raise InputError(f"{path}, header: no column is an error function; expected such as X, EXX(+), EXX(-)")
    stated = dict(_NOT_STATED)
    if _is_rotation(function, path):
        _ask_unit(function, path, table)
    if parse(function).axis in ROTARY_AXES:
        stated.pop("period")  # a table of a full turn repeats, one of a part does not: nothing else tells
    return {"type": _type_of(function), "applied": _applied(function), "function": function, **stated, **header}


def _is_rotation(function: str, path: str | Path) -> bool:
    try:
        return parse(function).is_rotation
    except InputError as error:
        raise InputError(f"{path}: function: {error}") from None


def _ask_unit(function: str, path: str | Path, table: CsvTable) -> None:
    """Raises `InputError` for values of a rotation that may be degrees, rad or µrad."""
    values = [name for name in table.columns if function in name]
    silent = [name for name in values if name not in table.units]
    if silent:
        raise InputError(
            f"{path}, header: {silent[0]} is a rotation without a unit; expected it in the column's name, such as "
            f"{silent[0]} [°], [rad] or [µrad]"
        )


def _is_own(function: str) -> bool:
    """Whether a function is the positioning of its axis."""
    name = parse(function)
    return function[1] == name.axis and name.is_rotation == (name.axis in ROTARY_AXES)


def _applied(function: str) -> str:
    """Who corrects by it: a rotary axis its own positioning, else the kinematic model."""
    return ITSELF if _is_own(function) and parse(function).axis in ROTARY_AXES else MODEL


def _type_of(function: str) -> str:
    """The type of compensation that holds one function, R-POS for one that its own axis corrects."""
    name, own = parse(function), _is_own(function)
    if name.axis in LINEAR_AXES:
        return "L-ANG" if name.is_rotation else "L-POS" if own else "L-STR"
    return "R-POS" if own else "R-ANG" if name.is_rotation else "R-RAX"
