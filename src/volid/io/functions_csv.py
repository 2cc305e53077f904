"""Tables of a solution as CSV: points to evaluate, deviations at them, error functions.

POINTS.csv has the machine's axis letters (mm or degrees), `tool_x,tool_y,tool_z` (mm) and optional `X_dir`, … (+1, -1, 0);
the table of deviations repeats it and adds `ex,ey,ez` (mm), `ea,eb,ec` (rad), their `u_…`, and `outside`: 1 where the position
lies outside what was measured. From a solution with Monte Carlo samples both tables also hold U = 2 u and the ends of 95 %
coverage intervals, `low`, `high` (symmetric in probability), `shortest_low`, `shortest_high`. Lines that begin with # say what
the numbers are and where they come from; a cell is empty where the data do not determine the value. Numbers keep all digits.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

import numpy as np

from volid.backend.even_points import DIGITS, round_position
from volid.exceptions import InputError, shown
from volid.fitting.results import Deviations, FunctionValue
from volid.fitting.solution import Solution
from volid.io.basics.atomic import atomic_output
from volid.io.basics.cells import CellWriter, header_line
from volid.io.basics.csv_table import CsvTable, read_csv
from volid.io.basics.hdf5_values import to_json
from volid.io.basics.provenance import sha256
from volid.io.campaign.sets import TOOL_COLUMNS, read_directions
from volid.model.axis_lines import AXIS_LINE
from volid.model.error_functions import describe_datum
from volid.model.iso230 import parse
from volid.model.machine import Machine
from volid.uncertainty.lack_of_fit import lack_of_fit, verdict_words

if TYPE_CHECKING:  # what these stand on takes long to import
    from volid.uncertainty.budget import Line
    from volid.uncertainty.coverage import Intervals
    from volid.uncertainty.intervals import Bands

DEVIATIONS = ("ex", "ey", "ez", "ea", "eb", "ec")
UNCERTAINTIES = tuple(f"u_{name}" for name in DEVIATIONS)
OUTSIDE = "outside"
REJECTED = "MODEL REJECTED"
FUNCTION_COLUMNS = ("function", "axis", "position", "direction", "value", "u")
BUDGET_COLUMNS = (
    "output", "position", "unit", "u", "source", "u_source", "u_source_unit", "sensitivity", "contribution", "share",
)  # fmt: skip
INTERVAL = ("U", "low", "high", "shortest_low", "shortest_high")
DEVIATION_INTERVALS = tuple(f"{end}_{name}" for end in INTERVAL for name in DEVIATIONS)
INTERVAL_MEANING = "95 % coverage intervals by Monte Carlo: low … high symmetric in probability, and shortest; U = 2 u"
_UNITS = ("mm",) * 3 + ("rad",) * 3


class Points(NamedTuple):
    """Where to evaluate: `positions` (m, n_axes), machine axis order; `tool` (m, 3) [mm]; `directions` (m, n_axes).

    `columns`: the file's cells as they stand, by column name; `notes`: how a file of another form was read.
    """

    positions: np.ndarray
    tool: np.ndarray
    directions: np.ndarray
    columns: dict[str, tuple[str, ...]]
    notes: tuple[str, ...] = ()


class Sheet(NamedTuple):
    """A table before it is written: its record, column names, and rows of numbers and texts.

    NaN stands for what the data do not determine. `digits`: decimal places of columns that are not to keep all digits; `short`:
    without zeros at their end.
    """

    header: Mapping[str, str]
    columns: tuple[str, ...]
    rows: Iterable[Sequence[Any]]
    digits: Mapping[str, int] = {}
    short: bool = False


@contextmanager
def text_output(path: str | Path, overwrite: bool = False) -> Iterator[TextIO]:
    """A text file that appears completely or not at all. Raises `OutputError` when `path` exists or cannot be written."""
    with atomic_output(path, overwrite) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        yield stream


def read_points(path: str | Path, machine: Machine, *, tools: bool = True) -> Points:
    """Points to evaluate, from POINTS.csv. Raises `InputError` naming the column, or the row and what it holds.

    Without `tools` the tool vector may be left out, and is 0 then.
    """
    table = read_csv(path).renamed({}, (), str(path))
    table.only(_point_columns(machine))
    return _points(table, machine, tools)


def _point_columns(machine: Machine) -> tuple[str, ...]:
    return (*machine.letters, *TOOL_COLUMNS, *(f"{letter}_dir" for letter in machine.letters))


def _points(table: CsvTable, machine: Machine, tools: bool = True) -> Points:
    known, purpose = _point_columns(machine), "every point needs one"
    table.require(machine.letters, "a point needs a position of every axis", known)
    tools = tools or any(name in table for name in TOOL_COLUMNS)
    if tools:
        table.require(TOOL_COLUMNS, "a point needs its tool vector in mm, because the deviation depends on it", known)
    positions = np.stack([table.numbers(axis.letter, axis.unit, purpose) for axis in machine.axes], axis=1)
    vectors = [table.numbers(name, "mm", purpose) for name in TOOL_COLUMNS] if tools else np.zeros((3, len(table)))
    tool = np.stack(list(vectors), axis=1)
    directions = read_directions(table, machine)
    columns = {name: cells for name, cells in table.columns.items() if name in known}
    if table.notes:  # cells in another form are written in the plain one
        numbers = np.concatenate([positions, tool, directions], axis=1).T
        plain = dict(
            zip((*machine.letters, *TOOL_COLUMNS, *(f"{a}_dir" for a in machine.letters)), numbers, strict=True)
        )
        columns = {name: tuple(map(repr, plain[name].tolist())) for name in columns}
    return Points(positions, tool, directions, columns, table.notes)


def source_lines(solution: Solution, source: str | Path | None = None) -> dict[str, str]:
    """What every table says about its origin; `source`: the solution's file."""
    machine, campaign = solution.machine, solution.campaign
    lines = {
        "verdict": verdict_words(solution),
        "datum": describe_datum(solution.machine, solution.datum),
        "machine": f"{machine.name} [{machine.structure.strip().strip('[]')}]",
        "campaign": campaign.title,
        "conditions": to_json(campaign.conditions) if campaign.conditions else "not recorded",
        "measured": ", ".join(
            f"{axis.letter} {low:g} … {high:g} {axis.unit}"
            for axis, (low, high) in sorted(
                zip(machine.axes, solution.measured_range(), strict=True), key=lambda pair: pair[0].letter
            )
        ),
    }
    if source is not None:
        lines |= {"source": shown(str(source)), "source sha256": sha256(source)}
    lines["lack of fit"] = str(lack_of_fit(solution))
    if solution.unseen:
        lines["attention"] = " ".join(f"{text}." for text in solution.unseen)
    if not solution.statistics.converged:
        lines["NOT CONVERGED"] = "the iteration stopped early; do not use these numbers"
    lines["date"] = datetime.now(UTC).isoformat(timespec="seconds")
    if solution.adequacy.rejected:
        lines[REJECTED] = solution.adequacy.verdict
    return lines


def write_csv(stream: TextIO, sheet: Sheet) -> None:
    """Lines "# key: value" (line breaks inside a value become blanks), a row of column names, and the rows."""
    for key, value in sheet.header.items():
        stream.write(header_line(key, value) + "\n")
    writer = CellWriter(stream)
    writer.writerow(sheet.columns)
    digits = [sheet.digits.get(name) for name in sheet.columns]
    write = _short_cell if sheet.short else _cell
    writer.writerows([write(v, n) for v, n in zip(row, digits, strict=True)] for row in sheet.rows)


def _cell(value: Any, digits: int | None) -> str:
    """A text as it stands; a number with all its digits or a fixed number of decimal places; empty for NaN."""
    if not isinstance(value, float):
        return str(value)
    if math.isnan(value):
        return ""
    return repr(value + 0.0) if digits is None else f"{round(value, digits) + 0.0:.{digits}f}"


def _short_cell(value: Any, digits: int | None) -> str:
    text = _cell(value, digits if digits is not None or not isinstance(value, float) else DIGITS)
    return text.rstrip("0").rstrip(".") if isinstance(value, float) else text


def round_place(position: float) -> float:
    """One position [mm or degrees] as it is written; NaN for none stays NaN."""
    return float(round_position(np.array(position)))


def deviations_sheet(
    points: Points,
    found: Deviations,
    solution: Solution,
    source: str | Path | None = None,
    intervals: Bands | None = None,
) -> Sheet:
    """Deviations at points, with standard uncertainties; the points' own columns stand as they were given.

    `intervals`: coverage intervals, from a solution with samples.
    """
    values = (
        "deviation of the functional point, actual - nominal, machine frame: ex, ey, ez mm; orientation ea, eb, ec rad"
    )
    meaning = {"values": values, "u": "standard uncertainty (k = 1); an empty cell is not determined by the data"}
    given = zip(*points.columns.values(), strict=True)
    extra = np.concatenate([2.0 * found.u, *intervals], axis=1) if intervals else np.zeros((len(found.u), 0))
    numbers = zip(
        found.values.tolist(), found.u.tolist(), found.outside.astype(int).tolist(), extra.tolist(), strict=True
    )
    return Sheet(
        header=meaning | ({"intervals": INTERVAL_MEANING} if intervals else {}) | source_lines(solution, source),
        columns=(*points.columns, *DEVIATIONS, *UNCERTAINTIES, OUTSIDE, *(DEVIATION_INTERVALS if intervals else ())),
        rows=(
            [*(c.strip() for c in cells), *e, *u, outside, *more]
            for cells, (e, u, outside, more) in zip(given, numbers, strict=True)
        ),
    )


def read_deviations(path: str | Path, machine: Machine) -> tuple[Points, Deviations]:
    """What was written from `deviations_sheet`. Raises `InputError` naming the column or row that is wrong."""
    table = read_csv(path)
    columns = (*DEVIATIONS, *UNCERTAINTIES, OUTSIDE)
    table.only((*_point_columns(machine), *columns, *DEVIATION_INTERVALS))
    table.require(columns, "a table of deviations has them all", _point_columns(machine))
    values, u = (
        np.stack(
            [table.numbers(n, unit, "or an empty cell", gaps=True) for n, unit in zip(names, _UNITS, strict=True)], 1
        )
        for names in (DEVIATIONS, UNCERTAINTIES)
    )
    return _points(table, machine), Deviations(values, u, np.isfinite(values), read_flags(table, OUTSIDE))


def read_flags(table: CsvTable, name: str) -> np.ndarray:
    """A column of 0 and 1, as bool (m,). Raises `InputError` naming the row that holds something else."""
    values = table.numbers(name, "0 or 1", "a flag")
    wrong = ~np.isin(values, (0.0, 1.0))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InputError(f"{table.where(i)}: {name} is {values[i]:g}; expected 0 or 1")
    return values == 1.0


def functions_sheet(
    rows: Sequence[FunctionValue],
    solution: Solution,
    source: str | Path | None = None,
    intervals: Intervals | None = None,
) -> Sheet:
    """Tabulated error functions and location errors; a location error has an empty position, and the value of its axis line.

    `intervals`: coverage intervals, from a solution with samples.
    """
    meaning = {
        "values": "error functions, tool relative to workpiece, and constants; translations mm, rotations rad",
        "location errors": f"{AXIS_LINE} (ISO 230-1), at the axis's nominal point",
        "u": "standard uncertainty (k = 1); an empty cell is not determined by the data",
        "direction": "approach direction, +1 or -1; 0: both alike (mean)",
    }
    rows = [row._replace(position=round_place(row.position)) for row in rows]
    if intervals is None:
        return Sheet(meaning | source_lines(solution, source), FUNCTION_COLUMNS, (tuple(row) for row in rows))
    ends = zip(*(column.tolist() for column in intervals), strict=True)
    return Sheet(
        meaning | {"intervals": INTERVAL_MEANING} | source_lines(solution, source),
        (*FUNCTION_COLUMNS, *INTERVAL),
        [(*row, 2.0 * row.u, *end) for row, end in zip(rows, ends, strict=True)],
    )


def budget_sheet(lines: Sequence[Line], solution: Solution, source: str | Path | None = None) -> Sheet:
    """The uncertainty budget, one row per output and source; NaN where a source has no single u."""
    meaning = {
        "values": "contributions to the standard uncertainty u (k = 1), in the unit of the output; their squares add up to u²",
        "location errors": AXIS_LINE,
        "sensitivity": "contribution / u_source; an empty cell: the source has members of several u",
    }
    placed = (line._replace(position=round_place(line.position)) for line in lines)
    return Sheet(meaning | source_lines(solution, source), BUDGET_COLUMNS, [tuple(line) for line in placed])


def read_functions(path: str | Path) -> list[FunctionValue]:
    """What was written from `functions_sheet`. Raises `InputError` naming the column or row that is wrong."""
    table = read_csv(path)
    table.only((*FUNCTION_COLUMNS, *INTERVAL))
    table.require(FUNCTION_COLUMNS, "a table of error functions has them all", FUNCTION_COLUMNS)
    names = table.labels("function", "expected an ISO 230-1 symbol").tolist()
    for i, name in enumerate(names):
        try:
            parse(name)
        except InputError as error:
            raise InputError(f"{table.where(i)}: {error}") from None
    position, value, u = (
        table.numbers(n, unit, "or an empty cell", gaps=True).tolist()
        for n, unit in (("position", "mm or degrees"), ("value", "mm or rad"), ("u", "mm or rad"))
    )
    direction = table.numbers("direction", "steps of one", "expected +1, -1 or 0").astype(int).tolist()
    axes = table.labels("axis", "expected an axis letter").tolist()
    return [FunctionValue(*row) for row in zip(names, axes, position, direction, value, u, strict=True)]
