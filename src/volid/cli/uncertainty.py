"""`volid uncertainty`: Monte Carlo refits of a solution, coverage intervals, and the budget."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from volid.cli.common import (
    add_output,
    add_solution,
    attention,
    check_output,
    conclude,
    explain,
    print_json,
    usable_solution,
)
from volid.cli.numbers import add_unusual, count, seed, tool_vector
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.fitting.solution import Solution
    from volid.uncertainty.statement import Statement

HELP = "Monte Carlo refits of a solution: coverage intervals beside the propagated uncertainty"

_EPILOG = """\
Every trial draws all readings anew within their u, and all systematic effects within theirs, and
fits again; trial i of a seed is the same whatever the number of trials or workers. With --digits
the run goes on until the results are stable to so many significant digits of u (JCGM 101, 7.9).

SOLUTION2.h5 is the solution with the samples. Finished batches are kept in SOLUTION2.h5.trials
until it is written: an interrupted run goes on with --resume. Without -o nothing is kept.

example:
  volid uncertainty solution.h5 --trials 10000 --seed 1 -o with_samples.h5

exit status: 0 good; 1 written, but trials did not converge, the wanted digits were not reached, or
the model is rejected by the data; 2 bad input; 130 interrupted
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    add_solution(parser)
    number = parser.add_mutually_exclusive_group()
    number.add_argument("--trials", metavar="N", type=count(20, 10**15), help="refits; default 10000")
    number.add_argument("--digits", metavar="D", type=count(1, 4), help="significant digits of u to be reached, 1 to 4")
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="of the trials; default 0")
    parser.add_argument("--resume", action="store_true", help="go on with an interrupted run")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler, such as tcp://host:8786")
    parser.add_argument(
        "--tool", metavar="x,y,z", type=tool_vector, help="mm, for the working volume; default: the most used one"
    )
    add_unusual(parser)
    add_output(parser, "SOLUTION2.h5", "solution with samples")


def run(args: argparse.Namespace) -> int:
    """Refit, write, state; 1 when something needs attention. Raises `InputError`, `OutputError`."""
    from volid.exceptions import InputError

    if args.resume and not args.output:
        raise InputError("--resume goes on with the run that writes -o; name it")
    check_output(args.output, args.force, [args.solution], alone=False)
    with Progress() as progress:
        solution = _sampled(args, progress)
        progress("evaluating the samples")
        import numpy as np

        from volid.uncertainty.statement import as_data, format_statement, statement

        tool = solution.most_used_tool() if args.tool is None else args.tool
        found = statement(solution, np.asarray(tool))
    if args.json:
        print_json({"output": args.output, **as_data(found), "attention": attention(solution)})
    else:
        print(format_statement(found) + (f"\n\nwritten: {args.output}" if args.output else ""))
    return conclude(args, attention(solution) + _messages(found))


def _messages(found: Statement) -> list[str]:
    """What of the trials needs attention."""
    messages = []
    if found.failed:
        messages.append(f"{found.failed} of {found.trials} trials did not converge and are left out")
    if found.tolerance > 1.0:
        messages.append(
            f"the wanted digits were not reached: numerical tolerance {found.tolerance:.2f} times the wanted one"
        )
    return messages


def _sampled(args: argparse.Namespace, progress: Progress) -> Solution:
    """The solution with samples, written when -o asks for it."""
    progress("reading the solution")
    import shutil

    from volid.io.solutions import read_solution

    folder = Path(f"{args.output}.trials") if args.output else None
    solution = usable_solution(args.solution)
    if args.tool is not None:
        solution.ask(args.tool)
    solution = solution.monte_carlo(
        args.trials,
        digits=args.digits,
        seed=args.seed,
        folder=folder,
        resume=args.resume,
        scheduler=args.scheduler,
        progress=progress,
    )
    if folder is None:
        return solution
    progress("writing the solution")
    _write(solution, args)
    solution = read_solution(args.output)
    shutil.rmtree(folder, ignore_errors=True)
    return solution


def _write(solution: Solution, args: argparse.Namespace) -> None:
    from volid.io.basics.provenance import provenance

    record = provenance([args.solution], args.command_line, {"seed": args.seed})
    record = {f"uncertainty {key}": value for key, value in record.items()}
    replace(solution, provenance={**solution.provenance, **record}).save(args.output, args.force)
