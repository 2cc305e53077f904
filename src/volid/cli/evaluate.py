"""`volid evaluate`: readings evaluated by a standard alone, without an error model."""

from __future__ import annotations

import argparse
import importlib
from typing import TYPE_CHECKING, Any

from volid.cli.common import (
    add_allow_outside,
    add_output,
    check_figure,
    check_output,
    conclude,
    explain,
    in_options,
    named_by,
    print_json,
    write_figure,
)
from volid.cli.numbers import add_unusual
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from collections.abc import Sequence

    from volid.standards.results import Evaluation

HELP = "a test evaluated by its standard: positioning, ball bar, diagonals, step diagonals"

# standard as it is asked for: module in volid.cli.evaluations
STANDARDS: dict[str, str] = {
    "iso230-2": "positioning",
    "iso230-4": "circular",
    "iso230-6": "diagonals",
    "step-diagonal": "step_diagonals",
}

_EPILOG = """\
'volid evaluate STANDARD --help' explains what each reads and gives. All of them take --set, --limits LIMITS.toml,
--figure FIGURE, --output OUT.csv, --json and --force.

example:
  volid evaluate iso230-2 runs.csv --axis X --limits limits.toml --figure positioning.svg

exit status: 0 good; 1 a limit is exceeded or not proved to be kept, or the result needs attention, which is named; 2 bad input
"""
_LIMITS = "largest values allowed, TOML, in mm (degrees of a rotary axis, rad of squareness): "


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command: one parser per standard."""
    explain(parser, _EPILOG)
    raw = argparse.RawDescriptionHelpFormatter
    standards = parser.add_subparsers(dest="standard", metavar="STANDARD", title="standards", required=True)
    for name, module in STANDARDS.items():
        standard = importlib.import_module(f"volid.cli.evaluations.{module}")
        own = standards.add_parser(
            name, help=standard.HELP, description=standard.HELP, formatter_class=raw, allow_abbrev=False
        )
        explain(own, standard.EPILOG)
        own.set_defaults(usage=own)
        own.add_argument("files", metavar="FILE", nargs="+", help="readings, see below")
        own.add_argument(
            "--set", metavar="NAME", action="append", help="set of a campaign; repeatable; default: all that fit"
        )
        standard.add_arguments(own)
        own.add_argument("--limits", metavar="LIMITS.toml", help=_LIMITS + standard.LIMITS)
        own.add_argument("--figure", metavar="FIGURE", help="the usual figure, .svg, .pdf or .png")
        add_unusual(own)
        add_allow_outside(own)
        add_output(own, "OUT.csv", "table behind the quantities, CSV")


def run(args: argparse.Namespace) -> int:
    """Evaluate, judge, draw, write; 1 where a limit is exceeded or not proved to be kept, or something needs attention."""
    inputs = [*args.files, *named_by(args.files), *([args.limits] if args.limits else [])]
    for path in (args.output, args.figure):
        check_output(path, args.force, inputs)
    check_figure(args.figure)
    standard = importlib.import_module(f"volid.cli.evaluations.{STANDARDS[args.standard]}")
    with Progress() as progress:
        progress("evaluating")
        from volid.io.evaluations.evaluate import evaluate

        common = {"limits": args.limits, "allow_outside": args.allow_outside, "sets": args.set}
        evaluations = evaluate(args.standard, *args.files, **common, **standard.options(args))
        _write(evaluations, standard, args)
    return _say(evaluations, args)


def _write(evaluations: Sequence[Evaluation], standard: Any, args: argparse.Namespace) -> None:
    from volid.io.functions_csv import Sheet, text_output, write_csv
    from volid.report.text.evaluations import evaluation_rows

    if hasattr(standard, "write"):
        standard.write(evaluations, args)
    if args.figure:
        write_figure(standard.draw(evaluations), args.figure, args.force)
    if args.output:
        columns, rows = evaluation_rows(evaluations)
        header = {"standard": ", ".join(dict.fromkeys(e.standard for e in evaluations))}
        header |= {"source": ", ".join(args.files)}
        with text_output(args.output, args.force) as stream:
            write_csv(stream, Sheet(header, columns, rows))


def _say(evaluations: Sequence[Evaluation], args: argparse.Namespace) -> int:
    from volid.report.text.evaluations import evaluation_lines, evaluations_data, unproved

    if args.json:
        print_json(evaluations_data(evaluations))
    else:
        print(in_options("\n\n".join("\n".join(evaluation_lines(e)) for e in evaluations), args))
        for path in filter(None, (args.output, args.figure, getattr(args, "tables", None))):
            print(f"written: {path}")
    return conclude(args, [*unproved(evaluations), *(text for e in evaluations for text in e.attention)])
