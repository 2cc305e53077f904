"""One path, three reference lines: what is straightness and what is squareness depends on the line."""

import numpy as np
from matplotlib.figure import Figure

from volid.report.plot.palette import BLACK, FAINT, NEUTRAL, SERIES, STYLES
from volid.report.plot.panels import figure_with_panels

MEASURED = (0.0, 600.0)  # mm


def path(y):
    """How far the functional point leaves the Y direction in X [µm], seen in the frame of the primary axis X."""
    return 0.02 * (y - 300.0) + 4.0 * np.sin(2.2 * np.pi * y / 600.0 + 0.6)


def least_squares(y):
    """The least-squares line of the path over the measured range [µm], evaluated at y, and its slope [µm/mm]."""
    x = np.linspace(*MEASURED, 601)
    slope, constant = np.polyfit(x, path(x), 1)
    return slope * y + constant, slope


def end_points(y):
    """The line through both ends, likewise."""
    slope = (path(MEASURED[1]) - path(MEASURED[0])) / (MEASURED[1] - MEASURED[0])
    return path(MEASURED[0]) + slope * (y - MEASURED[0]), slope


def draw() -> Figure:
    """The path with both lines, and what remains as straightness EXY."""
    figure, (left, right) = figure_with_panels(1, 2, figsize=(7.6, 3.0), sharex=True)
    y = np.linspace(*MEASURED, 301)
    left.plot(y, path(y), color=BLACK, lw=2.0, label="path")
    for (line, name), colour, style in zip(
        ((least_squares, "least squares"), (end_points, "end points")), SERIES, STYLES[1:], strict=False
    ):
        values, slope = line(y)
        label = f"{name}: slope {1e3 * slope:.1f} µm/m".replace("-", "\N{MINUS SIGN}")
        left.plot(y, values, color=colour, ls=style, lw=1.5, label=label)
        rest = path(y) - values
        right.plot(y, rest - np.interp(300.0, y, rest), color=colour, ls=style, lw=1.8, label=name)
    for panel, label in ((left, "path in X / µm"), (right, "EXY, zero at the reference / µm")):
        panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
        panel.set_xlabel("Y position / mm")
        panel.set_ylabel(label)
        low, high = panel.get_ylim()
        panel.set_ylim(low, high + 0.45 * (high - low))
        panel.legend(frameon=False, fontsize=8, loc="upper left")
    right.axvline(300.0, color=NEUTRAL, lw=0.8, ls=":")
    return figure
