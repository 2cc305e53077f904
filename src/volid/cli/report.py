"""volid report: a solution as one page to look at, to print and to hand over."""

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
    in_options,
    print_json,
    tell,
)
from volid.cli.handover import add_handover, check_handover, hand_over
from volid.cli.numbers import add_unusual, tool_vector
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.report.contents.contents import Contents

HELP = "one page to look at, to print and to hand over: verdict, figures, the deviation field, limits, provenance"
_EPILOG = """\
The page is one HTML file that needs no other, and prints to A4 with page numbers. Volumetric numbers
hold for one tool vector. Expanded uncertainties U have k = 2.

LIMITS.toml names the largest size allowed, in mm and rad, by symbol:
  rule = "guard band"        # ISO 14253-1 with U (default); or "simple": the value alone is compared
  largest_deviation = 0.050  # of the functional point over the working volume
  V_X = 0.040                # to V_C: volumetric accuracy of ISO 230-1, range of a component
  EC0Y = 15e-6               # squareness and location errors, their size
  EXX = 0.010                # error motions, their range over the measured travel
  "E[YZ]X" = 0.005           # all symbols of a form that have no limit of their own

--dcc writes an UNSIGNED RESULT FILE in the format of a digital calibration certificate (DCC 3.3.0):
no certificate, which is a laboratory's act. DATA.toml (or [conditions.dcc] of the campaign)
states what the file also needs; what is not stated is named, and nothing is invented:
  country = "DE"             # of the laboratory
  identifier = "K-2026-0417"
  begin = 2026-03-11
  end = 2026-03-12
  place = "customer"         # or laboratory, laboratoryBranch, customerBranch, other
  laboratory = { name = "…", street = "…", number = "…", post_code = "…", city = "…", country = "DE" }
  customer = { name = "…", city = "…" }
  machine = { manufacturer = "…", model = "…", serial_number = "…" }
  person = [{ name = "…", role = "…" }]
  instrument = [{ name = "…", serial_number = "…", certificate = "…" }]

example:
  volid report solution.h5 -o report.html --limits limits.toml
  volid report solution.h5 -o report.html --workbook result.xlsx --dcc result.xml --dcc-data lab.toml

exit status: 0 good; 1 written, but the result needs attention, or a limit is exceeded or not proved
to be kept, which is named; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument("--tool", metavar="x,y,z", type=tool_vector, help="tool vector, mm; default: the most used one")
    parser.add_argument(
        "--limits", metavar="LIMITS.toml", help="largest sizes allowed, see below; conformity is stated"
    )
    parser.add_argument("--lang", choices=("en", "de"), default="en", help="language of the page; default en")
    parser.add_argument(
        "--title", metavar="TEXT", default="", help="title of the page; default: from the machine's name"
    )
    add_handover(parser)
    add_unusual(parser)
    add_output(parser, "REPORT.html", "the page, one file that needs no other", required=True)


def run(args: argparse.Namespace) -> int:
    """Read, gather, draw, write. Raises `InputError`, `OutputError`."""
    inputs = [args.solution, *(f for f in (args.limits, args.dcc_data) if f)]
    check_output(args.output, args.force, inputs)
    data = check_handover(args, inputs)
    with Progress() as progress:
        progress("reading the solution")
        from volid.io.evaluations.limits import read_limits, read_rule
        from volid.io.functions_csv import text_output
        from volid.io.solutions import read_solution
        from volid.report.contents.contents import gather
        from volid.report.language import Texts
        from volid.report.page.page import page

        if args.limits:  # before the work; symbols and sizes are checked with it
            read_limits(args.limits), read_rule(args.limits)
        solution = read_solution(args.solution)
        progress("evaluating the working volume")
        contents = gather(solution, args.tool, args.solution, args.limits, args.title, args.command_line)
        text = page(contents, Texts(args.lang), progress)
        with text_output(args.output, args.force) as stream:
            stream.write(text)
        missing = hand_over(contents, data, args, progress)
    return _say(contents, args, missing)


def _say(contents: Contents, args: argparse.Namespace, missing: list[str]) -> int:
    """What was written, and what needs attention."""
    from volid.report.text.evaluations import evaluations_data, unproved

    messages = [in_options(m, args) for m in (*_barrier(contents), *_others(contents))]
    if args.json:
        print_json(
            {**evaluations_data([contents.evaluation]), "barrier": contents.barrier or None, "attention": messages}
        )
    else:
        beside = () if contents.barrier else (args.workbook, args.dcc)
        print(f"written: {', '.join(f for f in (args.output, *beside) if f)}")
    tell(args, missing)
    return conclude(args, [*messages, *unproved([contents.evaluation])])


def _others(contents: Contents) -> list[str]:
    """What else needs attention; the barrier's reason is not repeated."""
    reason = contents.barrier
    return [message for message in attention(contents.solution) if not (reason and message.endswith(reason))]


def _barrier(contents: Contents) -> list[str]:
    """Why no numbers are shown; nothing where they are."""
    if not contents.barrier:
        return []
    return [f"no numbers are shown{' and no limit is judged' if contents.limits else ''}: {contents.barrier}"]
