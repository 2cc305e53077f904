"""`volid study`: many simulated campaigns, each fitted and compared with its truth."""

from __future__ import annotations

import argparse
import shutil
from typing import TYPE_CHECKING, Any

from volid.cli.common import add_output, check_output, conclude, explain, input_files, print_json
from volid.cli.numbers import add_unusual, count
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.io.study_results import Places

HELP = "many simulated campaigns, each fitted and compared with its truth: bias, spread, coverage"
NAMED = 10  # failed campaigns named one by one

_EPILOG = """\
STUDY.toml (format "volid-study/1") names machines, designs (plans), factors on the noise, and seeds;
every combination is a campaign. Written are RESULTS.h5, RESULTS.csv (one row per campaign) and
RESULTS.summary.csv (bias, spread, coverage of the deviation field and of every function).

All cores are used; results do not depend on the number of workers. Finished campaigns are kept in
RESULTS.campaigns until all is written: an interrupted study goes on with --resume, also when
campaigns were added to it.

example:
  volid study study.toml -o results.h5

STUDY.toml:
  format = "volid-study/1"
  machines = ["models/wYXbZt_vertical.toml"]
  noise = [1.0, 2.0]
  seeds = 20
  [[design]]
  name = "standard"

exit status: 0 good; 1 written, but campaigns failed, or determine nothing, which are named; 2 bad
input; 130 interrupted
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    parser.add_argument("study", metavar="STUDY.toml", help="machines, designs, noise and seeds")
    parser.add_argument(
        "--workers", type=count(1, 10_000), metavar="N", help="processes on this machine; default: one per core"
    )
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler, such as tcp://host:8786, instead")
    parser.add_argument("--resume", action="store_true", help="go on with an interrupted study")
    add_unusual(parser)
    add_output(parser, "RESULTS.h5", "results; RESULTS.csv and RESULTS.summary.csv beside it", required=True)


def run(args: argparse.Namespace) -> int:
    """Carry out, write, summarise; 1 when campaigns failed. Raises `InputError`, `OutputError`, `VolidError`."""
    from volid.io.study_results import places

    output = places(args.output)
    for path in output[:3]:
        check_output(path, args.force, [args.study], alone=False)
    with Progress() as progress:
        records, found = _carry_out(args, output, progress)
    shutil.rmtree(output.folder, ignore_errors=True)
    failed = [r for r in records if r["error"]]
    if args.json:
        print_json({**_as_json(output, failed), "campaigns": len(records), "summary": found})
    else:
        print("\n".join([*_lines(found), f"\nwritten: {', '.join(map(str, output[:3]))}"]))
    return conclude(args, _failures(failed) + _open(records))


def _carry_out(
    args: argparse.Namespace, output: Places, progress: Progress
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """All campaigns, written; their records and the summary."""
    progress("reading the study")
    from volid.io.basics.provenance import provenance
    from volid.io.studies import read_study, study_files
    from volid.io.study_results import CampaignFolder, write_results
    from volid.study.campaigns import run_study
    from volid.study.summary import summary

    study = read_study(args.study)
    files, plans = study_files(args.study)
    record = provenance([*files, *input_files(list(map(str, plans)))], args.command_line)
    folder = CampaignFolder(output.folder, study, args.resume)
    done = folder.done() if args.resume else {}
    records = run_study(
        study, workers=args.workers, scheduler=args.scheduler, done=done, save=folder.save, progress=progress
    )
    found = summary(records)
    progress("writing the results")
    write_results(output, records, found, record, args.force)
    return records, found


def _as_json(output: Places, failed: list[dict[str, Any]]) -> dict[str, Any]:
    names = ("machine", "design", "noise", "seed", "error")
    return {
        "output": str(output.hdf5),
        "campaigns_csv": str(output.campaigns),
        "summary_csv": str(output.summary),
        "failed": [{name: r[name] for name in names} for r in failed],
    }


def _lines(rows: list[dict[str, Any]]) -> list[str]:
    """The deviation field of every machine, design and noise, in µm."""
    from volid.study.summary import FIELD

    lines = ["deviation field, 3-D [µm]        campaigns  failed  rejected   bias  spread    rms      u  coverage"]
    for r in rows:
        if r["quantity"] == FIELD:
            numbers = "".join(
                f" {_number(1e3 * r[name], 2):>{w}}" for name, w in (("bias", 6), ("spread", 7), ("rms", 6), ("u", 6))
            )
            name = f"{r['machine']}, {r['design']}, noise {r['noise']:g}"
            counts = f"{r['campaigns']:9d} {r['failed']:7d} {r['rejected']:9d}"
            lines.append(f"{name:<32} {counts}{numbers} {_number(100.0 * r['coverage'], 1):>7} %")
    return lines


def _number(value: float, digits: int) -> str:
    """A number, or n.d. for one that no campaign determines."""
    return "n.d." if value != value else f"{value:.{digits}f}"


def _open(records: list[dict[str, Any]]) -> list[str]:
    """Campaigns that were fitted but determine the deviation nowhere, in words."""
    found = [r for r in records if not r["error"] and r["rms"] != r["rms"]]
    designs = ", ".join(dict.fromkeys(r["design"] for r in found))
    if not found:
        return []
    return [
        f"{len(found)} of {len(records)} campaigns determine the deviation nowhere (design {designs}): bias, spread and coverage "
        "are from the others. volid fit names what such a plan leaves open"
    ]


def _failures(failed: list[dict[str, Any]]) -> list[str]:
    from volid.study.campaigns import Task

    names = Task._fields
    messages = [f"{Task(*(r[n] for n in names))} failed: {r['error']}" for r in failed[:NAMED]]
    if len(failed) > NAMED:
        messages.append(f"{len(failed) - NAMED} more campaigns failed; column error of the results says why")
    return messages
