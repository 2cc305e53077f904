"""Section "stations" of the page: stations, beams, measured points and tools in space."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from markupsafe import Markup

from volid.exceptions import cut, shown
from volid.report.contents.contents import Contents
from volid.report.contents.names import kind_words
from volid.report.contents.scene import Scene, Stand, scene_of
from volid.report.language import Texts
from volid.report.page.packing import colours, packed
from volid.report.page.section import Section, svg
from volid.report.page.templates import render
from volid.report.plot.panels import NAME_LENGTH, figure_with_panels, shown_vector, signs
from volid.report.plot.scene import draw_scene

WORDS = ("box", "beams", "lines", "tools", "stations", "spheres", "normalised")
COLOURED_TO = 3.0  # |residual| / u: above, one colour


def build(contents: Contents, texts: Texts) -> Section | None:
    """The section, None for a campaign without readings."""
    scene = scene_of(contents.solution, contents.tool)
    if not scene.n_points:
        return None
    shown = sum(len(p.places) for p in scene.points)
    body = render(
        "stations.html", texts, scene=scene, tool=shown_vector(contents.tool, texts), drawn=_drawing(scene, texts),
        shown=shown, elsewhere=_elsewhere(scene, texts),
    )  # fmt: skip
    return Section("stations", texts("page.section_stations"), body, _data(scene, texts))


def _elsewhere(scene: Scene, texts: Texts) -> list[str]:
    """Stations that do not stand on the workpiece, in words."""
    return [_said(s, texts) for s in scene.stations if s.body != "workpiece"]


def _said(stand: Stand, texts: Texts) -> str:
    x, y, z = (signs(f"{v:.1f}", texts) for v in stand.place)
    joint = "; " if texts.language == "de" else ", "
    return texts("field.stand", name=cut(stand.name), body=stand.body, place=f"X {x}{joint}Y {y}{joint}Z {z}")


def _drawing(scene: Scene, texts: Texts) -> Markup:
    figure, panel = figure_with_panels(figsize=(4.6, 4.0))
    draw_scene(panel, scene, texts)
    return svg(figure, texts("page.section_stations"))


def _plain(text: str) -> str:
    """A name for a drawing in 3-D, whose texts may hold tags: none of its own are obeyed."""
    return shown(text).replace("<", "‹")


def _stands(stands: Iterable[Stand], texts: Texts) -> list[dict[str, Any]]:
    return [
        {
            "name": _plain(cut(s.name, NAME_LENGTH)),
            "place": np.round(s.place, 2).tolist(),
            "words": _plain(_said(s, texts)),
        }
        for s in stands
    ]


def _data(scene: Scene, texts: Texts) -> dict[str, Any]:
    """Everything that the script draws."""
    everything = np.concatenate(
        [scene.box, *(p.places for p in scene.points), *(s.place[None] for s in (*scene.stations, *scene.spheres))]
    )
    room = 0.03 * float(np.ptp(everything, axis=0).max())
    low, high = everything.min(axis=0) - room, everything.max(axis=0) + room
    return {
        "box": packed(scene.box),
        "points": [
            {
                "name": f"{_plain(cut(p.name, NAME_LENGTH))} ({kind_words(p.kind, texts)})",
                "places": packed(p.places),
                "normalised": packed(p.normalised),
            }
            for p in scene.points
        ],
        "stations": _stands(scene.stations, texts),
        "spheres": _stands(scene.spheres, texts),
        "beams": [
            {"from": np.round(s.place, 2).tolist(), "to": packed(scene.beams[s.name])}
            for s in scene.stations
            if s.name in scene.beams
        ],
        "lines": [packed(line) for line in scene.lines],
        "tools": [packed(tool) for tool in scene.tools],
        "ranges": np.round(np.stack([low, high], axis=1), 3).tolist(),
        "most": COLOURED_TO,
        "colours": colours(),
        "words": {key: texts(f"field.{key}") for key in WORDS},
        "axes": ["X / mm", "Y / mm", "Z / mm"],
    }
