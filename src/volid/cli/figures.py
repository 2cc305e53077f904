"""`volid figures`: a solution as figures for papers, one file each."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from volid.cli.common import (
    add_output,
    add_solution,
    attention,
    conclude,
    explain,
    in_options,
    print_json,
    write_figure,
)
from volid.cli.numbers import add_unusual, tool_vector
from volid.cli.progress import Progress
from volid.report.plot.collection import FIGURES, check_names, draw

if TYPE_CHECKING:
    from volid.report.plot.collection import Named

HELP = "figures for papers, one file each: functions, sections of the field, residuals, stations and more"
FORMATS = ("svg", "pdf", "png")

_LINES = "\n".join(f"  {name:<13}{words}" for name, (_, words) in FIGURES.items())
_EPILOG = f"""\
figures:
{_LINES}

A figure that does not apply to the solution is left out, and the reason is given. All figures are
written, or none. Bands and bars are U with k = 2 unless a figure says otherwise.

example:
  volid figures solution.h5 -o figures --only functions,sections --format pdf --tool 0,0,-150

exit status: 0 good, whether or not figures were left out; 1 written, but the result needs
attention, which is named; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument("--only", metavar="NAME[,NAME]", type=_names, default=(), help="these figures; default: all")
    parser.add_argument("--format", choices=FORMATS, default="svg", help="of the files; default svg")
    parser.add_argument(
        "--tool", metavar="x,y,z", type=tool_vector, help="tool vector, mm; default: the most used one of the campaign"
    )
    parser.add_argument("--lang", choices=("en", "de"), default="en", help="language of the figures; default en")
    parser.add_argument(
        "--own-scales", action="store_true", help="each panel of functions has its own scale, not one for all"
    )
    add_unusual(parser)
    add_output(parser, "DIR", "folder for the files NAME.svg", required=True)


def _names(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())


def run(args: argparse.Namespace) -> int:
    """Read, draw, write; 1 when the solution needs attention. Raises `InputError`, `OutputError`."""
    from volid.io.basics.atomic import atomic_folder

    check_names(args.only)
    found: list[Named] = []
    with Progress() as progress, atomic_folder(args.output, args.force) as folder:
        progress("reading the solution")
        from volid.io.solutions import read_solution
        from volid.report.language import Texts
        from volid.report.plot.asked import Asked

        solution = read_solution(args.solution)
        if args.tool is not None:
            solution.ask(args.tool)
        asked = Asked(solution, args.tool or solution.most_used_tool(), Texts(args.lang), args.own_scales)
        for named in draw(asked, args.only):
            progress(f"drawing {named.name}")
            if named.figure is not None:
                write_figure(named.figure, folder / f"{named.name}.{args.format}", args.force)
            found.append(named._replace(figure=None))
    _say(found, args)
    return conclude(args, attention(solution))


def _say(found: list[Named], args: argparse.Namespace) -> None:
    """What was written, and what was left out for which reason."""
    written = [f"{n.name}.{args.format}" for n in found if not n.reason]
    left_out = {n.name: in_options(n.reason, args) for n in found if n.reason}
    if args.json:
        print_json({"folder": args.output, "written": written, "left_out": left_out})
        return
    for reason in dict.fromkeys(left_out.values()):
        print(f"left out: {', '.join(name for name, other in left_out.items() if other == reason)}: {reason}")
    print(f"written to {args.output}: {', '.join(written) or 'no figure'}")
