"""Files that `volid report` writes beside the page: workbook and certificate data."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from volid.cli.common import check_output
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.report.contents.contents import Contents


def add_handover(parser: argparse.ArgumentParser) -> None:
    """--workbook, --dcc, --dcc-data."""
    parser.add_argument(
        "--workbook", metavar="FILE.xlsx", help="also a workbook: one sheet per table, values as numbers"
    )
    parser.add_argument(
        "--dcc", metavar="FILE.xml", help="also an unsigned result file in the format of DCC 3.3.0, see below"
    )
    parser.add_argument(
        "--dcc-data", metavar="DATA.toml", help="laboratory, customer, machine, persons, dates for --dcc"
    )


def check_handover(args: argparse.Namespace, inputs: Sequence[str]) -> dict[str, Any]:
    """Refuse now what could not be written after the work; what --dcc-data holds. Raises `InputError`, `OutputError`."""
    from volid.exceptions import InputError
    from volid.io.basics.toml_table import read_toml
    from volid.report.certificate.facts import check_facts

    if args.dcc_data and not args.dcc:
        raise InputError(f"--dcc-data {args.dcc_data} is for --dcc, which is not asked for; name the file with --dcc")
    files = [args.output]
    for name, ending in ((args.workbook, ".xlsx"), (args.dcc, ".xml")):
        if name is None:
            continue
        if Path(name).suffix.lower() != ending:
            raise InputError(f"{name}: the file ends in {ending}; name it so")
        check_output(name, args.force, inputs)
        if any(Path(name).resolve() == Path(other).resolve() for other in files):
            raise InputError(f"{name} is asked for twice; choose another name")
        files.append(name)
    data = read_toml(args.dcc_data) if args.dcc_data else {}
    check_facts(data, args.dcc_data or "--dcc-data")
    return data


def hand_over(contents: Contents, data: dict[str, Any], args: argparse.Namespace, progress: Progress) -> list[str]:
    """Write the files that were asked for; notes about what nobody stated. Raises `InputError`, `OutputError`."""
    from volid.report.language import Texts

    if contents.barrier:  # the page says so; no numbers are handed over
        names = " and ".join(name for name in (args.workbook, args.dcc) if name)
        return [f"not written: {names}; no numbers are handed over that the page does not show"] if names else []
    if args.workbook:
        from volid.report.workbook.workbook import workbook_of

        progress("writing the workbook")
        workbook_of(contents, args.workbook, Texts(args.lang), args.force)
    if not args.dcc:
        return []
    from volid.report.certificate.administration import Request
    from volid.report.certificate.certificate import certificate_of
    from volid.report.certificate.facts import facts_of

    progress("writing the result file")
    facts = facts_of(contents.solution.campaign, data, args.dcc_data or "--dcc-data")
    request = Request(contents.solution, facts, args.solution, args.lang)
    certificate_of(contents, args.dcc, request, args.force)
    names = ", ".join(key.replace("_", " ") for key in request.missing())
    return [f"{args.dcc} is an unsigned result file; not stated, and named in it: {names}"] if names else []
