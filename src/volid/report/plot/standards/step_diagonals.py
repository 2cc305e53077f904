"""Figure of sequential step diagonals: the nine functions as small multiples, one column per axis, with U (k = 2)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.model.iso230 import LINEAR_AXES
from volid.report.plot.palette import SERIES
from volid.report.plot.panels import figure_with_panels
from volid.standards.results import Evaluation
from volid.standards.step_diagonals.separation import NAMES, NineFunctions

if TYPE_CHECKING:
    from matplotlib.figure import Figure


K = 2.0


def nine_figure(evaluations: Sequence[Evaluation]) -> Figure:
    """The nine functions of every evaluation, values in µm over positions in mm; bands are ± U (k = 2)."""
    figure, panels = figure_with_panels(3, 3, figsize=(10.5, 7.2), sharex="col", sharey=True)
    for colour, evaluation in zip(_colours(len(evaluations)), evaluations, strict=True):
        for i, panel in enumerate(panels.T.ravel()):
            _function(panel, evaluation.details, NAMES[i], colour, Path(evaluation.source).name or evaluation.subject)
    for i, panel in enumerate(panels.T.ravel()):
        axis, component = divmod(i, 3)
        what = "positioning" if axis == component else "straightness and squareness"
        panel.set_title(f"{NAMES[i]}: {what}", fontsize=9, loc="left", color="0.3")
    for letter, panel in zip(LINEAR_AXES, panels[-1], strict=True):
        panel.set_xlabel(f"{letter} / mm")
    for letter, panel in zip(LINEAR_AXES, panels[:, 0], strict=True):
        panel.set_ylabel(f"motion in {letter} / µm")
    if len(evaluations) > 1:
        panels[0, 0].legend(fontsize=7, frameon=False)
    figure.suptitle("Sequential step diagonals: nine displacement functions with U (k = 2)", fontsize=11)
    return figure


def _colours(count: int) -> list[str]:
    return [SERIES[i % len(SERIES)] for i in range(count)]


def _function(panel: Any, nine: NineFunctions, name: str, colour: str, label: str) -> None:
    x, value, u = nine.of(name)
    value, band = 1e3 * np.asarray(value), 1e3 * K * u
    panel.axhline(0.0, color="0.8", lw=0.8)
    panel.fill_between(x, value - band, value + band, color=colour, alpha=0.2, lw=0)
    panel.plot(x, value, color=colour, lw=1.3, label=label)
    panel.margins(x=0.02)
