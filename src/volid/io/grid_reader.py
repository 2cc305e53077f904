"""Spatial grids read back from CSV or HDF5 (`volid-grid/1`), whatever they were written as; see `volid.io.grids`."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite, prod
from pathlib import Path
from typing import Any

import numpy as np

from volid.compensation.grids.grid import IN_DEGREES, AnyGrid, Grid, RotaryGrid
from volid.compensation.grids.interpolation import grid_positions
from volid.compensation.grids.sides import HEAD, TABLE
from volid.exceptions import InputError
from volid.io.basics.csv_table import CsvTable, read_csv
from volid.io.basics.hdf5_group import Group
from volid.io.basics.hdf5_structure import shown
from volid.io.basics.hdf5_values import is_hdf5, reading
from volid.io.functions_csv import OUTSIDE, read_flags
from volid.io.grids import COLUMNS, FORMAT, INTERVAL_COLUMNS, U_COLUMNS
from volid.io.layouts import grid_record, is_as_printed, plain_names
from volid.io.record import SIGN, notes_of, read_header, require_keys, units_named
from volid.model.iso230 import LINEAR_AXES, ROTARY_AXES

_ROTARY = "R-VOL"
_NAMED = ("type", "values", "frame", "datum")


def read_grid(path: str | Path) -> AnyGrid:
    """A grid from CSV or HDF5, as error values in mm and rad whatever the file holds: `Grid`, or `RotaryGrid` for rotary axes.

    Args:
        path: Path of a file that `save_grid` or `volid grid` wrote, or of one in the layout of ISO/TR 16907 Tables 2 or 3 below
            lines "# key: value" that state `values`, and the `tool vector` or `side` and `reference point`.

    Raises:
        InputError: the file is damaged or of another format, a header line or column is missing, or the nodes are no regular
            grid.

    >>> path = getfixture("tmp_path") / "grid.csv"
    >>> keys = ["format: volid-grid/1", "type: L-POS", "values: error", "frame: machine", "datum: X", "tool vector: 0, 0, 0 mm"]
    >>> columns = "X,dX,dY,dZ,dA,dB,dC,u_dX,u_dY,u_dZ,u_dA,u_dB,u_dC,outside"
    >>> rows = ["0" + ",0" * 13, "100,0.01" + ",0" * 12]
    >>> _ = path.write_text(chr(10).join([*(f"# {key}" for key in keys), columns, *rows, ""]))
    >>> grid = read_grid(path)
    >>> grid.side, grid.values[:, 0].tolist()
    ('linear', [0.0, 0.01])
    """
    return _read_hdf5(path) if is_hdf5(path) else _read_csv(path)


def _read_hdf5(path: str | Path) -> AnyGrid:
    with reading(path, "grid", FORMAT) as file:
        header = {key.replace("_", " "): text for key, text in file.attributes.all_texts().items()}
        n = file.length("positions", 2)
        axes = _columns(file, header)
        positions = file.array("positions", (n, len(axes)), finite=True)
        values, u = (file.array(name, (n, len(COLUMNS))) for name in ("values", "u"))
        outside = file.array(OUTSIDE, (n,), bool)
    if np.isinf(values).any() or np.isinf(u).any() or (u < 0.0).any():
        raise InputError(
            f"{path}: values or u are infinite or u is negative; expected numbers, NaN where not determined"
        )
    return _assemble(str(path), header, axes, positions, values, u, outside)


def _columns(file: Group, header: Mapping[str, str]) -> tuple[str, ...]:
    """The axes of a grid, in the order of the columns of its positions."""
    found = file.attributes_of("positions").texts("columns")
    letters = ROTARY_AXES if "side" in header else LINEAR_AXES
    if not found or len(set(found)) < len(found) or not set(found) <= set(letters):
        raise InputError(
            f"{file.place('positions')}, attribute columns: is {', '.join(map(shown, found))}; expected axes out of {letters}"
        )
    return found


def _read_csv(path: str | Path) -> AnyGrid:
    header, table = read_header(path), plain_names(read_csv(path))
    rotary = "side" in header or not any(letter in table for letter in LINEAR_AXES)
    letters, unit = (ROTARY_AXES, "degrees") if rotary else (LINEAR_AXES, "mm")
    axes = tuple(letter for letter in letters if letter in table)
    known = (*axes, *COLUMNS, *U_COLUMNS, OUTSIDE)
    table.only((*known, *INTERVAL_COLUMNS))
    whole = any(name in table for name in U_COLUMNS) or ("format" in header and not is_as_printed(header))
    table.require((*COLUMNS, *((*U_COLUMNS, OUTSIDE) if whole else ())), "a grid has them all", known)
    if not axes:
        raise InputError(f"{path}, header: there is no column of positions; expected {' or '.join(letters)}")
    positions = np.stack([table.numbers(a, unit, "every node has a position") for a in axes], axis=1)
    values = _six(table, COLUMNS)
    u = _six(table, U_COLUMNS) if whole else np.full(values.shape, np.nan)
    outside = read_flags(table, OUTSIDE) if whole else np.zeros(len(values), dtype=bool)
    return _assemble(str(path), grid_record(header, axes), axes, *_in_order(positions, values, u, outside))


def _in_order(positions: np.ndarray, *others: np.ndarray) -> tuple[np.ndarray, ...]:
    """All rows with the first axis varying fastest, whichever does in the file."""
    order = np.lexsort(positions.T)
    return positions[order], *(other[order] for other in others)


def _six(table: CsvTable, names: tuple[str, ...]) -> np.ndarray:
    return np.stack([table.numbers(n, "mm or degrees", "or an empty cell", gaps=True) for n in names], axis=1)


def _check_header(path: str, header: Mapping[str, str], rotary: bool) -> None:
    """Raises `InputError` where the lines of a grid are missing, or say something that is not read."""
    special = ("side", "reference point", "period") if rotary else ("tool vector",)
    require_keys(
        path, header, (*_NAMED, *special), f"a grid written by volid, '{FORMAT}', or lines '# key: value' that say it"
    )
    if header.get("format", FORMAT) != FORMAT:
        raise InputError(f"{path}: format is '{header['format']}'; this volid reads '{FORMAT}'")
    if header["values"] not in SIGN:
        raise InputError(f"{path}: values are '{header['values']}'; expected {' or '.join(SIGN)}")
    if other := [unit for unit in units_named(header) if unit != "mm"]:
        raise InputError(
            f"{path}: units name '{other[0]}'; a grid is read in mm and degrees: convert its columns, and say so there"
        )


def _assemble(
    path: str,
    header: Mapping[str, str],
    axes: tuple[str, ...],
    positions: np.ndarray,
    values: np.ndarray,
    u: np.ndarray,
    outside: np.ndarray,
) -> AnyGrid:
    rotary = "side" in header or header.get("type") == _ROTARY or axes[0] in ROTARY_AXES
    _check_header(path, header, rotary)
    nodes = tuple(np.unique(column) for column in positions.T)
    whole = prod(map(len, nodes)) == len(positions)  # of scattered positions the regular grid would not fit into memory
    if not whole or not np.array_equal(grid_positions(nodes), positions):
        raise InputError(f"{path}: the nodes are no regular grid; expected every combination of positions once")
    common: dict[str, Any] = {
        "type": header["type"],
        "axes": axes,
        "nodes": nodes,
        "positions": positions,
        "values": SIGN[header["values"]] * values / IN_DEGREES,
        "u": u / IN_DEGREES,
        "outside": outside,
        "frame": header["frame"],
        "datum": header["datum"],
        "notes": notes_of(header),
    }
    if not rotary:
        return Grid(**common, tool=_vector(header, "tool vector", path))
    if header["side"] not in (TABLE, HEAD):
        raise InputError(f"{path}: side is '{header['side']}'; expected {TABLE} or {HEAD}")
    return RotaryGrid(
        **common,
        side=header["side"],
        determined=np.isfinite(values),
        reference_point=_vector(header, "reference point", path),
        period=_period(header["period"], axes, path),
    )


def _vector(header: Mapping[str, str], key: str, path: str) -> tuple[float, float, float]:
    try:
        x, y, z = (_finite(part) for part in header[key].split(" mm")[0].split(","))
    except ValueError:
        raise InputError(
            f"{path}: {key} is '{header[key]}'; expected three numbers in mm, such as 0, 0, -150 mm"
        ) from None
    return x, y, z


def _finite(text: str) -> float:
    value = float(text)
    if not isfinite(value):
        raise ValueError
    return value


def _period(text: str, axes: tuple[str, ...], path: str) -> tuple[float, ...]:
    try:
        found = dict(part.split() for part in text.removesuffix(" degrees").split(","))
        return tuple(_finite(found[axis]) for axis in axes)
    except (ValueError, KeyError):
        expected = ", ".join(f"{axis} 360" for axis in axes)
        raise InputError(
            f"{path}: period is '{text}'; expected one of every axis, such as {expected} degrees"
        ) from None
