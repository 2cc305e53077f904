"""volid report: a solution as one page to look at, to print and to hand over."""

from __future__ import annotations

import argparse

from volid.cli.common import add_output, add_solution, attention, check_output, conclude, explain, usable_solution
from volid.cli.progress import Progress

HELP = "one page to look at, to print and to hand over: verdict, figures, the deviation field, limits, provenance"
_EPILOG = """\
example:
  volid report solution.h5 -o report.html

exit status: 0 good; 1 written, but the result needs attention, which is named; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument("--lang", choices=("en", "de"), default="en", help="language of the page; default en")
    add_output(parser, "REPORT.html", "the page, one file that needs no other", required=True)


def run(args: argparse.Namespace) -> int:
    """Read, gather, draw, write. Raises `InputError`, `OutputError`."""
    check_output(args.output, args.force, [args.solution])
    with Progress() as progress:
        progress("reading the solution")
        from volid.io.functions_csv import text_output
        from volid.report.contents.contents import gather
        from volid.report.language import Texts
        from volid.report.page.page import page

        solution = usable_solution(args.solution)
        progress("drawing")
        text = page(gather(solution, source=args.solution), Texts(args.lang))
        with text_output(args.output, args.force) as stream:
            stream.write(text)
    return conclude(args, attention(solution))
