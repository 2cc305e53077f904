"""Error motions over their travels, with bands of U. Lengths in µm, rotations in µrad, positions in mm or degrees."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.exceptions import cut
from volid.fitting.solution import Solution
from volid.model.iso230 import DIRECTIONS, parse
from volid.model.machine import Axis
from volid.report.language import ENGLISH, Texts
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.curves import (
    Curve,
    K,
    cross_effect,
    curves,
    limits,
    missing,
    other_axis,
    scale_of,
    shown_axes,
)
from volid.report.plot.palette import BLACK, BLUE, FAINT, GREEN, NEUTRAL, ORANGE, SIGNED
from volid.report.plot.panels import figure_with_panels, heading, in_language, level_lines, note_below, signs
from volid.report.symbols import in_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WAYS = {0: (BLACK, "-"), 1: (BLUE, "-"), -1: (ORANGE, (0, (4, 1.5)))}  # colour and style by direction of approach
SHADE = 0.22
WIDTH, HEIGHT = 3.5, 1.75  # inches of a panel


def error_functions(
    solution: Solution,
    truth: Mapping[str, Callable[[np.ndarray], np.ndarray]] | None = None,
    axes: str = "XYZ",
    *,
    own_scales: bool = False,
    texts: Texts = ENGLISH,
) -> Figure:
    """All error motions of `axes` over their positions with bands of ± U (k = 2), one column for each axis.

    Functions with reversal have two lines, + and −. All translations share one scale, and so do all rotations. Functions that are
    not in the model, or not determined, are named below. A cross effect is shown at the other axis's reference (`cross_effects`
    draws all of it).

    Args:
        solution: The solution.
        truth: Known functions by symbol, position [mm or degrees] -> mm or rad.
        axes: Letters; those the machine lacks, or the model has no error motions of, do not count.
        own_scales: Whether each panel has its own scale instead.
        texts: The language.

    Raises:
        NothingToDrawError: none of `axes` has error motions.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> [panel.get_title(loc="left") for panel in error_functions(solution).axes if panel.lines]
    ['EXX: positioning of X', 'EZZ: positioning of Z']
    """
    shown = shown_axes(solution, axes)
    found = curves(solution, shown)
    if not found:
        raise NothingToDrawError("the model has no error motions of these axes")
    drawn = [c for c in found.values() if c.known > 0.0]
    placed = _placed(drawn, shown)
    rows, columns = len(placed[0]), len(placed)
    size = (max(WIDTH * columns, 6.0) + 0.4, HEIGHT * rows + 1.4)
    figure, panels = figure_with_panels(rows, columns, figsize=size, squeeze=False, sharex="col")
    ends = {} if own_scales else limits(drawn)
    for own, column in zip(placed, panels.T, strict=True):
        _column(column, own, ends, truth or {}, texts)
    if not own_scales:
        _first_of_row(panels)
    title = texts("functions.title", machine=cut(solution.machine.name))
    heading(figure, title, *legend_of_ways(figure.axes, texts))
    scales = texts("functions.own_scales" if own_scales else "functions.same_scales")
    note_below(figure, [scales, *remarks(found, shown, texts)])
    return figure


def _placed(drawn: Sequence[Curve], shown: Sequence[Axis]) -> list[list[Curve | None]]:
    """For each axis its functions from top to bottom, rotations below translations, rows that all lack left out.

    Functions of one direction stand beside each other; where most places were empty, those of each axis close up.
    """
    by_place = {(parse(c.name).direction, c.axis.letter): c for c in drawn}
    columns: list[list[Curve | None]] = [[] for _ in shown]
    for half in (DIRECTIONS[:3], DIRECTIONS[3:]):
        full = [[by_place.get((d, axis.letter)) for d in half] for axis in shown]
        rows = [i for i in range(3) if any(column[i] for column in full)]
        close = [[c for c in column if c is not None] for column in full]
        tallest = max(map(len, close))
        packed = 2 * sum(map(len, close)) <= len(rows) * len(shown)
        for column, own, tight in zip(columns, full, close, strict=True):
            column += [*tight, *[None] * (tallest - len(tight))] if packed else [own[i] for i in rows]
    return columns if columns[0] else [[None] for _ in shown]


def draw_function(
    panel: Any, shown: Curve, texts: Texts = ENGLISH, ends: Mapping[str, tuple[float, float]] | None = None
) -> None:
    """One error motion in a panel: bands of ± U, lines by direction of approach, and a line at zero.

    Args:
        panel: Axes of matplotlib.
        shown: The function, as `volid.report.plot.curves.curve` gives it.
        texts: The language.
        ends: Ends of the scale by unit, as `limits` gives them; None: the panel's own.
    """
    panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
    for way in shown.ways:
        colour, style = WAYS[way.direction]
        panel.fill_between(
            shown.positions, way.values - K * way.u, way.values + K * way.u, color=colour, alpha=SHADE, lw=0
        )
        label = texts("functions." + {0: "value", 1: "approached_up", -1: "approached_down"}[way.direction])
        panel.plot(shown.positions, way.values, color=colour, ls=style, lw=1.3, label=label)
    panel.set_title(f"{shown.name}: {in_words(shown.name, texts)}", fontsize=8, loc="left", color=NEUTRAL)
    panel.set_xlim(*ends_of(shown.axis))
    panel.set_ylim(*(ends or limits([shown]))[shown.unit])
    panel.tick_params(labelsize=8)
    in_language(panel.xaxis, texts)
    in_language(panel.yaxis, texts)


def ends_of(axis: Axis) -> tuple[float, float]:
    """Travel of an axis with a little room."""
    room = 0.02 * axis.length
    return axis.travel[0] - room, axis.travel[1] + room


def _column(
    panels: Sequence[Any], own: Sequence[Curve | None], ends: Mapping[str, Any], truth: Mapping[str, Any], texts: Texts
) -> None:
    """The functions of an axis below each other; the lowest one names the axis."""
    last = None
    for panel, c in zip(panels, own, strict=True):
        if c is None:
            panel.set_axis_off()
            continue
        draw_function(panel, c, texts, ends)
        panel.set_ylabel(c.unit, fontsize=8)
        if c.name in truth:
            true = scale_of(c.name) * truth[c.name](c.positions)
            panel.plot(c.positions, true, color=GREEN, lw=1.6, ls=":", label=texts("functions.truth"))
        last = panel, c
    if last is not None:
        panel, c = last
        panel.tick_params(labelbottom=True)
        panel.set_xlabel(f"{c.axis.letter} / {c.axis.unit}", fontsize=8)


def _first_of_row(panels: Any) -> None:
    """With one scale, numbers and units stand at the first panel of a row alone."""
    for row in panels:
        for panel in [p for p in row if p.axison][1:]:
            panel.tick_params(labelleft=False)
            panel.set_ylabel("")


def legend_of_ways(panels: Iterable[Any], texts: Texts) -> tuple[list[Any], list[str]]:
    """What the legend of many panels says, each line once, with the band of U: handles and labels."""
    from matplotlib.patches import Patch

    labelled = {label: h for p in panels for h, label in zip(*p.get_legend_handles_labels(), strict=True)}
    band = Patch(color=BLACK, alpha=SHADE, lw=0)
    return [*labelled.values(), band], [*labelled, texts("functions.band")]


def remarks(found: Mapping[str, Curve], shown: Sequence[Axis], texts: Texts) -> list[str]:
    """What the panels do not show, each said once: functions that are not in the model, not determined, or of two axes."""
    lines = []
    unknown = [c.name for c in found.values() if c.known == 0.0]
    unknown += [texts("functions.partly", name=c.name) for c in found.values() if 0.0 < c.known < 1.0]
    for key, names in (("not_determined", unknown), ("not_in_model", missing(shown, found))):
        if names:
            lines.append(texts(f"functions.{key}", names=", ".join(names)))
    for c in found.values():
        if c.beside is not None:
            words = {"name": c.name, "axis": c.beside.letter, "at": signs(f"{c.at:g}", texts), "unit": c.beside.unit}
            lines.append(texts("functions.at_reference", **words))
    return lines


def cross_effects(solution: Solution, *, texts: Texts = ENGLISH) -> Figure:
    """The error motions that depend on two axes as maps over both: translations with one scale, rotations with another.

    Args:
        solution: The solution.
        texts: The language.

    Raises:
        NothingToDrawError: the model has none.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> volid.plot.cross_effects(solution)
    Traceback (most recent call last):
    volid.report.plot.asked.NothingToDrawError: no error motion of the model depends on two axes
    """
    names = cross_names(solution)
    if not names:
        raise NothingToDrawError("no error motion of the model depends on two axes")
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    figure, panels = figure_with_panels(rows, columns, figsize=(4.2 * columns + 0.8, 3.4 * rows + 0.6), squeeze=False)
    maps = {name: cross_effect(solution, name) for name in names}
    for panel, name in zip(panels.ravel(), names, strict=False):
        alike = [maps[n][2] for n in names if parse(n).is_rotation == parse(name).is_rotation]
        areas = draw_cross_effect(panel, solution, name, maps[name], largest_of(alike), texts)
        figure.colorbar(areas, ax=panel, label=parse(name).report_unit)
    for panel in panels.ravel()[len(names) :]:
        panel.set_axis_off()
    heading(figure, texts("functions.cross_title", machine=cut(solution.machine.name)))
    return figure


def largest_of(fields: Iterable[np.ndarray]) -> float:
    """Largest size in some fields, 1 where all are 0 or unknown."""
    return max((float(np.nanmax(np.abs(f))) for f in fields if np.isfinite(f).any()), default=0.0) or 1.0


def cross_names(solution: Solution) -> list[str]:
    """Symbols of the error motions of two axes."""
    names = [name for name, part in solution.model.by_name if part == "mean"]
    return [name for name in names if other_axis(solution, name) is not None]


def draw_cross_effect(
    panel: Any, solution: Solution, name: str, field: tuple[np.ndarray, ...], largest: float, texts: Texts = ENGLISH
) -> Any:
    """A map of an error motion over its two axes in a panel, with lines of equal value, dashed where they are negative.

    Args:
        panel: Axes of matplotlib.
        solution: The solution.
        name: ISO 230-1 symbol.
        field: As `cross_effect` gives it.
        largest: End of the scale of both signs [µm or µrad].
        texts: The language.

    Returns the areas, for a colour bar.
    """
    x, y, values = field
    areas = level_lines(panel, x, y, values.T, largest, SIGNED)
    own, other = solution.machine.axis(parse(name).axis), other_axis(solution, name)
    panel.set_title(f"{name}: {in_words(name, texts)}", fontsize=8, loc="left", color=NEUTRAL)
    panel.set_xlabel(f"{own.letter} / {own.unit}", fontsize=8)
    if other is not None:
        panel.set_ylabel(f"{other.letter} / {other.unit}", fontsize=8)
    panel.tick_params(labelsize=8)
    in_language(panel.xaxis, texts)
    in_language(panel.yaxis, texts)
    return areas


def draw(asked: Asked) -> dict[str, Figure]:
    """For the collection of figures: the linear axes, the rotary axes, and what depends on two axes."""
    solution, texts = asked.solution, asked.texts
    found = {}
    for end, letters in (("", "XYZ"), ("rotary", "ABC")):
        if shown_axes(solution, letters):
            found[end] = error_functions(solution, axes=letters, own_scales=asked.own_scales, texts=texts)
    if cross_names(solution):
        found["cross_effects"] = cross_effects(solution, texts=texts)
    if not found:
        raise NothingToDrawError("the model has no error motions")
    return found
