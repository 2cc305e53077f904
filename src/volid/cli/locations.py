"""`volid locations`: location errors of the rotary axes, axis line and parameter."""

from __future__ import annotations

import argparse

from volid.cli.common import (
    add_output,
    add_solution,
    attention,
    check_output,
    conclude,
    explain,
    usable_solution,
    write_sheet,
)

HELP = "location errors of the rotary axes: axis average lines, relative to the machine or to another axis"

_EPILOG = """\
Columns location_error,axis,relative_to,parameter,axis_line,u,remark: two positions (mm) and two
orientations (rad) of every rotary axis. axis_line: what ISO 230-1 means by the symbol (EX0C, EA0C):
where the axis average line stands, machine directions, other axes at 0. parameter: parameter, tool
relative to workpiece; for an axis that carries the workpiece, minus the axis line. u holds for
both; a cell is empty where the data do not determine the value. Relative to the machine frame an
axis that another one carries has the errors of both; relative to that one, EX(0A)C, its own.

example:
  volid locations solution.h5 --relative-to A -o locations.csv

exit status: 0 good; 1 written, but location errors are not determined, or the model is rejected; 2
bad input, such as an axis on the other side of the machine
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument(
        "--relative-to",
        metavar="machine|A|B|C",
        default="machine",
        help="the datum: the machine frame (default), or a rotary axis of the same side",
    )
    add_output(parser, "OUT.csv", "table of location errors; default: standard output")


def run(args: argparse.Namespace) -> int:
    """Read, evaluate, write; 1 when something needs attention. Raises `InputError`, `OutputError`."""
    check_output(args.output, args.force, [args.solution])
    from volid.exceptions import InputError
    from volid.fitting.location_errors import location_errors
    from volid.io.locations import locations_sheet

    solution = usable_solution(args.solution)
    if all(axis.is_linear for axis in solution.machine.axes):
        raise InputError(
            f"{args.solution}: machine '{solution.machine.name}' has no rotary axis; expected one at least"
        )
    rows = location_errors(solution, args.relative_to)
    write_sheet(locations_sheet(rows, solution, args.solution), args)
    messages = attention(solution, named=True)
    unknown = [row.symbol for row in rows if row.u != row.u]
    if unknown:
        messages.append(f"not determined by the data, and left blank: {', '.join(unknown)}")
    if args.output and not args.json:
        print(f"{len(rows)} location errors written: {args.output}")
    return conclude(args, messages)
