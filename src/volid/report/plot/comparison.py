"""Figures of what changed: every function's change with its band of U, and functions over time with their line.

Lengths in µm, rotations in µrad, positions in mm or degrees.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from volid.model.iso230 import DIRECTIONS, ROTARY_AXES, parse
from volid.report.plot.palette import ATTENTION, BLUE, FAINT, NEUTRAL
from volid.report.plot.panels import figure_with_panels, heading, note_below
from volid.report.text.comparison import place_words
from volid.validation.solutions.comparison import Comparison
from volid.validation.solutions.dates import Times
from volid.validation.solutions.function_changes import FunctionChange
from volid.validation.solutions.series import FunctionDrift, Series

if TYPE_CHECKING:
    from matplotlib.figure import Figure

K = 2.0
CHANGED, SAME, LINE = ATTENTION, BLUE, NEUTRAL
MOST = 12  # functions over time
FAR = 4.0  # times the usual size, from which on a panel has its own scale
BOLD = "bold and orange, squares: significant (5 % over all functions)"
REVERSED = "solid: approached in + or the mean of both directions; dashed: approached in −"
_SCALE = {"mm": (1e3, "µm"), "rad": (1e6, "µrad")}


def changes_figure(found: Comparison) -> Figure:
    """Error motions of every axis as small panels, one row per direction, and constants as bars; changed ones are bold.

    Translations share one scale and rotations another; a panel far above the others has its own, and says so.

    Args:
        found: As `volid.compare` gives it.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> figure = volid.plot.changes_figure(volid.compare(solution, solution))
    >>> [panel.get_title(loc="left") for panel in figure.axes if panel.get_visible()]
    ['EXX / µm', 'EZZ / µm']
    """
    motions = [f for f in found.functions if np.isfinite(f.positions).all()]
    constants = [f for f in found.functions if not np.isfinite(f.positions).any() and np.isfinite(f.largest_change)]
    letters = sorted({parse(f.name).axis for f in motions}, key=DIRECTIONS.index)
    rows, columns = (6 if motions else 0) + (1 if constants else 0), max(len(letters), 2)
    figure, panels = figure_with_panels(rows, columns, figsize=(3.9 * columns, 1.75 * rows + 0.8), squeeze=False)
    for panel in panels.ravel():
        panel.set_visible(False)
    _motion_panels(panels, motions, letters)
    units = [unit for unit in ("mm", "rad") if any(f.unit == unit for f in constants)]
    for column, unit in enumerate(units):
        _constants_panel(panels[-1][column], [f for f in constants if f.unit == unit], unit)
    first, second = (name.replace("\\", "/").rsplit("/", 1)[-1] for name in found.names)
    heading(figure, f"change from {first} to {second}, bands and bars ± U (k = 2)")
    note_below(figure, [BOLD, *([REVERSED] if _reversed(motions) else [])])
    return figure


def _motion_panels(panels: Any, motions: list[FunctionChange], letters: list[str]) -> None:
    """The error motions, a row for each direction, a column for each axis."""
    for f in motions:
        row, column = parse(f.name).component, letters.index(parse(f.name).axis)
        _motion_panel(panels[row][column], f)
        if row == 5:
            unit = "°" if letters[column] in ROTARY_AXES else "mm"
            panels[row][column].set_xlabel(f"{letters[column]} / {unit}", fontsize=8)
    _share_scales(panels[:6] if motions else [])


def _reversed(motions: list[FunctionChange]) -> bool:
    """Whether a function differs by direction of approach."""
    return any((f.directions == -1).any() for f in motions)


def _motion_panel(panel: Any, change: FunctionChange) -> None:
    scale, unit = _SCALE[change.unit]
    colour = CHANGED if change.significant else SAME
    panel.set_visible(True)
    panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
    first = np.isnan(change.beside) | (change.beside == change.beside[0])
    for way, style in ((0, "-"), (1, "-"), (-1, "--")):
        own = (change.directions == way) & first
        if own.any():
            x, value, u = change.positions[own], scale * change.values[own], scale * change.values_u[own]
            panel.fill_between(x, value - K * u, value + K * u, color=colour, alpha=0.22, lw=0)
            panel.plot(x, value, style, color=colour, lw=1.5 if change.significant else 1.1)
    if not np.isfinite(change.values).any():
        panel.text(0.5, 0.5, "not determined", transform=panel.transAxes, ha="center", color=NEUTRAL, fontsize=8)
    title = f"{change.name} / {unit}"
    weight = "bold" if change.significant else "normal"
    panel.set_title(title, fontsize=8, loc="left", color=colour if change.significant else NEUTRAL, fontweight=weight)
    panel.tick_params(labelsize=7)


def _share_scales(panels: Any) -> None:
    """One scale for all translations, one for all rotations, so that sizes compare; a panel far above the others has its own."""
    for half in (panels[:3], panels[3:]):
        shown = [p for row in half for p in row if p.get_visible()]
        sizes = np.array([np.max(np.abs(p.get_ylim())) for p in shown])
        if not len(sizes):
            continue
        usual = sizes <= FAR * np.median(sizes)
        common = float(np.max(sizes[usual]))
        for panel, size, is_usual in zip(shown, sizes, usual, strict=True):
            panel.set_ylim(-(common if is_usual else size), common if is_usual else size)
            if not is_usual:
                panel.set_title(f"{panel.get_title(loc='left')}   own scale", fontsize=8, loc="left")


def _constants_panel(panel: Any, constants: list[FunctionChange], unit: str) -> None:
    scale, name = _SCALE[unit]
    panel.set_visible(True)
    panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
    for x, f in enumerate(constants):
        colour = CHANGED if f.significant else SAME
        panel.errorbar(
            x,
            scale * f.largest_change,
            yerr=scale * K * f.u,
            fmt="s" if f.significant else "o",
            ms=4,
            color=colour,
            capsize=3,
        )
    panel.set_xticks(range(len(constants)), [f.name for f in constants], fontsize=7)
    panel.set_xlim(-0.6, len(constants) - 0.4)
    panel.set_title(f"constants / {name}", fontsize=8, loc="left", color=NEUTRAL)
    panel.tick_params(labelsize=7)


def series_figure(found: Series, times: Times) -> Figure:
    """The change of the field since the first survey with its limit, and the functions that changed most surely, with lines.

    Args:
        found: As `volid.compare_series` gives it.
        times: Its times, for the axis.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> found = volid.compare_series([solution] * 3, [0.0, 30.0, 75.0])
    >>> from volid.validation.solutions.dates import stated_times
    >>> figure = volid.plot.series_figure(found, stated_times("2026-01-10, 2026-02-09, 2026-03-26", 3))
    >>> figure.axes[0].get_title(loc="left")
    'largest change of the functional point / µm'
    """
    order = sorted(found.functions, key=_sureness)
    shown = [f for f in order if np.isfinite(f.drift.largest_change)]
    changed = [f for f in shown if f.drift.significant or not f.steady]
    shown = (changed or shown)[:MOST]
    columns = 3 if len(shown) > 1 else 2
    rows = -(-(len(shown) + 1) // columns)
    figure, panels = figure_with_panels(rows, columns, figsize=(4.0 * columns, 2.6 * rows + 0.6), squeeze=False)
    for panel in panels.ravel()[len(shown) + 1 :]:
        panel.set_visible(False)
    _field_panel(panels.ravel()[0], found)
    for panel, function in zip(panels.ravel()[1:], shown, strict=False):
        _drift_panel(panel, found, function)
    for panel in panels.ravel()[: len(shown) + 1]:
        _time_axis(panel, found, times)
    what = "functions that changed" if changed else "no function changed significantly; most likely ones"
    heading(figure, f"change since {times.words(0.0)}, bars ± U (k = 2); {what}")
    if any(f.steady for f in shown):
        note_below(figure, ["line: the drift that fits best"])
    return figure


def _sureness(function: FunctionDrift) -> float:
    return float(np.nanmin([function.drift.probability, function.probability, 1.0]))


def _field_panel(panel: Any, found: Series) -> None:
    sizes = 1e3 * np.array([c.largest for c in found.volume])
    u = 1e3 * np.array([c.u for c in found.volume])
    panel.errorbar(found.times[1:], sizes, yerr=K * u, fmt="o", ms=4, color=SAME, capsize=3)
    for time in found.times[1:][np.isnan(sizes)]:
        panel.annotate(
            "not determined", (time, 0.0), xycoords=("data", "axes fraction"), xytext=(0, 4), textcoords="offset points",
            ha="center", rotation=90, fontsize=7, color=NEUTRAL,
        )  # fmt: skip
    limit = 1e3 * found.holding.limit
    if np.isfinite(limit):
        panel.axhline(limit, color=CHANGED, lw=1.0, ls="--")
        panel.annotate(
            "limit", (0.0, limit), xycoords=("axes fraction", "data"), xytext=(3, 3), textcoords="offset points",
            ha="left", fontsize=7, color=CHANGED,
        )  # fmt: skip
    highest = np.append(sizes + K * u, limit)
    panel.set_ylim(0.0, 1.25 * float(np.max(highest[np.isfinite(highest)], initial=1e-3)))
    panel.set_title("largest change of the functional point / µm", fontsize=8, loc="left", color=NEUTRAL)


def _drift_panel(panel: Any, found: Series, function: FunctionDrift) -> None:
    """Values at the position of the largest drift (or step), with the line where it went along one."""
    shown = function.drift if function.steady else function.step_change
    scale, unit = _SCALE[shown.unit]
    own = _index(function.drift, shown)
    values, u = scale * function.since_first[:, own], scale * function.since_first_u[:, own]
    panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
    panel.errorbar(found.times, values, yerr=K * u, fmt="o", ms=4, color=CHANGED, capsize=3)
    if function.steady:
        who = np.array(function.surveys)
        at = found.times[who]
        slope = scale * function.drift.values[own] / (at[-1] - at[0])
        weights = 1.0 / np.maximum(u[who], np.max(u[who[1:]], initial=1e-12)) ** 2
        middle = np.sum(weights * (values[who] - slope * at)) / np.sum(weights)
        panel.plot(at, middle + slope * at, color=LINE, lw=1.0)
    place = f" at {place_words(shown.name, shown.at)}" if np.isfinite(shown.at) else ""
    words = "drifts" if function.drift.significant and function.steady else "steps" if not function.steady else ""
    panel.set_title(f"{shown.name}{place} / {unit}   {words}", fontsize=8, loc="left", color=NEUTRAL)


def _index(drift: FunctionChange, shown: FunctionChange) -> int:
    if not np.isfinite(shown.at):
        return 0
    return int(np.flatnonzero((drift.positions == shown.at) & (drift.directions == shown.direction))[0])


def _time_axis(panel: Any, found: Series, times: Times) -> None:
    panel.set_xlim(-0.05 * found.times[-1], 1.05 * found.times[-1])
    panel.set_xticks(found.times, [times.words(t) for t in found.times.tolist()], rotation=30, ha="right", fontsize=7)
    panel.tick_params(axis="y", labelsize=7)
