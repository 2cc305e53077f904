"""What compensation types leave of the deviation, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.compensation.residual.fields import ANGLES, LENGTHS
from volid.compensation.residual.forecast import NONE, Forecast
from volid.exceptions import cut
from volid.report.contents.outlook import outlook
from volid.report.language import ENGLISH, Texts
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.palette import BLUE, FAINT, GREEN, ORANGE, PINK
from volid.report.plot.panels import figure_with_panels, heading, in_language, note_below, shown_vector, signs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_DRAWN = 3  # tool vectors in a figure
MARKERS = ("o", "s", "^")  # by tool vector
SHOWN = ((0, "largest", BLUE, True), (2, "rms", GREEN, False))  # number, text, colour, whether filled
TURNS = tuple(zip(range(len(LENGTHS), len(LENGTHS) + len(ANGLES)), "ov^D", (BLUE, ORANGE, GREEN, PINK), strict=True))
APART = 0.17  # of a row, between markers of it
STEPS = (1.0, 2.0, 5.0)
WIDE = 10.0  # largest over smallest value, from which on a scale is logarithmic


def forecast_figure(found: Forecast, machine_name: str, *, texts: Texts = ENGLISH) -> Figure:
    """Largest and RMS length and the orientation after each type, each with its 95 % interval, one row for each type.

    Lengths are shown for up to three tool vectors, orientations for the first one. A scale is logarithmic where types differ by
    more than a factor of ten.

    Args:
        found: As `volid.forecast` gives it.
        machine_name: For the title.
        texts: The language.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
    >>> base = volid.compensation_base(solution, (0.0, 0.0, -150.0))
    >>> found = volid.forecast(solution, [["L-POS"]], base, [(0.0, 0.0, -150.0)], most_draws=20)
    >>> [label.get_text() for label in volid.plot.forecast_figure(found, "my machine").axes[0].get_yticklabels()]
    ['none', 'L-POS']
    """
    rows = len(found.columns)
    tools = min(len(found.tools), MOST_DRAWN)
    figure, (left, right) = figure_with_panels(1, 2, figsize=(11, 0.42 * rows + 2.2), width_ratios=(3, 2), sharey=True)
    draw_lengths(left, found, texts)
    draw_orientations(right, found, texts)
    for panel, columns in ((left, tools), (right, len(ANGLES))):
        panel.legend(fontsize=8, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=max(columns, 2))
    heading(figure, texts("figures.forecast_title", machine=machine_name))
    note_below(figure, [texts("figures.forecast_note", tool=shown_vector(found.tools[0].tolist(), texts))])
    return figure


def draw_lengths(panel: Any, found: Forecast, texts: Texts = ENGLISH) -> None:
    """Largest and RMS length after each type, with 95 % intervals, for up to three tool vectors, in a panel.

    Args:
        panel: Axes of matplotlib.
        found: As `volid.forecast` gives it.
        texts: The language.
    """
    tools = found.tools[:MOST_DRAWN]
    shifts = _beside(len(SHOWN) * len(tools))
    for i, tool in enumerate(tools):
        for j, (k, name, colour, filled) in enumerate(SHOWN):
            label = texts(f"figures.{name}", tool=shown_vector(tool.tolist(), texts))
            style = {"fmt": MARKERS[i], "color": colour, "label": label, "mfc": colour if filled else "none"}
            _intervals(panel, found, (i, k), 1e3, {**style, "shift": shifts[i * len(SHOWN) + j]})
    _scale(
        panel,
        [1e3 * c.predictions[i].value[k] for c in found.columns for i in range(len(tools)) for k, *_ in SHOWN],
        texts,
    )
    panel.set_xlabel(texts("figures.remaining"), fontsize=9)
    _rows(panel, found, texts)


def draw_orientations(panel: Any, found: Forecast, texts: Texts = ENGLISH) -> None:
    """Largest orientation errors after each type, with 95 % intervals, for the first tool vector, in a panel.

    Args:
        panel: Axes of matplotlib.
        found: As `volid.forecast` gives it.
        texts: The language.
    """
    shifts = _beside(len(TURNS))
    for (k, marker, colour), name, shift in zip(TURNS, ANGLES, shifts, strict=True):
        label = texts("figures.tool_axis") if name == ANGLES[-1] else texts("figures.about", line=name)
        _intervals(panel, found, (0, k), 1e6, {"fmt": marker, "color": colour, "label": label, "shift": shift})
    _scale(panel, [1e6 * c.predictions[0].value[k] for c in found.columns for k, *_ in TURNS], texts)
    panel.set_xlabel(texts("figures.orientation"), fontsize=9)
    _rows(panel, found, texts)


def _intervals(panel: Any, found: Forecast, which: tuple[int, int], factor: float, style: dict[str, Any]) -> None:
    """Markers of one quantity with their intervals, a row for each type. `which`: tool vector and quantity."""
    i, k = which
    p = [c.predictions[i] for c in found.columns]
    value, low, high = (factor * np.array([getattr(v, key)[k] for v in p]) for key in ("value", "low", "high"))
    y = np.arange(len(p)) + style.pop("shift")
    span = np.maximum([value - low, high - value], 0.0)
    panel.errorbar(value, y, xerr=span, ms=4.5, capsize=2.5, lw=1.2, **style)


def _beside(count: int) -> list[float]:
    """Where markers of one row stand, so that none lies on another."""
    return [APART * (i - 0.5 * (count - 1)) * min(1.0, 4.0 / count) for i in range(count)]


def _rows(panel: Any, found: Forecast, texts: Texts) -> None:
    """Names of the types at their rows, which lines divide; the first one on top."""
    names = [texts("figures.no_type") if c.name == NONE else c.name for c in found.columns]
    panel.set_yticks(range(len(names)), names, fontsize=8)
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.tick_params(axis="y", length=0)
    panel.tick_params(axis="x", labelsize=8)
    for edge in range(1, len(names)):
        panel.axhline(edge - 0.5, color=FAINT, lw=0.8, zorder=0)
    panel.grid(axis="x", color=FAINT, lw=0.6)
    panel.set_axisbelow(True)


def _scale(panel: Any, values: Sequence[float], texts: Texts) -> None:
    """A scale from 0, logarithmic where the values differ by more than `WIDE`."""
    known = np.array([v for v in values if np.isfinite(v) and v > 0.0])
    if len(known) and known.max() > WIDE * known.min():
        panel.set_xscale("log")
        _round_ticks(panel, texts)
    else:
        panel.set_xlim(left=0.0)
        in_language(panel.xaxis, texts)


def _round_ticks(panel: Any, texts: Texts) -> None:
    """Ticks of a logarithmic scale at 1, 2 and 5 times powers of ten, of wide ones at powers of ten alone."""
    low, high = panel.get_xlim()
    decades = np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    steps: Sequence[float] = STEPS if len(decades) <= 5 else STEPS[:1]
    ticks = [s * 10.0**d for d in decades for s in steps if low <= s * 10.0**d <= high]
    panel.set_xticks(ticks, [signs(f"{t:g}", texts) for t in ticks])
    panel.set_xticks([], minor=True)


def draw(asked: Asked) -> Figure:
    """For the collection of figures: every type that the machine can have, for the tool vector alone."""
    found = outlook(asked.solution, asked.tool)
    if found.forecast is None:
        raise NothingToDrawError(found.reason)
    return forecast_figure(found.forecast, cut(asked.solution.machine.name), texts=asked.texts)
