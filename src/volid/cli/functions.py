"""`volid functions`: the error functions as a table."""

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
from volid.cli.numbers import add_unusual, number

HELP = "table of the error functions and location errors with their uncertainty"

_EPILOG = """\
Columns function,axis,position,direction,value,u: translations in mm, rotations in rad, positions
in mm or degrees over the measured range; functions with reversal have direction +1 and -1, others
0; a cell is empty where the data do not determine the value. Location errors have an empty
position, and as value that of the axis average line in the machine frame, as ISO 230-1 means it and
volid locations has it as axis_line. Functions of two axes are tabulated at the other axis's reference. From a solution with Monte
Carlo samples (volid uncertainty): also U = 2 u and the 95 % coverage intervals low … high
(symmetric in probability) and shortest_low … shortest_high.

example:
  volid functions solution.h5 --step 50 -o functions.csv

exit status: 0 good; 1 written, but functions are not determined, or the model is rejected; 2 bad
input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument(
        "--step",
        metavar="S",
        type=number("mm or degrees", above=0.0),
        help="spacing, mm or degrees; default: 21 points",
    )
    add_unusual(parser)
    add_output(parser, "OUT.csv", "table of functions; default: standard output")


def run(args: argparse.Namespace) -> int:
    """Read, tabulate, write; 1 when functions need attention. Raises `InputError`, `OutputError`."""
    check_output(args.output, args.force, [args.solution])
    from volid.io.functions_csv import functions_sheet

    solution = usable_solution(args.solution)
    rows, intervals = solution.functions(step=args.step), None
    if solution.samples:
        from volid.uncertainty.intervals import function_intervals

        intervals = function_intervals(solution, rows)
    write_sheet(functions_sheet(rows, solution, args.solution, intervals), args)
    messages = attention(solution, named=True)
    names = list(dict.fromkeys(row.name for row in rows))
    unknown = list(dict.fromkeys(row.name for row in rows if row.value != row.value))
    if unknown:
        messages.append(f"not determined by the data, wholly or in part, and left blank: {', '.join(unknown)}")
    if args.output and not args.json:
        print(f"{len(names)} functions and location errors written: {args.output}")
    return conclude(args, messages)
