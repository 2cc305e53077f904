"""Calibrated points and their covariance: CSV files that a set names, read into its options and written beside it.

Points: columns `point, x, y, z` [mm], optional `artefact`, and `u` or `u_x, u_y, u_z` [mm], where an empty cell of u says that
the coordinate is exact, and one of x, y, z that it is not calibrated (only for coordinates that `components` leaves out).
Covariance: a column `name` ("P1 x", or "plate P1 x" with several artefacts), then one column for each name, in mm².
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from volid.campaign import ObservationSet
from volid.exceptions import InputError
from volid.io.basics.cells import CellWriter
from volid.io.basics.csv_table import CsvTable, read_csv
from volid.io.basics.toml_table import Table

COORDINATES = ("x", "y", "z")
U = ("u_x", "u_y", "u_z")
POINTS, COVARIANCE = "points", "covariance"
SOLE = "1"  # artefact of a set, or of a file of points, that names none
_PURPOSE = "every calibrated point needs one"


def with_files(
    found: ObservationSet, table: Table, folder: Path, notes: tuple[str, ...] = ()
) -> tuple[ObservationSet, tuple[str, ...]]:
    """The set with the contents of the files that its keys `points` and `covariance` name, and `notes` with how they were read.

    Where set and file have one artefact, and one of them does not name it, it is the same. Raises `InputError`.
    """
    options = dict(found.options)
    if isinstance(options.get(POINTS), str):
        components = str(options.get("components", "XYZ"))
        options[POINTS], how = read_points(folder / table.text(POINTS), components)
        notes = (*notes, *how)
    elif not isinstance(options.get(POINTS), Mapping):
        raise table.wrong(POINTS, 'the name of a file, such as "plate.csv", with columns artefact, point, x, y, z, u')
    if isinstance(options.get(COVARIANCE), str):
        options[COVARIANCE], how = read_covariance(folder / table.text(COVARIANCE))
        notes = (*notes, *how)
    elif not isinstance(options.get(COVARIANCE, {}), Mapping):
        raise table.wrong(COVARIANCE, 'the name of a file, such as "covariance.csv"')
    return _same_artefact(replace(found, options=options)), notes


def _same_artefact(found: ObservationSet) -> ObservationSet:
    """The set whose only artefact, or whose only calibrated artefact, gets the other's name where it has none."""
    points, named = found.options[POINTS], np.unique(found.labels["artefact"]).tolist()
    if len(points) != 1 or len(named) != 1 or named == list(points):
        return found
    (own,), (calibrated,) = named, points
    if calibrated == SOLE:
        return replace(found, options={**found.options, POINTS: {own: points[calibrated]}})
    if own == SOLE:
        return replace(found, labels={**found.labels, "artefact": np.full(len(found), calibrated)})
    return found


def read_points(path: Path, components: str = "XYZ") -> tuple[dict[str, dict[str, list[float]]], tuple[str, ...]]:
    """{artefact: {point: [x, y, z, u_x, u_y, u_z]}} of a CSV file [mm], and how it was read.

    Raises `InputError` naming file and row.
    """
    csv = read_csv(path).renamed({}, (), str(path))
    csv.only(("artefact", "point", *COORDINATES, "u", *U))
    csv.require(("point", *(c for c in COORDINATES if c.upper() in components)), _PURPOSE, tuple(csv.columns))
    if "u" in csv and any(name in csv for name in U):
        raise InputError(
            f"{csv.source}, header: u beside {', '.join(n for n in U if n in csv)}; expected one or the others"
        )
    places = [_coordinate(csv, c, c.upper() not in components) for c in COORDINATES]
    u = [_uncertainty(csv, "u" if "u" in csv else name) for name in U]
    artefacts = csv.labels("artefact", _PURPOSE) if "artefact" in csv else np.full(len(csv), SOLE)
    names = csv.labels("point", _PURPOSE)
    found: dict[str, dict[str, list[float]]] = {}
    for i, row in enumerate(np.stack([*places, *u], axis=1).tolist()):
        artefact, point = str(artefacts[i]), str(names[i])
        if point in found.setdefault(artefact, {}):
            raise InputError(f"{csv.where(i)}: point '{point}' stands twice; expected every point of an artefact once")
        found[artefact][point] = row
    return found, csv.notes


def _coordinate(csv: CsvTable, name: str, may_be_empty: bool) -> np.ndarray:
    if name not in csv:
        return np.zeros(len(csv))
    return (
        np.nan_to_num(csv.numbers(name, "mm", _PURPOSE, gaps=True))
        if may_be_empty
        else csv.numbers(name, "mm", _PURPOSE)
    )


def _uncertainty(csv: CsvTable, name: str) -> np.ndarray:
    if name not in csv:
        return np.zeros(len(csv))
    values = np.nan_to_num(csv.numbers(name, "mm", "leave the cell empty for a coordinate that is exact", gaps=True))
    if (values < 0.0).any():
        i = int(np.argmax(values < 0.0))
        raise InputError(
            f"{csv.where(i)}: {name} is {values[i]:g}; expected a standard uncertainty in mm, not negative"
        )
    return values


def read_covariance(path: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    """{"names": …, "values": …} of a CSV file [mm²], and how it was read. Raises `InputError` where names do not agree."""
    csv = read_csv(path)
    csv.require(("name",), "the first column names the rows", tuple(csv.columns))
    names, columns = csv.labels("name", "every row needs one").tolist(), [n for n in csv.columns if n != "name"]
    if missing := [n for n in (*names, *columns) if n not in names or n not in columns]:
        raise InputError(
            f"{csv.source}: '{missing[0]}' is named in {'a row' if missing[0] in names else 'the header'} only; expected a "
            "square matrix whose rows and columns have the same names"
        )
    values = np.stack([csv.numbers(n, "mm²", "a covariance matrix has no empty cell") for n in names], axis=1)
    return {"names": names, "values": values.tolist()}, csv.notes


def files_of(options: Mapping[str, Any], file: str, taken: list[str]) -> dict[str, str]:
    """Names of the files that hold the calibration of a set whose rows are in `file`, by its key; none is among `taken`."""
    found = {}
    for key in (POINTS, COVARIANCE):
        if options.get(key):
            stem = f"{file.removesuffix('.csv')}.{key}"
            found[key] = f"{stem}.csv" if f"{stem}.csv" not in taken else f"{stem}_.csv"
    return found


def write_file(key: str, options: Mapping[str, Any], path: Path) -> None:
    """Write the points or the covariance of a set."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = CellWriter(file)
        if key == COVARIANCE:
            names = options[key]["names"]
            writer.writerow(["name", *names])
            writer.writerows([name, *row] for name, row in zip(names, options[key]["values"], strict=True))
            return
        writer.writerow(["artefact", "point", *COORDINATES, *U])
        for artefact, points in options[key].items():
            writer.writerows([artefact, point, *_six(row)] for point, row in points.items())


def _six(row: list[float]) -> list[float]:
    u = [0.0] * 3 if len(row) == 3 else list(row[3:]) * (3 if len(row) == 4 else 1)
    return [*row[:3], *u]
