"""`volid evaluate iso230-2`: accuracy and repeatability of positioning of linear and rotary axes."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from volid.standards.results import Evaluation

HELP = "ISO 230-2: accuracy and repeatability of positioning, linear and rotary axes"
LIMITS = "E = 0.010; [X] E = 0.008 for one axis"

EPILOG = """\
FILE: a campaign (.toml, .h5; kind component along the axis that moves, or projection along an axis), a file of a laser
interferometer that volid import knows (.rtl, .rta, .pos), or a table (CSV):
  target,direction,run,actual                     a row for each approach (deviation = actual - target does instead of actual)
  target,up_1,up_2,up_3,up_4,up_5,down_1,…        a row for each target, deviations or positions
  X,EXX(+),EXX(-) below "# values: compensation"  a compensation table, rows absolute or incremental: E, M and B from the means
mm, degrees for rotary axes; a header may say otherwise, such as up_1 [µm]. Rules of the standard that the test does not follow
are named, and the quantities evaluated all the same.

U: from a campaign's own u and effects, and from --uncertainty TOML with the test's conditions (both add); each may be left out:
  device = { U = 0.0002, U_per_length = 5e-7 }                   of the certificate, k = 2, mm and mm/mm
  misalignment = { angle = 0.001 }                               rad at most; or { offset = 0.5 } mm at most over the targets
  temperature = { u = 0.2, expansion = 11.5e-6, at = 22.0, u_expansion = 1e-6 }
  drift = { range = 0.0008 }                                     mm during the test; form = "linear": evenly through it
  setup = { u = 0.0002 }                                         mm, what each run has in common
  noise = { u = 0.0001 }                                         mm, of a reading

example:
  volid evaluate iso230-2 runs.csv --axis X --limits limits.toml --figure X.svg
  volid evaluate iso230-2 campaign.toml --set laser --uncertainty conditions.toml -o targets.csv
  volid evaluate iso230-2 X.pos --axis X --key sign=1

exit status: 0 good; 1 a limit is exceeded or not proved to be kept, or the result needs attention, which is named; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this standard."""
    parser.add_argument(
        "--axis", metavar="X", help="the axis that moved, where the file does not say; of several the one that counts"
    )
    parser.add_argument("--uncertainty", metavar="TOML", help="conditions of the test, from which U follows")
    parser.add_argument(
        "--key",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="how a file of another program is read, as for volid import",
    )


def options(args: argparse.Namespace) -> dict[str, Any]:
    """Those of the standard, for the library."""
    from volid.cli.import_options import key_of

    keys: dict[str, Any] = {}
    for text in args.key:
        keys |= key_of(text)
    return {"axis": args.axis, "keys": keys, "uncertainty": args.uncertainty}


def draw(evaluations: Sequence[Evaluation]) -> Any:
    """The usual figure."""
    from volid.report.plot.standards.positioning import positioning_figure

    return positioning_figure(evaluations)
