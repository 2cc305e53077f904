"""`volid fit`: from campaigns to a solution."""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from volid.cli.common import (
    add_allow_outside,
    add_output,
    attention,
    check_output,
    conclude,
    explain,
    input_files,
    named_by,
    print_json,
)
from volid.cli.numbers import add_unusual, tool_vector
from volid.cli.progress import PATIENCE, Progress

if TYPE_CHECKING:
    from volid.campaign import Campaign
    from volid.fitting.solution import Solution

HELP = "identify the machine's error model from one or more campaigns"

_EPILOG = """\
CAMPAIGN is an HDF5 file or a manifest; several of one machine are fitted together. The verdict (do
the residuals agree with the stated uncertainties?) and what the data do not determine stand first
in the summary that is printed.

example:
  volid fit campaign.toml ballbar.h5 --robust --datum primary=Z,secondary=X -o solution.h5

Functions refer to the measured range of their axes. How smooth they are follows from the readings,
where the machine file states no segments; what lies between the positions is part of every u.
"Smooth over" in the summary is the distance over which the values of a function stay alike.

With several sets the summary says of each whether its u fits its scatter, whether it contradicts
the others, and how well they predict it. --estimate-u, behind the campaigns, finds the u of sets
from their residuals (restricted maximum likelihood), one factor for the readings of each unit; the
factors stand in the summary and in SOLUTION.h5, beside the u that were stated:
  volid fit campaign.toml ballbar.h5 -o solution.h5 --estimate-u bar

Where the manifest names a log of the air ([[environment]]), lengths read in light are corrected
with it, and lengths are reduced to 20 °C where it says how machine and artefact expand; "air and
temperature" in the summary says by how much.

exit status: 0 good; 1 written, but the model is rejected by the data, not everything is
determined, an axis was measured at positions too far apart for its functions, or the iteration has
not converged; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    parser.add_argument("campaign", metavar="CAMPAIGN", nargs="+", help="campaign, HDF5 or manifest")
    parser.add_argument("--robust", action="store_true", help="find gross outliers, name them and set them aside")
    parser.add_argument(
        "--datum", metavar="KEY=VALUE,…", help="primary, secondary, line, reference_X, …; default: machine's"
    )
    parser.add_argument(
        "--tool", metavar="x,y,z", type=tool_vector, help="mm, for the summary; default: the most used one"
    )
    parser.add_argument(
        "--prior",
        metavar="SOLUTION0.h5",
        help="earlier solution of axes of this machine; counts as readings, with its u",
    )
    parser.add_argument(
        "--estimate-u",
        metavar="SET",
        nargs="*",
        help="estimate the u of these sets from the residuals; of all sets where none is named, or for all",
    )
    parser.add_argument(
        "--solver",
        choices=("chord", "optimistix"),
        default="chord",
        help="chord (default): fewest assemblies of the normal equations; optimistix: one a step; the minimum is the same",
    )
    parser.add_argument(
        "--stream",
        action="store_true",
        help="read one HDF5 campaign part by part, for more readings than fit into memory; stations, smoothness and rank are "
        "decided on a sample",
    )
    parser.add_argument(
        "--accept-large-errors",
        action="store_true",
        help="take errors of any size without asking whether readings are in another unit (in a [[set]]: large_errors = true)",
    )
    add_unusual(parser)
    add_allow_outside(parser)
    add_output(parser, "SOLUTION.h5", "solution, with its campaign and machine", required=True)


def run(args: argparse.Namespace) -> int:
    """Fit, write, summarise; 1 when something needs attention. Raises `InputError`, `OutputError`."""
    check_output(args.output, args.force, [*_inputs(args), *named_by(args.campaign)])
    began = time.monotonic()
    with Progress() as progress:
        solution = _solve(args, progress)
        _summarise(args, solution, progress)
    elapsed = time.monotonic() - began
    if elapsed > PATIENCE:
        sys.stdout.flush()
        print(f"volid: done in {elapsed:.0f} s", file=sys.stderr)
    return conclude(args, attention(solution))


def _inputs(args: argparse.Namespace) -> list[str]:
    return [*args.campaign, *([args.prior] if args.prior else [])]


def _solve(args: argparse.Namespace, progress: Progress) -> Solution:
    """Read, fit and write."""
    progress("reading the campaign")
    from volid.io.solutions import read_solution

    prior = read_solution(args.prior) if args.prior else None
    solution = (_stream if args.stream else _in_memory)(args, prior, progress)
    progress("writing the solution")
    solution.save(args.output, args.force)
    return solution


def _in_memory(args: argparse.Namespace, prior: Solution | None, progress: Progress) -> Solution:
    """Fit all readings at once. Raises `InputError`."""
    from volid.fitting.datum import parse_datum
    from volid.fitting.fit import fit
    from volid.io import load_campaign

    campaign = load_campaign(*args.campaign, allow_outside=args.allow_outside)
    _ask_tool(campaign, args)
    large, estimate = args.accept_large_errors, _sets_to_estimate(args)
    options = {"robust": args.robust, "solver": args.solver, "accept_large_errors": large, "estimate_u": estimate}
    record = _record(args, options)
    datum = parse_datum(campaign.machine, args.datum) if args.datum else None
    found = fit(
        campaign,
        robust=args.robust,
        datum=datum,
        prior=prior,
        estimate_u=estimate,
        solver=args.solver,
        accept_large_errors=large,
        progress=progress,
    )
    return replace(found, provenance=record)


def _sets_to_estimate(args: argparse.Namespace) -> bool | list[str]:
    """Whose u is estimated: False, True for every set, or names of sets."""
    return False if args.estimate_u is None else args.estimate_u or True


def _ask_tool(campaign: Campaign, args: argparse.Namespace) -> None:
    """Before the fit. Raises `InputError` for a tool vector of the summary that looks like another unit than mm."""
    from volid.model.requests import ask_tools

    if args.tool is not None:
        ask_tools(campaign.machine, args.tool, campaign.tool_vectors)


def _record(args: argparse.Namespace, options: dict[str, Any]) -> dict[str, str]:
    from volid.io.basics.provenance import provenance

    options |= {"datum": args.datum, "prior": args.prior}
    return provenance(input_files(_inputs(args)), args.command_line, options)


def _stream(args: argparse.Namespace, prior: Solution | None, progress: Progress) -> Solution:
    """Fit part by part. Raises `InputError` for several campaigns, or options that need all readings at once."""
    from volid.exceptions import InputError
    from volid.fitting.datum import parse_datum
    from volid.fitting.streamed import fit_streamed
    from volid.io.campaign.stream import CampaignStream

    if len(args.campaign) > 1:
        raise InputError(f"--stream reads one campaign; {len(args.campaign)} are given. Expected one HDF5 file")
    if args.robust or args.solver != "chord" or args.estimate_u is not None:
        wrong = "--robust" if args.robust else f"--solver {args.solver}"
        wrong = wrong if args.estimate_u is None else "--estimate-u"
        raise InputError(
            f"--stream and {wrong} exclude each other: that needs all readings at once; leave one of them out"
        )
    stream = CampaignStream(args.campaign[0])
    record = _record(args, {"stream": True})
    first = next(stream.parts())
    _ask_tool(first, args)
    datum = parse_datum(first.machine, args.datum) if args.datum else None
    large = args.accept_large_errors
    found = fit_streamed(stream, datum=datum, prior=prior, accept_large_errors=large, progress=progress)
    return replace(found, provenance=record)


def _summarise(args: argparse.Namespace, solution: Solution, progress: Progress) -> None:
    progress("evaluating the working volume")
    from volid.report.text.summary import summary_data
    from volid.report.text.summary_lines import format_summary

    data = summary_data(solution, args.tool)
    if args.json:
        print_json({"output": args.output, **data, "attention": attention(solution)})
    else:
        print(format_summary(data) + f"\n\nwritten: {args.output}")
