"""Residuals of the readings: by set and station, over time, over axis positions, and their distribution."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.exceptions import cut, shown
from volid.fitting.solution import Solution
from volid.report.contents.readings import Readings, readings_of
from volid.report.language import ENGLISH, Texts
from volid.report.plot.asked import Asked
from volid.report.plot.dots import MOST, Marked, draw_dots, expected_lines, finished, frame_of, quiet, thinned
from volid.report.plot.palette import FAINT, NEUTRAL, SERIES
from volid.report.plot.panels import figure_with_panels, heading, signs
from volid.report.plot.residual_distribution import distribution_panel, normal_panel
from volid.report.plot.residual_regions import residuals_by_region

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME_LENGTH = 26  # letters of a strip's name that are written
MOST_RUNS = 100  # stretches of one station that are divided
HOUR = 3600.0  # s
LINE = 140  # letters of a line below a figure


def draw(asked: Asked) -> dict[str, Figure]:
    """The figures of a solution."""
    solution, texts = asked.solution, asked.texts
    figures = {"": residual_plot(solution, texts), "positions": residuals_by_position(solution, texts)}
    return figures | {"regions": residuals_by_region(solution, texts)}


def residual_plot(solution: Solution, texts: Texts = ENGLISH) -> Figure:
    """Residuals over u sqrt(1 - h): by set and station, over time or the order of the files, and against the normal distribution.

    The worst readings are numbered, and named by file and row below. Readings that no other checks are rings: their residual is
    0 whatever they say.

    Args:
        solution: A solution, as `volid.fit` makes it.
        texts: The language.

    Source: ISO/TR 16907 11.3; Baarda 1968 for the critical value.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
    >>> len(volid.plot.residual_plot(solution).axes)
    4
    """
    readings = readings_of(solution)
    strips = len(readings.strips)
    tall = 2.8 + 0.13 * max(strips - 6, 0)
    shape = {"width_ratios": (1.5, 1.0), "height_ratios": (tall, 2.8)}
    figure, panels = figure_with_panels(2, 2, figsize=(11.0, tall + 3.3), **shape)
    strips_panel(panels[0][0], readings, texts)
    order_panel(panels[1][0], readings, texts)
    distribution_panel(panels[0][1], readings, texts)
    normal_panel(panels[1][1], readings, texts)
    heading(figure, f"{cut(solution.machine.name)}: {texts('residuals.title')}")
    figure.supxlabel(footnote(readings, texts), fontsize=7, x=0.01, ha="left", color=NEUTRAL)
    finished(figure, texts)
    return figure


def footnote(readings: Readings, texts: Texts) -> str:
    """What the marks mean, and which the numbered readings are."""
    lines = [texts("residuals.marks", critical=signs(f"{readings.critical:.1f}", texts))]
    for k, number in enumerate(readings.worst, 1):
        aside = texts("residuals.aside") if readings.outlier[number] else texts("residuals.used")
        size = signs(f"{readings.normalised[number]:+.1f}", texts)
        lines.append(f"{k}: {readings.where(number)} ({readings.label(number, texts)}): {size}, {aside}")
    return "\n".join(fill(line, LINE) for line in [*lines, *remarks(readings, texts)])


def remarks(readings: Readings, texts: Texts) -> list[str]:
    """What has to be known before RMS and dots are trusted: estimated u, a sample of the readings, dots that are left out."""
    found = []
    if readings.estimated:
        found.append(texts("residuals.estimated", sets=", ".join(readings.estimated)))
    if readings.all_readings > len(readings.row):
        found.append(texts("residuals.sample", shown=len(readings.row), n=readings.all_readings))
    if len(readings.row) > MOST:
        found.append(texts("residuals.thinned", shown=MOST, n=len(readings.row)))
    return found


def marked(readings: Readings, places: np.ndarray, numbers: np.ndarray | None = None) -> Marked:
    """What is drawn of the readings of these `numbers` (default: all): at most `MOST`, the largest all."""
    numbers = np.arange(len(readings.row)) if numbers is None else numbers
    kept = numbers[thinned(readings.normalised[numbers])]
    worst = [int(np.flatnonzero(kept == w)[0]) for w in readings.worst if w in kept]
    return Marked(
        places[kept],
        readings.normalised[kept],
        readings.outlier[kept],
        ~readings.checked[kept],
        np.array(worst, dtype=np.int64),
    )


def frame_for(readings: Readings) -> float:
    """Half width of the frame that all panels of the readings share."""
    return frame_of(readings.normalised)


def strips_panel(panel: Any, readings: Readings, texts: Texts) -> None:
    """A row for every set and station: its readings in their order, and at the right the RMS over what is expected of it."""
    places, frame = np.zeros(len(readings.row)), frame_for(readings)
    for k, strip in enumerate(readings.strips):
        places[strip.numbers] = k - 0.38 + 0.76 * np.linspace(0.0, 1.0, len(strip.numbers))
        if k:
            panel.axhline(k - 0.5, color=FAINT, lw=0.6, zorder=0)
        panel.text(
            1.01,
            k,
            _weight(readings, strip.numbers, texts),
            transform=panel.get_yaxis_transform(),
            fontsize=7,
            va="center",
        )
    expected_lines(panel, readings.critical, frame, lying=True)
    draw_dots(panel, marked(readings, places), frame, lying=True)
    panel.set_yticks(range(len(readings.strips)), [_cut(s.name) for s in readings.strips])
    panel.set_ylim(len(readings.strips) - 0.5, -0.5)
    panel.set_xlim(-frame, frame)
    panel.set_xlabel(texts("residuals.normalised"), fontsize=8)
    panel.set_title(texts("residuals.by_station"), fontsize=8, loc="left")
    above = {"transform": panel.transAxes, "fontsize": 7, "va": "bottom", "color": NEUTRAL}
    panel.text(1.01, 1.005, texts("residuals.rms_column").replace(" / ", " /\n"), **above)
    quiet(panel)
    panel.tick_params(axis="y", length=0)


def _weight(readings: Readings, numbers: np.ndarray, texts: Texts) -> str:
    weight = readings.unit_weight(numbers)
    return signs(f"{weight:.2f}", texts) if np.isfinite(weight) else "–"


def _cut(name: str) -> str:
    return cut(shown(name), NAME_LENGTH)


def has_times(readings: Readings) -> bool:
    """Whether the time of every reading is recorded, and several times are."""
    return bool(np.isfinite(readings.time).all()) and float(np.ptp(readings.time)) > 0.0


def order_panel(panel: Any, readings: Readings, texts: Texts) -> None:
    """Residuals over time, or over the order in the files where no time was recorded; a line wherever the station changes."""
    timed, frame = has_times(readings), frame_for(readings)
    places = (readings.time - readings.time.min()) / HOUR if timed else np.arange(1.0, len(readings.row) + 1.0)
    expected_lines(panel, readings.critical, frame)
    draw_dots(panel, marked(readings, places), frame)
    room = 0.02 * float(np.ptp(places)) or 1.0
    panel.set_xlim(places.min() - room, places.max() + room)
    panel.set_ylim(-frame, frame)
    _divide(panel, readings, places)
    panel.set_xlabel(texts("residuals.time" if timed else "residuals.order"), fontsize=8)
    panel.set_ylabel(texts("residuals.normalised"), fontsize=8)
    panel.set_title(texts("residuals.over_time" if timed else "residuals.over_order"), fontsize=8, loc="left", pad=14)
    quiet(panel)


def _divide(panel: Any, readings: Readings, places: np.ndarray) -> None:
    """Lines between stretches of one set and station, and their names above where they have room."""
    strip = np.zeros(len(places), dtype=int)
    for k, s in enumerate(readings.strips):
        strip[s.numbers] = k
    order = np.argsort(places, kind="stable")
    changes = np.flatnonzero(np.diff(strip[order])) + 1
    if not len(changes) or len(changes) >= MOST_RUNS:
        return
    for before, after in zip(places[order[changes - 1]], places[order[changes]], strict=True):
        panel.axvline(
            0.5 * (before + after), color=NEUTRAL, lw=0.7 if len(changes) < 12 else 0.3, zorder=1, gid="change"
        )
    width = float(np.ptp(places))
    for run in np.split(order, changes):
        name, middle = readings.strips[strip[run[0]]].name, 0.5 * (places[run[0]] + places[run[-1]])
        if np.ptp(places[run]) / width * 60.0 > len(name):
            panel.text(
                middle, 1.01, name, transform=panel.get_xaxis_transform(), fontsize=7, ha="center", color=NEUTRAL
            )


def residuals_by_position(solution: Solution, texts: Texts = ENGLISH) -> Figure:
    """Residuals over u sqrt(1 - h) over the position of every axis, with their RMS in sixths of the travel.

    Args:
        solution: A solution, as `volid.fit` makes it.
        texts: The language.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
    >>> [panel.get_xlabel() for panel in volid.plot.residuals_by_position(solution).axes[:3]]
    ['Y / mm', 'X / mm', 'Z / mm']
    """
    readings = readings_of(solution)
    moved = moving_axes(readings)
    columns = min(3, len(moved))
    rows = -(-len(moved) // columns)
    figure, panels = figure_with_panels(
        rows, columns, figsize=(max(3.7 * columns, 9.6), 2.7 * rows + 0.7), squeeze=False
    )
    for panel, i in zip(panels.ravel(), moved, strict=False):
        position_panel(panel, readings, i, texts)
    for panel in panels.ravel()[len(moved) :]:
        panel.remove()
    heading(figure, f"{cut(solution.machine.name)}: {texts('residuals.over_positions')}")
    figure.supxlabel(footnote(readings, texts), fontsize=7, x=0.01, ha="left", color=NEUTRAL)
    finished(figure, texts)
    return figure


def moving_axes(readings: Readings) -> list[int]:
    """Numbers of the axes that move in the campaign; the first one where none does."""
    found = np.flatnonzero(np.ptp(readings.positions, axis=0) > 0.0).tolist()
    return found or [0]


def position_panel(panel: Any, readings: Readings, i: int, texts: Texts) -> None:
    """Residuals over the position of axis number `i`, and the RMS over what is expected in sixths of the measured range."""
    axis, frame = readings.campaign.machine.axes[i], frame_for(readings)
    places = readings.positions[:, i]
    expected_lines(panel, readings.critical, frame)
    draw_dots(panel, marked(readings, places), frame)
    for low, high, weight in weights_over(readings, places):
        for sign in (-1.0, 1.0):
            panel.plot([low, high], [sign * weight] * 2, color=SERIES[1], lw=1.6, zorder=4, gid="rms")
    panel.set_ylim(-frame, frame)
    panel.set_xlabel(f"{axis.letter} / {axis.unit}", fontsize=8)
    panel.set_ylabel(texts("residuals.normalised"), fontsize=8)
    quiet(panel)


def weights_over(readings: Readings, places: np.ndarray, bins: int = 6) -> list[tuple[float, float, float]]:
    """Low and high end of parts of equal width, and the RMS of their residuals over what is expected; empty ones are left out."""
    edges = np.linspace(places.min(), places.max(), bins + 1)
    index = np.clip(np.searchsorted(edges, places, side="right") - 1, 0, bins - 1)
    found = [(edges[k], edges[k + 1], readings.unit_weight(np.flatnonzero(index == k))) for k in range(bins)]
    return [(float(low), float(high), weight) for low, high, weight in found if np.isfinite(weight)]
