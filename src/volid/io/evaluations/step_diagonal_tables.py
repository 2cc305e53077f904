"""The compensation tables of the nine functions as files of `volid-table/1`, as `volid.load_control` reads them."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from volid.io.basics.atomic import atomic_folder
from volid.io.basics.provenance import sha256
from volid.io.functions_csv import write_csv
from volid.io.tables import TableForm, table_lines, table_sheet
from volid.standards.step_diagonals.separation import NineFunctions
from volid.standards.step_diagonals.tables import tables_of


def save_step_tables(
    nine: NineFunctions, folder: str | Path, *, files: Sequence[str | Path] = (), overwrite: bool = False
) -> None:
    """Nine tables EXX.csv, EYX.csv, … with compensation values into a folder.

    Args:
        nine: The nine functions, as `separate` makes them.
        folder: A new folder, or with `overwrite` an existing one.
        files: Files of the readings, for the record in the tables.
        overwrite: Whether an existing folder is replaced.

    Raises:
        OutputError: the folder exists and `overwrite` is False, or it cannot be written.
    """
    form, machine = TableForm(), nine.steps.machine
    origin = {"machine": f"{machine.name} [{machine.structure.strip().strip('[]')}]"}
    for file in files:
        origin |= {"source": str(file), "source sha256": sha256(file)}
    origin["date"] = datetime.now(UTC).isoformat(timespec="seconds")
    with atomic_folder(folder, overwrite) as place:
        for table in tables_of(nine):
            notes = {f"note {i}": note for i, note in enumerate(table.notes, start=1)}
            header = table_lines(table, form, machine) | origin | {"datum": table.datum} | notes
            with (place / f"{table.function}.csv").open("w", newline="", encoding="utf-8") as stream:
                write_csv(stream, table_sheet(table, form, header))
