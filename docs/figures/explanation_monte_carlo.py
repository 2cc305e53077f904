"""Propagation beside Monte Carlo: a value that is linear in the unknowns, and one that is not."""

import numpy as np
from matplotlib.figure import Figure

from volid.report.plot.palette import BLACK, SERIES, STYLES
from volid.report.plot.panels import figure_with_panels

U = 1.0  # µm, standard uncertainty of each value, independent
TRUE = 1.5 * np.sin(np.linspace(0.0, np.pi, 11)) ** 2  # straightness at 11 positions [µm]


def samples(n=40_000, seed=1):
    """Estimated straightness in n repeated campaigns, (n, 11) [µm]."""
    return TRUE + U * np.random.default_rng(seed).standard_normal((n, 11))


def draw() -> Figure:
    """Histograms of the value in the middle and of the range, with the normal distribution that propagation gives."""
    figure, panels = figure_with_panels(1, 2, figsize=(7.6, 3.0))
    drawn = samples()
    outputs = (
        ("value in the middle / µm", drawn[:, 5], TRUE[5], U),
        ("range, largest \N{MINUS SIGN} smallest / µm", np.ptp(drawn, axis=1), np.ptp(TRUE), U * np.sqrt(2.0)),
    )
    for panel, (name, values, true, u) in zip(panels, outputs, strict=True):
        x = np.linspace(min(values.min(), true - 4 * u), max(values.max(), true + 4 * u), 401)
        panel.hist(values, bins=60, density=True, color=SERIES[0], alpha=0.45, label="Monte Carlo")
        normal = np.exp(-0.5 * ((x - true) / u) ** 2) / (u * np.sqrt(2.0 * np.pi))
        panel.plot(x, normal, color=SERIES[1], ls=STYLES[1], lw=1.8, label="propagation")
        panel.axvline(true, color=BLACK, lw=1.2, ls=STYLES[3], label="true value")
        panel.set_xlabel(name)
        panel.set_yticks([])
    panels[0].set_ylabel("density")
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False, fontsize=8
    )
    return figure
