"""`volid evaluate iso230-6`: displacements along body and face diagonals."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from volid.standards.results import Evaluation

HELP = "ISO 230-6: displacements along body and face diagonals"
LIMITS = "E_d = 0.020; [face] E_d = 0.015 for face diagonals"

EPILOG = """\
FILE is a campaign with beams along diagonals (volid plan MACHINE diagonals; of steps the readings on
the diagonal count), a table of step diagonals, or a CSV, one row per reading, mm:
  # u: 0.0005
  diagonal,target,direction,run,deviation     PPP, NPP, PNP, PPN, XY_PP, XY_NP, …; +1 on, -1 back

E_PPP, R_PPP, B_PPP … are those of ISO 230-2 along each diagonal; E_d, R_d, B_d the largest of the body
diagonals, and of the face diagonals. Of diagonals run one way only: E_up_PPP (E_down on the way back), E_up_d.
In LIMITS.toml: E_d = 0.020, or [body] E_d = 0.020.

example:
  volid evaluate iso230-6 diagonals.csv --limits limits.toml --figure diagonals.svg

exit status: 0 good; 1 a limit is exceeded or not proved to be kept; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """No options of its own."""


def options(args: argparse.Namespace) -> dict[str, Any]:
    """None of its own."""
    return {}


def draw(evaluations: Sequence[Evaluation]) -> Figure:
    """A panel per diagonal, both ways."""
    from volid.report.plot.standards.diagonals import diagonals_figure

    return diagonals_figure(evaluations)
