"""`volid inspect`: what existing files of a control hold, at given positions, as a figure, or in another control's format."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from volid.cli.common import (
    add_output,
    check_figure,
    check_output,
    conclude,
    explain,
    print_json,
    tell,
    write_figure,
    write_sheet,
)
from volid.cli.compensation_options import ByAxis, assignments
from volid.cli.control_options import add_files_of, in_words_of, one_option
from volid.cli.left_over import left_out
from volid.cli.numbers import tool_vector

if TYPE_CHECKING:
    from volid.controllers.existing.reading import ExistingCompensation
    from volid.controllers.export import Export
    from volid.model.machine import Machine

HELP = "an existing compensation of a control: what its files hold, values, figure, conversion to another control"

_EPILOG = """\
FILE: files of a control, folders of them, or volid's own tables and grids. Without --cnc the control
is recognised by content. Without --machine a plain one is taken with the axes that the files name.

--at POINTS.csv: axis letters (mm or degrees), optional X_dir, … (+1, -1, or 0 for the mean of both)
and tool_x,tool_y,tool_z (needed where rotations act). The result repeats it and adds ex,ey,ez, the
deviation that the control expects (actual - nominal, machine frame, mm), and correction_X, …, what
it adds to the command of each axis.

--to NAME writes the same compensation for another control, where that is exact: the written files
are read back, and both must move the axes alike. Tables become a grid, tables of axes tables of
error functions, and the other way, where no value changes; else the command says what would.
To add a new compensation to an existing one: volid export, tables or grid with --add-to.

example:
  volid inspect x.comp y.comp --cnc linuxcnc --machine machine.toml --figure tables.png

exit status: 0 good; 1 something about the files is odd, and named; 2 bad input, also files that the
other control cannot hold
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    parser.add_argument("files", metavar="FILE", nargs="+", help="files of the control, or folders of them")
    add_files_of(parser)
    parser.add_argument("--machine", metavar="MACHINE.toml", help="the machine that the control moves")
    parser.add_argument("--at", metavar="POINTS.csv", help="where values are wanted")
    parser.add_argument("--figure", metavar="FILE", help="a figure, .png, .svg or .pdf")
    parser.add_argument("--lang", choices=("en", "de"), default="en", help="language of the figure; default en")
    parser.add_argument("--to", metavar="NAME", help="another control, for which the files are written to DIR")
    parser.add_argument("--to-sign", choices=("error", "compensation"), help="where the sign of --to is open")
    parser.add_argument(
        "--to-option",
        metavar="K=V",
        type=one_option,
        action="append",
        default=[],
        help="an option of --to; repeat it",
    )
    parser.add_argument(
        "--line",
        metavar="X=..,Y=..",
        type=assignments,
        action=ByAxis,
        help="with --to: where lines cross that rotations act from; default: references of the axes",
    )
    parser.add_argument("--tool", metavar="x,y,z", type=tool_vector, help="with --to: tool vector of lever arms, mm")
    parser.add_argument(
        "--mean", action="store_true", help="with --to: take the mean where the other control has one direction"
    )
    add_output(parser, "OUT", "with --to a folder for the files; with --at the table, default: standard output")


def run(args: argparse.Namespace) -> int:
    """Read, say, evaluate, draw, convert; 1 where something is odd. Raises `InputError`, `OutputError`."""
    _check(args)
    from volid.controllers.existing.looks import oddities
    from volid.io.control_files import load_compensation

    found = load_compensation(args.files, args.cnc, _machine(args), sign=args.sign, options=dict(args.option))
    if args.figure:
        _draw(found, args)
    if args.at:
        _values(found, args)
    made = _convert(found, args) if args.to else None
    _say(found, made, args)
    tell(args, left_out(args.files, [found]))
    return conclude(args, oddities(found))


def _check(args: argparse.Namespace) -> None:
    """Before anything is read. Raises `InputError`, `OutputError`."""
    from volid.exceptions import InputError

    check_figure(args.figure)
    check_output(args.figure, args.force, args.files)
    if args.to and args.at:
        raise InputError("--at and --to have one output each; run the command twice")
    if args.to and not args.output:
        raise InputError(f"--to {args.to} writes files; name a folder for them with -o")
    if args.output and not (args.to or args.at):
        raise InputError(f"-o {args.output}: nothing is written without --at POINTS.csv or --to NAME; leave it out")
    idle = [n for n in ("to_sign", "to_option", "line", "tool", "mean") if getattr(args, n) and not args.to]
    if idle:
        raise InputError(f"--{idle[0].replace('_', '-')} says how files of another control are made; name it with --to")
    if args.at:
        check_output(args.output, args.force, [*args.files, args.at])


def _machine(args: argparse.Namespace) -> Machine | None:
    from volid.io import read_machine

    return read_machine(args.machine) if args.machine else None


def _draw(found: ExistingCompensation, args: argparse.Namespace) -> None:
    from volid.report.language import Texts
    from volid.report.plot.existing import existing_figure

    write_figure(existing_figure(found, texts=Texts(args.lang)), args.figure, args.force)


def _values(found: ExistingCompensation, args: argparse.Namespace) -> None:
    from volid.controllers.existing.looks import points_beyond
    from volid.exceptions import InputError
    from volid.io.existing_values import values_sheet
    from volid.io.functions_csv import read_points

    try:
        points = read_points(args.at, found.machine, tools=False)
    except InputError as error:
        if args.machine:
            raise
        known = ", ".join(found.machine.letters)
        raise InputError(
            f"{error}. No machine was given, and the files name {known} alone; name it with --machine"
        ) from None
    write_sheet(values_sheet(found, points), args)
    tell(args, [*points.notes, *points_beyond(found, points.positions)])


def _convert(found: ExistingCompensation, args: argparse.Namespace) -> Export:
    """The files of another control, written. Raises `InputError`, `OutputError`."""
    from volid.controllers.existing.conversion import Target, convert
    from volid.io.exports import save_export

    target = Target(args.to, args.to_sign, dict(args.to_option), args.line, args.tool, args.mean)
    with in_words_of(cnc="to", sign="to_sign"):
        made = convert(found.compensation, found.machine, target)
    made = replace(made, notes=(*made.notes, *_made_up(found, args)))
    save_export(made, args.output, overwrite=args.force)
    return made


def _made_up(found: ExistingCompensation, args: argparse.Namespace) -> list[str]:
    """That the sheet goes to positions of axes about which the files say nothing, and no machine either."""
    from volid.controllers.existing.contents import nodes_by_axis

    unknown = [a for a in found.machine.letters if a not in nodes_by_axis(found.compensation)]
    if args.machine or not unknown:
        return []
    return [
        f"no machine was given, and no table is over {', '.join(unknown)}: positions of it in the commissioning sheet are made "
        "up; with `machine` they lie within its travel"
    ]


def _say(found: ExistingCompensation, made: Export | None, args: argparse.Namespace) -> None:
    """The words on standard output, unless values stand there."""
    from volid.report.text.inspection import inspection_data, inspection_lines

    if args.at and (args.json or not args.output):
        return
    if args.json:
        print_json(inspection_data(found) | _written_data(made))
        return
    code = found.machine.structure.strip().strip("[]")
    print("\n".join(inspection_lines(found, f"{found.machine.name} [{code}]")))
    if args.at:
        print(f"values written: {args.output}")
    if made is not None:
        print(f"\nfor {made.declaration.name}, {made.declaration.title}, read back and found to move the axes alike:")
        print("\n".join(f"  {args.output}/{f.name}: {f.what}" for f in made.written.files))
        tell(args, made.notes)


def _written_data(made: Export | None) -> dict[str, Any]:
    if made is None:
        return {}
    return {"written": [f.name for f in made.written.files], "notes": list(made.notes)}
