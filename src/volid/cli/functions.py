"""`volid functions`: the error functions as a table."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from volid.fitting.solution import Solution

HELP = "table of the error functions and location errors with their uncertainty"

_EPILOG = """\
Columns function,axis,position,direction,value,u: translations in mm, rotations in rad, positions
in mm or degrees over the measured range; functions with reversal have direction +1 and -1, others
0; a cell is empty where the data do not determine the value. Location errors have an empty
position, and as value that of the axis average line in the machine frame, as ISO 230-1 means it and
volid locations has it as axis_line. Functions of two axes are tabulated at the other axis's reference. From a solution with Monte
Carlo samples (volid uncertainty): also U = 2 u and the 95 % coverage intervals low … high
(symmetric in probability) and shortest_low … shortest_high.

--plot draws error motions in characters, as wide as the terminal, instead of the table, or beside it
where -o names its file: value, and value ± U (k = 2) as dots.

example:
  volid functions solution.h5 --step 50 -o functions.csv
  volid functions solution.h5 --plot EXX,E?Y

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
    parser.add_argument(
        "--plot",
        metavar="NAME,…",
        nargs="?",
        const="*",
        help="pictures of error motions; * and ? stand for letters; default: all",
    )
    add_unusual(parser)
    add_output(parser, "OUT.csv", "table of functions; default: standard output")


def run(args: argparse.Namespace) -> int:
    """Read, tabulate, write; 1 when functions need attention. Raises `InputError`, `OutputError`."""
    check_output(args.output, args.force, [args.solution])
    _check_plot(args)
    from volid.io.functions_csv import functions_sheet

    solution = usable_solution(args.solution)
    if args.plot:
        _names(solution, args.plot)  # a mistake is told before the work
    rows, intervals = solution.functions(step=args.step), None
    if solution.samples:
        from volid.uncertainty.intervals import function_intervals

        intervals = function_intervals(solution, rows)
    if args.plot:
        _draw(solution, args)
    if args.output or args.json or not args.plot:
        write_sheet(functions_sheet(rows, solution, args.solution, intervals), args)
    messages = attention(solution, named=True)
    names = list(dict.fromkeys(row.name for row in rows))
    unknown = list(dict.fromkeys(row.name for row in rows if row.value != row.value))
    if unknown:
        messages.append(f"not determined by the data, wholly or in part, and left blank: {', '.join(unknown)}")
    if args.output and not args.json:
        print(f"{len(names)} functions and location errors written: {args.output}")
    return conclude(args, messages)


def _check_plot(args: argparse.Namespace) -> None:
    """Raises `InputError` where two results would stand on standard output."""
    from volid.cli.streams import STANDARD_OUTPUT
    from volid.exceptions import InputError

    if args.plot and (args.json or args.output == STANDARD_OUTPUT):
        raise InputError("--plot and the table both go to standard output; leave one out, or name a file with -o")


def _names(solution: Solution, asked: str) -> list[str]:
    """Symbols of the error motions asked for, axis by axis. Raises `InputError` for one that is not there."""
    from fnmatch import fnmatchcase

    from volid.exceptions import InputError
    from volid.model.iso230 import DIRECTIONS, parse

    motions = [name for name in solution.model.names if not parse(name).location]
    motions.sort(key=lambda name: (DIRECTIONS.index(name[2]), DIRECTIONS.index(name[1])))
    patterns = [part.strip() for part in asked.split(",") if part.strip()]
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in motions):
            raise InputError(f"--plot {pattern}: the model has no such error motion; it has {', '.join(motions)}")
    return [name for name in motions if any(fnmatchcase(name, pattern) for pattern in patterns)]


def _draw(solution: Solution, args: argparse.Namespace) -> None:
    """Pictures on standard output, as wide as the terminal; in ASCII where it has no other characters."""
    import shutil
    import sys

    from volid.cli.common import print_verdict
    from volid.report.text.picture import picture

    plain = not (sys.stdout.encoding or "").lower().startswith("utf")
    print_verdict(solution)
    for name in _names(solution, args.plot):
        print("\n".join(picture(solution, name, shutil.get_terminal_size().columns, plain)) + "\n")
