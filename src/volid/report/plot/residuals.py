"""Residuals of the readings over their order, and their distribution."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from volid.fitting.solution import Solution
from volid.report.plot.palette import BLACK, SERIES
from volid.report.plot.panels import figure_with_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def residual_plot(solution: Solution) -> Figure:
    """Normalised residuals in the order of the readings, and their distribution against the standard normal."""
    figure, (left, right) = figure_with_panels(1, 2, figsize=(11, 3.6), width_ratios=(3, 1), sharey=True)
    start = 0
    for k, s in enumerate(solution.campaign.sets):
        values, out = solution.readings.normalised[k], solution.readings.outliers[k]
        number = start + np.arange(values.size)
        left.plot(number, values.ravel(), ".", ms=3, color=SERIES[k % 3], label=s.name)
        if out.any():
            left.plot(number[out.ravel()], values.ravel()[out.ravel()], "x", color=BLACK, label="outlier, set aside")
        start += values.size
    kept = np.concatenate(
        [n[~o] for n, o in zip(solution.readings.normalised, solution.readings.outliers, strict=True)]
    )
    right.hist(kept, bins=41, orientation="horizontal", density=True, color=SERIES[0], alpha=0.4)
    z = np.linspace(-4.0, 4.0, 201)
    right.plot(np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi), z, color=BLACK, lw=1.0)
    left.set_ylim(-6.0, 6.0)
    left.set_xlabel("reading")
    left.set_ylabel("residual / u")
    right.set_xlabel("density")
    left.legend(fontsize=8, frameon=False, loc="upper right")
    left.set_title(solution.adequacy.verdict, fontsize=9, loc="left")
    return figure
