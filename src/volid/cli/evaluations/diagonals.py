"""`volid evaluate iso230-6`: displacements along body and face diagonals."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from volid.standards.results import Evaluation

HELP = "ISO 230-6: displacements along body and face diagonals"

EPILOG = """\
FILE is a campaign with beams along diagonals (volid plan MACHINE diagonals; of steps the readings on
the diagonal count), a table of step diagonals, or a CSV, one row per reading, mm:
  # u: 0.0005
  diagonal,target,direction,run,deviation     PPP, NPP, PNP, PPN, XY_PP, XY_NP, …; +1 on, -1 back

E_PPP, R_PPP, B_PPP … are those of ISO 230-2 along each diagonal; E_d, R_d, B_d the largest of the body
diagonals, and of the face diagonals. In LIMITS.toml: E_d = 0.020, or [body] E_d = 0.020.

example:
  volid evaluate iso230-6 diagonals.csv --limits limits.toml --figure diagonals.svg

exit status: 0 good; 1 a limit is exceeded; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """No options of its own."""


def evaluate(args: argparse.Namespace) -> list[Evaluation]:
    """Body and face diagonals of every set and file. Raises `InputError` where a file holds none."""
    from volid.standards.diagonals_result import evaluate_diagonals

    found = []
    for file in args.files:
        for name, diagonals in _read(file, args).items():
            found += evaluate_diagonals(diagonals, f"{file}, set {name}" if name else file)
    return found


def _read(file: str, args: argparse.Namespace) -> dict:
    from volid.io import load_campaign
    from volid.io.basics.hdf5_values import is_hdf5
    from volid.io.diagonals import is_diagonals, read_diagonals
    from volid.io.step_diagonals import read_step_diagonals
    from volid.standards.diagonals import diagonals_of

    if is_hdf5(file) or Path(file).suffix.lower() == ".toml":
        return diagonals_of(load_campaign(file, allow_outside=args.allow_outside), args.set)
    if is_diagonals(file):
        return {"": read_diagonals(file)}
    return {"": diagonals_of(read_step_diagonals(file))["step diagonals"]}


def draw(evaluations: Sequence[Evaluation]) -> Figure:
    """A panel per diagonal, both ways."""
    from volid.report.standards.diagonals import diagonals_figure

    return diagonals_figure(evaluations)
