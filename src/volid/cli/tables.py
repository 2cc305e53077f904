"""`volid tables`: error and compensation tables of single functions."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from volid.cli.common import (
    add_output,
    add_solution,
    attention,
    conclude,
    explain,
    print_json,
    tell,
    usable_solution,
)
from volid.cli.compensation_options import (
    add_base,
    add_range,
    add_rounding,
    add_sampling,
    add_types,
    base_from,
    prepared,
    ranges_from,
    sampling_of,
)
from volid.cli.existing_options import add_existing, existing_from, existing_notes, old_tables
from volid.cli.left_over import left_out
from volid.cli.numbers import add_unusual
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.compensation.tables.error_table import ErrorTable
    from volid.compensation.types import CompensationType
    from volid.fitting.solution import Solution
    from volid.io.functions_csv import Sheet
    from volid.io.tables import TableForm

HELP = "error or compensation tables per function, for controls that know single-axis functions"

_WAYS = {"mean": 0.0, "+": 1.0, "-": -1.0}
_EPILOG = """\
One CSV file per function goes into DIR: EXX.csv, EYX.csv, … Values are compensation values, minus
the error values (actual - nominal); --errors writes error values. Types with tables: L-POS, L-STR,
L-SQU along the lines through --at with the base tool (squareness as a slope of the straightness
table), R-POS, R-RAX; L-ANG, L-VOL, R-POR, R-ANG, R-VOL for a control with a kinematic model.
Types that are named together share one table per function.

Points: --step, --max-points, --max-error (fewest points that keep the bound; with --max-points a
bound that cannot be kept is refused), --spacing free for tables that need no equal steps. Rounded
to --increment, also on the running sum of --incremental, so that rounding does not add up.
--add-to sums an existing table or folder of tables, or files of a control, and the new ones;
--add-active takes the files that the campaign names as active.

example:
  volid tables solution.h5 --type L-POS --at X=500,Y=300,Z=-250 -o tables
  volid tables solution.h5 --type L-STR --type L-SQU --max-error 0.0005 --incremental -o tables

Tables span the measured part of the travels, or --range. --layout iso writes the columns of ISO/TR
16907 Table 1 and no others below the lines that begin with #: zero at position 0 (or the lower end,
or --zero) approached in +; with --reversal difference the second column is added for motion in -.

exit status: 0 good; 1 written, but a sum with --add-to reaches beyond what was measured or the model
is rejected; 1 and nothing written when the data do not determine a function; 2 bad input, also
points outside what was measured without --extrapolate
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    add_types(parser)
    add_base(parser, "base tool vector, mm; default: the most used one; L-ANG and L-VOL demand it")
    add_sampling(parser, "points")
    parser.add_argument(
        "--spacing", choices=("equal", "free"), default="equal", help="equal or free steps; default equal"
    )
    parser.add_argument("--errors", action="store_true", help="error values instead of compensation values")
    parser.add_argument("--incremental", action="store_true", help="increments from row to row")
    parser.add_argument(
        "--reversal",
        choices=("columns", "value", "difference"),
        default="columns",
        help="both directions as columns (default), one value per axis, or as second column the reversal that is "
        "added for motion in -",
    )
    add_rounding(parser, "tables of an axis (default: --at)")
    parser.add_argument(
        "--approach", choices=("mean", "+", "-"), help="how the position of --zero is approached; default mean, iso: +"
    )
    parser.add_argument(
        "--layout", choices=("volid", "iso"), default="volid", help="columns: volid's or those of Table 1"
    )
    add_existing(parser)
    add_range(parser, "points")
    add_unusual(parser)
    add_output(parser, "DIR", "folder for the tables", required=True)


def run(args: argparse.Namespace) -> int:
    """Read, tabulate, write; 1 when values need attention. Raises `InputError`, `OutputError`, `NotDeterminedError`."""
    from volid.io.basics.atomic import atomic_folder

    form = _form(args)
    _refuse_existing(args)
    with Progress() as progress:
        progress("reading the solution")

        solution = usable_solution(args.solution)
        progress("tabulating")
        tables, notes = _tables(solution, args)
        sheets = _sheets(tables, form, solution, args, notes)
        _refuse_others(Path(args.output), sheets)
        with atomic_folder(args.output, args.force) as folder:
            _write(sheets, folder)
    if args.json:
        found = [{"header": dict(s.header), "columns": s.columns, "rows": list(s.rows)} for s in sheets.values()]
        print_json({"tables": found})
    else:
        _print(tables, form, args)
    tell(args, notes)
    return conclude(args, attention(solution, named=True) + _messages(tables, args))


def _refuse_existing(args: argparse.Namespace) -> None:
    """Raises `OutputError` before the work begins."""
    from volid.exceptions import OutputError

    if Path(args.output).exists() and not args.force:
        raise OutputError(f"{args.output} exists; choose another name or pass --force")


def _form(args: argparse.Namespace) -> TableForm:
    from math import radians

    from volid.exceptions import InputError
    from volid.io.tables import TableForm

    if args.approach and not (args.zero or args.layout == "iso"):
        raise InputError(
            f"--approach {args.approach} says how the position of --zero is approached; add --zero, or leave it out"
        )
    angle = None if args.angle_increment is None else radians(args.angle_increment)
    return TableForm(args.errors, args.incremental, args.reversal, args.increment, angle, args.layout)


def _tables(solution: Solution, args: argparse.Namespace) -> tuple[tuple[ErrorTable, ...], list[str]]:
    """The tables, and notes about them. Raises `InputError`, `NotDeterminedError`."""
    from volid.compensation.ranges import cut_notes, refuse_extrapolation
    from volid.compensation.superposition import add_tables
    from volid.compensation.tables.by_function import error_tables
    from volid.exceptions import InputError

    types = _types(solution, args)
    tool = solution.most_used_tool() if args.tool is None else args.tool
    solution, notes = prepared(solution, args, [tool])
    base, ranges = base_from(solution, args, tool), ranges_from(solution, args)
    zero, approach = _zero(args, ranges)
    tables = error_tables(solution, types, base, sampling_of(args, args.spacing), zero, ranges, approach)
    if not tables:
        raise InputError(f"--type {', '.join(args.type)}: the model has no function that it corrects; nothing to write")
    if not args.extrapolate:
        refuse_extrapolation(solution, tables, base, ranges)
    notes += cut_notes(solution, ranges, [t.axis for t in tables])
    existing = existing_from(solution, args)
    notes += [*existing_notes(solution, existing), *left_out(args.add_to, existing)]
    return add_tables(tables, old_tables(solution.machine, existing)), notes


def _zero(args: argparse.Namespace, ranges: dict[str, tuple[float, float]]) -> tuple[dict[str, float] | None, float]:
    """Where tables are zero, and how that position is approached; Table 1 is zero at 0, or at the lower end, in +."""
    if args.layout == "volid":
        return args.zero, _WAYS[args.approach or "mean"]
    at_zero = {letter: 0.0 if low <= 0.0 <= high else low for letter, (low, high) in ranges.items()}
    return {**at_zero, **(args.zero or {})}, _WAYS[args.approach or "+"]


def _types(solution: Solution, args: argparse.Namespace) -> tuple[CompensationType, ...]:
    """The types asked for. Raises `InputError`, also for one that needs a tool vector without it."""
    from volid.compensation.types import select
    from volid.exceptions import InputError

    types = select(args.type, solution.machine)
    needing = next((t.name for t in types if t.name in ("L-ANG", "L-VOL")), None)
    if needing and args.tool is None:
        raise InputError(
            f"--type {needing} needs the tool vector of its lines, because angular errors act through it; give --tool x,y,z, "
            "such as --tool 0,0,-150"
        )
    return types


def _sheets(
    tables: tuple[ErrorTable, ...], form: TableForm, solution: Solution, args: argparse.Namespace, notes: list[str]
) -> dict[str, Sheet]:
    from volid.io.tables import table_header, table_sheet

    sheets = {}
    for table in tables:
        header = table_header(table, form, solution, args.solution, args.command_line)
        header |= {f"note {len(table.notes) + i}": note for i, note in enumerate(notes, start=1)}
        sheet = table_sheet(table, form, header)
        sheets[f"{table.function}.csv"] = sheet._replace(rows=list(sheet.rows))
    return sheets


def _refuse_others(folder: Path, sheets: dict[str, Sheet]) -> None:
    """Raises `OutputError` when old tables would stay beside the new ones, where a control would read them too."""
    from volid.exceptions import OutputError

    others = sorted(p.name for p in folder.glob("*.csv") if p.name not in sheets) if folder.is_dir() else []
    if others:
        raise OutputError(
            f"{folder} holds other tables ({', '.join(others[:5])}); choose another folder or remove them"
        )


def _write(sheets: dict[str, Sheet], folder: Path) -> None:
    from volid.io.functions_csv import write_csv

    for name, sheet in sheets.items():
        with (folder / name).open("w", newline="", encoding="utf-8") as stream:
            write_csv(stream, sheet)


def _print(tables: tuple[ErrorTable, ...], form: TableForm, args: argparse.Namespace) -> None:
    from volid.io.tables import written_values
    from volid.report.text.basics import micro, table, unit_of

    rows = []
    for t in tables:
        loss = written_values(t, form)[2]
        off = [micro(v, t.unit, 3) for v in (t.interpolation, loss)]
        rows.append([t.function, t.type, str(len(t.positions)), *off, unit_of(t.unit)])
    print("\n".join(table(["table", "type", "points", "interpolation", "rounding", ""], rows, left=2, right=1)))
    print(f"{len(tables)} tables written: {args.output}")


def _messages(tables: tuple[ErrorTable, ...], args: argparse.Namespace) -> list[str]:
    out = [t for t in tables if t.outside.any()]
    if not out or args.extrapolate:
        return []
    points = ", ".join(f"{t.function} {int(t.outside.sum())} of {len(t.outside)}" for t in out)
    return [
        f"points outside the measured positions: {points}: extrapolated (outside = 1). Measure there, or accept with "
        f"--extrapolate"
    ]
