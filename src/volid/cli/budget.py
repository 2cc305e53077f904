"""`volid budget`: which source contributes how much to the uncertainty of which output."""

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
    print_json,
    print_verdict,
    tell,
    usable_solution,
    write_sheet,
)
from volid.cli.numbers import add_unusual, ask_points, tool_vector
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.fitting.solution import Solution
    from volid.io.functions_csv import Points
    from volid.uncertainty.budget import Rows

HELP = "uncertainty budget: which source contributes how much to which output"

_EPILOG = """\
Sources are the sets of readings, every systematic effect, calibrated lengths and an earlier
solution (--prior). Outputs are location errors, error functions at 7 positions (mean of both directions
of approach) and the deviation in the working volume (largest, RMS, ranges V_X, V_Y, V_Z), or with
--at the six components at given points. Contributions are standard uncertainties; their squares add up to u². OUT.csv has one row
per output and source, largest first: output, position, unit, u, source, u_source, u_source_unit,
sensitivity, contribution, share (mm and rad). Sensitivity = contribution / u_source, blank where a
source has members of several u.

example:
  volid budget solution.h5 -o budget.csv
  volid budget solution.h5 --at points.csv

exit status: 0 good; 1 written, but not everything is determined, or the model is rejected; 2 bad
input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument("--at", metavar="POINTS.csv", help="axis positions and tool vectors, as of volid errors")
    parser.add_argument(
        "--tool", metavar="x,y,z", type=tool_vector, help="mm, for the working volume; default: the most used one"
    )
    add_unusual(parser)
    add_output(parser, "OUT.csv", "the complete budget; default: its summary on standard output")


def run(args: argparse.Namespace) -> int:
    """Read, propagate source by source, write; 1 when something needs attention. Raises `InputError`, `OutputError`."""
    check_output(args.output, args.force, [args.solution, *([args.at] if args.at else [])])
    with Progress() as progress:
        progress("reading the solution")
        from volid.io.functions_csv import budget_sheet, read_points
        from volid.report.text.budget import format_budget
        from volid.uncertainty.budget import budget, budget_lines
        from volid.uncertainty.lack_of_fit import lack_of_fit

        solution = usable_solution(args.solution)
        points = read_points(args.at, solution.machine) if args.at else None  # a mistake in it is told before the work
        if points is not None:
            ask_points(solution, points, args.at)
        progress("propagating every source")
        lines = list(budget_lines(budget(solution), _rows(solution, points, args)))
    if args.output:
        write_sheet(budget_sheet(lines, solution, args.solution), args)
    elif args.json:
        print_json({"lines": [line._asdict() for line in lines], "lack_of_fit": lack_of_fit(solution)._asdict()})
    if not args.json:
        print_verdict(solution)
        print(format_budget(lines, lack_of_fit(solution)) + (f"\n\nwritten: {args.output}" if args.output else ""))
    tell(args, points.notes if points is not None else ())
    return conclude(args, attention(solution))


def _rows(solution: Solution, points: Points | None, args: argparse.Namespace) -> Rows:
    """The outputs asked for."""
    import numpy as np

    from volid.uncertainty.budget import headline_rows, point_rows
    from volid.uncertainty.outputs import headline_outputs

    if points is not None:
        return point_rows(solution, points.positions, points.tool, points.directions)
    tool = solution.most_used_tool() if args.tool is None else args.tool
    return headline_rows(solution, headline_outputs(solution, np.asarray(tool)))
