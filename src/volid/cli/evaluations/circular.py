"""`volid evaluate iso230-4`: circular tests with a double ball bar."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from volid.standards.results import Evaluation

HELP = "circular tests with a double ball bar, ISO 230-4"
LIMITS = "G_XY = 0.010; [YZ] F_max = 0.008 for one plane"

EPILOG = """\
FILE: a campaign (manifest or HDF5) with sets of distances on circles of two axes, as
'volid plan circles' plans them; or a table (CSV) with the columns angle (degrees) and radius
or deviation (mm), optional sense, run, plane, u, and lines '# plane: XY', '# radius: 150',
'# feed: 1000', '# u: 0.0005', '# length_u: 0.0005' above them. Rows stand in the order in which
they were read. A .b5r file is shown as its program evaluated it, and never evaluated again.

Per plane: circular deviation G of each sense and G_b of both (minimum zone; _ls: about the
least-squares centre), radial deviations F_max and F_min, hysteresis H, mean bidirectional radial
deviation D; then squareness, scale, reversal, lag and bow, each with U (k = 2), and the reversal
spikes, which are told apart from them.

example:
  volid evaluate iso230-4 datasets/ball_bar_circles/campaign.toml --figure circles.svg
  volid evaluate iso230-4 circle.csv --plane XY --radius 150 --feed 1000 -o readings.csv

exit status: 0 good; 1 a limit is exceeded, or the result needs attention, which is named; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the standard."""
    parser.add_argument("--plane", metavar="XY", help="of a table that does not say it: XY, YZ or ZX")
    parser.add_argument("--radius", metavar="R", type=float, help="nominal radius of a table, mm")
    parser.add_argument("--feed", metavar="F", type=float, help="feed along the path, mm/min: a lag becomes a time")
    parser.add_argument("--u", metavar="u", type=float, help="standard uncertainty of a table's readings, mm")
    parser.add_argument(
        "--length-u", metavar="u", type=_length, help="standard uncertainty of the bar's length, mm, or 'unknown'"
    )
    parser.add_argument(
        "--spike-window", metavar="DEG", type=float, help="behind changes of quadrant, degrees; default 15"
    )
    parser.add_argument("--setup-centre", action="store_true", help="F from the centre as it was set up")


def _length(text: str) -> float:
    return float("inf") if text == "unknown" else float(text)


def options(args: argparse.Namespace) -> dict[str, Any]:
    """Those of the standard, for the library."""
    stated = {name: getattr(args, name) for name in ("plane", "radius", "feed", "u", "length_u")}
    return {**stated, "window": args.spike_window, "setup_centre": args.setup_centre}


def draw(evaluations: Sequence[Evaluation]) -> Any:
    """The polar plot of every plane."""
    from volid.report.plot.standards.circular import polar_plot

    return polar_plot(evaluations)
