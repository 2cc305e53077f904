"""`volid grid`: spatial compensation or error grids."""

from __future__ import annotations

import argparse
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
    tool_vector,
    write_sheets,
)
from volid.cli.progress import Progress
from volid.report.text import vector

if TYPE_CHECKING:
    from volid.fitting.solution import Solution
    from volid.io.grid_files import AnyGrid

HELP = "spatial grid of compensation (or error) values over the working volume"

LINEAR, ROTARY = "L-VOL", "R-VOL"
TYPES = (LINEAR, ROTARY)
_LATER = ("L-POS", "L-STR", "L-SQU", "L-ANG", "FOR", "L-VOL+", "R-POS", "R-RAX", "R-POR", "R-ANG", "R-VOL+")
_EPILOG = f"""\
Types: {", ".join(TYPES)}. Compensation values are minus the error values (actual - nominal);
--errors writes the error values. The grid spans the travels, both ends included, the first axis
varying fastest; translations in mm, rotations in degrees. Lines that begin with # state type, sign,
tool vector or reference point, frame, datum and source. OUT is CSV, or HDF5 when it ends in .h5.

L-VOL holds for one tool vector; with rotary axes, for a rotated one and the linear axes' errors
only. R-VOL (ISO/TR 16907 Table 3) holds at a reference point; the lever arm from it is stated.
Rotary axes on both sides make two grids, whose effects add up: OUT.csv then becomes OUT.table.csv
and OUT.head.csv.

example:
  volid grid solution.h5 --type L-VOL --step 50 --tool 0,0,-150 -o grid.csv
  volid grid solution.h5 --type R-VOL --step 10 --reference-point 0,0,0 -o rotary.csv

exit status: 0 good; 1 written, but nodes lie outside what was measured (unless --extrapolate),
rotations are not determined, the model leaves out error functions, or is rejected; 1 and nothing
written when the data do not determine the translations; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument("--type", default=LINEAR, metavar="TYPE", help="type of compensation; default L-VOL")
    spacing = parser.add_mutually_exclusive_group()
    spacing.add_argument("--step", metavar="S", type=float, help="spacing of the nodes, mm; degrees for R-VOL")
    spacing.add_argument("--points", metavar="N", type=int, help="nodes per axis; default 21, for R-VOL 37")
    parser.add_argument(
        "--tool", metavar="x,y,z", type=tool_vector, help="tool vector, mm; default: the most used one of the campaign"
    )
    parser.add_argument(
        "--reference-point",
        metavar="x,y,z",
        type=tool_vector,
        help="of R-VOL, mm, machine frame, linear axes at 0; default: on the rotary axis nearest the bed",
    )
    parser.add_argument("--errors", action="store_true", help="error values instead of compensation values")
    parser.add_argument("--extrapolate", action="store_true", help="nodes outside what was measured are meant")
    add_output(parser, "OUT", "grid, .csv or .h5; default: CSV on standard output")


def run(args: argparse.Namespace) -> int:
    """Read, evaluate, write; 1 when values need attention. Raises `InputError`, `OutputError`, `NotDeterminedError`."""
    _check_options(args)
    check_output(args.output, args.force, [args.solution])
    with Progress() as progress:
        progress("reading the solution")
        from volid.io.solution_hdf5 import read_solution

        solution = read_solution(args.solution)
        progress("evaluating the grid")
        grids = _grids(solution, args)
        paths = _write(grids, solution, args)
    if args.output and not args.json:
        for grid, path in zip(grids, paths, strict=True):
            print(f"{_described(grid, args)} written: {path}")
    messages = [m for grid in grids for m in _messages(grid, args, several=len(grids) > 1)]
    return conclude(args, [m for m in attention(solution) if "do not determine" not in m] + messages)


def _check_options(args: argparse.Namespace) -> None:
    from volid.exceptions import InputError

    available = f"available: {', '.join(TYPES)}"
    if args.type in _LATER:
        raise InputError(f"--type {args.type} is not offered yet; {available}")
    if args.type not in TYPES:
        raise InputError(f"--type '{args.type}' is no compensation type of ISO/TR 16907; {available}")
    if args.type == ROTARY and args.tool is not None:
        raise InputError(
            "--tool is for L-VOL; an R-VOL grid holds for every tool, through the lever arm from its reference point "
            "(--reference-point x,y,z)"
        )
    if args.type == LINEAR and args.reference_point is not None:
        raise InputError("--reference-point is for R-VOL; an L-VOL grid holds for a tool vector (--tool x,y,z)")


def _grids(solution: Solution, args: argparse.Namespace) -> tuple[AnyGrid, ...]:
    from volid.compensation.grids import linear_grid
    from volid.compensation.rotary_grids import rotary_grids
    from volid.report.summary import most_used_tool

    if args.type == ROTARY:
        return rotary_grids(solution, step=args.step, points=args.points, reference_point=args.reference_point)
    tool = most_used_tool(solution.campaign) if args.tool is None else args.tool
    return (linear_grid(solution, step=args.step, points=args.points, tool=tool),)


def _write(grids: tuple[AnyGrid, ...], solution: Solution, args: argparse.Namespace) -> list[Path]:
    """The grids to their files, or one to standard output; the paths. Raises `InputError` for two without a file."""
    from volid.exceptions import InputError
    from volid.io.grid_files import COMPENSATION, ERROR, grid_header, grid_paths, grid_sheet, write_grid_hdf5

    if len(grids) > 1 and not (args.output or args.json):
        raise InputError(
            "two grids, of the rotary axes in the table and in the head; name a file with -o, or take --json"
        )
    paths = grid_paths(grids, args.output) if args.output else []
    for path in paths:
        check_output(path, args.force, [args.solution])
    headers = [grid_header(grid, ERROR if args.errors else COMPENSATION, solution, args.solution) for grid in grids]
    if args.output and Path(args.output).suffix.lower() in HDF5:
        for grid, header, path in zip(grids, headers, paths, strict=True):
            write_grid_hdf5(grid, header, path, args.force)
        found = [
            {"header": h, "nodes": dict(zip(g.axes, g.nodes, strict=True))} for g, h in zip(grids, headers, strict=True)
        ]
        if args.json:
            print_json({"grids": found} if args.type == ROTARY else found[0])
        return paths
    sheets = [grid_sheet(grid, header) for grid, header in zip(grids, headers, strict=True)]
    write_sheets(sheets, paths, args, key="grids" if args.type == ROTARY else "")
    return paths


def _described(grid: AnyGrid, args: argparse.Namespace) -> str:
    counts = " × ".join(str(len(nodes)) for nodes in grid.nodes)
    values = "error" if args.errors else "compensation"
    if args.type == LINEAR:
        return f"{counts} nodes of {values} values for tool vector {vector(getattr(grid, 'tool', ()))} mm"
    where = vector(getattr(grid, "reference_point", ()))
    side = getattr(grid, "side", "")
    return f"{counts} nodes of {values} values of {', '.join(grid.axes)} in the {side}, reference point {where} mm,"


def _messages(grid: AnyGrid, args: argparse.Namespace, several: bool) -> list[str]:
    from volid.compensation.parts import LEFT_OUT

    what = f"{getattr(grid, 'side', '')}: " if several else ""
    messages = [f"{what}{note}" for note in grid.notes if note.startswith(LEFT_OUT)]
    lost = [f"d{c}" for k, c in enumerate("XYZABC") if (grid.values[:, k] != grid.values[:, k]).any()]
    if lost:
        advice = "no other tool vector" if args.type == LINEAR else "no lever arm"
        messages.append(f"{what}{', '.join(lost)} not determined by the data and left blank; use {advice}")
    outside = int(grid.outside.sum())
    if outside and not args.extrapolate:
        n = len(grid.outside)
        messages.append(
            f"{what}{outside} of {n} nodes lie outside the measured positions: extrapolated (outside = 1). Measure there, or "
            "accept with --extrapolate"
        )
    return messages
