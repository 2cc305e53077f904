"""`volid evaluate step-diagonal`: nine displacement functions from sequential step diagonals."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from volid.standards.results import Evaluation

HELP = "sequential step diagonals: nine displacement functions of X, Y, Z, squareness, compensation tables"
LIMITS = 'EYX = 0.005; EC0Y = 20e-6; "Dx(x)" = 0.010'

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

exit status: 0 good; 1 a limit is exceeded or not proved to be kept, or the diagonals contradict each other; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this standard."""
    parser.add_argument("--machine", metavar="MACHINE.toml", help="the machine that a CSV is of, for its travels")
    parser.add_argument(
        "--leak", metavar="FILE.h5", help="solution or truth: predict what its rotations leak into the nine"
    )
    parser.add_argument("--model", metavar="SOLUTION.h5", help="solution to put beside the nine functions")
    parser.add_argument("--tables", metavar="DIR", help="write compensation tables EXX.csv, EYX.csv, …")


def options(args: argparse.Namespace) -> dict[str, Any]:
    """Those of the standard, for the library."""
    return {"machine": args.machine, "leak": args.leak, "model": args.model}


def write(evaluations: Sequence[Evaluation], args: argparse.Namespace) -> None:
    """Compensation tables of the nine functions, where they are asked for. Raises `InputError` for those of several sets."""
    from volid.exceptions import InputError
    from volid.io.evaluations.step_diagonal_tables import save_step_tables

    if not args.tables:
        return
    if len(evaluations) > 1:
        raise InputError(f"{len(evaluations)} sets of step diagonals, and tables are of one; name it with `set`")
    save_step_tables(evaluations[0].details, args.tables, files=args.files, overwrite=args.force)


def draw(evaluations: Sequence[Evaluation]) -> Figure:
    """The nine functions with U."""
    from volid.report.plot.standards.step_diagonals import nine_figure

    return nine_figure(evaluations)
