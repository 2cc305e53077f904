"""`volid evaluate step-diagonal`: nine displacement functions from sequential step diagonals."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from volid.campaign import Campaign
    from volid.model.machine import Machine
    from volid.standards.results import Evaluation, Section

HELP = "sequential step diagonals: nine displacement functions of X, Y, Z, squareness, compensation tables"

EPILOG = """\
FILE is a campaign with a projection set along the four body diagonals in steps of X, Y, Z (volid plan
MACHINE step-diagonals), or a CSV with one column per diagonal, 3 n readings in the order of the steps:
  # box: X 0 800, Y 0 600, Z 0 600     mm, between which positions the diagonals run
  # tool: 0, 0, -150                   mm, to the point of the mirror that the beam meets first
  # u: 0.0005                          mm, of a reading
  # values: displacement               or deviation, or increments (of every single step)
  PPP,NPP,PNP,PPN                      also PPP_back (the way back), PPP_2 (a second run)

Dx(x), Dy(x), … Dz(z) are separated by least squares: three unknowns, four diagonals per step. Rotations
of the axes leak into them. --leak predicts by how much from a solution or a simulation's truth;
--model puts a fit of the full kinematic model beside them. Tables hold compensation values.

example:
  volid evaluate step-diagonal steps.csv --tables DIR --figure nine.svg -o nine.csv
  volid evaluate step-diagonal campaign.h5 --leak truth.h5 --model solution.h5

exit status: 0 good; 1 a limit is exceeded, or the diagonals contradict each other; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this standard."""
    parser.add_argument("--machine", metavar="MACHINE.toml", help="the machine that a CSV is of, for its travels")
    parser.add_argument(
        "--leak", metavar="FILE.h5", help="solution or truth: predict what its rotations leak into the nine"
    )
    parser.add_argument("--model", metavar="SOLUTION.h5", help="solution to put beside the nine functions")
    parser.add_argument("--tables", metavar="DIR", help="write compensation tables EXX.csv, EYX.csv, …")


def evaluate(args: argparse.Namespace) -> list[Evaluation]:
    """One evaluation per set. Raises `InputError` where a file holds none, `OutputError` for tables that cannot be written."""
    from volid.exceptions import InputError
    from volid.io.machines import read_machine
    from volid.standards.step_diagonals_result import evaluate_step_diagonals
    from volid.standards.step_diagonals_steps import step_sets

    machine = read_machine(args.machine) if args.machine else None
    found = []
    for file in args.files:
        campaign = _campaign(file, machine, args)
        sets = step_sets(campaign, args.set)
        if not sets:
            raise InputError(f"{file}: no set{_named(args.set)} holds steps of single axes along body diagonals")
        found += [replace(e, source=file) for e in (evaluate_step_diagonals(s, campaign) for s in sets)]
    if args.tables:
        _write_tables(found, args)
    return [replace(e, sections=tuple(_beside(e, args)), attention=(*e.attention, *_unknown(args))) for e in found]


def _named(names: Sequence[str] | None) -> str:
    return f" named {' or '.join(names)}" if names else ""


def _campaign(file: str, machine: Machine | None, args: argparse.Namespace) -> Campaign:
    from volid.environment.reduction import reduced
    from volid.io import load_campaign
    from volid.io.basics.hdf5_values import is_hdf5
    from volid.io.step_diagonals import read_step_diagonals

    if is_hdf5(file) or Path(file).suffix.lower() == ".toml":
        return reduced(load_campaign(file, allow_outside=args.allow_outside))
    return read_step_diagonals(file, machine)


def _write_tables(found: Sequence[Evaluation], args: argparse.Namespace) -> None:
    from volid.exceptions import InputError
    from volid.io.step_diagonal_tables import save_step_tables

    if len(found) > 1:
        raise InputError(f"{len(found)} sets of step diagonals, and tables are of one; name it with `set`")
    save_step_tables(found[0].details, args.tables, files=args.files, overwrite=args.force)


def _beside(evaluation: Evaluation, args: argparse.Namespace) -> Iterator[Section]:
    """The tables of leak and model."""
    if args.leak:
        from volid.io.truths import load_truth
        from volid.standards.step_diagonals_leak import leak_of

        yield leak_of(evaluation.details, load_truth(args.leak)).section()
    if args.model:
        from volid.io.solutions import read_solution
        from volid.standards.step_diagonals_model import by_model

        yield by_model(evaluation.details, read_solution(args.model)).section()


def _unknown(args: argparse.Namespace) -> Iterator[str]:
    """What a solution that the leak is predicted from does not determine."""
    from volid.io.solutions import read_solution
    from volid.io.truths import is_solution

    if args.leak and is_solution(args.leak):
        from volid.standards.step_diagonals_leak import not_known

        if names := not_known(read_solution(args.leak)):
            yield f"{args.leak} does not determine {', '.join(names)}: the leak is predicted as if they were 0"


def draw(evaluations: Sequence[Evaluation]) -> Figure:
    """The nine functions with U."""
    from volid.report.standards.step_diagonals import nine_figure

    return nine_figure(evaluations)
