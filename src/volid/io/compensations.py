"""Complete compensations as files: written to a folder, and read back into a simulated control."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from volid.compensation.control import Control
from volid.compensation.grids.grid import AnyGrid
from volid.compensation.package import Compensation
from volid.compensation.tables.error_table import ErrorTable
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.io.basics.atomic import atomic_folder
from volid.io.basics.csv_table import read_csv
from volid.io.basics.hdf5_values import is_hdf5
from volid.io.functions_csv import write_csv
from volid.io.grid_reader import read_grid
from volid.io.grids import FORMAT as GRID_FORMAT
from volid.io.grids import grid_paths, save_grid
from volid.io.layouts import function_of, is_published_grid
from volid.io.record import read_header
from volid.io.table_reader import read_table
from volid.io.tables import FORMAT as TABLE_FORMAT
from volid.io.tables import TableForm, table_header, table_sheet
from volid.model.iso230 import SPINDLE
from volid.model.machine import Machine


def save_compensation(
    made: Compensation,
    solution: Solution,
    folder: str | Path,
    *,
    form: TableForm | None = None,
    errors: bool = False,
    source: str | Path | None = None,
    overwrite: bool = False,
) -> None:
    """All tables and grids of a compensation into a folder: EXX.csv, …, grid.linear.csv, …

    Args:
        made: The compensation, as `volid.compensate` makes it.
        solution: The solution from which it was made, for the record in the files.
        folder: A new folder, or with `overwrite` an existing one.
        form: How tables are written.
        errors: Whether error values are written instead of compensation values.
        source: File of the solution, for the record in the files.
        overwrite: Whether an existing folder is replaced.

    Raises:
        OutputError: the folder exists and `overwrite` is False, or it cannot be written.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> base = volid.compensation_base(solution, (0.0, 0.0, -150.0))
    >>> made = volid.compensate(solution, ["R-POS", "R-POR"], base, points=5)
    >>> folder = getfixture("tmp_path") / "control"
    >>> volid.save_compensation(made, solution, folder)
    >>> sorted(path.name for path in folder.iterdir())
    ['EAA.csv', 'ECC.csv', 'grid.csv']
    """
    form = TableForm(errors=errors) if form is None else form
    with atomic_folder(folder, overwrite) as place:
        for table in made.tables:
            sheet = table_sheet(table, form, table_header(table, form, solution, source))
            with (place / f"{table.function}.csv").open("w", newline="", encoding="utf-8") as stream:
                write_csv(stream, sheet)
        for grid, path in zip(
            made.grids, grid_paths(made.grids, place / "grid.csv") if made.grids else [], strict=True
        ):
            save_grid(grid, solution, path, errors=errors, source=source)


def load_control(machine: Machine, paths: Iterable[str | Path], **options: Any) -> Control:
    """A simulated control with the tables and grids of files and folders.

    Args:
        machine: The machine whose axes the control moves.
        paths: Paths of tables and grids, and of folders that contain them.
        options: Options of `Control`: tool, increment, clamped, poles, correct_motion, smoothing.

    Raises:
        InputError: a file is neither a table nor a grid of volid, the machine lacks an axis of one, a grid stands in another
            frame than that of the machine, or there are two tables of one function.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> made = volid.compensate(solution, ["R-POS"], volid.compensation_base(solution, (0.0, 0.0, -150.0)))
    >>> folder = getfixture("tmp_path") / "tables"
    >>> volid.save_compensation(made, solution, folder)
    >>> [table.function for table in volid.load_control(solution.machine, [folder]).tables]
    ['EAA', 'ECC']
    """
    tables, grids = [], []
    for path in _files(paths):
        kind = GRID_FORMAT if is_hdf5(path) else _format(path)
        if kind == TABLE_FORMAT:
            tables.append(_table_of(path, machine))
        elif kind == GRID_FORMAT:
            grids.append(_grid_of(path, machine))
        else:
            raise InputError(
                f"{path}: format is '{kind}'; expected '{TABLE_FORMAT}' or '{GRID_FORMAT}', written by volid"
            )
    names = [t.function for t in tables]
    twice = next((n for n in names if names.count(n) > 1), None)
    if twice:
        raise InputError(f"two tables of {twice}; a control holds one per function. Superimpose them first")
    return Control(machine, tuple(tables), tuple(grids), **options)


def _table_of(path: Path, machine: Machine) -> ErrorTable:
    table = read_table(path)
    _require_axes(path, machine, f"table of {table.function}", (table.axis,))
    return table


def _grid_of(path: Path, machine: Machine) -> AnyGrid:
    grid = read_grid(path)
    _require_axes(path, machine, f"grid over {', '.join(grid.axes)}", grid.axes)
    if grid.frame != "machine":
        raise InputError(f"{path}: frame is '{grid.frame}'; expected machine, in which a control applies the values")
    return grid


def _require_axes(path: Path, machine: Machine, what: str, axes: Iterable[str]) -> None:
    """Raises `InputError` where the machine lacks an axis of a table or grid."""
    lacking = [a for a in axes if a not in (*machine.letters, SPINDLE)]
    if lacking:
        raise InputError(
            f"{path}: {what}, but machine '{machine.name}' has no axis {lacking[0]}; its axes are {', '.join(machine.letters)}"
        )


def _files(paths: Iterable[str | Path]) -> list[Path]:
    found: list[Path] = []
    for path in map(Path, paths):
        found += (
            sorted(p for p in path.iterdir() if p.suffix.lower() in (".csv", ".h5", ".hdf5"))
            if path.is_dir()
            else [path]
        )
    return found


def _format(path: Path) -> str:
    """The format that a CSV file states, or that its columns have where it is a published layout."""
    stated = read_header(path).get("format")
    if stated is not None:
        return stated
    names = read_csv(path).columns
    return GRID_FORMAT if is_published_grid(names) else TABLE_FORMAT if function_of(names) else "missing"
