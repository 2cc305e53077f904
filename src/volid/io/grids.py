"""Spatial grids as CSV, for people and controls, and as HDF5 (`volid-grid/1`): positions, six components, u, `outside`.

Both forms hold absolute values, with lengths in mm and rotations in DEGREES (ISO/TR 16907 Tables 2 and 3), the first axis varying
fastest. They state whether these are error values (actual - nominal) or compensation values (minus that). A cell is empty (NaN)
where the data do not determine the value; `outside` = 1 marks nodes outside what was measured.

A CSV file has lines "# key: value", then the columns `X,Y,Z,dX,dY,dZ,dA,dB,dC,u_dX,…,u_dC,outside`, with coverage intervals also
`U_…`, `low_…`, `high_…`, `shortest_low_…` and `shortest_high_…`, which are not read back. The columns of rotary axes are
`A,C,dX,…` with A, B, C in degrees. An HDF5 file has the same keys as attributes of the root (blanks as `_`), and the datasets
`positions` (n, axes) [mm or degrees], `values` and `u` (n, 6) [mm, degrees], whose attribute `columns` names the columns, and
`outside` (n,). A grid in memory always holds error values in mm and rad, and reading restores them. One file holds one grid; a
machine with rotary axes on both sides has one file per side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from volid.backend.even_points import round_position
from volid.compensation.grids.grid import IN_DEGREES, AnyGrid, Grid, RotaryGrid
from volid.compensation.reversal import reversal_text
from volid.fitting.solution import Solution
from volid.io.basics.hdf5_values import write_array
from volid.io.basics.hdf5_writing import hdf5_output
from volid.io.functions_csv import (
    INTERVAL,
    INTERVAL_MEANING,
    OUTSIDE,
    Sheet,
    text_output,
    write_csv,
)
from volid.io.layouts import ISO, VOLID, check_layout
from volid.io.record import COMPENSATION, ERROR, SIGN, closing_lines, values_lines
from volid.model.iso230 import DIRECTIONS
from volid.model.machine import Machine

FORMAT = "volid-grid/1"
HDF5 = (".h5", ".hdf5")
COLUMNS = tuple(f"d{letter}" for letter in DIRECTIONS)
U_COLUMNS = tuple(f"u_{name}" for name in COLUMNS)
INTERVAL_COLUMNS = tuple(f"{end}_{name}" for end in INTERVAL for name in COLUMNS)
_POSITION = "the control moves X, Y, Z by d at the functional point; orientation stays as it is"
_APPLIED = {
    "FOR": "the control turns the rotary axes against dA, dB, dC, outside kinematic poles; dX, dY, dZ are 0",
    "L-VOL+": f"{_POSITION.split(';')[0]}, and turns the rotary axes against dA, dB, dC, outside kinematic poles",
    "R-VOL+": f"{_POSITION.split(';')[0]}, and turns the rotary axes against dA, dB, dC, outside kinematic poles",
}
_TOOL = "{} mm; another tool vector t: d(t) = d + (dA, dB, dC in rad) x (t - this tool vector)"
_ROTATED = "; tool vectors as the rotary axes of the head turn them; the linear axes' errors only"
_REFERENCE = "{} mm, in the frame of the body that bears the rotary axes: the machine's, with the linear axes at 0"
_EFFECT = "; at a functional point: d + (dA, dB, dC in rad) x lever arm"


def grid_header(
    grid: AnyGrid,
    values: str,
    solution: Solution,
    source: str | Path | None = None,
    command: Sequence[str] = (),
) -> dict[str, str]:
    """The record of a grid file, from which the grid can be made again (ISO/TR 16907 12).

    `values`: "error" or "compensation"; `source`: the solution's file; `command`: the words of the command line.
    """
    lines = grid_lines(grid, values, solution.machine, reversal_text(solution, grid))
    return lines | closing_lines(solution, source, grid.datum, command, grid.notes)


def grid_lines(grid: AnyGrid, values: str, machine: Machine, reversal: str) -> dict[str, str]:
    """What the numbers of a grid are; where they come from is for the maker of the grid to say. `reversal`: in words."""
    lines = {
        "format": FORMAT,
        "type": grid.type,
        **values_lines(values),
        "applied": _APPLIED.get(grid.type, _POSITION),
        "absolute": "absolute values, not increments",
        "reversal": reversal,
        "units": f"{_units(grid)} dX, dY, dZ mm; dA, dB, dC degrees; u_… standard uncertainty (k = 1)",
        **(_rotary_lines(grid) if isinstance(grid, RotaryGrid) else _tool_lines(grid, machine)),
        "frame": grid.frame,
        "limits": "; ".join(
            f"{a} {n[0]:g} … {n[-1]:g}, {len(n)} points" for a, n in zip(grid.axes, grid.nodes, strict=True)
        )
        + "; linear interpolation",
    }
    if grid.bands is not None:
        lines["intervals"] = INTERVAL_MEANING
    return lines


def _units(grid: AnyGrid) -> str:
    axes = ", ".join(grid.axes)
    return f"{axes} degrees;" if isinstance(grid, RotaryGrid) else f"{axes},"


def _tool_lines(grid: Grid, machine: Machine) -> dict[str, str]:
    rotary = any(not axis.is_linear for axis in machine.axes)
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
    """Paths of the files: `path` for one grid; for several OUT.linear.csv, OUT.table.csv and OUT.head.csv instead of OUT.csv."""
    path = Path(path)
    if len(grids) == 1:
        return [path]
    names = [grid.side for grid in grids]
    several = {n for n in names if names.count(n) > 1}
    parts = [f"{n}.{g.type}" if n in several else n for n, g in zip(names, grids, strict=True)]
    return [path.with_name(f"{path.stem}.{part}{path.suffix}") for part in parts]


def grid_sheet(grid: AnyGrid, header: Mapping[str, str], layout: str = VOLID) -> Sheet:
    """The grid as a table, `header` from `grid_header`; in CSV, components keep 1e-9 mm and 1e-12 degrees.

    `layout`: "volid", or "iso" for the columns and the order of ISO/TR 16907 Tables 2 and 3, and no others.
    """
    check_layout(layout)
    if layout == ISO:
        return _as_printed(grid, header)
    values, u = _outward(grid, header["values"])
    ends = _interval_columns(grid, header["values"])
    columns = INTERVAL_COLUMNS if ends.shape[1] else ()
    rows = zip(round_position(grid.positions), values, u, grid.outside.astype(int).tolist(), ends, strict=True)
    return Sheet(
        header=header,
        columns=(*grid.axes, *COLUMNS, *U_COLUMNS, OUTSIDE, *columns),
        rows=([*q.tolist(), *v.tolist(), *s.tolist(), outside, *e.tolist()] for q, v, s, outside, e in rows),
        digits=dict(zip((*COLUMNS, *U_COLUMNS, *INTERVAL_COLUMNS), (9, 9, 9, 12, 12, 12) * 7, strict=True)),
    )


def _as_printed(grid: AnyGrid, header: Mapping[str, str]) -> Sheet:
    """Table 2, X running fastest, or Table 3, the last rotary axis running fastest."""
    columns, rows = (grid.table_2 if isinstance(grid, Grid) else grid.table_3)(errors=header["values"] == ERROR)
    return Sheet(
        header={**header, "layout": ISO},
        columns=columns,
        rows=([int(n), *row] for n, *row in rows.tolist()),
        digits=dict(zip(columns[-6:], (9, 9, 9, 12, 12, 12), strict=True)),
        short=True,
    )


def _interval_columns(grid: AnyGrid, values: str) -> np.ndarray:
    """U and the ends of the coverage intervals, (n, 30) [mm, degrees]; (n, 0) without. A change of sign exchanges the ends."""
    if grid.bands is None:
        return np.zeros((len(grid.values), 0))
    ends = grid.bands if values == ERROR else -grid.bands[[1, 0, 3, 2]]
    return np.concatenate([2.0 * grid.u * IN_DEGREES, *(end * IN_DEGREES for end in ends)], axis=1)


def write_grid_hdf5(grid: AnyGrid, header: Mapping[str, str], path: str | Path, overwrite: bool = False) -> None:
    """Write a grid to an HDF5 file, completely or not at all. Raises `OutputError` when `path` cannot be written."""
    with hdf5_output(path, overwrite) as file:
        for key, text in header.items():
            file.attrs[key.replace(" ", "_")] = text
        unit = "degrees" if isinstance(grid, RotaryGrid) else "mm"
        write_array(file, "positions", round_position(grid.positions), unit=unit).attrs["columns"] = list(grid.axes)
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

    Args:
        grid: A grid that `linear_grid`, `rotary_grids` or `compensate` made.
        solution: The solution from which it was made, for the record in the file.
        path: Path of the file.
        errors: Whether error values are written instead of compensation values.
        source: File of the solution, for the record in the file.
        overwrite: Whether an existing file is replaced.

    Raises:
        OutputError: `path` exists and `overwrite` is False, or it cannot be written.

    Source: ISO/TR 16907 12.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> grid = volid.linear_grid(solution, points=2, tool=(0.0, 0.0, -150.0))
    >>> path = getfixture("tmp_path") / "grid.csv"
    >>> volid.save_grid(grid, solution, path)
    >>> read = volid.load_grid(path)
    >>> read.type, read.tool, bool(abs(read.values - grid.values).max() < 1e-9)
    ('L-VOL', (0.0, 0.0, -150.0), True)
    """
    header = grid_header(grid, ERROR if errors else COMPENSATION, solution, source)
    if Path(path).suffix.lower() in HDF5:
        write_grid_hdf5(grid, header, path, overwrite)
        return
    with text_output(path, overwrite) as stream:
        write_csv(stream, grid_sheet(grid, header))


def _outward(grid: AnyGrid, values: str) -> tuple[np.ndarray, np.ndarray]:
    """Values with the sign asked for, and u, both (n, 6) [mm, degrees]."""
    return SIGN[values] * grid.values * IN_DEGREES, grid.u * IN_DEGREES
