"""`volid residual`: what each compensation type leaves."""

from __future__ import annotations

import argparse
import shlex
from typing import TYPE_CHECKING, Any

from volid.cli.common import (
    add_output,
    add_solution,
    attention,
    check_figure,
    check_output,
    conclude,
    explain,
    print_json,
    print_verdict,
    usable_solution,
    write_figure,
    write_sheet,
)
from volid.cli.compensation_options import (
    ByAxis,
    add_base,
    add_range,
    base_from,
    in_frame,
    limits,
    prepared,
    ranges_from,
    rule_from,
    scatter,
)
from volid.cli.control_options import add_control_limits, add_files_of, control_limits, in_words_of
from volid.cli.left_over import left_out
from volid.cli.numbers import add_unusual, count, number, seed, tool_vector
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.compensation.package import Compensation
    from volid.compensation.residual.forecast import Forecast
    from volid.fitting.solution import Solution

HELP = "what each compensation type leaves over the working volume, side by side, with intervals"
LINEAR_FEED, ROTARY_FEED = 10_000.0, 3_600.0  # mm/min; °/min, ten turns
FULL = "tables and grids are from the rigid functions; what remains is that of the full model, cross effects included"

_EPILOG = """\
Every --type is one row of the table, types joined by a comma act together: --type L-VOL,R-VOL. The
first row is "none". A simulated control applies tables and grids as they would be written. Stated
are the deviation of the functional point and the orientation error that remain over the working
volume: the largest with corners, edges, both approach directions and, unless --tool or --tools name
others, all tool vectors of the campaign; RMS and 95 % over the volume. 95 % intervals are from the
Monte Carlo samples of the solution (volid uncertainty), else from its covariance. --tools adds other
tool vectors with the same compensation; --tool-error gives the control a wrong one. --rigid makes
tables and grids from single-axis functions; what remains is that of the full model.

--compensation is one more row: what existing files leave, of a control or volid's own. Where files of
the same control were active while measuring, they stand in their place, else they come on top.

The machine's repeatability is in every row: as readings show it that come back to a place from the
same direction with the same tool, the instrument's u and drift between visits taken out, else as the
campaign states it. --repeatability states it: one number for the functional point, or by axis; 0
leaves it out. Thermal change is on top, as far as [conditions] thermal_limit (mm) states it.

Limits: --limit and --speed-limit refuse a compensation that asks an axis for more; speeds for axes
that move one at a time with --feed (linear, mm/min) and --turn (rotary, degrees/min).

example:
  volid residual solution.h5 --type L-POS --type L-VOL --tool 0,0,-150 --figure residual.png

exit status: 0 good; 1 written, but the model is rejected or the volume leaves what was measured;
1 and nothing written when the data do not determine the deviation; 2 bad input, or a limit exceeded
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument(
        "--type", action="append", metavar="TYPE[,TYPE]", default=[], help="a row of the table; repeat it"
    )
    parser.add_argument(
        "--compensation",
        metavar="FILE",
        action="append",
        default=[],
        help="files of a control, or tables and grids, as one more row: what they leave as they are; repeat it",
    )
    add_files_of(parser, "compensation-")
    add_base(parser, "base tool vector, mm; default: the most used one of the campaign")
    parser.add_argument(
        "--tools", metavar="x,y,z", type=tool_vector, action="append", help="further tool vectors; repeat it"
    )
    parser.add_argument(
        "--tool-error", metavar="x,y,z", type=tool_vector, default=(0.0, 0.0, 0.0), help="believed less true tool, mm"
    )
    parser.add_argument(
        "--points", metavar="N", type=count(2, 1_000_000), help="nodes per axis of grids; default 21, rotary axes 37"
    )
    parser.add_argument(
        "--tables", action="store_true", help="types as tables of single functions where they have them"
    )
    add_range(parser, "nodes and points")
    _add_motion(parser)
    parser.add_argument(
        "--repeatability",
        metavar="S|X=..",
        type=scatter,
        help="standard deviation of the functional point, mm, or by axis, mm or degrees; default: as the campaign shows it",
    )
    parser.add_argument("--figure", metavar="FILE", help="a figure, .png, .svg or .pdf")
    parser.add_argument("--seed", metavar="N", type=seed, default=0, help="of points and draws")
    add_unusual(parser)
    add_output(parser, "OUT.csv", "table of all numbers; the text goes to standard output anyway")


def _add_motion(parser: argparse.ArgumentParser) -> None:
    """What the axes can do, and may be asked for."""
    add_control_limits(parser)
    parser.add_argument(
        "--limit", metavar="X=..", type=limits, action=ByAxis, default={}, help="largest correction, mm or degrees"
    )
    parser.add_argument(
        "--speed-limit", metavar="X=..", type=limits, action=ByAxis, default={}, help="largest speed, per minute"
    )
    parser.add_argument(
        "--feed",
        metavar="F",
        type=number("mm/min", above=0.0),
        default=LINEAR_FEED,
        help=f"mm/min; default {LINEAR_FEED:g}",
    )
    parser.add_argument(
        "--turn",
        metavar="F",
        type=number("degrees/min", above=0.0),
        default=ROTARY_FEED,
        help=f"degrees/min; default {ROTARY_FEED:g}",
    )


def run(args: argparse.Namespace) -> int:
    """Read, forecast, write; 1 when values need attention. Raises `InputError`, `OutputError`, `NotDeterminedError`."""
    check_output(args.output, args.force, [args.solution])
    check_output(args.figure, args.force, [args.solution])
    check_figure(args.figure)
    with Progress() as progress:
        progress("reading the solution")
        import numpy as np

        solution = usable_solution(args.solution)
        progress("predicting")
        progress("predicting")
        found, notes = _forecast(solution, args, progress)
        feeds = np.array([args.feed if a.is_linear else args.turn for a in solution.machine.axes])
        _check_limits(found, solution, feeds, args)
        if args.figure:
            progress("drawing")
            _draw(found, solution, args)
    _write(found, solution, feeds, notes, args)
    return conclude(args, attention(solution, named=True) + _messages(solution))


def _messages(solution: Solution) -> list[str]:
    """Which axes were not measured over their entire travel."""
    measured = zip(solution.campaign.machine.axes, solution.measured_range(), strict=True)
    outside = [
        axis.letter
        for axis, (low, high) in measured
        if low > axis.travel[0] + 0.01 * axis.length or high < axis.travel[1] - 0.01 * axis.length
    ]
    if not outside:
        return []
    return [f"the travel of {', '.join(outside)} was not measured to its ends; the prediction is for the measured part"]


def _forecast(solution: Solution, args: argparse.Namespace, progress: Progress) -> tuple[Forecast, list[str]]:
    import numpy as np

    from volid.compensation.residual.forecast import forecast
    from volid.compensation.types import select
    from volid.exceptions import InputError
    from volid.uncertainty.lack_of_fit import lack_of_fit

    lists = [[t.strip() for t in text.split(",")] for text in args.type]
    loaded, on_files = _loaded(solution, args)
    if not lists and not loaded:
        raise InputError("--type TYPE is missing: name the types of the rows, or existing files with --compensation")
    for names in lists:
        select(names, solution.machine)
    tool = solution.most_used_tool() if args.tool is None else args.tool
    tools = [tool, *(args.tools or [])]
    made_from, notes = prepared(solution, args, tools)
    judged = _judged(solution, args) if args.rigid else made_from
    found = forecast(
        judged, lists, base_from(made_from, args, tool), np.array(tools), points=args.points, rule=rule_from(args.rule),
        form="tables" if args.tables else None, control=control_limits(args), tool_error=args.tool_error, seed=args.seed,
        ranges=ranges_from(made_from, args), made_from=made_from, every_tool=args.tool is None and not args.tools,
        repeatability=args.repeatability, loaded=loaded, progress=progress,
    )  # fmt: skip
    return found, [*notes, *on_files, *([FULL] if args.rigid else []), f"lack of fit: {lack_of_fit(solution)}"]


def _loaded(solution: Solution, args: argparse.Namespace) -> tuple[dict[str, Compensation], list[str]]:
    """The row of --compensation, as it acts on the machine in the state in which it was measured, and what that means."""
    from functools import reduce

    from volid.compensation.on_top import add_compensations
    from volid.controllers.existing.state import in_place
    from volid.io.control_files import existing_of, recorded_compensations

    if not args.compensation:
        return {}, []
    of = {"sign": args.compensation_sign, "options": dict(args.compensation_option)}
    with in_words_of(cnc="compensation_cnc", sign="compensation_sign"):
        held = existing_of(solution.machine, args.compensation, args.compensation_cnc, **of)
    if not held:
        return {}, []
    names = ", ".join(dict.fromkeys(n.rsplit("/", 1)[-1] for e in held for n in e.files))
    whole = reduce(add_compensations, (e.compensation for e in held))
    made, notes = in_place(whole, held, recorded_compensations(solution.campaign))
    return {names: made}, [*notes, *left_out(args.compensation, held)]


def _judged(solution: Solution, args: argparse.Namespace) -> Solution:
    """The full solution, cross effects included: what a compensation from rigid functions leaves of it is what remains."""
    full = in_frame(solution, args)
    return full.extrapolated() if args.extrapolate else full


def _check_limits(found: Forecast, solution: Solution, feeds: Any, args: argparse.Namespace) -> None:
    from volid.compensation.motion import asked_speed, check_motion
    from volid.exceptions import InputError

    for column in found.columns[1:]:
        try:
            speed = asked_speed(column.motion, feeds)
            check_motion(solution.machine, column.motion, speed, args.limit, args.speed_limit)
        except InputError as error:
            raise InputError(f"{column.name}: {error}") from None


def _draw(found: Forecast, solution: Solution, args: argparse.Namespace) -> None:
    from volid.report.plot.forecast import forecast_figure

    write_figure(forecast_figure(found, solution.machine.name), args.figure, args.force)


def _write(found: Forecast, solution: Solution, feeds: Any, notes: list[str], args: argparse.Namespace) -> None:
    from volid.io.functions_csv import Sheet, source_lines
    from volid.report.text.residual import COLUMNS, forecast_data, forecast_rows, forecast_text

    header = {
        "values": "remaining deviation after compensation, mm; orientation A, B, C rad; low, high: 95 % coverage interval",
        "draws": f"{found.draws}, {found.source}",
        **source_lines(solution, args.solution),
        "command": shlex.join(args.command_line),
    }
    if args.output:
        as_json, args.json = args.json, False
        write_sheet(Sheet(header, COLUMNS, forecast_rows(found)), args)
        args.json = as_json
    if args.json:
        print_json(forecast_data(found, solution.machine, feeds) | {"notes": notes})
        return
    print_verdict(solution)
    shown = 1 + len(args.tools or [])
    print("\n".join([*forecast_text(found, solution.machine, feeds, shown), *notes]))
