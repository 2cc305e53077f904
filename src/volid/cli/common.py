"""What the verbs have in common: arguments, checks of the output before the work begins, and how tables and JSON are written."""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from volid.exceptions import shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from volid.fitting.solution import Solution
    from volid.io.functions_csv import Sheet

HDF5 = (".h5", ".hdf5")
# parameter of the library: option of another name
_CALLED = {"overwrite": "force", "ranges": "range", "types": "type", "clamped": "clamp"}
_COMMANDS = {  # function of the library: command that does it and writes a file, or option that says the same
    "fit": "volid fit",
    "monte_carlo": "volid uncertainty with -o",
    "save_campaign": "volid import",
    "simulate": "volid simulate",
    "study.run_study": "volid study",
    "save_grid": "volid grid",
    "recorded_compensations": "--add-active",
    "accept_unusual": "--accept-unusual",
}
_PARAMETER = re.compile(r"`(\w+)(?:=([^`]*))?`")


def explain(parser: argparse.ArgumentParser, text: str) -> None:
    """The end of a verb's help: details, example, exit status."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = text


def add_output(parser: argparse.ArgumentParser, metavar: str, text: str, required: bool = False) -> None:
    """-o, --json and --force, which every verb has."""
    parser.add_argument("-o", "--output", metavar=metavar, required=required, help=text)
    parser.add_argument("--json", action="store_true", help="the result as JSON on standard output")
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")


def add_allow_outside(parser: argparse.ArgumentParser) -> None:
    """--allow-outside, of verbs that read manifests."""
    parser.add_argument(
        "--allow-outside",
        action="store_true",
        help="manifests may name files outside their own folder, if you trust them",
    )


def add_solution(parser: argparse.ArgumentParser) -> None:
    """SOLUTION.h5."""
    parser.add_argument("solution", metavar="SOLUTION.h5", help="written by volid fit")


def in_options(text: str, args: argparse.Namespace) -> str:
    """A message of the library with its parameters as options of the verb: "`resume=True`" becomes "--resume".

    A value other than True follows its option, in quotes where it has blanks; what is no option of the verb stays as it is.
    """
    parser = getattr(args, "usage", None)  # set where the command line was parsed
    known = set(re.findall(r"--[a-z-]+", parser.format_usage())) if parser is not None else set()

    def option(match: re.Match[str]) -> str:
        name, value = match.groups()
        found = "--" + _CALLED.get(name, name).replace("_", "-")
        if found not in known:
            return match.group()
        if value in (None, "True"):
            return found
        return f'{found} "{value}"' if " " in value else f"{found} {value}"

    for function, command in _COMMANDS.items():
        text = text.replace(f"`volid.{function}`", command)
    return _PARAMETER.sub(option, text)


FIGURES = (".png", ".svg", ".pdf")


def check_figure(path: str | Path | None) -> None:
    """Refuse a figure now that could not be drawn after the work.

    Raises `InputError` without matplotlib, or for another ending.
    """
    from volid.exceptions import InputError

    if path is None:
        return
    if Path(path).suffix.lower() not in FIGURES:
        raise InputError(f"{path}: a figure ends in {', '.join(FIGURES)}; name the file so")
    if find_spec("matplotlib") is None:
        raise InputError("figures need matplotlib, which is not installed; run pip install matplotlib, or ask for none")


def write_figure(figure: Figure, path: str | Path, overwrite: bool) -> None:
    """A figure of matplotlib as the file's ending says; it appears completely or not at all. Raises `OutputError`."""
    from matplotlib import rc_context

    from volid.io.basics.atomic import atomic_output

    kind = Path(path).suffix.lstrip(".").lower() or "png"
    dated = {"svg": "Date", "pdf": "CreationDate"}  # left out, so that the same figure is the same file
    metadata = {dated[kind]: None} if kind in dated else {}
    with atomic_output(path, overwrite) as temporary, rc_context({"svg.hashsalt": "volid", "pdf.fonttype": 42}):
        figure.savefig(temporary, format=kind, dpi=150, metadata=metadata)


class _Stop(Exception):
    pass


def check_output(
    path: str | Path | None, overwrite: bool, inputs: Iterable[str | Path] = (), alone: bool = True
) -> None:
    """Refuse now what could not be written after the work: an existing file, a folder that is missing or closed.

    Raises `OutputError`, also when `path` is one of the `inputs`, even with `overwrite`, and for a stream such as standard
    output where other files will stand beside it (not `alone`).
    """
    from volid.exceptions import OutputError
    from volid.io.basics.atomic import atomic_output
    from volid.io.basics.targets import find_target

    if path is None:
        return
    if find_target(path, overwrite).file is None:
        if not alone:
            raise OutputError(f"{path} is no file, and other files are written beside it; name a file")
        return
    for name in inputs:
        if os.path.exists(name) and os.path.exists(path) and os.path.samefile(name, path):
            raise OutputError(f"{path} is an input of this command; choose another name for the output")
    try:
        with atomic_output(path, overwrite) as temporary:
            temporary.touch()
            raise _Stop
    except _Stop:
        return


def input_files(paths: Sequence[str]) -> list[Path]:
    """Every file that campaigns are made of: HDF5 files as they are, manifests with their machine and CSV files."""
    from volid.io.basics.hdf5_values import is_hdf5
    from volid.io.basics.toml_table import read_toml

    found: list[Path] = []
    for path in map(Path, paths):
        found.append(path)
        if not is_hdf5(path):
            manifest = read_toml(path)
            found += [path.parent / name for name in (manifest["machine"], *(s["file"] for s in manifest["set"]))]
            found += [path.parent / name for name in _active_files(manifest.get("conditions", {}))]
    return list(dict.fromkeys(found))


def _active_files(conditions: dict[str, Any]) -> list[str]:
    """Files of a control that a record of conditions names as active."""
    entries = conditions.get("active_compensations", [])
    named = [e.get("file", []) for e in entries if isinstance(e, dict)] if isinstance(entries, list) else []
    return [name for files in named for name in (files if isinstance(files, list) else [files])]


def named_by(paths: Sequence[str]) -> list[Path]:
    """Files that manifests name, which no output may replace; none where a manifest is wrong, which is told as it is read."""
    from volid.exceptions import VolidError

    try:
        return input_files(paths)
    except (VolidError, KeyError, TypeError):
        return []


def write_sheet(sheet: Sheet, args: argparse.Namespace) -> None:
    """A table to -o as CSV, or to standard output as CSV, or as JSON with --json (also beside -o)."""
    write_sheets([sheet], [Path(args.output)] if args.output else [], args)


def write_sheets(sheets: Sequence[Sheet], paths: Sequence[Path], args: argparse.Namespace, key: str = "") -> None:
    """Tables to their paths as CSV, or one to standard output; with --json as a list under `key`, or one without it."""
    from volid.io.functions_csv import text_output, write_csv

    sheets = [sheet._replace(rows=list(sheet.rows)) for sheet in sheets]
    for sheet, path in zip(sheets, paths, strict=False):
        with text_output(path, args.force) as stream:
            write_csv(stream, sheet)
    if args.json:
        found = [{"header": dict(s.header), "columns": s.columns, "rows": s.rows} for s in sheets]
        print_json({key: found} if key else found[0])
    elif not paths:
        write_csv(sys.stdout, sheets[0])


def print_json(data: Any) -> None:
    """JSON on standard output, with null for NaN, which JSON does not have."""
    from volid.report.text.summary import plain

    print(shown(json.dumps(plain(data), ensure_ascii=False, indent=1, allow_nan=False), as_json=True))


def attention(solution: Solution, named: bool = False) -> list[str]:
    """Why numbers of this solution need attention; empty when all is well.

    `named`: the verb itself names what is not determined.
    """
    messages = []
    if solution.adequacy.rejected:
        messages.append(
            "the model is REJECTED by the data: the stated uncertainties do not hold (volid summary names likely causes)"
        )
    asked = solution.adequacy.questions
    if asked and not solution.adequacy.rejected:
        messages.append(f"the result is not accepted before a question is answered: {asked[0].text}")
    contradicting = [t.set for t in solution.adequacy.sets if t.contradicts]
    if contradicting and not solution.adequacy.rejected:
        messages.append(f"set '{contradicting[0]}' contradicts others (volid summary says which and how)")
    if not solution.statistics.converged:
        messages.append("the fit has not converged: do not use its numbers")
    if not (solution.adequacy.rejected and solution.adequacy.causes):  # levels and segments follow from the misfit then
        messages += solution.unseen
    if not named and not solution.fully_determined:
        directions = solution.null_space.shape[1]
        messages.append(
            f"the data do not determine {directions} combination(s) of the parameters (volid summary names them)"
        )
    return messages


def usable_solution(path: str) -> Solution:
    """A solution for tables and grids. Raises `InputError`, also where its numbers follow from a mistake, with the reason."""
    from volid.exceptions import InputError
    from volid.io.solutions import read_solution

    solution = read_solution(path)
    if reason := solution.adequacy.barrier:
        raise InputError(
            f"{path}: no table or grid is made of this solution: {reason}. Mend the campaign, and fit again (volid summary says "
            "more)"
        )
    return solution


def print_verdict(solution: Solution) -> None:
    """One line on standard output where numbers below it need more than a look: rejected, or u enlarged."""
    from volid.fitting.diagnosis.adequacy import ACCEPTED, NOT_TESTABLE
    from volid.uncertainty.lack_of_fit import verdict_words

    if solution.adequacy.grade not in (ACCEPTED, NOT_TESTABLE):
        print(f"*** {verdict_words(solution)} ***\n")


def tell(args: argparse.Namespace, notes: Sequence[str]) -> None:
    """Notes about a result: on standard output, or on standard error where the result itself stands there."""
    for note in (in_options(note, args) for note in notes):
        if args.output and not args.json:
            print(f"note: {note}")
        else:
            print(f"volid {args.verb}: note: {note}", file=sys.stderr)


def conclude(args: argparse.Namespace, messages: Sequence[str]) -> int:
    """Name on standard error what needs attention; the exit status, 1 when there is something."""
    for message in messages:
        print(f"volid {args.verb}: attention: {in_options(message, args)}", file=sys.stderr)
    return 1 if messages else 0
