"""Lengths cannot tell a machine with its stations from the same, moved as one."""

import numpy as np
from matplotlib.figure import Figure

from volid.report.plot.palette import BLACK, SERIES
from volid.report.plot.panels import figure_with_panels

STATIONS = np.array([[-1.3, -0.9], [4.4, -1.1], [4.6, 3.9]])
POINT = np.array([3.0, 2.0])


def lattice():
    """A grid of a slightly deformed machine."""
    x, y = np.meshgrid(np.arange(4.0), np.arange(4.0))
    return np.stack([x + 0.10 * np.sin(1.3 * y), y + 0.08 * x * (x - 3.0) * 0.4], axis=-1)


def moved(points, angle=-0.16, shift=(0.45, 0.55)):
    """The same places after a rigid motion."""
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]]) + shift


def draw() -> Figure:
    """Both arrangements over each other, with their equal beams."""
    figure, panel = figure_with_panels(figsize=(5.4, 4.2))
    grid = lattice()
    for transform, colour, style, words in (
        (lambda p: p, SERIES[0], "-", "one solution"),
        (moved, SERIES[1], "--", "another one: all lengths are equal"),
    ):
        net, stations = transform(grid), transform(STATIONS)
        for lines in (net, net.transpose(1, 0, 2)):
            for line in lines:
                panel.plot(*line.T, color=colour, ls=style, lw=1.1)
        target = transform(grid[2, 2])
        for station in stations:
            panel.plot(*np.array([station, target]).T, color=colour, ls=":", lw=1.4)
        panel.plot(*stations.T, "^", color=colour, ms=9, mec=BLACK)
        panel.plot([], [], color=colour, ls=style, marker="^", mec=BLACK, label=words)
    panel.set_aspect("equal")
    panel.set_axis_off()
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    return figure
