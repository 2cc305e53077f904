"""`volid field`: a field measured point by point as a spatial grid, without any kinematic hypothesis."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from volid.cli.common import (
    add_allow_outside,
    add_output,
    check_output,
    conclude,
    explain,
    named_by,
    print_json,
    usable_solution,
)
from volid.cli.numbers import add_unusual, count, number, tool_vector
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.campaign import Campaign
    from volid.compensation.grids.grid import Grid
    from volid.compensation.measured.against import Comparison
    from volid.compensation.measured.field import MeasuredField

HELP = "a field measured point by point as a spatial grid, without kinematic model, and the model tested by it"

_EPILOG = """\
CAMPAIGN holds coordinates of a tracker (kind point, also polar), or distances from at least four
stations to the same places, which give points by multilateration. Points of volid multilaterate are
a point set once the axis positions stand beside them. The deviations, actual - nominal after the
best rigid placement of each station, are interpolated by a Gaussian process for each of X, Y and Z;
u contains readings and interpolation. What a rigid motion of the workpiece takes up is taken out
once, for all tool vectors together.

The grid is of type L-VOL, as volid grid writes it, but rotations are blank: it holds for its tool
vector only. Nodes outside the convex hull of the measured places are blank, or with --outside flag
extrapolated and flagged (outside = 1), as a control without blank cells needs it. Without --tool
there is one grid for each tool vector with 8 places or more: OUT.1.csv, OUT.2.csv, …

--compare tests whether a solution describes the field, place by place, with the u of both, and names
the regions where it does not.

example:
  volid field tracker.toml --step 100 --errors --compare solution.h5 -o field.csv

exit status: 0 good; 1 written, but the model does not describe the field, or positions stand too far
apart to see what lies between; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    parser.add_argument("campaign", metavar="CAMPAIGN", help="campaign, manifest (.toml) or .h5")
    parser.add_argument("--step", metavar="S", type=number("mm", above=0.0), help="distance between nodes, mm")
    parser.add_argument("--points", metavar="N", type=count(2, 1000), help="nodes per axis; default 11")
    parser.add_argument(
        "--tool", metavar="x,y,z", type=tool_vector, action="append", help="measured tool vector, mm; repeat it"
    )
    parser.add_argument("--outside", choices=("blank", "flag"), default="blank", help="nodes outside what was measured")
    parser.add_argument("--compare", metavar="SOLUTION.h5", help="a solution to be tested by the field")
    parser.add_argument("--errors", action="store_true", help="error values instead of compensation values")
    add_unusual(parser)
    add_allow_outside(parser)
    add_output(parser, "OUT", "grid, .csv or .h5", required=True)


def run(args: argparse.Namespace) -> int:
    """Read, interpolate, compare, write; 1 when something needs attention. Raises `InputError`, `OutputError`."""
    inputs = [args.campaign, *named_by([args.campaign]), *([args.compare] if args.compare else [])]
    check_output(args.output, args.force, inputs, alone=False)
    with Progress() as progress:
        progress("reading the campaign")
        from volid.compensation.measured.field import measured_field
        from volid.io import load_campaign
        from volid.plausibility.checks import check_campaign

        campaign = load_campaign(args.campaign, allow_outside=args.allow_outside)
        check_campaign(campaign)
        progress("interpolating")
        field = measured_field(campaign)
        tools = args.tool or field.tools.tolist()
        kept = args.outside == "flag"
        grids = [field.grid(tuple(t), step=args.step, points=args.points, keep_outside=kept) for t in tools]
        compared = _compared(field, grids, args, progress)
        paths = _write(grids, compared, campaign, args)
    return _say(field, grids, compared, paths, args)


def _compared(field: MeasuredField, grids: list[Grid], args: argparse.Namespace, progress: Any) -> list[Comparison]:
    if not args.compare:
        return []
    progress("comparing")
    from volid.compensation.measured.against import compare_field

    solution = usable_solution(args.compare)
    return [compare_field(field, solution, grid.tool) for grid in grids]


def _write(grids: list[Grid], compared: list[Comparison], campaign: Campaign, args: argparse.Namespace) -> list[Path]:
    from volid.io.fields import field_header, write_field
    from volid.io.record import COMPENSATION, ERROR

    path = Path(args.output)
    paths = (
        [path]
        if len(grids) == 1
        else [path.with_name(f"{path.stem}.{i}{path.suffix}") for i in range(1, len(grids) + 1)]
    )
    values = ERROR if args.errors else COMPENSATION
    for target in paths:
        check_output(target, args.force, [args.campaign])
    for i, (grid, target) in enumerate(zip(grids, paths, strict=True)):
        verdict = compared[i] if compared else None
        header = field_header(grid, values, campaign, args.campaign, args.command_line, verdict)
        write_field(grid, header, target, args.force)
    return paths


def _say(
    field: MeasuredField, grids: list[Grid], compared: list[Comparison], paths: list[Path], args: argparse.Namespace
) -> int:
    from volid.report.text.field import comparison_data, comparison_lines, field_lines

    if args.json:
        print_json(
            {
                "places": len(field.points),
                "frame": field.frame,
                "grids": [
                    {"file": str(p), "tool": list(g.tool), "nodes": len(g.values)}
                    for p, g in zip(paths, grids, strict=True)
                ],
                "comparisons": [comparison_data(c) for c in compared],
            }
        )
    else:
        print("\n".join(field_lines(field, grids)))
        for found in compared:
            print("\n".join(comparison_lines(found)))
        for path in paths:
            print(f"written: {path}")
    return conclude(args, [*field.attention, *(c.verdict for c in compared if not c.describes)])
