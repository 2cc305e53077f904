"""`volid import`: a campaign from text to one self-contained HDF5 file."""

from __future__ import annotations

import argparse
import sys

from volid.cli.common import add_allow_outside, add_output, check_output, explain, input_files, named_by, print_json

HELP = "a campaign from text (a manifest and CSV files) to one HDF5 file"

_EPILOG = """\
Reads the manifest, its machine file and its CSV files, checks everything that can be checked
before a fit (units, duplicated rows, travels), and writes one self-contained file. Several
manifests of one machine are merged.

example:
  volid import campaign.toml -o campaign.h5

exit status: 0 good, with odd readings named on standard error; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    parser.add_argument("manifest", metavar="MANIFEST.toml", nargs="+", help="campaign as text")
    parser.add_argument(
        "--accept-large-errors",
        action="store_true",
        help="errors are as large as they seem; kept in the file as large_errors = true of every set",
    )
    add_allow_outside(parser)
    add_output(parser, "CAMPAIGN.h5", "campaign as one HDF5 file", required=True)


def run(args: argparse.Namespace) -> int:
    """Read, check, write. Raises `InputError`, `OutputError`."""
    from volid.io import load_campaign, write_campaign
    from volid.observations.base import with_large_errors
    from volid.plausibility.checks import check_campaign

    check_output(args.output, args.force, [*args.manifest, *named_by(args.manifest)])
    campaign = load_campaign(*args.manifest, allow_outside=args.allow_outside)
    check_output(args.output, args.force, input_files(args.manifest))
    if args.accept_large_errors:
        campaign = with_large_errors(campaign)
    warnings = [*campaign.warnings, *check_campaign(campaign)]
    write_campaign(campaign, args.output, overwrite=args.force)
    sets = [{"set": s.name, "kind": s.kind, "n_readings": int(s.readings.size)} for s in campaign.sets]
    for warning in warnings:
        print(f"volid import: {warning}", file=sys.stderr)
    if args.json:
        found = {"machine": campaign.machine.name, "stations": len(campaign.stations), "sets": sets}
        print_json({"output": args.output, **found, "warnings": warnings})
    else:
        for s in sets:
            print(f"set {s['set']}: {s['n_readings']} readings, {s['kind']}")
        print(f"{campaign.n_readings} readings from {len(campaign.stations)} stations on '{campaign.machine.name}'")
        print(f"written: {args.output}")
    return 0
