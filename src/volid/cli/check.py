"""`volid check`: few new readings on an old solution."""

from __future__ import annotations

import argparse

from volid.cli.common import (
    add_allow_outside,
    add_output,
    add_solution,
    attention,
    check_output,
    conclude,
    explain,
    input_files,
    named_by,
    print_json,
)
from volid.cli.numbers import add_unusual
from volid.cli.progress import Progress

HELP = "a quick check of an old solution by few new readings: what has changed, and the solution updated"

_EPILOG = """\
CAMPAIGN holds few new readings on the machine: forty distances, a circle of a ball bar, four
diagonals. They are compared with what the solution predicts, with the u of both; false alarms are
5 %. Where they disagree, what changed is named: a squareness or location error, the scale of an
axis, an error motion, or a tool or instrument that differs; and what the readings cannot tell from
it. "found with 90 %" says how small a change this check finds.

UPDATED.h5 is the solution of the new readings with the old one as prior knowledge, of which what
changed is released.

example:
  volid check acceptance.h5 monday.toml -o updated.h5

exit status: 0 no change found; 1 written, and what changed is named; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument("campaign", metavar="CAMPAIGN", nargs="+", help="new readings, HDF5 or manifest")
    add_unusual(parser)
    add_allow_outside(parser)
    add_output(parser, "UPDATED.h5", "solution of the new readings with the old one as prior")


def run(args: argparse.Namespace) -> int:
    """Read, check, write; 1 where something changed. Raises `InputError`, `OutputError`."""
    inputs = [args.solution, *args.campaign]
    check_output(args.output, args.force, [*inputs, *named_by(args.campaign)])
    with Progress() as progress:
        progress("reading the campaign")
        from dataclasses import replace

        from volid.io import load_campaign
        from volid.io.basics.provenance import provenance
        from volid.io.solutions import read_solution
        from volid.report.text.check import check_attention, check_data, check_lines
        from volid.validation.check import check

        solution = read_solution(args.solution)
        campaign = load_campaign(*args.campaign, allow_outside=args.allow_outside)
        found = check(solution, campaign, progress=progress)
        if args.output:
            files = [args.solution, *input_files(args.campaign)]
            record = provenance(files, args.command_line, {"prior": args.solution})
            replace(found.updated, provenance=record).save(args.output, args.force)
    if args.json:
        print_json({"output": args.output, **check_data(found)})
    else:
        print("\n".join(check_lines(found)))
        if args.output:
            print(f"written: {args.output}")
    doubts = attention(found.updated, named=True) if args.output else []
    return conclude(args, [*check_attention(found), *doubts])
