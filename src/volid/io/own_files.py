"""volid's own tables and grids, read together from files and folders as one compensation."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from volid.compensation.grids.grid import AnyGrid
from volid.compensation.package import Compensation
from volid.compensation.tables.error_table import ErrorTable
from volid.exceptions import InputError
from volid.io.basics.csv_table import read_csv
from volid.io.basics.encodings import read_bytes
from volid.io.basics.hdf5_values import is_hdf5, opened
from volid.io.grid_reader import read_grid
from volid.io.grids import FORMAT as GRID_FORMAT
from volid.io.layouts import function_of, is_published_grid
from volid.io.record import read_header
from volid.io.table_reader import read_table
from volid.io.tables import FORMAT as TABLE_FORMAT
from volid.model.iso230 import SPINDLE
from volid.model.machine import Machine

_ENDINGS = (".csv", ".h5", ".hdf5")
_LOOKED_AT = 4096  # bytes: the record stands at the beginning


def is_own(path: str | Path) -> bool:
    """Whether a file says that volid wrote it as a table or grid, or a folder holds such files. Raises `InputError`."""
    path = Path(path)
    if path.is_dir():
        return any(p.is_file() and _says_so(p) for p in path.iterdir() if p.suffix.lower() in _ENDINGS)
    return _says_so(path)


def _says_so(path: Path) -> bool:
    if is_hdf5(path):
        with opened(path, "grid") as file:
            return "format" in file.attributes and file.attributes.text("format") == GRID_FORMAT
    text = read_bytes(path)[:_LOOKED_AT]
    return any(f"format: {tag}".encode() in text for tag in (TABLE_FORMAT, GRID_FORMAT))


def own_compensation(machine: Machine, paths: Iterable[str | Path]) -> Compensation:
    """Tables and grids of volid's own files and of folders of them. Raises `InputError` as `volid.load_control` does."""
    tables, grids = [], []
    for path in own_paths(paths):
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
    return Compensation((), tuple(tables), tuple(grids))


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


def own_paths(paths: Iterable[str | Path]) -> list[Path]:
    """The files that are read: those that are named, and of folders those with the endings of tables and grids."""
    found: list[Path] = []
    for path in map(Path, paths):
        found += sorted(p for p in path.iterdir() if p.suffix.lower() in _ENDINGS) if path.is_dir() else [path]
    return found


def _format(path: Path) -> str:
    """The format that a CSV file states, or that its columns have where it is a published layout."""
    stated = read_header(path).get("format")
    if stated is not None:
        return stated
    names = read_csv(path).columns
    return GRID_FORMAT if is_published_grid(names) else TABLE_FORMAT if function_of(names) else "missing"
