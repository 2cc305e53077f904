"""A validation as a figure: residuals over U, the distribution of E_n, and where it is worst."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.report.plot.palette import ATTENTION, BLACK, BLUE, FAINT, NEUTRAL, SERIES
from volid.report.plot.panels import as_written, figure_with_panels
from volid.validation.readings.groups import Compared
from volid.validation.readings.validation import Validation
from volid.validation.readings.verdict import MEMBERS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = 12
MARKERS = ".x+1^"  # by set
EN, WORST = BLUE, ATTENTION


def validation_figure(found: Validation) -> Figure:
    """Residuals over U of every reading by set, the distribution of E_n beside what is to be expected, and where it is worst.

    Args:
        found: As `volid.validate` gives it.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> found = volid.validate(solution, solution.campaign)
    >>> volid.plot.validation_figure(found).axes[1].get_xlabel()
    'E_n'
    """
    figure, (left, middle, right) = figure_with_panels(1, 3, figsize=(13, 4.2), width_ratios=(1.6, 1.0, 1.3))
    _over_readings(left, found.sets)
    _distribution(middle, found)
    _worst(right, found)
    verdict = found.verdict.split(":")[0].split(",")[0]
    figure.suptitle(f"Validation: {verdict}; E_n > 1 for {100 * found.e_n_above_1:.1f} % of {len(found.e_n)} readings")
    return figure


def _over_readings(panel: Any, sets: tuple[Compared, ...]) -> None:
    first = 0
    for i, s in enumerate(sets):
        signed = (s.residual / (2.0 * s.u)).ravel()
        place = first + np.arange(len(signed))
        style = {"marker": MARKERS[i % len(MARKERS)], "ms": 3, "color": SERIES[i % len(SERIES)]}
        panel.plot(place, signed, ls="none", label=s.set, **style)
        first += len(signed)
    panel.axhspan(-1.0, 1.0, color=FAINT, alpha=0.5, lw=0, zorder=0)
    panel.set_xlabel("reading")
    panel.set_ylabel("residual / U (k = 2)")
    panel.set_title("grey: |E_n| ≤ 1", fontsize=9, loc="left", color=NEUTRAL)
    if len(sets) > 1:
        below = panel.legend(fontsize=7, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
        as_written(below.get_texts())


def _distribution(panel: Any, found: Validation) -> None:
    from scipy.special import ndtr

    ordered = np.sort(found.e_n)
    share = (np.arange(len(ordered)) + 0.5) / max(len(ordered), 1)
    panel.plot(ordered, 100 * share, color=EN, lw=1.6, label="readings")
    x = np.linspace(0.0, max(2.0, float(ordered[-1]) if len(ordered) else 2.0), 200)
    panel.plot(x, 100 * (2.0 * ndtr(2.0 * x) - 1.0), "--", color=BLACK, lw=1.0, label="if it is right, on average")
    panel.axvline(1.0, color=FAINT, lw=0.8, zorder=0)
    panel.set_xlabel("E_n")
    panel.set_ylabel("share of readings below / %")
    panel.legend(fontsize=7, frameon=False, loc="lower right")


def _worst(panel: Any, found: Validation) -> None:
    shown = [g for g in found.groups if g.sort != "set" and g.n >= MEMBERS][:SHOWN][::-1] or list(found.groups)[::-1]
    place = np.arange(len(shown))
    panel.barh(place, [g.ratio for g in shown], color=[WORST if g.ratio > 1.5 else EN for g in shown], height=0.7)
    panel.axvline(1.0, color=BLACK, lw=0.9, ls="--")
    panel.set_yticks(place, [re.sub(r"-(?=\d)", "−", g.what) for g in shown], fontsize=7)
    as_written(panel.get_yticklabels())
    panel.set_xlabel("RMS of residual / u; about 1 is to be expected")
    panel.set_title("groups that fit worst", fontsize=9, loc="left", color=NEUTRAL)
