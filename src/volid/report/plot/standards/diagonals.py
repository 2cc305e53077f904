"""Figure of diagonals after ISO 230-6: mean deviations on both ways with ± 2 s, one panel per diagonal."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.report.plot.palette import FAINT, SERIES
from volid.report.plot.panels import figure_with_panels, heading
from volid.standards.diagonals.lines import Diagonal
from volid.standards.positioning.runs import WAY_NAMES, statistics_of
from volid.standards.results import Evaluation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ACROSS = {1: 1, 2: 2, 4: 2}  # panels side by side; more: 3


def diagonals_figure(evaluations: Sequence[Evaluation]) -> Figure:
    """Deviations in µm over the distance from the start of each diagonal in mm, all panels at one scale.

    Args:
        evaluations: As `volid.evaluate` gives them for ISO 230-6.

    >>> import volid
    >>> found = volid.evaluate("iso230-6", "datasets/step_diagonals_800/steps.csv")
    >>> len(volid.plot.diagonals_figure(found).axes)
    4
    """
    found = [(evaluation, diagonal) for evaluation in evaluations for diagonal in evaluation.details]
    across = ACROSS.get(len(found), 4 if len(found) > 9 else 3)
    down = ceil(len(found) / across)
    size = (3.4 * across + 1.0, 2.5 * down + 0.8)
    figure, panels = figure_with_panels(down, across, figsize=size, sharey=True, squeeze=False)
    for panel, (evaluation, diagonal) in zip(panels.ravel(), found, strict=False):
        _draw(panel, diagonal)
        shown = [f"{s} {1e3 * v:.1f}" for s, v in _values(evaluation, diagonal).items()]
        panel.set_title(f"{diagonal.name}: {', '.join(shown)} µm", fontsize=9, loc="left")
    for panel in panels.ravel()[len(found) :]:
        panel.set_axis_off()
    for panel in panels[:, 0]:
        panel.set_ylabel("deviation / µm")
    for number, panel in enumerate(panels.ravel()[: len(found)]):
        if number + across >= len(found):
            panel.set_xlabel("distance from the start / mm")
    title = "Diagonal displacement test, ISO 230-6: means of both ways" + _scatter(found)
    heading(figure, title, *panels[0, 0].get_legend_handles_labels())
    return figure


def _scatter(found: Sequence[tuple[Evaluation, Diagonal]]) -> str:
    return " with ± 2 s" if any(np.isfinite(statistics_of(d.runs.deviations).s).any() for _, d in found) else ""


def _values(evaluation: Evaluation, diagonal: Diagonal) -> dict[str, float]:
    own = {q.symbol: q.value for q in evaluation.quantities}
    return {s: own[f"{s}_{diagonal.name}"] for s in "ERB" if f"{s}_{diagonal.name}" in own}


def _draw(panel: Any, diagonal: Diagonal) -> None:
    found, x = statistics_of(diagonal.runs.deviations), diagonal.runs.targets
    panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
    for way, (colour, marker) in enumerate(zip(SERIES, "^v", strict=False)):
        mean, s = 1e3 * found.mean[:, way], 1e3 * found.s[:, way]
        panel.fill_between(x, mean - 2.0 * s, mean + 2.0 * s, color=colour, alpha=0.2, lw=0)
        panel.plot(
            x,
            mean,
            color=colour,
            ls=("-", "--")[way],
            lw=1.2,
            marker=marker,
            ms=3,
            label={"up": "on", "down": "back"}[WAY_NAMES[way]],
        )
    panel.margins(x=0.03)
