"""A picture of an error motion in characters, for a terminal: the function over its travel, and value ± U (k = 2) as dots.

Drawn with plotext; without colours, so that it can be read in grey, sent by mail and kept in a log.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from volid.fitting.results import FunctionValue
from volid.fitting.solution import Solution
from volid.fitting.tabulation import points_with_waves
from volid.model.iso230 import describe, parse
from volid.report.text.basics import scale_of

K = 2.0
POINTS, NARROW, WIDE, HEIGHT = 121, 40, 120, 18
LINE, BAND, UP, DOWN, ASCII_LINE, ASCII_BAND = "braille", "·", "+", "o", "*", "."
_PLAIN: dict[int, str | int | None] = {**str.maketrans("┌┐└┘├┤┬┴┼─│µ·", "++++||++|-|u."), ord("°"): "deg"}
_TICKS = 6


def picture(solution: Solution, name: str, width: int = 100, plain: bool = False) -> list[str]:
    """The lines of a picture of an error motion, without spaces at their ends.

    Args:
        solution: A solution, as `volid.fit` makes it.
        name: ISO 230-1 symbol of an error motion in the model, such as "EXX".
        width: Of the picture, in characters; taken as 40 to 120, and not above that of the terminal.
        plain: Whether it has characters of ASCII alone.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> print(picture(solution, "EXX", width=60, plain=True)[0])
    EXX positioning of X [um], + o approached in + and -, . value +/- U (k = 2)
    """
    axis = solution.machine.axis(parse(name).axis)
    rows = solution.motion(name, np.linspace(*axis.travel, points_with_waves(solution, name, POINTS)))
    known = [row for row in rows if np.isfinite(row.value)]
    unit = parse(name).report_unit
    both = any(row.direction for row in rows)
    key = f"{UP} {DOWN} approached in + and -, " if both else ""
    head = f"{name} {describe(name)} [{unit}], {key}{BAND} value {'+/-' if plain else '±'} U (k = 2)"
    if len(known) <= 1:  # the reference alone, where every function is 0
        lines = [f"{name} {describe(name)}: not determined by the data"]
    else:
        lines = [head, *_drawn(known, max(NARROW, min(width, WIDE)), f"{axis.letter} / {axis.unit}", plain)]
    return [line.translate(_PLAIN) for line in lines] if plain else lines


def _drawn(rows: Sequence[FunctionValue], width: int, label: str, plain: bool) -> list[str]:
    import plotext

    figure = plotext.figure
    figure.clear()
    figure.plot_size(width, HEIGHT)
    figure.label(label, "x")
    scale = scale_of(parse(rows[0].name).unit)
    _ticks(figure, "x", [row.position for row in rows])
    _ticks(figure, "y", [scale * (row.value + sign * K * row.u) for row in rows for sign in (-1.0, 1.0)])
    for direction in dict.fromkeys(row.direction for row in rows):
        own = [row for row in rows if row.direction == direction]
        x, value, u = (np.array([getattr(row, key) for row in own]) for key in ("position", "value", "u"))
        for sign in (-1.0, 1.0):
            band = scale * (value + sign * K * u)
            figure.draw(figure.signal(x.tolist(), band.tolist(), marker=ASCII_BAND if plain else BAND))
        line = figure.signal(x.tolist(), (scale * value).tolist(), marker=_marker(direction, plain))
        figure.draw(line.lines() if not direction else line)
    text = plotext.uncolorize(figure.build().string())
    figure.clear()
    return [line.rstrip() for line in str(text).splitlines() if line.strip()]


def _ticks(figure: Any, axis: str, values: Sequence[float]) -> None:
    """Round numbers along an axis, which reaches from the smallest to the largest value."""
    from matplotlib.ticker import MaxNLocator

    low, high = min(values), max(values)
    low, high = (low, high) if high > low else (low - 1.0, high + 1.0)
    ticks = [float(t) for t in MaxNLocator(_TICKS).tick_values(low, high) if low <= t <= high]
    ruler = figure.ruler(axis)
    ruler.lim(low, high)
    ruler.ticks(ticks, [f"{t:g}" for t in ticks])


def _marker(direction: int, plain: bool) -> str:
    return {1: UP, -1: DOWN}.get(direction, ASCII_LINE if plain else LINE)
