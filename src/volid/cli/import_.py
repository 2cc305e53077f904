"""`volid import`: campaigns as text, and files of other programs, to one campaign."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from volid.cli.common import (
    add_allow_outside,
    add_output,
    check_output,
    explain,
    input_files,
    named_by,
    print_json,
    write_sheet,
)
from volid.cli.import_options import add_foreign, keys_of

if TYPE_CHECKING:
    from volid.campaign import Campaign
    from volid.io.instruments.base import Evaluation

HELP = "a campaign from text (manifest and CSV files), or from files of instruments and other programs"

_EPILOG = """\
MANIFEST.toml: reads the manifest, its machine file and its CSV files, checks everything that can be checked before a fit
(units, duplicated rows, travels), and writes one self-contained file. Several manifests of one machine are merged. A [[set]]
may name a file of another program: file = "x.rtl", as = "rtl", and the keys below.

other FILEs: each becomes one set. --machine and what the file does not say are stated by options, which are keys of its
[[set]]: --axis X, --at Y=300,Z=-250 (where the others stood), --tool 0,0,-150 (where the reflector or probe was), --u 0.0005,
--key NAME=VALUE for any other. The type is recognised by content, or stated by --as; --formats lists the types, what is
read of each, what is assumed, and its keys. What is imported, and by which keys, is kept in the campaign's conditions. A file
that holds another program's results instead of readings makes no campaign: its table is shown, or written as CSV with -o.

delimited text of any other program is read by a map of its columns: --as text with --key 'columns={x="X_mm"}' and the like,
or --map MAP.toml, a file of these keys. A campaign that was imported so remembers its map, and is the --map of the next file.

touches of a probe (msr, linuxcnc, text with --key touches=true): a sphere is fitted to the touches of each tool path, name or
pose of the rotary axes (--key gap=40 or --key count=9 tell spheres apart where these do not), and its centre is the reading,
with the u that the scatter of all touches and their places give; --u is what a centre is uncertain by besides, such as the
machine's repeatability. Optional keys: origin, sphere_diameter, ball_diameter, fix_radius, touch_u (datasets/README.md says
what they mean).

CAMPAIGN is one HDF5 file; ending in .toml a manifest with its CSV files beside it, or a folder for them, ending in /.

example:
  volid import campaign.toml -o campaign.h5
  volid import probe.txt --machine machine.toml --tool 0,0,-230 --key coordinates=tip --key gap=40 -o spheres.h5
  volid import next.csv --map first.toml -o next.h5
  volid import x.rtl --machine machine.toml --axis X --at Y=300,Z=-250 --tool 0,0,-150 --u 0.0005 -o x.h5

exit status: 0 good, with odd readings named on standard error; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    parser.add_argument("files", metavar="FILE", nargs="+", help="campaign as text, or a file of another program")
    add_foreign(parser)
    parser.add_argument(
        "--accept-large-errors",
        action="store_true",
        help="errors are as large as they seem; kept in the file as large_errors = true of every set",
    )
    add_allow_outside(parser)
    add_output(parser, "CAMPAIGN", "campaign as one HDF5 file (.h5), or as text (.toml, or a folder)")


def run(args: argparse.Namespace) -> int:
    """Read, check, write. Raises `InputError`, `OutputError`."""
    keys = _with_map(args, keys_of(args))
    if args.machine or keys or not all(map(_is_campaign, args.files)):
        return _foreign(args, keys)
    from volid.io import load_campaign

    _check_output(args, [*args.files, *named_by(args.files)])
    campaign = load_campaign(*args.files, allow_outside=args.allow_outside)
    _check_output(args, input_files(args.files))
    return _finish(args, campaign)


def _with_map(args: argparse.Namespace, keys: dict[str, Any]) -> dict[str, Any]:
    """The keys with those of --map before them; its machine file counts where --machine is absent."""
    if not args.map:
        return keys
    from volid.io.campaign.column_map import read_map

    found = read_map(args.map)
    if found.machine is not None and not args.machine:
        args.machine = str(found.machine)
    return {**found.keys, **keys}


def _is_campaign(name: str) -> bool:
    """Whether a file is a campaign of volid's own, or meant to be one."""
    from volid.exceptions import VolidError
    from volid.io.campaign.files import is_campaign
    from volid.io.instruments.recognition import fitting, open_foreign, volids_own

    path = Path(name)
    if not path.exists() or is_campaign(path):
        return True
    try:
        file = open_foreign(path)
    except VolidError:
        return False
    return bool(volids_own(file.text)) or (path.suffix.lower() == ".csv" and not fitting(file))


def _foreign(args: argparse.Namespace, keys: dict[str, Any]) -> int:
    """Files of other programs: a campaign, or the tables that they hold."""
    from volid.exceptions import InputError
    from volid.io.campaign.imported import evaluation_of, import_files

    stated = keys.get("as", "auto"), keys.get("encoding")
    tables = [found for name in args.files if (found := evaluation_of(name, *stated)) is not None]
    if tables and len(tables) < len(args.files):
        raise InputError("some files hold readings and others what was evaluated; import them one by one")
    if tables:
        return _show(args, tables)
    if not args.machine:
        raise InputError(f"{args.files[0]}: this holds readings; name the machine that was measured with --machine")
    _check_output(args, [*args.files, args.machine])
    return _finish(args, import_files(args.files, args.machine, keys))


def _show(args: argparse.Namespace, tables: Sequence[Evaluation]) -> int:
    """Tables of what another program has evaluated: on standard output, as JSON, or as CSV in a file."""
    from volid.exceptions import InputError
    from volid.io.functions_csv import Sheet

    if args.machine:
        raise InputError(f"{args.files[0]}: this holds what was evaluated, and no readings; show it without --machine")
    if len(tables) > 1:
        raise InputError("each of the files holds a table of its own; import them one by one")
    check_output(args.output, args.force, args.files)
    write_sheet(Sheet(*tables[0]), args)
    return 0


def _check_output(args: argparse.Namespace, inputs: Sequence[str | Path]) -> None:
    from volid.exceptions import InputError

    if args.output is None:
        raise InputError(f"{args.files[0]}: this makes a campaign; name its file with -o, such as -o campaign.h5")
    if not Path(args.output).is_dir() and not args.output.endswith("/"):
        check_output(args.output, args.force, inputs, alone=not args.output.lower().endswith(".toml"))


def _write(args: argparse.Namespace, campaign: Campaign) -> None:
    """One HDF5 file, or the text form."""
    from volid.io import write_campaign, write_manifest

    as_text = args.output.lower().endswith(".toml") or args.output.endswith("/") or Path(args.output).is_dir()
    (write_manifest if as_text else write_campaign)(campaign, args.output, overwrite=args.force)


def _finish(args: argparse.Namespace, campaign: Campaign) -> int:
    """Check a campaign, write it, and say what it holds."""
    from volid.observations.base import with_large_errors
    from volid.plausibility.checks import check_campaign

    if args.accept_large_errors:
        campaign = with_large_errors(campaign)
    warnings = [*campaign.warnings, *check_campaign(campaign)]
    _write(args, campaign)
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
