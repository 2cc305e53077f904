"""Many values as dots: none of the largest is lost, what lies beyond the frame is marked at its edge, the worst are numbered."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from volid.report.language import Texts
from volid.report.plot.palette import ATTENTION, FAINT, NEUTRAL, PAPER, SERIES
from volid.report.plot.panels import as_written, in_language

MOST = 5000  # dots of a panel
LARGEST = 0.25  # share of them that is kept for the largest
PIXELS = 300  # dots from which on they are drawn as a picture within the figure: one of 100,000 stays small
RESOLUTION = 170  # dots per inch of that picture
LEAST, ROOM = 4.0, 8.0  # the frame, in normalised residuals: at least, and in robust standard deviations at most
NEAR = 0.06  # of the frame: numbers of the worst that lie nearer to each other are written as one


class Marked(NamedTuple):
    """Values to be drawn: `values` (n,), `places` (n,) along the other direction, `numbered`: indices of the worst, in order.

    `struck` (n,): those set aside; `idle` (n,): those that say nothing, because no other reading checks them.
    """

    places: np.ndarray
    values: np.ndarray
    struck: np.ndarray
    idle: np.ndarray
    numbered: np.ndarray


def thinned(values: np.ndarray, most: int = MOST) -> np.ndarray:
    """Indices of at most `most` values, in ascending order: the largest by amount, and of the others every so many.

    >>> thinned(np.array([0.0, 1.0, 0.0, 0.0, -9.0, 0.0, 0.0, 0.0]), most=4).tolist()
    [0, 3, 4, 7]
    """
    n = len(values)
    if n <= most:
        return np.arange(n)
    largest = np.argsort(-np.abs(values), kind="stable")[: max(int(LARGEST * most), 1)]
    others = np.setdiff1d(np.arange(n), largest)
    every = np.linspace(0, len(others) - 1, most - len(largest)).round().astype(int)
    return np.sort(np.concatenate([largest, others[every]]))


def frame_of(values: np.ndarray) -> float:
    """Half width of a frame that shows nearly all values: a single gross one must not press the others flat."""
    sizes = np.abs(values[np.isfinite(values)])
    if not sizes.size:
        return LEAST
    robust = 1.4826 * float(np.median(sizes))
    return float(max(LEAST, min(1.1 * sizes.max(), ROOM * robust)))


def draw_dots(panel: Any, marked: Marked, frame: float, lying: bool = False, colour: str = SERIES[0]) -> None:
    """Dots of values over their places; `lying`: the values along the horizontal axis.

    Args:
        panel: Axes of matplotlib.
        marked: What is drawn.
        frame: Half width of the frame of the values.
        lying: Whether values are along the horizontal axis.
        colour: Of ordinary dots.
    """
    inside = np.abs(marked.values) <= frame
    ordinary = inside & ~marked.struck & ~marked.idle
    size = 5.0 if ordinary.sum() < PIXELS else 3.4
    picture = {"rasterized": bool(ordinary.sum() > PIXELS)}
    _points(panel, marked, ordinary, lying, marker=".", ms=size, color=colour, mew=0, gid="readings", **picture)
    _points(
        panel, marked, inside & marked.idle, lying, marker="o", ms=2.5, mfc="none", mec=NEUTRAL, mew=0.5, gid="idle"
    )
    _points(panel, marked, inside & marked.struck, lying, marker="x", ms=4.5, mec=ATTENTION, mew=1.1, gid="set aside")
    for sign, marker in ((1, ">" if lying else "^"), (-1, "<" if lying else "v")):
        beyond = ~inside & (np.sign(marked.values) == sign)
        at_edge = marked._replace(values=np.full(len(marked.values), 0.97 * sign * frame))
        edge = {"marker": marker, "ms": 4.5, "mec": ATTENTION, "mew": 0.7, "gid": "beyond"}
        _points(panel, at_edge, beyond & ~marked.struck, lying, mfc=ATTENTION, **edge)
        _points(panel, at_edge, beyond & marked.struck, lying, mfc="none", **edge)
    _number(panel, marked, frame, lying)


def _points(panel: Any, marked: Marked, chosen: np.ndarray, lying: bool, **style: Any) -> None:
    if chosen.any():
        pair = (marked.values[chosen], marked.places[chosen])
        panel.plot(*(pair if lying else pair[::-1]), ls="none", zorder=3, **style)


def _number(panel: Any, marked: Marked, frame: float, lying: bool) -> None:
    """The worst, numbered from 1 in their order: those near to each other share one text."""
    if not len(marked.numbered):
        return
    width = max(float(np.ptp(marked.places)), 1e-12)
    values = np.clip(marked.values[marked.numbered], -0.97 * frame, 0.97 * frame)
    at = np.stack([marked.places[marked.numbered] / width, values / (2.0 * frame)], axis=1)
    for members in near_each_other(at):
        text = ", ".join(str(k + 1) for k in members)
        place, value = marked.places[marked.numbered[members[0]]], float(values[members[0]])
        xy = (value, place) if lying else (place, value)
        side, ahead = ("right", -5) if lying and value > 0.0 else ("left", 5)
        style = {"fontsize": 7, "ha": side, "va": "center", "zorder": 4, "gid": "worst"}
        panel.annotate(text, xy, (ahead, 0), textcoords="offset points", **style)


def near_each_other(at: np.ndarray, near: float = NEAR) -> list[list[int]]:
    """Indices of places (m, 2) in groups: each joins the first group whose first member is nearer than `near`."""
    groups: list[list[int]] = []
    for i in range(len(at)):
        home = next((g for g in groups if np.abs(at[i] - at[g[0]]).max() < near), None)
        if home is None:
            groups.append([i])
        else:
            home.append(i)
    return groups


def finished(figure: Any, texts: Texts) -> None:
    """Every text of a figure as it is written, because it may hold names from files: a dollar sign begins no formula; and the
    numbers of all its axes in the signs of a language."""
    from matplotlib.text import Text

    as_written(figure.findobj(Text))
    for panel in figure.axes:
        in_language(panel.xaxis, texts)
        in_language(panel.yaxis, texts)


def halo() -> list[Any]:
    """What makes a text readable on lines and points: a white seam around its letters, for `path_effects`."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.0, foreground=PAPER)]


def quiet(panel: Any) -> None:
    """A panel with small letters and without frame at the top and the right."""
    panel.tick_params(labelsize=7)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)


def expected_lines(panel: Any, critical: float, frame: float, lying: bool = False) -> None:
    """Zero, ± 2, between which 95 % of good residuals lie, and the critical value, where it is within the frame."""
    line = panel.axvline if lying else panel.axhline
    line(0.0, color=FAINT, lw=0.8, zorder=1)
    for sign in (-1.0, 1.0):
        line(sign * 2.0, color=NEUTRAL, lw=0.6, ls=":", zorder=2)
        if critical < frame:
            line(sign * critical, color=ATTENTION, lw=0.8, ls="--", zorder=2, gid="critical")
