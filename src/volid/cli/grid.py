"""`volid grid`: spatial compensation or error grids."""

from __future__ import annotations

import argparse
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING

from volid.cli.common import (
    HDF5,
    add_output,
    add_solution,
    attention,
    check_output,
    conclude,
    explain,
    print_json,
    tell,
    usable_solution,
    write_sheets,
)
from volid.cli.compensation_options import (
    add_base,
    add_range,
    add_rounding,
    add_sampling,
    base_from,
    prepared,
    ranges_from,
    rule_from,
    sampling_of,
)
from volid.cli.existing_options import add_existing, existing_from, existing_notes, old_grids
from volid.cli.grid_messages import LINEAR, ROTARY, described, messages_of, reversal_lines
from volid.cli.left_over import left_out
from volid.cli.numbers import add_unusual, count, place
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.compensation.grids.grid import AnyGrid
    from volid.compensation.types import CompensationType
    from volid.controllers.existing.reading import ExistingCompensation
    from volid.fitting.solution import Solution

HELP = "spatial grid of compensation (or error) values over the working volume"

_EPILOG = """\
Every type of ISO/TR 16907 but R-POS has a grid; default L-VOL, repeat --type to combine types.
Compensation values are minus the error values (actual - nominal); --errors writes the error
values. The grid spans the measured part of the travels, or --range, both ends included, the first
axis varying fastest; translations in mm, rotations in degrees. Lines that begin with # state type,
sign, tool vector or reference point, frame, datum, source and command. OUT is CSV, or HDF5 when it
ends in .h5.

A linear grid holds for one tool vector; with rotary axes, for a rotated one and the linear axes'
errors only. A rotary grid (ISO/TR 16907 Table 3) holds at a reference point; the lever arm from it
is stated. Several grids, whose effects add up, become OUT.linear.csv, OUT.table.csv, OUT.head.csv.
FOR, L-VOL+ and R-VOL+ turn rotary axes by the rotations of their grids. --layout iso writes n, the
positions, ΔX … ΔC and no more, in linear grids X running fastest, in rotary ones the last axis.

example:
  volid grid solution.h5 --type L-VOL --step 50 --tool 0,0,-150 -o grid.csv
  volid grid solution.h5 --type R-VOL --step 10 --reference-point 0,0,0 -o rotary.csv

exit status: 0 good; 1 written, but rotations are not determined, a sum with --add-to reaches beyond
what was measured, the model leaves out error functions, or is rejected; 1 and nothing written when
the data do not determine the translations; 2 bad input, also nodes outside what was measured
without --extrapolate
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument(
        "--type", action="append", metavar="TYPE", help="type of compensation; default L-VOL; repeat it"
    )
    parser.add_argument(
        "--points", metavar="N", type=count(2, 1_000_000), help="nodes per axis; default 21, rotary axes 37"
    )
    add_sampling(parser, "nodes")
    add_base(parser, "tool vector, mm; default: the most used one of the campaign")
    parser.add_argument(
        "--reference-point",
        metavar="x,y,z",
        type=place,
        help="of rotary grids, mm, machine frame, linear axes at 0; default: on the rotary axis nearest the bed",
    )
    parser.add_argument("--errors", action="store_true", help="error values instead of compensation values")
    add_range(parser, "nodes")
    add_rounding(parser, "translations of a linear grid")
    parser.add_argument(
        "--intervals",
        action="store_true",
        help="95 %% coverage intervals of the values, from Monte Carlo samples; L-VOL, R-VOL",
    )
    add_existing(parser)
    add_unusual(parser)
    parser.add_argument(
        "--layout", choices=("volid", "iso"), default="volid", help="columns: volid's, or those of Tables 2 and 3; CSV"
    )
    add_output(parser, "OUT", "grid, .csv or .h5; default: CSV on standard output")


def run(args: argparse.Namespace) -> int:
    """Read, evaluate, write; 1 when values need attention. Raises `InputError`, `OutputError`, `NotDeterminedError`."""
    args.type = args.type or [LINEAR]
    _check_options(args)
    check_output(args.output, args.force, [args.solution])
    with Progress() as progress:
        progress("reading the solution")

        solution = usable_solution(args.solution)
        progress("evaluating the grid")
        grids, notes = _grids(solution, args)
        paths = _write(grids, solution, args, notes)
    tell(args, [*notes, *reversal_lines(solution, grids)])
    if args.output and not args.json:
        for grid, path in zip(grids, paths, strict=True):
            print(f"{described(grid, args)} written: {path}")
    messages = [m for grid in grids for m in messages_of(grid, args, several=len(grids) > 1)]
    return conclude(args, attention(solution, named=True) + messages)


def _check_options(args: argparse.Namespace) -> None:
    """Before the solution is read. Raises `InputError` for options that contradict each other or the types."""
    from volid.compensation.types import compensation_type

    types = [compensation_type(name) for name in args.type]
    _check_types(types, args)
    _check_intervals(args)
    _check_layout(args)
    _check_points(args)


def _check_types(types: list[CompensationType], args: argparse.Namespace) -> None:
    """Raises `InputError` for a type without a grid, or an option that none of the types knows."""
    from volid.compensation.types import GRID
    from volid.exceptions import InputError

    without = next((t.name for t in types if GRID not in t.forms), None)
    if without:
        raise InputError(
            f"--type {without} has no grid; it is a table of the axis itself: volid tables --type {without}"
        )
    if args.tool is not None and args.type == [ROTARY]:
        raise InputError(
            "--tool is for L-VOL; an R-VOL grid holds for every tool, through the lever arm from its reference point "
            "(--reference-point x,y,z)"
        )
    if args.reference_point is not None and not any(t.is_rotary or t.turns for t in types):
        raise InputError("--reference-point is for R-VOL; an L-VOL grid holds for a tool vector (--tool x,y,z)")
    if args.zero and not any(t.is_linear for t in types):
        raise InputError(
            "--zero is for grids of linear axes: a constant taken out of a rotary grid would displace its axis"
        )


def _check_intervals(args: argparse.Namespace) -> None:
    """Raises `InputError` for --intervals with what the samples know nothing of."""
    from volid.exceptions import InputError

    asked = {name: getattr(args, name) for name in ("rigid", "add_to", "add_active", "rule", "zero")}
    asked["align"] = args.align != "axes"
    clash = next((name for name, value in asked.items() if value), None)
    if args.intervals and clash:
        raise InputError(
            f"--intervals and --{clash.replace('_', '-')} exclude each other: the samples know nothing of it; leave one out"
        )


def _check_layout(args: argparse.Namespace) -> None:
    """Raises `InputError` for the layout of the Technical Report with what it has no place for."""
    from volid.exceptions import InputError

    hdf5 = args.output is not None and Path(args.output).suffix.lower() in HDF5
    clash = "an HDF5 file" if hdf5 else "--intervals" if args.intervals else ""
    if args.layout == "iso" and clash:
        raise InputError(f"--layout iso is a table of positions and values in CSV, which {clash} is not; leave one out")


def _check_points(args: argparse.Namespace) -> None:
    from volid.exceptions import InputError

    if args.points is None:
        return
    if any(v is not None for v in (args.step, args.max_points, args.max_error)):
        raise InputError("--points stands alone; take it, or --step, or --max-points and --max-error")


def _grids(solution: Solution, args: argparse.Namespace) -> tuple[tuple[AnyGrid, ...], list[str]]:
    from volid.compensation.package import compensate
    from volid.compensation.ranges import cut_notes, refuse_extrapolation
    from volid.compensation.rounding import rounded_grid

    tool = solution.most_used_tool() if args.tool is None else args.tool
    solution, notes = prepared(solution, args, [tool])
    base, ranges = base_from(solution, args, tool), ranges_from(solution, args)
    made = compensate(
        solution,
        args.type,
        base,
        grids=sampling_of(args),
        points=args.points,
        form="grid",
        rule=rule_from(args.rule),
        reference_point=args.reference_point,
        ranges=ranges,
        zero=args.zero,
    )
    grids = made.grids
    if not args.extrapolate:
        refuse_extrapolation(solution, grids, base, ranges)
    notes += cut_notes(solution, ranges, [a for g in grids for a in g.axes])
    if args.intervals:
        from volid.compensation.grids.intervals import with_intervals

        grids = tuple(with_intervals(solution, grid) for grid in grids)
    existing = existing_from(solution, args)
    notes += [*existing_notes(solution, existing), *left_out(args.add_to, existing)]
    angle = None if args.angle_increment is None else radians(args.angle_increment)
    summed = _superimposed(grids, existing, notes)
    return tuple(rounded_grid(g, args.increment, angle) for g in summed), notes


def _superimposed(
    grids: tuple[AnyGrid, ...], existing: tuple[ExistingCompensation, ...], notes: list[str]
) -> tuple[AnyGrid, ...]:
    """Grids on top of the existing ones, matched by side. Raises `InputError` for one that has no partner."""
    from volid.compensation.on_top import are_partners
    from volid.compensation.superposition import add_grid
    from volid.exceptions import InputError

    found = list(grids)
    for old, words in old_grids(grids, existing, notes):
        partner = next((i for i, new in enumerate(found) if are_partners(new, old)), None)
        if partner is None:
            new = ", ".join(f"{g.type} ({g.side})" for g in found)
            raise InputError(
                f"--add-to: {words}: a {old.type} grid ({old.side}) has no partner among the new ones: {new}"
            )
        found[partner] = add_grid(found[partner], old)
    return tuple(found)


def _write(grids: tuple[AnyGrid, ...], solution: Solution, args: argparse.Namespace, notes: list[str]) -> list[Path]:
    """The grids to their files, or one to standard output; the paths. Raises `InputError` for two without a file."""
    from volid.exceptions import InputError
    from volid.io.grids import grid_paths, grid_sheet

    if len(grids) > 1 and not (args.output or args.json):
        sides = ", ".join(g.side for g in grids)
        raise InputError(f"{len(grids)} grids ({sides}); name a file with -o, or take --json")
    paths = grid_paths(grids, args.output) if args.output else []
    for path in paths:
        check_output(path, args.force, [args.solution])
    headers = [_header(grid, solution, args, notes) for grid in grids]
    key = "grids" if args.type == [ROTARY] or len(grids) > 1 else ""
    if args.output and Path(args.output).suffix.lower() in HDF5:
        _write_hdf5(grids, headers, paths, args, key)
    else:
        write_sheets([grid_sheet(g, h, args.layout) for g, h in zip(grids, headers, strict=True)], paths, args, key)
    return paths


def _header(grid: AnyGrid, solution: Solution, args: argparse.Namespace, notes: list[str]) -> dict[str, str]:
    from volid.io.grids import grid_header
    from volid.io.record import COMPENSATION, ERROR

    values = ERROR if args.errors else COMPENSATION
    header = dict(grid_header(grid, values, solution, args.solution, args.command_line))
    return header | {f"note {i}": note for i, note in enumerate(notes, start=len(grid.notes) + 1)}


def _write_hdf5(
    grids: tuple[AnyGrid, ...], headers: list[dict[str, str]], paths: list[Path], args: argparse.Namespace, key: str
) -> None:
    """One file per grid; with --json their headers and nodes on standard output."""
    from volid.io.grids import write_grid_hdf5

    found = []
    for grid, header, path in zip(grids, headers, paths, strict=True):
        write_grid_hdf5(grid, header, path, args.force)
        found.append({"header": header, "nodes": dict(zip(grid.axes, grid.nodes, strict=True))})
    if args.json:
        print_json({key: found} if key else found[0])
