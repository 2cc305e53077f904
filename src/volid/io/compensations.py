"""Complete compensations as files: written to a folder, and read back into a simulated control."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from volid.compensation.control import Control
from volid.compensation.package import Compensation
from volid.controllers.existing.reading import ExistingCompensation
from volid.fitting.solution import Solution
from volid.io.basics.atomic import atomic_folder
from volid.io.control_files import existing_of
from volid.io.functions_csv import write_csv
from volid.io.grids import grid_paths, save_grid
from volid.io.tables import TableForm, table_header, table_sheet
from volid.model.machine import Machine

_KINDS = ("tables", "grids", "axis_tables")  # of a `Compensation`


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


def load_control(
    machine: Machine,
    paths: Iterable[str | Path],
    *,
    cnc: str | None = None,
    sign: str | None = None,
    control_options: Mapping[str, Any] | None = None,
    **options: Any,
) -> Control:
    """A simulated control with the tables and grids of files and folders: volid's own, and files of controls.

    Args:
        machine: The machine whose axes the control moves.
        paths: Paths of tables and grids, and of folders that contain them.
        cnc: Name of the control, one of `volid.CONTROLS`, whose files those that volid did not write are; by default recognised.
        sign: "error" or "compensation" where public sources leave the sign of that control open.
        control_options: Options of that control, see its declaration.
        options: Options of `Control`: tool, increment, clamped, poles, correct_motion, smoothing.

    Raises:
        InputError: a file is neither a table nor a grid of volid nor a file of a control, the machine lacks an axis of one, a
            grid stands in another frame than that of the machine, or there are two tables of one function.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> made = volid.compensate(solution, ["R-POS"], volid.compensation_base(solution, (0.0, 0.0, -150.0)))
    >>> folder = getfixture("tmp_path") / "tables"
    >>> volid.save_compensation(made, solution, folder)
    >>> [table.function for table in volid.load_control(solution.machine, [folder]).tables]
    ['EAA', 'ECC']
    """
    return control_of(machine, existing_of(machine, paths, cnc, sign=sign, options=control_options), **options)


def control_of(machine: Machine, held: Iterable[ExistingCompensation], **options: Any) -> Control:
    """A simulated control that holds existing compensations together; `options`: those of `Control`."""
    held = tuple(held)
    tables, grids, by_axis = ([x for e in held for x in getattr(e.compensation, kind)] for kind in _KINDS)
    return Control(machine, tuple(tables), tuple(grids), axis_tables=tuple(by_axis), **options)
