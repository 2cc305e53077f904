"""`volid export`: the files that a control loads, with what a person does to put them into it."""

from __future__ import annotations

import argparse

from volid.cli.common import add_output, attention, conclude, explain, tell, usable_solution
from volid.cli.numbers import add_unusual

HELP = "the files that a control loads, from a solution, with a commissioning sheet and the record"

_EPILOG = """\
example:
  volid export solution.h5 --cnc linuxcnc --type L-POS -o control

exit status: 0 good; 1 written, but the model is rejected or the result needs attention; 2 bad input, also a type
that the control cannot carry
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    parser.add_argument("solution", metavar="SOLUTION.h5", help="written by volid fit")
    parser.add_argument("--cnc", metavar="NAME", required=True, help="the control")
    parser.add_argument("--type", action="append", metavar="TYPE", default=[], help="type of compensation")
    parser.add_argument("--sign", choices=("error", "compensation"), help="where public sources leave the sign open")
    parser.add_argument("--option", action="append", metavar="KEY=VALUE", default=[], help="an option of the control")
    add_unusual(parser)
    add_output(parser, "DIR", "folder for the files", required=True)


def run(args: argparse.Namespace) -> int:
    """Read, make, write. Raises `InputError`, `OutputError`, `NotDeterminedError`."""
    from volid.controllers.export import export
    from volid.io.exports import save_export

    solution = usable_solution(args.solution)
    options = dict(text.split("=", 1) for text in args.option)
    made = export(solution, args.cnc, args.type, sign=args.sign, options=options)
    save_export(made, args.output, overwrite=args.force)
    for file in made.written.files:
        print(f"{file.name}: {file.what}")
    tell(args, made.written.notes)
    return conclude(args, attention(solution))
