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
    write_sheet,
)
from volid.cli.progress import Progress
from volid.report.text import vector

if TYPE_CHECKING:
    from volid.compensation.grids import Grid

HELP = "spatial grid of compensation (or error) values over the working volume"

TYPES = ("L-VOL",)
_LATER = ("L-POS", "L-STR", "L-SQU", "L-ANG", "FOR", "L-VOL+", "R-POS", "R-RAX", "R-POR", "R-ANG", "R-VOL", "R-VOL+")
_EPILOG = f"""\
Types: {", ".join(TYPES)}. Compensation values are minus the error values (actual - nominal);
--errors writes the error values. The grid spans the travels, both ends included, X varying
fastest; translations in mm hold for the tool vector, rotations are in degrees. Lines that begin
with # state type, sign, tool vector, frame, datum and source. OUT is CSV, or HDF5 when it ends in
.h5.

example:
  volid grid solution.h5 --type L-VOL --step 50 --tool 0,0,-150 -o grid.csv

exit status: 0 good; 1 written, but nodes lie outside what was measured (unless --extrapolate),
rotations are not determined, or the model is rejected; 1 and nothing written when the data do not
determine the translations; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument("--type", default="L-VOL", metavar="TYPE", help="type of compensation; default L-VOL")
    spacing = parser.add_mutually_exclusive_group()
    spacing.add_argument("--step", metavar="S", type=float, help="spacing of the nodes, mm")
    spacing.add_argument("--points", metavar="N", type=int, help="nodes per axis; default 21")
    parser.add_argument(
        "--tool", metavar="x,y,z", type=tool_vector, help="tool vector, mm; default: the most used one of the campaign"
    )
    parser.add_argument("--errors", action="store_true", help="error values instead of compensation values")
    parser.add_argument("--extrapolate", action="store_true", help="nodes outside what was measured are meant")
    add_output(parser, "OUT", "grid, .csv or .h5; default: CSV on standard output")


def run(args: argparse.Namespace) -> int:
    """Read, evaluate, write; 1 when values need attention. Raises `InputError`, `OutputError`, `NotDeterminedError`."""
    _check_type(args.type)
    check_output(args.output, args.force, [args.solution])
    with Progress() as progress:
        progress("reading the solution")
        from volid.compensation.grids import linear_grid
        from volid.io.grid_files import COMPENSATION, ERROR, grid_header, grid_sheet, write_grid_hdf5
        from volid.io.solution_hdf5 import read_solution
        from volid.report.summary import most_used_tool

        solution = read_solution(args.solution)
        progress("evaluating the grid")
        tool = most_used_tool(solution.campaign) if args.tool is None else args.tool
        grid = linear_grid(solution, step=args.step, points=args.points, tool=tool)
        header = grid_header(grid, ERROR if args.errors else COMPENSATION, solution, args.solution)
        if args.output and Path(args.output).suffix.lower() in HDF5:
            write_grid_hdf5(grid, header, args.output, args.force)
            if args.json:
                print_json({"header": header, "nodes": dict(zip(grid.axes, grid.nodes, strict=True))})
        else:
            write_sheet(grid_sheet(grid, header), args)
    if args.output and not args.json:
        counts = " × ".join(str(len(nodes)) for nodes in grid.nodes)
        where = vector(grid.tool)
        print(f"{counts} nodes of {header['values']} values for tool vector {where} mm written: {args.output}")
    return conclude(args, [m for m in attention(solution) if "do not determine" not in m] + _messages(grid, args))


def _check_type(name: str) -> None:
    from volid.exceptions import InputError

    if name in TYPES:
        return
    available = f"available: {', '.join(TYPES)}"
    if name in _LATER:
        raise InputError(f"--type {name} is not offered yet; {available}")
    raise InputError(f"--type '{name}' is no compensation type of ISO/TR 16907; {available}")


def _messages(grid: Grid, args: argparse.Namespace) -> list[str]:
    messages = []
    lost = [f"d{c}" for k, c in enumerate("XYZABC") if (grid.values[:, k] != grid.values[:, k]).any()]
    if lost:
        messages.append(f"{', '.join(lost)} not determined by the data and left blank; use no other tool vector")
    outside = int(grid.outside.sum())
    if outside and not args.extrapolate:
        n = len(grid.outside)
        messages.append(
            f"{outside} of {n} nodes lie outside the measured positions: extrapolated (outside = 1). Measure there, or "
            "accept with --extrapolate"
        )
    return messages
