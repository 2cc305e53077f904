"""`volid export`: the files that a control loads, with what a person does to put them into it."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from volid.cli.common import add_output, attention, conclude, explain, in_options, print_json, tell, usable_solution
from volid.cli.compensation_options import (
    ByAxis,
    add_base,
    add_range,
    add_sampling,
    assignments,
    base_from,
    limits,
    prepared,
    rule_from,
    sampling_of,
)
from volid.cli.existing_options import add_existing, existing_from
from volid.cli.left_over import files_in, left_out, left_over
from volid.cli.numbers import add_unusual, count
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.controllers.export import ExportRequest
    from volid.fitting.solution import Solution

HELP = "the files that a control loads, from a solution, with a commissioning sheet and the record"
ALL, LIST = "all", "list"

_EPILOG = """\
Into DIR go the files of the control, COMMISSIONING.md (what to back up, to set, to load, one point
for each table at which the sign is proved, how to switch it off again) and RECORD.md (how the
machine was measured, what the values mean, what is expected to remain). --cnc list names the
controls; --explain says what one takes, and on what each fact rests: documented by the vendor, run
on the control, inferred, or open. --cnc all writes every control into a folder of its own.

Without --type the most complete types are taken that the control carries and the data determine.
Where public sources leave a sign open, --sign must state it. --option KEY=VALUE is for options of
the control (--explain lists them), with all: NAME.KEY=VALUE.

Axes that move only because another one does lose their own reversal at each turn. --increment and
--most-turns N make tables of such axes steady: whole increments and at most N turns along a travel,
as near to the exact values as that allows; what cannot be kept is refused. --clamp A,C leaves out
what would move these axes.

What was measured with a compensation active is what remains with it: --add-to OLD (files of any
control, tables, grids) or --add-active (the files that the campaign names as active) writes the sum.

example:
  volid export solution.h5 --cnc linuxcnc --type L-POS -o control
  volid export --cnc sinumerik-cec --explain
  volid export solution.h5 --cnc all -o controls

exit status: 0 good; 1 written, but the model is rejected or the result needs attention; 1 and nothing
written when the data do not determine a type; 2 bad input, also a type that the control cannot carry;
with all: what a control refuses stands in the table, and 2 when none was written
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    parser.add_argument("solution", metavar="SOLUTION.h5", nargs="?", help="written by volid fit; not for --explain")
    parser.add_argument("--cnc", metavar="NAME", required=True, help="the control, all of them, or list")
    parser.add_argument("--explain", action="store_true", help="what the control takes, and on what that rests")
    parser.add_argument(
        "--type", action="append", metavar="TYPE", default=[], help="type of compensation; repeat it; default: the most"
    )
    parser.add_argument("--sign", choices=("error", "compensation"), help="where public sources leave the sign open")
    parser.add_argument(
        "--option", action="append", metavar="KEY=VALUE", default=[], help="an option of the control; repeat it"
    )
    add_base(parser, "base tool vector, mm; default: the most used one")
    add_sampling(parser, "points")
    add_range(parser, "points")
    parser.add_argument(
        "--zero", metavar="X=..", type=assignments, action=ByAxis, help="where tables of an axis are zero"
    )
    _add_axes(parser)
    add_existing(parser)
    add_unusual(parser)
    add_output(parser, "DIR", "folder for the files")


def _add_axes(parser: argparse.ArgumentParser) -> None:
    """What the axes can do and may be asked for."""
    parser.add_argument(
        "--increment", metavar="X=..", type=limits, action=ByAxis, help="least increments of the axes, mm or degrees"
    )
    parser.add_argument("--clamp", metavar="A,C", help="axes that stay clamped")
    parser.add_argument(
        "--most-turns", metavar="N", type=count(0, 10_000), help="turns of an axis that only helps, along a travel"
    )
    parser.add_argument(
        "--axis-reversal", metavar="X=..", type=limits, action=ByAxis, help="reversal of the axes, if not the model's"
    )


def run(args: argparse.Namespace) -> int:
    """Explain, or read, make, write. Raises `InputError`, `OutputError`, `NotDeterminedError`."""
    from volid.cli.export_all import export_all, list_controls, refuse_existing
    from volid.controllers.export import controller
    from volid.controllers.handover.explain import explained, explained_data

    if args.cnc == LIST or (args.explain and args.cnc == ALL):
        return list_controls(args)
    if args.cnc != ALL:
        controller(args.cnc)
    if args.explain:
        chosen = controller(args.cnc)
        print_json(explained_data(chosen)) if args.json else print(in_options(explained(chosen), args), end="")
        return 0
    _ask_for_files(args)
    refuse_existing(args)
    with Progress() as progress:
        progress("reading the solution")
        solution = usable_solution(args.solution)
        tool = solution.most_used_tool() if args.tool is None else args.tool
        solution, notes = prepared(solution, args, [tool])
        notes += _not_stated(solution)
        request = request_from(solution, args, tool)
        notes += left_out(args.add_to, request.add_to)
        if args.cnc == ALL:
            return export_all(solution, request, notes, args, progress)
        progress("making the files")
        return _one(solution, request, notes, args)


def _not_stated(solution: Solution) -> list[str]:
    """What the record lacks of ISO/TR 16907 9.1."""
    from volid.controllers.handover.record import missing_items

    missing = missing_items(solution)
    return (
        [f"RECORD.md lacks what the campaign does not state: {', '.join(missing)} (ISO/TR 16907 9.1)"]
        if missing
        else []
    )


def _ask_for_files(args: argparse.Namespace) -> None:
    """Raises `InputError` where the solution or the folder is not named."""
    from volid.exceptions import InputError

    if not args.solution:
        raise InputError("no solution is named; expected SOLUTION.h5 as volid fit writes it, or --explain")
    if not args.output:
        raise InputError("-o DIR is missing: name the folder for the files")


def request_from(solution: Solution, args: argparse.Namespace, tool: Any) -> ExportRequest:
    """Everything that is asked for. Raises `InputError`, `NotDeterminedError`."""
    from volid.controllers.axes import Axes
    from volid.controllers.export import ExportRequest

    clamped = tuple(a.strip() for a in args.clamp.split(",")) if args.clamp else ()
    return ExportRequest(
        types=tuple(n.strip() for text in args.type for n in text.split(",")),
        base=base_from(solution, args, tool),
        sampling=sampling_of(args),
        sign=args.sign,
        options=options_from(args),
        zero=args.zero,
        ranges=args.range,
        extrapolate=args.extrapolate,
        axes=Axes(args.increment or {}, clamped, args.most_turns, args.axis_reversal or {}),
        rule=rule_from(args.rule),
        add_to=existing_from(solution, args),
    )


def options_from(args: argparse.Namespace) -> dict[str, str]:
    """Options of the control, KEY=VALUE. Raises `InputError` for what is none, or stated twice."""
    from volid.exceptions import InputError

    found: dict[str, str] = {}
    for text in args.option:
        key, equal, value = text.partition("=")
        if not equal or not key:
            raise InputError(f"--option '{text}'; expected KEY=VALUE, such as comp_file_type=1")
        if key in found:
            raise InputError(f"--option {key} is given twice; expected every option once")
        found[key] = value
    return found


def _one(solution: Solution, request: ExportRequest, notes: list[str], args: argparse.Namespace) -> int:
    """One control: its files into the folder, what they are to standard output."""
    from volid.cli.export_all import in_json, names_of
    from volid.controllers.existing.measured_state import OTHER
    from volid.controllers.existing.state import NOT_ACTIVE, REPLACED
    from volid.controllers.export import controller, export_of
    from volid.io.exports import RECORD, SHEET, save_export

    before = files_in(args.output)
    made = export_of(solution, controller(args.cnc), request)
    save_export(
        made,
        args.output,
        overwrite=args.force,
        source=args.solution,
        command=args.command_line,
        words=lambda text: in_options(text, args),
    )
    if args.json:
        print_json(in_json(made))
    else:
        print(f"{made.declaration.title}: {', '.join(made.types)}")
        for file in made.written.files:
            print(f"  {file.name}: {file.what}")
        print(f"  {SHEET}: what to do at the machine, with a sign check for each table")
        print(f"  {RECORD}: what the values are, and where they come from")
    wrong = [n for n in made.notes if REPLACED in n or NOT_ACTIVE in n or OTHER in n]
    tell(args, [n for n in (*notes, *made.notes) if n not in wrong])
    wrong += left_over(args.output, before, names_of(made))
    return conclude(args, attention(solution, named=True) + wrong)
