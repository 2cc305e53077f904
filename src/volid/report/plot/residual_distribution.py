"""Residuals against the normal distribution: a histogram, and a normal probability plot with the band of good readings."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import betaincinv, ndtri

from volid.report.contents.readings import Readings
from volid.report.language import Texts
from volid.report.plot.dots import PIXELS, frame_of, quiet, thinned
from volid.report.plot.palette import ATTENTION, FAINT, NEUTRAL, SERIES
from volid.report.plot.panels import signs

BINS = 40
LEVEL = 0.95  # of the band
CURVE = 160  # points of the band


def distribution_panel(panel: Any, readings: Readings, texts: Texts) -> None:
    """Histogram of the residuals that were used and are checked, with the standard normal density."""
    values = readings.normalised[readings.used]
    frame = frame_of(readings.normalised)
    if values.size:
        beyond = int((np.abs(values) > frame).sum())
        edges = np.linspace(-frame, frame, BINS + 1)
        counts = np.histogram(values, edges)[0] / (len(values) * np.diff(edges))
        panel.bar(edges[:-1], counts, np.diff(edges), align="edge", color=SERIES[0], alpha=0.45, lw=0, gid="histogram")
        z = np.linspace(-frame, frame, 201)
        density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
        panel.plot(z, density, color=NEUTRAL, lw=1.2, ls="--", label=texts("residuals.expected"))
        panel.legend(fontsize=7, frameon=False, loc="upper right")
        said = texts("residuals.spread", n=len(values), rms=signs(f"{np.sqrt(np.mean(values**2)):.2f}", texts))
        panel.text(0.02, 0.97, said, transform=panel.transAxes, fontsize=7, va="top")
        if beyond:
            text = texts("residuals.beyond", n=beyond, frame=signs(f"{frame:.1f}", texts))
            panel.text(0.02, 0.80, text, transform=panel.transAxes, fontsize=7, va="top", color=ATTENTION)
    else:
        nothing_checks(panel, texts)
    panel.set_xlim(-frame, frame)
    panel.set_xlabel(texts("residuals.normalised"), fontsize=8)
    panel.set_ylabel(texts("residuals.density"), fontsize=8)
    panel.set_title(texts("residuals.distribution"), fontsize=8, loc="left")
    quiet(panel)


def nothing_checks(panel: Any, texts: Texts) -> None:
    """Says that residuals say nothing."""
    place = {"transform": panel.transAxes, "ha": "center", "va": "center"}
    panel.text(0.5, 0.5, texts("residuals.nothing_checks"), fontsize=8, color=ATTENTION, **place)


def normal_panel(panel: Any, readings: Readings, texts: Texts) -> None:
    """The used residuals in ascending order over the quantiles of the normal distribution, with the band of good ones.

    All are within the frame: it follows the largest of them.
    """
    values = np.sort(readings.normalised[readings.used])
    if values.size:
        quantiles, low, high = order_band(len(values))
        kept = thinned(quantiles)
        band = thinned(quantiles, CURVE)
        panel.fill_between(quantiles[band], low[band], high[band], color=FAINT, lw=0, label=texts("residuals.band"))
        ends = quantiles[[0, -1]]
        panel.plot(ends, ends, color=NEUTRAL, lw=0.9, ls="--")
        picture = len(kept) > PIXELS
        style = {"ms": 2.6, "mew": 0, "ls": "none", "rasterized": picture}
        panel.plot(quantiles[kept], values[kept], ".", color=SERIES[0], gid="quantiles", **style)
        panel.legend(fontsize=7, frameon=False, loc="upper left")
    else:
        nothing_checks(panel, texts)
    panel.set_xlabel(texts("residuals.quantile"), fontsize=8)
    panel.set_ylabel(texts("residuals.normalised"), fontsize=8)
    panel.set_title(texts("residuals.probability"), fontsize=8, loc="left")
    quiet(panel)


def order_band(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Quantile of every one of n sorted standard normal values (its median), and the ends of its 95 % interval, each (n,).

    The i-th smallest of n uniform values has a beta distribution with i and n + 1 - i. For independent values, each by itself.

    >>> quantile, low, high = order_band(1)
    >>> round(float(low[0]), 2), round(float(quantile[0]), 2), round(float(high[0]), 2)
    (-1.96, 0.0, 1.96)
    """
    i = np.arange(1, n + 1)
    low, middle, high = (ndtri(betaincinv(i, n + 1 - i, p)) for p in (0.5 - 0.5 * LEVEL, 0.5, 0.5 + 0.5 * LEVEL))
    return middle, low, high
