"""A compensation as files in memory, volid's own tables and grids, and back: for programs that read these themselves."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from volid.compensation.grids.grid import AnyGrid
from volid.compensation.package import Compensation
from volid.compensation.tables.error_table import ErrorTable
from volid.exceptions import InputError
from volid.io.compensations import load_control
from volid.io.functions_csv import Sheet, write_csv
from volid.io.grids import grid_lines, grid_paths, grid_sheet, write_grid_hdf5
from volid.io.record import COMPENSATION, ERROR
from volid.io.tables import TableForm, table_lines, table_sheet
from volid.model.machine import Machine

_ONE = "one value for both directions of approach"
_UNKNOWN = "not stated"


def compensation_files(
    made: Compensation, machine: Machine, *, errors: bool = False, incremental: bool = False, hdf5: bool = False
) -> dict[str, str | bytes]:
    """Tables and grids as volid's own files, content by name: EXX.csv, …, grid.csv or grid.h5.

    `save_compensation` writes the same to a folder, with the record of the solution that they were made from.

    Args:
        made: The compensation, as `volid.compensate` makes it.
        machine: The machine whose axes move.
        errors: Whether error values are written instead of compensation values.
        incremental: Whether tables hold increments from row to row instead of absolute values.
        hdf5: Whether grids are HDF5 files instead of CSV.

    Returns:
        Text of CSV files, bytes of HDF5 files, by the name of the file.

    Raises:
        InputError: the compensation holds tables of axes, which volid's own files do not.

    >>> import numpy as np
    >>> import volid
    >>> machine = volid.load_machine("models/wYXbZt_vertical.toml")
    >>> x, e, u = np.array([0.0, 1000.0]), np.array([0.0, 0.010]), np.zeros((2, 2))
    >>> table = volid.ErrorTable("L-POS", "EXX", x, e, e, u, x > 1e9, "kinematic model", 0.0)
    >>> files = volid.compensation_files(volid.Compensation(("L-POS",), (table,), ()), machine)
    >>> files["EXX.csv"].splitlines()[-1]
    '1000.0,-0.010000000,0.000000000,0'
    """
    if made.axis_tables:
        first = made.axis_tables[0]
        raise InputError(
            f"the table of {first.output} over {first.argument} is one of axes; volid's own files hold error functions and grids"
        )
    form = TableForm(errors=errors, incremental=incremental)
    found: dict[str, str | bytes] = {}
    for table in made.tables:
        found[f"{table.function}.csv"] = _text(table_sheet(table, form, _record_of_table(table, form, machine)))
    names = grid_paths(made.grids, Path("grid.h5" if hdf5 else "grid.csv")) if made.grids else []
    for grid, path in zip(made.grids, names, strict=True):
        header = _record_of_grid(grid, machine, ERROR if errors else COMPENSATION)
        found[path.name] = _bytes(grid, header) if hdf5 else _text(grid_sheet(grid, header))
    return found


def compensation_from_files(files: Mapping[str, str | bytes], machine: Machine) -> Compensation:
    """Tables and grids of error values from volid's own files.

    Args:
        files: Content by name, as `compensation_files` gives it.
        machine: The machine whose axes they move.

    Raises:
        InputError: a file is neither a table nor a grid of volid, or damaged, or the machine lacks an axis of one.

    >>> import volid
    >>> machine = volid.load_machine("models/wYXbZt_vertical.toml")
    >>> text = "# values: error" + chr(10) + "X,EXX" + chr(10) + "0,0" + chr(10) + "1000,0.01" + chr(10)
    >>> volid.compensation_from_files({"EXX.csv": text}, machine).tables[0].forward.tolist()
    [0.0, 0.01]
    """
    with TemporaryDirectory() as folder:
        for name, content in files.items():
            plain = Path(name).name
            (Path(folder) / plain).write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
        try:
            control = load_control(machine, sorted(Path(folder).iterdir()))
        except InputError as error:
            raise InputError(str(error).replace(f"{folder}/", "")) from None
    return Compensation((), control.tables, control.grids, control.axis_tables)


def _record_of_table(table: ErrorTable, form: TableForm, machine: Machine) -> dict[str, str]:
    lines = table_lines(table, form, machine)
    return lines | {"zero": table.zero or _UNKNOWN, "datum": table.datum or _UNKNOWN, **_notes(table.notes)}


def _record_of_grid(grid: AnyGrid, machine: Machine, values: str) -> dict[str, str]:
    return grid_lines(grid, values, machine, _ONE) | {"datum": grid.datum or _UNKNOWN, **_notes(grid.notes)}


def _notes(notes: Iterable[str]) -> dict[str, str]:
    return {f"note {i}": note for i, note in enumerate(notes, start=1)}


def _text(sheet: Sheet) -> str:
    stream = io.StringIO()
    write_csv(stream, sheet)
    return stream.getvalue()


def _bytes(grid: AnyGrid, header: Mapping[str, str]) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "grid.h5"
        write_grid_hdf5(grid, header, path)
        return path.read_bytes()
