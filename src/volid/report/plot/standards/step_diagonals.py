"""Figure of sequential step diagonals: the nine functions as small multiples, one column per axis, with U (k = 2)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.model.iso230 import LINEAR_AXES
from volid.report.plot.palette import FAINT, NEUTRAL, SERIES, STYLES
from volid.report.plot.panels import figure_with_panels, heading
from volid.standards.results import Evaluation
from volid.standards.step_diagonals.separation import NAMES, NineFunctions

if TYPE_CHECKING:
    from matplotlib.figure import Figure


K = 2.0


def nine_figure(evaluations: Sequence[Evaluation]) -> Figure:
    """The nine functions of every evaluation, values in µm over positions in mm; bands are ± U (k = 2).

    Args:
        evaluations: As `volid.evaluate` gives them for sequential step diagonals.

    >>> import volid
    >>> figure = volid.plot.nine_figure(volid.evaluate("step-diagonal", "datasets/step_diagonals_800/steps.csv"))
    >>> len(figure.axes)
    9
    """
    figure, panels = figure_with_panels(3, 3, figsize=(10.5, 7.2), sharex="col", sharey=True)
    for number, evaluation in enumerate(evaluations):
        label = Path(evaluation.source).name or evaluation.subject
        for i, panel in enumerate(panels.T.ravel()):
            _function(panel, evaluation.details, NAMES[i], number, label)
    for i, panel in enumerate(panels.T.ravel()):
        axis, component = divmod(i, 3)
        what = "positioning" if axis == component else "straightness and squareness"
        panel.set_title(f"{NAMES[i]}: {what}", fontsize=9, loc="left", color=NEUTRAL)
    for letter, panel in zip(LINEAR_AXES, panels[-1], strict=True):
        panel.set_xlabel(f"{letter} / mm")
    for letter, panel in zip(LINEAR_AXES, panels[:, 0], strict=True):
        panel.set_ylabel(f"motion in {letter} / µm")
    labels = panels[0, 0].get_legend_handles_labels() if len(evaluations) > 1 else ()
    heading(figure, "Sequential step diagonals: nine displacement functions with U (k = 2)", *labels)
    return figure


def _function(panel: Any, nine: NineFunctions, name: str, number: int, label: str) -> None:
    colour, style = SERIES[number % len(SERIES)], STYLES[number % len(STYLES)]
    x, value, u = nine.of(name)
    value, band = 1e3 * np.asarray(value), 1e3 * K * u
    panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
    panel.fill_between(x, value - band, value + band, color=colour, alpha=0.2, lw=0)
    panel.plot(x, value, color=colour, ls=style, lw=1.3, label=label)
    panel.margins(x=0.02)
