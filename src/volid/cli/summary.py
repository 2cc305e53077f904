"""`volid summary`: what a solution says, on one screen."""

from __future__ import annotations

import argparse

from volid.cli.common import (
    add_output,
    add_solution,
    attention,
    check_output,
    conclude,
    explain,
    print_json,
)
from volid.cli.numbers import add_unusual, tool_vector
from volid.cli.progress import Progress

HELP = "what a solution says: verdict, squareness, volumetric accuracy, error functions"

_EPILOG = """\
Lengths in µm, rotations in µrad, expanded uncertainties U with k = 2. The volumetric accuracy
V_XYZ (ISO 230-1) and the deviations hold for one tool vector. With --json numbers are in mm and
rad.

example:
  volid summary solution.h5 --tool 0,0,-150
  volid summary solution.h5 --sets

exit status: 0 good; 1 the model is rejected, not everything is determined, or the fit did not
converge; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument("--tool", metavar="x,y,z", type=tool_vector, help="tool vector, mm; default: the most used one")
    parser.add_argument(
        "--sets",
        action="store_true",
        help="besides, who determines what: every function without each set, and from it alone",
    )
    add_unusual(parser)
    add_output(parser, "SUMMARY.txt", "text file; default: standard output")


def run(args: argparse.Namespace) -> int:
    """Read and summarise; 1 when the solution needs attention. Raises `InputError`, `OutputError`."""
    check_output(args.output, args.force, [args.solution])
    with Progress() as progress:
        progress("reading the solution")
        from volid.fitting.mixed.who import who_determines
        from volid.io.functions_csv import text_output
        from volid.io.solutions import read_solution
        from volid.report.text.sets import format_who, who_data
        from volid.report.text.summary import plain, summary_data
        from volid.report.text.summary_lines import format_summary

        solution = read_solution(args.solution)
        if args.tool is not None:
            solution.ask(args.tool)
        progress("evaluating the working volume")
        data = summary_data(solution, args.tool)
        text = format_summary(data)
        if args.sets:
            progress("leaving out one set after the other")
            found = who_determines(solution)
            data["who_determines"], text = plain(who_data(found)), f"{text}\n\n{format_who(found)}"
    if args.output:
        with text_output(args.output, args.force) as stream:
            stream.write(text + "\n")
    if args.json:
        print_json({**data, "attention": attention(solution)})
    else:
        print(f"written: {args.output}" if args.output else text)
    return conclude(args, attention(solution))
