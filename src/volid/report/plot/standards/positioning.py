"""The figure of a positioning test: mean deviations both ways with bands of ± 2 s, every approach, and A, E, R, B beside them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from volid.report.plot.palette import BLACK, FAINT, NEUTRAL, SERIES
from volid.report.plot.panels import figure_with_panels
from volid.standards.positioning.evaluation import PositioningResult
from volid.standards.positioning.runs import WAY_NAMES
from volid.standards.results import FAIL, Evaluation, Quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = dict(zip(WAY_NAMES, SERIES, strict=False))
_MARKERS = {"up": "^", "down": "v"}
_SIGNS = {"up": "+", "down": "−"}
_STYLES = {"up": "-", "down": "--"}
_APART = 0.006  # of the targets' range: approaches of the two directions are drawn so far beside their target


def positioning_figure(evaluations: Sequence[Evaluation]) -> Figure:
    """One row for each axis: deviations over the targets on the left, the quantities as bars at the same scale on the right.

    Lengths in µm, angles in arc seconds. `evaluations`: as `evaluate_positioning` gives them.

    Args:
        evaluations: As `volid.evaluate` gives them for ISO 230-2.

    >>> import volid
    >>> figure = volid.plot.positioning_figure(volid.evaluate("iso230-2", "datasets/iso230_2_synthetic/X_wide.csv", axis="X"))
    >>> len(figure.axes)
    2
    """
    n = len(evaluations)
    sides = (4, 1.5)
    figure, panels = figure_with_panels(n, 2, figsize=(9.5, 4.4 * n), squeeze=False, sharey="row", width_ratios=sides)
    for (left, right), evaluation in zip(panels, evaluations, strict=True):
        result: PositioningResult = evaluation.details
        scale, unit = (1e3, "µm") if result.runs.unit == "mm" else (3600.0, "arc sec")
        _deviations(left, result, scale)
        left.set_ylabel(f"deviation / {unit}")
        left.set_xlabel(f"position of {evaluation.subject} / {result.runs.unit}")
        left.set_title(
            f"{evaluation.standard}, {evaluation.subject}", loc="left", fontsize=10, pad=18
        )  # above the legend
        _quantities(right, evaluation, scale, unit)
    return figure


def _deviations(panel: Any, result: PositioningResult, scale: float) -> None:
    runs, found = result.runs, result.statistics
    panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
    aside = _APART * runs.length
    for way in runs.directions:
        name, (x, mean, s) = WAY_NAMES[way], (runs.targets, scale * found.mean[:, way], scale * found.s[:, way])
        colour, seen = _COLOURS[name], np.isfinite(mean)
        label = f"approached in {_SIGNS[name]}"
        panel.plot(
            x[seen], mean[seen], f"{_MARKERS[name]}{_STYLES[name]}", color=colour, ms=5, lw=1.3, label=label, zorder=3
        )
        spread = seen & np.isfinite(s)
        if spread.any():
            low, high = (mean - 2.0 * s)[spread], (mean + 2.0 * s)[spread]
            panel.fill_between(
                x[spread], low, high, color=colour, alpha=0.15, lw=0, label=f"mean ± 2 s, {_SIGNS[name]}"
            )
        if runs.deviations.shape[2] > 1:
            each = np.repeat((x + (aside if name == "up" else -aside))[:, None], runs.deviations.shape[2], axis=1)
            points = scale * runs.deviations[:, way]
            panel.plot(each.ravel(), points.ravel(), ".", color=colour, ms=3, alpha=0.45, zorder=2)
    panel.margins(x=0.03)
    place = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.2}
    panel.legend(fontsize=8, frameon=False, ncols=4, columnspacing=1.2, **place)


class _Bar(NamedTuple):
    """A quantity as the span that it is, low to high."""

    quantity: Quantity
    low: float
    high: float


def _quantities(panel: Any, evaluation: Evaluation, scale: float, unit: str) -> None:
    """Spans of the quantities, each where it comes about, and below them their values, with U and verdict."""
    bars = _bars(evaluation)
    for x, bar in enumerate(bars):
        ends = [scale * bar.low, scale * bar.high]
        panel.plot([x, x], ends, color=BLACK, lw=2.0, marker="_", ms=12, mew=1.6)
    panel.set_xticks(range(len(bars)), [_label(bar.quantity, scale) for bar in bars], fontsize=8)
    for bar, text in zip(bars, panel.get_xticklabels(), strict=True):
        text.set_fontweight("bold" if bar.quantity.verdict == FAIL else "normal")
    panel.set_xlim(-0.6, max(len(bars), 1) - 0.4)
    panel.tick_params(axis="y", labelleft=False, length=0)
    panel.tick_params(axis="x", length=0)
    for side in ("top", "right", "left"):
        panel.spines[side].set_visible(False)
    panel.set_title(unit, loc="left", fontsize=9, color=NEUTRAL)


def _bars(evaluation: Evaluation) -> list[_Bar]:
    """A and E of both directions, R and B at the target where they come about; of one direction A, E and R."""
    result: PositioningResult = evaluation.details
    mean, s = result.statistics.mean, result.statistics.s
    low, high = mean - 2.0 * s, mean + 2.0 * s
    known = {q.symbol: q for q in evaluation.quantities}
    ends = "" if len(result.runs.directions) == 2 else f"_{WAY_NAMES[result.runs.directions[0]]}"
    found = [(f"A{ends}", low, high), (f"E{ends}", mean, mean)]
    widest = np.nanmax(high, axis=1, initial=-np.inf) - np.nanmin(low, axis=1, initial=np.inf)
    found.append((f"R{ends}", *_at(widest, low, high)))
    found.append(("B", *_at(np.abs(result.statistics.reversal), mean, mean)))
    return [_Bar(known[name], float(np.nanmin(a)), float(np.nanmax(b))) for name, a, b in found if name in known]


def _at(size: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The two arrays at the target of the largest size."""
    i = int(np.argmax(np.where(np.isfinite(size), size, -np.inf)))
    return low[i], high[i]


def _label(quantity: Quantity, scale: float) -> str:
    lines = [quantity.symbol.replace("_", " "), f"{scale * quantity.value:.1f}"]
    if quantity.U is not None:
        lines.append(f"± {scale * quantity.U:.1f}")
    if quantity.limit is not None:
        lines += [f"≤ {scale * quantity.limit:g}", quantity.verdict]
    return "\n".join(lines)
