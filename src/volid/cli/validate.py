"""`volid validate`: a solution against readings that it was not made from."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from volid.cli.common import (
    add_allow_outside,
    add_output,
    add_solution,
    check_figure,
    check_output,
    conclude,
    explain,
    in_options,
    named_by,
    print_json,
    tell,
    usable_solution,
    write_figure,
)
from volid.cli.control_options import add_control, control_from, loaded_files
from volid.cli.left_over import left_out
from volid.cli.numbers import add_unusual, number
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.validation.readings.validation import Validation

HELP = "a solution tested by readings of another campaign: agreement with the prediction, E_n, what would be found"

_EPILOG = """\
The campaign is another set-up on the same machine (ISO/TR 16907 11.3); volid plan --validate
SOLUTION.h5 -o PLAN.toml plans one. Its own stations, dead paths, offsets and alignments are found
anew; the machine is held, and may differ from the solution only as far as the solution's
uncertainty allows. A right solution is confirmed in 95 of 100 cases. E_n is the residual over its
expanded uncertainty (k = 2), of reading and prediction together. What the campaign would have found
is said with it: scale, squareness, tool length, a bump in a function.

With --compensation the campaign was measured while these tables and grids were active; the
prediction is then what the solution says remains.

OUT.csv: one line per reading: set, row, reading_of_row (of rows with several), predicted, reading,
residual, u, E_n.

example:
  volid validate solution.h5 check.toml -o residuals.csv --figure validation.svg

exit status: 0 confirmed; 1 not confirmed, or no fair test: the fit has seen the readings,
compensations were active that are not stated, the solution is rejected by its own readings, or the
readings are too coarse to test anything; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument("campaign", metavar="CAMPAIGN", help="other readings of the same machine: a manifest or HDF5")
    parser.add_argument(
        "--level",
        metavar="P",
        type=number(above=0.0, most=0.9999),
        default=0.95,
        help="probability with which a right solution is confirmed; default 0.95",
    )
    parser.add_argument("--extrapolate", action="store_true", help="readings outside the measured range too")
    parser.add_argument("--figure", metavar="FILE", help="residuals, E_n and regions, .svg, .pdf or .png")
    add_control(parser)
    add_unusual(parser)
    add_allow_outside(parser)
    add_output(parser, "OUT.csv", "every reading with its prediction, CSV")


def run(args: argparse.Namespace) -> int:
    """Read, test, write; 1 when the solution is not confirmed. Raises `InputError`, `OutputError`."""
    inputs = [args.solution, args.campaign, *named_by([args.campaign]), *args.compensation]
    for path in (args.output, args.figure):
        check_output(path, args.force, inputs)
    check_figure(args.figure)
    with Progress() as progress:
        progress("reading")
        from volid.io import load_campaign
        from volid.validation.readings.validation import validate

        solution = usable_solution(args.solution)
        campaign = load_campaign(args.campaign, allow_outside=args.allow_outside)
        progress("validating")
        found = validate(
            solution,
            campaign,
            control=control_from(args, solution.campaign.machine),
            level=args.level,
            extrapolate=args.extrapolate,
        )
        loaded = loaded_files(args, solution.campaign.machine) if args.compensation else ()
        _write(found, args)
    tell(args, left_out(args.compensation, loaded))
    return _say(found, args)


def _write(found: Validation, args: argparse.Namespace) -> None:
    from volid.io.functions_csv import Sheet, text_output, write_csv
    from volid.report.plot.validation import validation_figure
    from volid.report.text.validation import COLUMNS, reading_rows

    if args.figure:
        write_figure(validation_figure(found), args.figure, args.force)
    if args.output:
        header = {"solution": args.solution, "campaign": args.campaign, "verdict": found.verdict}
        header["units"] = "those of the readings; u: standard uncertainty of the residual; E_n = |residual| / (2 u)"
        with text_output(args.output, args.force) as stream:
            write_csv(stream, Sheet(header, COLUMNS, reading_rows(found)))


def _say(found: Validation, args: argparse.Namespace) -> int:
    from volid.report.text.validation import validation_data, validation_lines

    if args.json:
        print_json(validation_data(found))
    else:
        written = [f"written: {path}" for path in filter(None, (args.output, args.figure))]
        print(in_options("\n".join([*validation_lines(found), *written]), args))
    return conclude(args, found.attention)
