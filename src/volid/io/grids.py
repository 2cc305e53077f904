"""Spatial grids as CSV, for people and controls, and as HDF5 (`volid-grid/1`): positions, six components, u, `outside`.

Both forms hold lengths in mm and rotations in DEGREES (ISO/TR 16907 Tables 2 and 3), the first axis varying fastest, absolute
values, and say whether they are error values (actual - nominal) or compensation values (minus that). A cell is empty (NaN) where
the data do not determine the value; `outside` = 1 marks nodes outside what was measured. CSV: lines "# key: value", then the
columns `X,Y,Z,dX,dY,dZ,dA,dB,dC,u_dX,…,u_dC,outside`, with coverage intervals also `U_…`, `low_…`, `high_…`, `shortest_low_…` and
`shortest_high_…`, which a reader leaves aside; of the rotary axes `A,C,dX,…` with A, B, C in degrees. HDF5: the same keys
as attributes of the root (blanks as `_`), and the datasets `positions` (n, axes) [mm or degrees], `values` and `u` (n, 6) [mm,
degrees], their attribute `columns` naming the columns, `outside` (n,). A grid in memory always holds error values, mm and rad;
reading back restores them. One file holds one grid: of a machine with rotary axes on both sides, one file per side.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from volid.compensation.grids.grid import IN_DEGREES, AnyGrid, Grid, RotaryGrid
from volid.compensation.grids.interpolation import grid_positions
from volid.compensation.grids.sides import HEAD, TABLE
from volid.compensation.reversal import reversal_text
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.io.basics.atomic import atomic_output
from volid.io.basics.csv_table import CsvTable, read_csv
from volid.io.basics.hdf5_values import is_hdf5, reading, write_array
from volid.io.basics.toml_table import read_text
from volid.io.functions_csv import (
    INTERVAL,
    INTERVAL_MEANING,
    OUTSIDE,
    REJECTED,
    Sheet,
    read_flags,
    source_lines,
    text_output,
    write_csv,
)
from volid.model.iso230 import DIRECTIONS, LINEAR_AXES, ROTARY_AXES

FORMAT = "volid-grid/1"
ERROR, COMPENSATION = "error", "compensation"
HDF5 = (".h5", ".hdf5")
COLUMNS = tuple(f"d{letter}" for letter in DIRECTIONS)
U_COLUMNS = tuple(f"u_{name}" for name in COLUMNS)
INTERVAL_COLUMNS = tuple(f"{end}_{name}" for end in INTERVAL for name in COLUMNS)
_SIGN = {
    ERROR: "error value = actual - nominal; the compensation value is minus it",
    COMPENSATION: "compensation value = -(actual - nominal); a control that adds it to the command removes the deviation",
}
_POSITION = "the control moves X, Y, Z by d at the functional point; orientation stays as it is"
_APPLIED = {
    "FOR": "the control turns the rotary axes against dA, dB, dC, outside kinematic poles; dX, dY, dZ are 0",
    "L-VOL+": f"{_POSITION.split(';')[0]}, and turns the rotary axes against dA, dB, dC, outside kinematic poles",
    "R-VOL+": f"{_POSITION.split(';')[0]}, and turns the rotary axes against dA, dB, dC, outside kinematic poles",
}
_TOOL = "{} mm; another tool vector t: d(t) = d + (dA, dB, dC in rad) x (t - this tool vector)"
_ROTATED = "; tool vectors as the rotary axes of the head turn them; the linear axes' errors only"
_ROTARY = "R-VOL"
_REFERENCE = "{} mm, in the frame of the body that bears the rotary axes: the machine's, with the linear axes at 0"
_EFFECT = "; at a functional point: d + (dA, dB, dC in rad) x lever arm"
_NAMED = ("format", "type", "values", "frame", "datum")


def grid_header(
    grid: AnyGrid,
    values: str,
    solution: Solution,
    source: str | Path | None = None,
    command: Sequence[str] = (),
) -> dict[str, str]:
    """What a grid file says about itself, enough to make it again (ISO/TR 16907 12).

    `values`: "error" or "compensation"; `source`: the solution's file; `command`: the words of the command line.
    """
    lines = {
        "format": FORMAT,
        "type": grid.type,
        "values": values,
        "sign": _SIGN[values],
        "applied": _APPLIED.get(grid.type, _POSITION),
        "absolute": "absolute values, not increments",
        "reversal": reversal_text(solution, grid),
        "units": f"{_units(grid)} dX, dY, dZ mm; dA, dB, dC degrees; u_… standard uncertainty (k = 1)",
        **(_rotary_lines(grid) if isinstance(grid, RotaryGrid) else _tool_lines(grid, solution)),
        "frame": grid.frame,
        "limits": "; ".join(
            f"{a} {n[0]:g} … {n[-1]:g}, {len(n)} points" for a, n in zip(grid.axes, grid.nodes, strict=True)
        )
        + "; linear interpolation",
    }
    if grid.bands is not None:
        lines["intervals"] = INTERVAL_MEANING
    lines |= source_lines(solution, source) | {"datum": grid.datum}
    if command:
        lines["command"] = shlex.join(command)
    if any(note.startswith(REJECTED) for note in grid.notes):
        del lines[REJECTED]  # said in the notes, which a reader gets back
    return lines | {f"note {i}": note for i, note in enumerate(grid.notes, start=1)}


def _units(grid: AnyGrid) -> str:
    axes = ", ".join(grid.axes)
    return f"{axes} degrees;" if isinstance(grid, RotaryGrid) else f"{axes},"


def _tool_lines(grid: Grid, solution: Solution) -> dict[str, str]:
    rotary = any(not axis.is_linear for axis in solution.machine.axes)
    return {"tool vector": _TOOL.format(_three(grid.tool)) + (_ROTATED if rotary else "")}


def _rotary_lines(grid: RotaryGrid) -> dict[str, str]:
    """Side, reference point, lever arm, and the period of each axis: 360 degrees for one that turns fully, else 0."""
    period = ", ".join(f"{axis} {p:g}" for axis, p in zip(grid.axes, grid.period, strict=True))
    return {
        "side": grid.side,
        "reference point": _REFERENCE.format(_three(grid.reference_point)),
        "lever arm": grid.lever_arm + _EFFECT,
        "period": f"{period} degrees",
    }


def _three(values: Sequence[float]) -> str:
    return ", ".join(f"{v:.12g}" for v in values)


def grid_paths(grids: Sequence[AnyGrid], path: str | Path) -> list[Path]:
    """Where grids go: `path` for one; of several OUT.linear.csv, OUT.table.csv and OUT.head.csv instead of OUT.csv."""
    path = Path(path)
    if len(grids) == 1:
        return [path]
    names = [grid.side for grid in grids]
    several = {n for n in names if names.count(n) > 1}
    parts = [f"{n}.{g.type}" if n in several else n for n, g in zip(names, grids, strict=True)]
    return [path.with_name(f"{path.stem}.{part}{path.suffix}") for part in parts]


def grid_sheet(grid: AnyGrid, header: Mapping[str, str]) -> Sheet:
    """The grid as a table, `header` from `grid_header`; in CSV, components keep 1e-9 mm and 1e-12 degrees."""
    values, u = _outward(grid, header["values"])
    ends = _interval_columns(grid, header["values"])
    columns = INTERVAL_COLUMNS if ends.shape[1] else ()
    rows = zip(grid.positions, values, u, grid.outside.astype(int).tolist(), ends, strict=True)
    return Sheet(
        header=header,
        columns=(*grid.axes, *COLUMNS, *U_COLUMNS, OUTSIDE, *columns),
        rows=([*q.tolist(), *v.tolist(), *s.tolist(), outside, *e.tolist()] for q, v, s, outside, e in rows),
        digits=dict(zip((*COLUMNS, *U_COLUMNS, *INTERVAL_COLUMNS), (9, 9, 9, 12, 12, 12) * 7, strict=True)),
    )


def _interval_columns(grid: AnyGrid, values: str) -> np.ndarray:
    """U and the ends of the coverage intervals, (n, 30) [mm, degrees], (n, 0) without; with the sign the ends change places."""
    if grid.bands is None:
        return np.zeros((len(grid.values), 0))
    ends = grid.bands if values == ERROR else -grid.bands[[1, 0, 3, 2]]
    return np.concatenate([2.0 * grid.u * IN_DEGREES, *(end * IN_DEGREES for end in ends)], axis=1)


def write_grid_hdf5(grid: AnyGrid, header: Mapping[str, str], path: str | Path, overwrite: bool = False) -> None:
    """Write a grid to an HDF5 file, whole or not at all. Raises `OutputError` when `path` cannot be written."""
    with atomic_output(path, overwrite) as temporary, h5py.File(temporary, "w") as file:
        for key, text in header.items():
            file.attrs[key.replace(" ", "_")] = text
        unit = "degrees" if isinstance(grid, RotaryGrid) else "mm"
        write_array(file, "positions", grid.positions, unit=unit).attrs["columns"] = list(grid.axes)
        for name, columns, block in zip(
            ("values", "u"), (COLUMNS, U_COLUMNS), _outward(grid, header["values"]), strict=True
        ):
            write_array(file, name, block, unit="mm, degrees").attrs["columns"] = list(columns)
        write_array(file, OUTSIDE, grid.outside, bool)
        if grid.bands is not None:
            ends = _interval_columns(grid, header["values"])
            write_array(file, "intervals", ends, unit="mm, degrees").attrs["columns"] = list(INTERVAL_COLUMNS)


def save_grid(
    grid: AnyGrid,
    solution: Solution,
    path: str | Path,
    *,
    errors: bool = False,
    source: str | Path | None = None,
    overwrite: bool = False,
) -> None:
    """Write a grid as HDF5 when `path` ends in .h5 or .hdf5, else as CSV: compensation values unless `errors`.

    Raises `OutputError` when `path` exists (unless `overwrite`) or cannot be written.
    """
    header = grid_header(grid, ERROR if errors else COMPENSATION, solution, source)
    if Path(path).suffix.lower() in HDF5:
        write_grid_hdf5(grid, header, path, overwrite)
        return
    with text_output(path, overwrite) as stream:
        write_csv(stream, grid_sheet(grid, header))


def _outward(grid: AnyGrid, values: str) -> tuple[np.ndarray, np.ndarray]:
    """Values with the sign asked for, and u, both (n, 6) [mm, degrees]."""
    sign = {ERROR: 1.0, COMPENSATION: -1.0}[values]
    return sign * grid.values * IN_DEGREES, grid.u * IN_DEGREES


def read_grid(path: str | Path) -> AnyGrid:
    """A grid from CSV or HDF5, as error values in mm and rad whatever the file holds; a `RotaryGrid` for R-VOL.

    Raises `InputError` when the file is damaged or of another format, a header line or column is missing, or the nodes
    are no regular grid with the first axis varying fastest.
    """
    return _read_hdf5(path) if is_hdf5(path) else _read_csv(path)


def _read_hdf5(path: str | Path) -> AnyGrid:
    with reading(path, "grid", FORMAT) as file:
        header = {key.replace("_", " "): str(value) for key, value in file.attrs.items()}
        axes = tuple(str(a) for a in file["positions"].attrs["columns"])
        arrays = [np.asarray(file[name][()]) for name in ("positions", "values", "u", OUTSIDE)]
    return _assemble(str(path), header, axes, *arrays)


def _read_csv(path: str | Path) -> AnyGrid:
    comments = [line[1:].strip() for line in read_text(Path(path)).split("\n") if line.startswith("#")]
    header = dict(line.split(": ", 1) for line in comments if ": " in line)
    table = read_csv(path)
    letters, unit = (ROTARY_AXES, "degrees") if "side" in header else (LINEAR_AXES, "mm")
    axes = tuple(letter for letter in letters if letter in table)
    known = (*axes, *COLUMNS, *U_COLUMNS, OUTSIDE)
    table.only((*known, *INTERVAL_COLUMNS))
    table.require((*COLUMNS, *U_COLUMNS, OUTSIDE), "a grid has them all", known)
    if not axes:
        raise InputError(f"{path}, header: there is no column of positions; expected {' or '.join(letters)}")
    positions = np.stack([table.numbers(a, unit, "every node has a position") for a in axes], axis=1)
    return _assemble(
        str(path), header, axes, positions, _six(table, COLUMNS), _six(table, U_COLUMNS), read_flags(table, OUTSIDE)
    )


def _six(table: CsvTable, names: tuple[str, ...]) -> np.ndarray:
    return np.stack([table.numbers(n, "mm or degrees", "or an empty cell", gaps=True) for n in names], axis=1)


def _assemble(
    path: str,
    header: Mapping[str, str],
    axes: tuple[str, ...],
    positions: np.ndarray,
    values: np.ndarray,
    u: np.ndarray,
    outside: np.ndarray,
) -> AnyGrid:
    rotary = "side" in header or header.get("type") == _ROTARY
    for key in (*_NAMED, *(("side", "reference point", "period") if rotary else ("tool vector",))):
        if key not in header:
            raise InputError(f"{path}: header '{key}' is missing; expected a grid written by volid, '{FORMAT}'")
    if header["format"] != FORMAT:
        raise InputError(f"{path}: format is '{header['format']}'; this volid reads '{FORMAT}'")
    if header["values"] not in _SIGN:
        raise InputError(f"{path}: values are '{header['values']}'; expected {ERROR} or {COMPENSATION}")
    nodes = tuple(np.unique(column) for column in positions.T)
    if not np.array_equal(grid_positions(nodes), positions):
        raise InputError(
            f"{path}: the nodes are no regular grid with {axes[0]} varying fastest; expected every node once"
        )
    sign = 1.0 if header["values"] == ERROR else -1.0
    common: dict[str, Any] = {
        "type": header["type"],
        "axes": axes,
        "nodes": nodes,
        "positions": positions,
        "values": sign * values / IN_DEGREES,
        "u": u / IN_DEGREES,
        "outside": outside,
        "frame": header["frame"],
        "datum": header["datum"],
        "notes": tuple(text for key, text in header.items() if re.fullmatch(r"note \d+", key)),
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
        x, y, z = (float(part) for part in header[key].split(" mm")[0].split(","))
    except ValueError:
        raise InputError(
            f"{path}: {key} is '{header[key]}'; expected three numbers in mm, such as 0, 0, -150 mm"
        ) from None
    return x, y, z


def _period(text: str, axes: tuple[str, ...], path: str) -> tuple[float, ...]:
    try:
        found = dict(part.split() for part in text.removesuffix(" degrees").split(","))
        return tuple(float(found[axis]) for axis in axes)
    except (ValueError, KeyError):
        expected = ", ".join(f"{axis} 360" for axis in axes)
        raise InputError(
            f"{path}: period is '{text}'; expected one of every axis, such as {expected} degrees"
        ) from None
