"""`volid datum`: a solution in another datum."""

from __future__ import annotations

import argparse
import shlex
from dataclasses import replace

from volid.cli.common import add_output, add_solution, attention, check_output, conclude, explain, print_json, tell
from volid.cli.progress import Progress

HELP = "the same solution in another datum, without a new fit"

_EPILOG = """\
An S-transformation of parameters, stations and covariance: deviations change by a rigid motion of
the workpiece frame only. Keys: primary, secondary (axis letters), line (least_squares or
end_point), reference_X, reference_Y, reference_Z (mm, where the functions are zero). What is left
out stays as the machine file has it. A reference outside the measured range is moved to its nearest
end, and said.

example:
  volid datum solution.h5 --to primary=Z,secondary=X -o solution_z.h5

exit status: 0 good; 1 written, but the model is rejected or not everything is determined; 2 bad
input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    parser.add_argument(
        "--to", metavar="KEY=VALUE,…", required=True, help="the new datum, such as primary=Z,secondary=X"
    )
    add_output(parser, "SOLUTION2.h5", "solution in the new datum", required=True)


def run(args: argparse.Namespace) -> int:
    """Read, transform, write; 1 when the solution needs attention. Raises `InputError`, `OutputError`."""
    check_output(args.output, args.force, [args.solution])
    with Progress() as progress:
        progress("reading the solution")
        from volid.fitting.datum import parse_datum
        from volid.io.basics.provenance import sha256
        from volid.io.solutions import read_solution, write_solution
        from volid.model.error_functions import describe_datum

        solution = read_solution(args.solution)
        progress("changing the datum")
        moved = solution.in_datum(parse_datum(solution.machine, args.to))
        record = {"datum command": shlex.join(args.command_line), f"sha256 {args.solution}": sha256(args.solution)}
        moved = replace(moved, provenance=dict(solution.provenance) | record)
        write_solution(moved, args.output, args.force)
    old, new = (describe_datum(s.machine, s.datum) for s in (solution, moved))
    notes = moved.notes[len(solution.notes) :]
    if args.json:
        print_json({"output": args.output, "from": old, "to": new, "notes": notes, "attention": attention(moved)})
    else:
        print(f"from: {old}\nto:   {new}\nwritten: {args.output}")
    tell(args, notes)
    return conclude(args, attention(moved))
