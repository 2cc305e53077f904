"""The polar plot of a circular test: both senses about the nominal circle, deviations magnified, beside it the quantities."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.exceptions import InputError
from volid.report.plot.palette import BLUE, FAINT, GREEN, NEUTRAL, ORANGE
from volid.report.plot.panels import figure_with_panels
from volid.standards.circular.evaluation import CircularDetails
from volid.standards.results import Evaluation, Quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = {1: BLUE, -1: ORANGE}
_WORDS = {1: "anticlockwise", -1: "clockwise"}
_NOMINAL = 6.0  # divisions: radius of the nominal circle
_REACH = 3.6  # divisions: deviations are drawn no farther from it
_GEOMETRY = ("scale_", "squareness_", "B_E")  # symbols that begin the terms of the geometry
_STEPS = (1.0, 2.0, 5.0)
_WIDE = 5.9  # inches of a panel with its text
_TALL = 6.0  # inches of the polar plot
_LINE = 0.125  # inches of a line of the text
_COLUMN = 36  # characters of a column of it
_ENDS = ((0.0, "+{0}"), (90.0, "+{1}"), (180.0, "−{0}"), (270.0, "−{1}"))


def polar_plot(evaluations: Sequence[Evaluation]) -> Figure:
    """One polar plot for each evaluated plane: paths of all runs, the nominal circle, circles of one division, the minimum
    zone of both.

    Deviations are those about the centre that was chosen. The magnification is that of a deviation against the circle as drawn.

    Args:
        evaluations: As `volid.evaluate` gives them for ISO 230-4.

    Raises:
        InputError: nothing was evaluated from readings, as in a vendor's file.

    >>> import volid
    >>> found = volid.evaluate("iso230-4", "datasets/ball_bar_circles/campaign.toml")
    >>> volid.plot.polar_plot(found[:1]).axes[0].get_legend() is not None
    True
    """
    drawn = [e for e in evaluations if isinstance(e.details, CircularDetails)]
    if not drawn:
        raise InputError("there are no readings to draw: the file holds another program's evaluation alone")
    columns = min(len(drawn), 3)
    rows, texts = -(-len(drawn) // columns), [_text_lines(e) for e in drawn]
    below = _LINE * (max(map(len, texts)) + 1)
    size, heights = (_WIDE * columns, (_TALL + below) * rows), [_TALL, below] * rows
    figure, panels = figure_with_panels(2 * rows, columns, figsize=size, height_ratios=heights, squeeze=False)
    for panel in panels.ravel():
        panel.set_axis_off()
    for i, evaluation in enumerate(drawn):
        row, column = divmod(i, columns)
        _panel(panels[2 * row][column], evaluation)
        where = {"va": "top", "transform": panels[2 * row + 1][column].transAxes}
        panels[2 * row + 1][column].text(0.03, 1.0, "\n".join(texts[i]), family="monospace", fontsize=7, **where)
    return figure


def per_division(largest: float) -> float:
    """µm per division, 1, 2 or 5 times a power of ten, so that deviations up to `largest` [mm] fit.

    >>> per_division(0.012), per_division(0.0004)
    (5.0, 0.2)
    """
    wanted = max(1e3 * largest / _REACH, 1e-3)
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(next(round(s * power, 9) for s in (*_STEPS, 10.0) if s * power >= wanted * (1.0 - 1e-9)))


def _panel(panel: Any, evaluation: Evaluation) -> None:
    details = evaluation.details
    test, deviation = details.test, details.deviation
    step = per_division(float(np.abs(deviation).max()))
    _scale(panel, test.plane, step)
    for sense in test.senses:
        for n, rows in enumerate(r for r in test.runs if test.sense[r[0]] == sense):
            label = f"{_WORDS[sense]} ({test.name(sense)})" if n == 0 else None
            style = "-" if sense > 0 else (0, (5, 1.2))
            panel.plot(
                *_place(test.angle[rows], deviation[rows], step), ls=style, color=COLOURS[sense], lw=1.1, label=label
            )
    _enclosing(panel, details, step)
    magnified = test.radius * 1e3 / _NOMINAL / step
    title = f"{evaluation.subject}: {step:g} µm per division, deviations × {float(f'{magnified:.2g}'):,.0f}"
    feed = f", feed {test.feed:g} mm/min" if test.feed else ""
    panel.set_title(f"{title}\nradius {test.radius:g} mm{feed}, {_source(evaluation)}", fontsize=9, parse_math=False)
    panel.legend(loc="upper left", fontsize=7, frameon=False, borderaxespad=0.0)
    panel.set_aspect("equal")
    reach = _NOMINAL + _REACH + 1.3
    panel.set_xlim(-reach, reach)
    panel.set_ylim(-reach, reach)


def _source(evaluation: Evaluation) -> str:
    name = evaluation.source.replace("\\", "/").rsplit("/", 1)[-1]
    return name if len(name) < 40 else f"{name[:39]}…"


def _place(angle: np.ndarray, deviation: np.ndarray | float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Where deviations [mm] at angles [degrees] are drawn, in divisions."""
    r, phi = _NOMINAL + 1e3 * np.asarray(deviation) / step, np.deg2rad(angle)
    return r * np.cos(phi), r * np.sin(phi)


def _scale(panel: Any, plane: str, step: float) -> None:
    """Circles of one division with their deviations, the nominal one strong; rays of the axes with their names."""
    turn = np.linspace(0.0, 360.0, 361)
    for k in range(-3, 4):
        panel.plot(
            *_place(turn, k * 1e-3, 1.0), color=NEUTRAL if k == 0 else FAINT, lw=1.0 if k == 0 else 0.6, zorder=0
        )
        x, y = (float(c[0]) for c in _place(np.array([-37.0]), k * 1e-3, 1.0))
        label = f"{k * step:+g}".replace("-", "−") if k else "0 µm"
        on_paper = {"ha": "center", "va": "center", "bbox": {"fc": "white", "ec": "none", "pad": 0.6}}
        panel.text(x, y, label, fontsize=6.5, color=NEUTRAL, zorder=1, **on_paper)
    for angle, name in _ENDS:
        inner, outer = (_place(np.array([angle]), k * 1e-3, 1.0) for k in (-3, 3.3))
        panel.plot(*np.hstack([np.stack(inner), np.stack(outer)]), color=FAINT, lw=0.6, zorder=0)
        x, y = (float(c[0]) for c in _place(np.array([angle]), 4.1e-3, 1.0))
        panel.text(x, y, name.format(*plane), ha="center", va="center", fontsize=9)


def _enclosing(panel: Any, details: CircularDetails, step: float) -> None:
    """The two circles of the minimum zone: of both senses, or of the only one."""
    symbol, zone = list(details.zones.items())[-1]
    turn = np.linspace(0.0, 360.0, 361)
    n = np.stack([np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))])
    shift = np.asarray(zone.centre) @ n + _from_drawn_centre(details, n)
    for k, radius in enumerate((zone.inner, zone.inner + zone.width)):
        label = f"minimum zone, {symbol}" if k == 0 else None
        panel.plot(*_place(turn, shift + radius, step), color=GREEN, lw=0.9, ls=":", label=label)


def _from_drawn_centre(details: CircularDetails, n: np.ndarray) -> np.ndarray:
    """Deviations of a circle about the least-squares centre, as drawn about the centre that was chosen."""
    moved = details.deviation - details.circle.deviation
    about_setup = float(np.ptp(moved)) > 1e-9 and details.test.is_calibrated
    return -np.asarray(details.circle.centre) @ n if about_setup else np.zeros(n.shape[1])


def _text_lines(evaluation: Evaluation) -> list[str]:
    """Quantities in two columns, those of the standard and the geometry; below them the spikes."""
    spikes = [q for q in evaluation.quantities if q.symbol.startswith("spike_")]
    rest = [q for q in evaluation.quantities if q not in spikes and not q.symbol.endswith("_ls")]
    first = next((i for i, q in enumerate(rest) if q.symbol.startswith(_GEOMETRY)), len(rest))
    pairs = zip_longest(map(_line, rest[:first]), map(_line, rest[first:]), fillvalue="")
    lines = [f"{left:<{_COLUMN}} {right}" for left, right in pairs]
    return [*lines, "", *_spike_lines(evaluation, spikes)]


def _line(q: Quantity) -> str:
    scale, unit, digits = {"mm": (1e3, "µm", 1), "rad": (1e6, "µrad", 1), "mm/mm": (1e6, "µm/m", 1)}.get(
        q.unit, (1.0, q.unit, 2)
    )
    U = "" if q.U is None else f" ± {scale * q.U:.{digits}f}"
    return f"{q.symbol:<14}{scale * q.value:8.{digits}f}{U:<8} {unit}{f' {q.verdict}' if q.verdict else ''}"


def _spike_lines(evaluation: Evaluation, spikes: Sequence[Quantity]) -> list[str]:
    """Heights of the spikes, a line for each sense, a column for each end of an axis."""
    test = evaluation.details.test
    if not spikes:
        return []
    heights = {q.symbol: 1e3 * q.value for q in spikes}
    ends = [name.format(*test.plane) for _, name in _ENDS]
    lines = [f"{'spikes / µm':<16}" + "".join(f"{end:>8}" for end in ends)]
    for sense in test.senses:
        cells = [heights.get(f"spike_{test.name(sense)}_{angle:.0f}") for angle, _ in _ENDS]
        lines.append(f"{_WORDS[sense]:<16}" + "".join(f"{'' if c is None else f'{c:.1f}':>8}" for c in cells))
    return lines
