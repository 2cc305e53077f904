"""The lever arm of a pitching head: the same rotation, three tools, three positioning errors."""

import numpy as np
from matplotlib.figure import Figure

from volid.report.plot.palette import BLACK, FAINT, NEUTRAL, SERIES, STYLES
from volid.report.plot.panels import figure_with_panels

LENGTHS = (0.0, 150.0, 300.0)  # of tools that point along -Z [mm]


def pitch(x):
    """A pitch of the X axis [µrad]: EBX, zero in the middle of the travel."""
    return 20.0 * np.sin(np.pi * (x - 500.0) / 1000.0)


def deviation(x, length):
    """What the pitch does at the functional point in X [µm]: EBX times the tool's Z coordinate, -length."""
    return 1e-3 * pitch(x) * -length


def draw() -> Figure:
    """A pitching carriage, and the deviation in X along the travel for three tools."""
    figure, (left, right) = figure_with_panels(1, 2, figsize=(7.6, 3.0), width_ratios=(1, 1.25))
    sketch(left)
    x = np.linspace(0.0, 1000.0, 101)
    for length, colour, style in zip(LENGTHS, SERIES, STYLES, strict=False):
        right.plot(x, deviation(x, length), color=colour, ls=style, lw=1.8, label=f"tool of {length:g} mm")
    right.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
    right.set_xlabel("X position / mm")
    right.set_ylabel("deviation in X by EBX alone / µm")
    right.legend(frameon=False, fontsize=8)
    return figure


def sketch(panel) -> None:
    """A carriage on its guide, turned by an exaggerated EBX, and two tools."""
    angle = np.radians(9.0)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])  # about +Y: X, Z seen from -Y
    panel.plot([-1.6, 1.6], [0.0, 0.0], color=BLACK, lw=2.5)
    corners = np.array([[-0.6, -0.12], [0.6, -0.12], [0.6, 0.3], [-0.6, 0.3], [-0.6, -0.12]]) @ turn.T
    panel.plot(*corners.T, color=BLACK, lw=1.2)
    for length, colour in ((1.1, SERIES[1]), (2.2, SERIES[2])):
        tip = turn @ np.array([0.0, -length])
        panel.plot([0.0, tip[0]], [0.0, tip[1]], color=colour, lw=2.2, zorder=1 - length)
        panel.plot([0.0, 0.0], [0.0, -length], color=NEUTRAL, ls=":", lw=1.2)
        panel.annotate(
            "", tip, (0.0, -length), arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.6, "shrinkA": 0}
        )
    panel.text(0.72, 0.36, "carriage of X,\nturned by EBX > 0", fontsize=8, va="bottom", ha="center")
    panel.text(0.08, -1.12, "150 mm", fontsize=8, va="center")
    panel.text(0.08, -2.2, "300 mm: twice the deviation", fontsize=8, va="center")
    panel.text(1.6, -0.14, "+X", fontsize=9, va="top", ha="right")
    panel.set_xlim(-1.8, 2.0)
    panel.set_ylim(-2.5, 1.1)
    panel.set_aspect("equal")
    panel.set_axis_off()
