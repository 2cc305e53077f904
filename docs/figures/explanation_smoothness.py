"""One set of readings, three distances over which a function's values stay alike, and what the readings say of each."""

import numpy as np
from matplotlib.figure import Figure

from volid.fitting.smoothness.covariance import matern
from volid.report.plot.palette import BLACK, BLUE, NEUTRAL
from volid.report.plot.panels import figure_with_panels

U, SIZE, LENGTHS = 1.0, 4.0, (30.0, 140.0, 600.0)  # µm, µm, mm
POSITIONS = np.linspace(0.0, 1000.0, 21)  # mm


def true(x):
    """A straightness without sharp corners [µm]."""
    return 4.0 * np.sin(2.0 * np.pi * x / 700.0) + 1.5 * np.sin(2.0 * np.pi * x / 320.0 + 1.0)


def readings():
    """The true values with noise of 1 µm."""
    return true(POSITIONS) + U * np.random.default_rng(4).standard_normal(len(POSITIONS))


def covariance(x, other, length):
    """Prior covariance of the function with a nearly free line [µm²]."""
    line = 1e4 * (1.0 + np.outer(x - 500.0, other - 500.0) / 500.0**2)
    return SIZE**2 * matern(np.abs(x[:, None] - other[None, :]), length) + line


def evidence(length):
    """Logarithm of the density of the readings."""
    k = covariance(POSITIONS, POSITIONS, length) + U**2 * np.eye(len(POSITIONS))
    y = readings()
    return -0.5 * (y @ np.linalg.solve(k, y) + np.linalg.slogdet(k)[1] + len(y) * np.log(2.0 * np.pi))


def estimate(x, length):
    """Value and standard uncertainty of the function at x [µm]."""
    k = covariance(POSITIONS, POSITIONS, length) + U**2 * np.eye(len(POSITIONS))
    cross = covariance(x, POSITIONS, length)
    variance = np.diag(covariance(x, x, length) - cross @ np.linalg.solve(k, cross.T))
    return cross @ np.linalg.solve(k, readings()), np.sqrt(np.maximum(variance, 0.0))


def draw() -> Figure:
    """Three fits at one scale."""
    figure, panels = figure_with_panels(1, 3, figsize=(8.2, 2.9), sharey=True)
    x = np.linspace(0.0, 1000.0, 401)
    best = max(evidence(length) for length in LENGTHS)
    for panel, length in zip(panels, LENGTHS, strict=True):
        value, u = estimate(x, length)
        panel.fill_between(x, value - 2.0 * u, value + 2.0 * u, color=BLUE, alpha=0.25, lw=0, label="estimate ± U")
        panel.plot(x, value, color=BLUE, lw=1.6)
        panel.plot(x, true(x), color=BLACK, lw=1.2, ls="--", label="true function")
        panel.plot(POSITIONS, readings(), "o", color=NEUTRAL, ms=3.5, label="readings")
        panel.set_title(
            f"{length:g} mm: ln p = {evidence(length) - best:.1f}".replace("-", "\N{MINUS SIGN}"), fontsize=9
        )
        panel.set_xlabel("X position / mm")
    panels[0].set_ylabel("straightness / µm")
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False, fontsize=8
    )
    return figure
