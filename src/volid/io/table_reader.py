"""Tables read back from CSV (`volid-table/1`), whatever form they were written in; see `volid.io.tables`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from volid.compensation.tables.error_table import ITSELF, MODEL, ErrorTable, added_in_minus
from volid.exceptions import InputError
from volid.io.basics.csv_table import CsvTable, read_csv
from volid.io.basics.units import spelled
from volid.io.functions_csv import OUTSIDE, read_flags
from volid.io.layouts import table_record
from volid.io.record import SIGN, notes_of, read_header, require_keys, units_named
from volid.io.tables import ABSOLUTE, FORMAT, INCREMENTAL
from volid.model.iso230 import parse

_NAMED = ("type", "function", "values", "rows", "applied", "zero", "period", "datum")


def read_table(path: str | Path) -> ErrorTable:
    """A table as error values, absolute, in mm or rad, whatever the file holds.

    Args:
        path: Path of a CSV file that `save_compensation` wrote, or of a table in the layout of ISO/TR 16907 Table 1 below a line
            "# values: error" or "# values: compensation".

    Raises:
        InputError: the file is damaged or of another format, a header line or column is missing, or the positions do not rise.

    >>> path = getfixture("tmp_path") / "EXX.csv"
    >>> keys = ["format: volid-table/1", "type: L-POS", "function: EXX", "values: compensation", "rows: absolute"]
    >>> keys += ["applied: kinematic model", "zero: X = 0 mm", "period: none", "datum: primary axis X"]
    >>> lines = [*(f"# {key}" for key in keys), "X,EXX", "0,0", "100,-0.01", ""]
    >>> _ = path.write_text(chr(10).join(lines))
    >>> read_table(path).forward.tolist()
    [0.0, 0.01]
    """
    table = read_csv(path).renamed({}, (), str(path))
    header = table_record(read_header(path), path, table)
    require_keys(path, header, _NAMED, f"a table written by volid, '{FORMAT}', or lines '# key: value' that say it")
    if "format" in header:
        _expect(path, header, "format", (FORMAT,))
    _expect(path, header, "values", tuple(SIGN))
    _expect(path, header, "rows", (ABSOLUTE, INCREMENTAL))
    _expect(path, header, "applied", (MODEL, ITSELF))
    name = header["function"]
    axis = _axis_of(name, path)
    _check_units(path, header, table, name)
    positions = table.numbers(*_required(table, axis), "mm or degrees", "every row has a position")  # type: ignore[arg-type]
    if np.any(np.diff(positions) <= 0):
        i = int(np.argmax(np.diff(positions) <= 0)) + 1
        raise InputError(f"{table.where(i)}: {axis} is {positions[i]:g}; expected positions that rise from row to row")
    forward, reverse = _values(table, name, header, str(path))
    u = _uncertainties(table, name)
    basis: dict[str, str] = {k: header[k] for k in ("line", "tool vector", "elevation") if k in header}
    off = re.search(r"points (\S+) ", header.get("interpolation", "") + " ")
    return ErrorTable(
        type=header["type"],
        function=name,
        positions=positions,
        forward=forward,
        reverse=reverse,
        u=u,
        outside=read_flags(table, OUTSIDE) if OUTSIDE in table else np.zeros(len(positions), dtype=bool),
        applied=header["applied"],
        interpolation=_number(off[1], "interpolation", header, path) if off and off[1] != "nan" else math.nan,
        basis=basis,
        zero=header["zero"],
        datum=header["datum"],
        period=0.0 if header["period"] == "none" else _number(header["period"], "period", header, path),
        notes=notes_of(header),
    )


def _expect(path: str | Path, header: Mapping[str, str], key: str, values: Sequence[str]) -> None:
    if header[key] not in values:
        raise InputError(f"{path}: {key} is '{header[key]}'; expected {' or '.join(values)}")


def _axis_of(name: str, path: str | Path) -> str:
    try:
        return parse(name).axis
    except InputError as error:
        raise InputError(f"{path}: function: {error}") from None


def _check_units(path: str | Path, header: Mapping[str, str], table: CsvTable, name: str) -> None:
    """Raises `InputError` where the line "# units" names another unit than that of the values, and no column has it."""
    wanted, stated = parse(name).unit, {None, *table.units.values()}
    beside = re.findall(rf"\b{name}(?:\([+-]\))?\s+(mm|rad|deg|degrees|°)(?!\w)", header.get("units", ""))
    named = [u for u in units_named(header) if u not in ("mm", "rad")] + [u for u in beside if u != wanted]
    other = [u for u in named if (spelled(u) or u) not in stated]
    if other:
        raise InputError(
            f"{path}: units name '{other[0]}'; {name} is read in {wanted}: convert its columns, and say so there, or put the "
            f"unit into the name of the column, such as {name} [{other[0]}]"
        )


def _number(text: str, key: str, header: Mapping[str, str], path: str | Path) -> float:
    """The number with which `text`, the value of a header line or a part of it, begins. Raises `InputError` for another one."""
    try:
        value = float(text.split()[0])
    except (ValueError, IndexError):
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{path}: {key} is '{header[key]}'; expected a number, as volid writes it")
    return value


def _required(table: CsvTable, axis: str) -> tuple[str]:
    table.require((axis,), "every row has a position")
    return (axis,)


def _values(table: CsvTable, name: str, header: Mapping[str, str], path: str) -> tuple[np.ndarray, np.ndarray]:
    """Error values approached in + and -, absolute."""
    unit = parse(name).unit
    sign = SIGN[header["values"]]
    sum_up = np.cumsum if header["rows"] == INCREMENTAL else np.asarray

    def column(c: str) -> np.ndarray:
        return np.asarray(sign * sum_up(table.numbers(c, unit, "every row has a value")))

    if f"{name}(+)" in table and f"{name}(-)" in table:
        return column(f"{name}(+)"), column(f"{name}(-)")
    if f"{name}(+)" in table and added_in_minus(name) in table:
        up = column(f"{name}(+)")
        return up, up + sign * table.numbers(added_in_minus(name), unit, "every row has a reversal")
    if f"{name}(+)" in table and f"B_{name}" in table:  # as volid 0.1 wrote it
        up = column(f"{name}(+)")
        return up, up - sign * table.numbers(f"B_{name}", unit, "every row has a reversal value")
    table.require((name,), f"expected {name}, or {name}(+) with {name}(-) or {added_in_minus(name)}")
    mean, half = column(name), 0.0
    if "reversal value" in header:
        half = 0.5 * sign * _number(header["reversal value"], "reversal value", header, path)
    return mean + half, mean - half


def _uncertainties(table: CsvTable, name: str) -> np.ndarray:
    found = [c for c in table.columns if c.startswith("u_")]
    if not found:
        return np.full((len(table), 2), np.nan)
    columns = [table.numbers(c, "mm or rad", "or an empty cell", gaps=True) for c in found]
    return np.stack([columns[0], columns[-1]], axis=1)


def tables_in(folder: str | Path) -> Iterator[ErrorTable]:
    """All tables of a folder, or the one table of a file."""
    path = Path(folder)
    files = sorted(path.glob("*.csv")) if path.is_dir() else [path]
    if not files:
        raise InputError(f"{folder}: holds no table (*.csv); expected a folder of tables, format '{FORMAT}'")
    return (read_table(file) for file in files)
