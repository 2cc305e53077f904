"""Stations, beams, measured points and the working volume of a campaign, drawn on paper."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.exceptions import cut
from volid.fitting.solution import Solution
from volid.report.contents.names import kind_words
from volid.report.contents.scene import Scene, scene_of
from volid.report.language import ENGLISH, Texts
from volid.report.plot.isometric import draw_box, prepare, projected, range_words
from volid.report.plot.palette import BLACK, FAINT, NEUTRAL, SERIES
from volid.report.plot.panels import NAME_LENGTH, figure_with_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARKERS = (".", "x", "+", "1", "2", "3", "4")
LETTERS = 12.5  # of the legend, beside each other in an inch
NO_BREAK = "\u00a0"
FEW = 350  # points of a set in a drawing


def campaign_view(solution: Solution, tool: Sequence[float] | None = None, *, texts: Texts = ENGLISH) -> Figure:
    """Stations, beams, measured points, spheres, lines and tool vectors around the working volume, in parallel projection.

    Args:
        solution: A solution, as `volid.fit` makes it.
        tool: Tool vector that the working volume is drawn for, shape (3,) [mm]; None: the most used one.
        texts: The language.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> campaign_view(solution).axes[0].get_legend() is not None
    True
    """
    scene = scene_of(solution, solution.most_used_tool() if tool is None else tool)
    figure, panel = figure_with_panels(figsize=(7.2, 5.4))
    draw_scene(panel, scene, texts)
    panel.set_title(
        "\n".join(wrap(f"{cut(solution.machine.name)}: {cut(solution.campaign.title)}", 90)), fontsize=9, loc="left"
    )
    return figure


def draw_scene(panel: Any, scene: Scene, texts: Texts = ENGLISH) -> None:
    """Draw everything of a scene into a panel, with one legend below it."""
    stands = [s.place for s in (*scene.stations, *scene.spheres)]
    points = [p.places for p in scene.points]
    prepare(panel, np.concatenate([scene.box, *points, *(s[None] for s in stands), *scene.tools]))
    low, high = scene.box.min(axis=0), scene.box.max(axis=0)
    draw_box(panel, low, high, None)
    for station in scene.stations:
        for target in scene.beams.get(station.name, np.zeros((0, 3)))[::3]:
            panel.plot(*projected(np.array([station.place, target])).T, color=FAINT, lw=0.6, zorder=0)
    for line in scene.lines:
        panel.plot(*projected(line).T, color=NEUTRAL, lw=0.9, zorder=1)
    names = [f"{cut(p.name, NAME_LENGTH)} ({kind_words(p.kind, texts)})" for p in scene.points]
    names = (
        names if len(names) <= len(SERIES) else [kind_words(p.kind, texts) for p in scene.points]
    )  # too many to be told apart
    order = list(dict.fromkeys(names))
    for name, p in zip(names, scene.points, strict=True):
        i = order.index(name)
        shown = projected(p.places[:: max(1, len(p.places) // FEW)])
        marker, colour = MARKERS[i % len(MARKERS)], SERIES[i % len(SERIES)]
        panel.plot(*shown.T, marker, ms=3.5, color=colour, label=name, zorder=2)
    for i, tool in enumerate(scene.tools):
        label = texts("field.tools") if i == 0 else None
        panel.plot(*projected(tool).T, "-", color=BLACK, lw=2.5, label=label, zorder=3)
    _draw_stands(panel, scene, texts)
    ranges = [range_words(name, a, b, texts) for name, a, b in zip("XYZ", low, high, strict=True)]
    letters = int(LETTERS * panel.figure.get_figwidth())
    volume = "\n".join(wrap(f"{texts('field.box')}: {', '.join(r.replace(' ', NO_BREAK) for r in ranges)}", letters))
    handles, labels = panel.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    columns = min(3, max(1, letters // (max(map(len, once), default=0) + 8)))
    panel.legend(
        once.values(), once.keys(), title=volume, title_fontsize=8, fontsize=8, frameon=False,
        loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=columns,
    )  # fmt: skip


def _draw_stands(panel: Any, scene: Scene, texts: Texts) -> None:
    for stands, marker, key in ((scene.stations, "^", "field.stations"), (scene.spheres, "o", "field.spheres")):
        for i, stand in enumerate(stands):
            x, y = projected(stand.place)
            label = texts(key) if i == 0 else None
            panel.plot(x, y, marker, ms=7, mfc="none", mec=BLACK, mew=1.3, ls="none", label=label, zorder=4)
            panel.annotate(
                cut(stand.name, NAME_LENGTH), (x, y), xytext=(6, 4), textcoords="offset points", fontsize=8, zorder=5
            )
