"""`volid errors`: deviations at given positions."""

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
    tell,
    usable_solution,
    write_sheet,
)
from volid.cli.numbers import add_unusual, ask_points
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.fitting.results import Deviations
    from volid.fitting.solution import Solution
    from volid.io.functions_csv import Points
    from volid.uncertainty.intervals import Bands

HELP = "deviation of the functional point at given axis positions and tool vectors"

_EPILOG = """\
POINTS.csv has the machine's axis letters (mm or degrees), tool_x,tool_y,tool_z (mm), and optional
X_dir, … (approach direction, +1, -1 or 0). The result repeats it and adds ex,ey,ez (mm), ea,eb,ec
(rad), actual - nominal in the machine frame, their standard uncertainties u_…, and outside = 1
where a position lies outside what was measured. A cell is empty where the data do not determine
the value, and outside the measured range, where --extrapolate gives values with the u that the
smoothness of the functions leaves. From a solution with Monte Carlo samples (volid uncertainty): also U_… = 2 u and the 95 %
coverage intervals low_… to high_… (symmetric in probability) and shortest_low_… to shortest_high_….

example:
  volid errors solution.h5 --at points.csv -o deviations.csv

exit status: 0 good; 1 written, but values are not determined or outside, or the model is
rejected; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument("--at", metavar="POINTS.csv", required=True, help="where: axis positions and tool vectors")
    parser.add_argument(
        "--extrapolate", action="store_true", help="values outside the measured range, as smooth as the functions are"
    )
    add_unusual(parser)
    add_output(parser, "OUT.csv", "table of deviations; default: standard output")


def run(args: argparse.Namespace) -> int:
    """Read, evaluate, write; 1 when values need attention. Raises `InputError`, `OutputError`."""
    check_output(args.output, args.force, [args.solution, args.at])
    with Progress() as progress:
        progress("reading")
        from volid.io.functions_csv import deviations_sheet, read_points

        solution = usable_solution(args.solution)
        points = read_points(args.at, solution.machine)
        ask_points(solution, points, args.at)
        progress(f"evaluating {len(points.positions)} points")
        if args.extrapolate:
            solution = solution.extrapolated()
        found = solution.evaluate(points.positions, points.tool, points.directions)
        intervals = _intervals(solution, points, found, progress)
    write_sheet(deviations_sheet(points, found, solution, args.solution, intervals), args)
    if args.output and not args.json:
        print(f"{len(points.positions)} points written: {args.output}")
    tell(args, points.notes)
    return conclude(args, attention(solution, named=True) + _messages(solution, found))


def _intervals(solution: Solution, points: Points, found: Deviations, progress: Progress) -> Bands | None:
    """Coverage intervals when the solution has samples."""
    if not solution.samples:
        return None
    from volid.uncertainty.intervals import deviation_intervals

    progress("coverage intervals")
    return deviation_intervals(solution, found.values, points.positions, points.tool, points.directions)


def _messages(solution: Solution, found: Deviations) -> list[str]:
    """What of the values needs attention."""
    open_inside = (~found.determined).any(axis=1) & ~found.outside
    n, unknown, outside = len(found.values), int(open_inside.sum()), int(found.outside.sum())
    blank = int((~found.determined.any(axis=1) & found.outside).sum())
    messages = []
    if unknown:
        reason = " ".join(solution.statements)
        said = f"{unknown} of {n} points have components that the data do not determine, left blank. {reason}"
        messages.append(said.rstrip())
    if outside:
        messages.append(
            f"{outside} of {n} points lie outside the measured positions (outside = 1), {blank} of them left blank"
        )
    return messages
