"""The command line: a dispatcher with one module per verb, each with HELP, add_arguments(parser) and run(args) -> int.

Nothing here imports NumPy, SciPy or JAX, and only the module of the verb that was asked for is imported at all, so that
`volid --help` answers at once. Exit status: 0 good; 1 written, but the result needs attention and is named, or the data do not
determine what was asked for; 2 bad input, or an output that cannot be written; 70 a fault of volid itself; 130 interrupted;
141 nobody reads standard output any more.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import re
import sys
from collections.abc import Sequence
from contextlib import suppress

from volid.backend.consent import accept_unusual
from volid.cli.common import in_options
from volid.cli.environment import prepare, version
from volid.cli.faults import report_fault
from volid.cli.interrupts import INTERRUPTS
from volid.cli.streams import is_of_a_stream, output_on_standard_output, silence, streams
from volid.exceptions import NotDeterminedError, VolidError, shown

# verb: (module, one line of help, the same as the module's HELP)
VERBS = {
    "plan": ("plan", "what to measure: a standard path or grid as a manifest without readings"),
    "simulate": ("simulate", "a campaign measured on a virtual machine, with the truth stored beside it"),
    "import": (
        "import_",
        "a campaign from text (manifest and CSV files), or from files of instruments and other programs",
    ),
    "fit": ("fit", "identify the machine's error model from one or more campaigns"),
    "uncertainty": (
        "uncertainty",
        "Monte Carlo refits of a solution: coverage intervals beside the propagated uncertainty",
    ),
    "budget": ("budget", "uncertainty budget: which source contributes how much to which output"),
    "study": (
        "study",
        "many simulated campaigns, each fitted and compared with its truth: bias, spread, coverage",
    ),
    "evaluate": ("evaluate", "a test evaluated by its standard: positioning, ball bar, diagonals, step diagonals"),
    "summary": ("summary", "what a solution says: verdict, squareness, volumetric accuracy, error functions"),
    "errors": ("errors", "deviation of the functional point at given axis positions and tool vectors"),
    "functions": ("functions", "table of the error functions and location errors with their uncertainty"),
    "tables": ("tables", "error or compensation tables per function, for controls that know single-axis functions"),
    "locations": (
        "locations",
        "location errors of the rotary axes: axis average lines, relative to the machine or to another axis",
    ),
    "grid": ("grid", "spatial grid of compensation (or error) values over the working volume"),
    "field": (
        "field",
        "a field measured point by point as a spatial grid, without kinematic model, and the model tested by it",
    ),
    "export": ("export", "the files that a control loads, from a solution, with a commissioning sheet and the record"),
    "inspect": (
        "inspect",
        "an existing compensation of a control: what its files hold, values, figure, conversion to another control",
    ),
    "apply": ("apply", "a program of G-code corrected in advance, for controls that hold no table, such as grbl"),
    "residual": (
        "residual",
        "what each compensation type leaves over the working volume, side by side, with intervals",
    ),
    "validate": (
        "validate",
        "a solution tested by readings of another campaign: agreement with the prediction, E_n, what would be found",
    ),
    "check": (
        "check",
        "a quick check of an old solution by few new readings: what has changed, and the solution updated",
    ),
    "compare": (
        "compare",
        "what changed significantly between solutions of one machine; three or more: a series over time",
    ),
    "report": (
        "report",
        "one page to look at, to print and to hand over: verdict, figures, the deviation field, limits, provenance",
    ),
    "figures": (
        "figures",
        "figures for papers, one file each: functions, sections of the field, residuals, stations and more",
    ),
    "datum": ("datum", "the same solution in another datum, without a new fit"),
    "multilaterate": (
        "multilaterate",
        "coordinates of a distance network, free or with fixed points, without a machine model",
    ),
}
_EPILOG = """\
example:
  volid fit campaign.toml -o solution.h5
  volid grid solution.h5 --type L-VOL --step 50 -o grid.csv

'volid VERB --help' explains a verb. -o - writes to standard output; standard error then has all words.

exit status: 0 good; 1 written, but the result needs attention, which is named; 2 bad input, or an
output that cannot be written; 70 a fault of volid itself, with a file to send; 130 interrupted
"""
_OPTION_AND_NEGATIVE = re.compile(r"-\d|-\.\d")


def console() -> int:
    """The program `volid`: `main`, and a quick end."""
    status = main()
    gc.freeze()  # else Python looks through all of JAX's objects once more before it ends, for a third of a second
    return status


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    verb = next((a for a in arguments if not a.startswith("-")), "")
    try:
        with streams():
            status = _answer(verb, arguments)
            sys.stdout.flush()
        return status
    except OSError as error:
        silence()
        if isinstance(error, BrokenPipeError):  # the reader, such as head, has seen enough
            return 141
        with suppress(OSError):
            print(f"volid: standard output or a file cannot be written: {error.strerror}", file=sys.stderr)
        return 2


def _answer(verb: str, arguments: list[str]) -> int:
    """Run one command; what goes wrong, foreseen or not, is said on standard error and becomes the exit status."""
    args = argparse.Namespace()
    try:
        args = _parsed(verb, arguments)
        unusual = accept_unusual(getattr(args, "accept_unusual", False))
        with INTERRUPTS, unusual, output_on_standard_output(args):
            status: int = importlib.import_module(f"volid.cli.{VERBS[verb][0]}").run(args)
            sys.stdout.flush()
        return status
    except SystemExit as stop:  # argparse has printed help or what is wrong
        return stop.code if isinstance(stop.code, int) else 0
    except VolidError as error:
        message = in_options(str(error).removeprefix(f"{verb}: "), args)
        print(f"volid {verb}: {message}", file=sys.stderr)
        return 1 if isinstance(error, NotDeterminedError) else 2
    except KeyboardInterrupt:
        print(f"\nvolid {verb}: interrupted", file=sys.stderr)
        return 130
    except Exception as error:
        if is_of_a_stream(error):
            raise
        return report_fault(verb, error, arguments)


def _parsed(verb: str, arguments: list[str]) -> argparse.Namespace:
    """The arguments of the verb; raises `SystemExit` where argparse has said what is wrong."""
    args, strange = _parser(verb).parse_known_args(_join_negative(arguments))
    if strange:
        args.usage.error(f"unrecognized arguments: {' '.join(strange)}")
    if not args.verb:
        _parser("").print_help(sys.stderr)
        raise SystemExit(2)
    prepare()
    args.command_line = ("volid", *map(shown, arguments))
    return args


def _parser(verb: str) -> argparse.ArgumentParser:
    """The parser, with the arguments of `verb` only."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="volid",
        description="Identify the geometric errors of a machine tool from measurements, and compensate them.",
        epilog=_EPILOG,
        formatter_class=raw,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"volid {version()}")
    parser.set_defaults(usage=parser)
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", title="verbs")
    for name, (module, text) in VERBS.items():
        sub = verbs.add_parser(name, help=text, description=text, formatter_class=raw, allow_abbrev=False)
        if name == verb:
            sub.set_defaults(usage=sub)
            importlib.import_module(f"volid.cli.{module}").add_arguments(sub)
    return parser


def _join_negative(arguments: Sequence[str]) -> list[str]:
    """`--tool -30,0,-150` as one word, because argparse takes a word that begins with - for an option."""
    result: list[str] = []
    for word in arguments:
        if result and result[-1].startswith("--") and "=" not in result[-1] and _OPTION_AND_NEGATIVE.match(word):
            result[-1] += f"={word}"
        else:
            result.append(word)
    return result
