"""The measuring geometry in three views to one scale: stations, beams, measured points and the working volume."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from volid.exceptions import cut
from volid.fitting.solution import Solution
from volid.report.contents.geometry import MeasuringGeometry, Stand, geometry_of
from volid.report.language import ENGLISH, Texts
from volid.report.plot.asked import Asked
from volid.report.plot.dots import finished, halo, near_each_other, quiet
from volid.report.plot.palette import ATTENTION, BLACK, NEUTRAL, PAPER, SERIES
from volid.report.plot.panels import NAME_LENGTH, figure_with_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BEAMS = 30  # of a station that are drawn
POINTS = 3000  # measured points that are drawn
PIXELS = 300  # points from which on they are a picture within the figure
WIDTH = 9.0  # inch, of the figure
ROOM = 0.08  # of the extent, around everything
NEAR = 0.03  # of the extent: stations nearer to each other in a view share one text
LETTERS = "XYZ"


class View(NamedTuple):
    """A view: numbers of the coordinates to the right and up, and the key of its name."""

    right: int
    up: int
    name: str


TOP, FRONT, SIDE = View(0, 1, "top"), View(0, 2, "front"), View(1, 2, "side")


def draw(asked: Asked) -> Figure:
    """The figure of a solution."""
    return station_geometry(asked.solution, asked.texts)


def station_geometry(solution: Solution, texts: Texts = ENGLISH) -> Figure:
    """Stations, some of their beams, measured points and the working volume in three views to one scale [mm].

    Args:
        solution: A solution, as `volid.fit` makes it.
        texts: The language.

    Everything is nominal, in the frame of the body that `geometry_of` chooses and the title names. Stations stand where the fit
    found them. A campaign without stations shows its measured points and what stands on the workpiece.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
    >>> [panel.get_ylabel() for panel in volid.plot.station_geometry(solution).axes[:3]]
    ['Z / mm', 'Z / mm', 'Y / mm']
    """
    geometry = geometry_of(solution)
    low, high = extent_of(geometry)
    x, y, z = high - low
    scale = (WIDTH - 1.8) / (x + y)
    size = {"width_ratios": (x, y), "height_ratios": (z, y)}
    figure, panels = figure_with_panels(2, 2, figsize=(WIDTH, scale * (z + y) + 2.0), **size)
    for panel, view in ((panels[0][0], FRONT), (panels[0][1], SIDE), (panels[1][0], TOP)):
        view_panel(panel, geometry, view, texts)
    panels[1][1].set_axis_off()
    handles, labels = panels[0][0].get_legend_handles_labels()
    panels[1][1].legend(handles, labels, fontsize=8, frameon=False, loc="center left")
    figure.suptitle(f"{cut(solution.machine.name)}\n{title_of(geometry, texts)}", fontsize=9)
    finished(figure, texts)
    return figure


def title_of(geometry: MeasuringGeometry, texts: Texts) -> str:
    """In whose frame everything is drawn, and who is left out."""
    body = (
        texts(f"stations.{geometry.body}")
        if geometry.body in ("workpiece", "bed")
        else texts("stations.axis", axis=geometry.body)
    )
    text = texts("stations.title", body=body)
    if not geometry.left_out:
        return text
    names = ", ".join(cut(name, NAME_LENGTH) for name in geometry.left_out)
    return f"{text}\n{texts('stations.left_out', names=names)}"


def extent_of(geometry: MeasuringGeometry) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates of everything, with room around it, each (3,) [mm]."""
    places = [s.place[None] for s in (*geometry.stations, *geometry.spheres)]
    everything = np.concatenate([geometry.points, geometry.corners, *places])
    low, high = everything.min(axis=0), everything.max(axis=0)
    room = ROOM * float((high - low).max())
    return low - room, high + room


def view_panel(panel: Any, geometry: MeasuringGeometry, view: View, texts: Texts) -> None:
    """One view of the geometry; both directions to one scale."""
    pair = [view.right, view.up]
    low, high = extent_of(geometry)
    _volume(panel, geometry, pair, texts)
    for i, station in enumerate(geometry.stations):
        _beams(panel, station, pair, SERIES[i % len(SERIES)], texts("stations.beams") if not i else None)
    points = geometry.points[:: max(-(-len(geometry.points) // POINTS), 1)]
    style = {
        "color": NEUTRAL,
        "ms": 4.5 if len(points) < PIXELS else 2.5,
        "mew": 0,
        "rasterized": len(points) > PIXELS,
        "zorder": 2,
        "gid": "points",
    }
    panel.plot(*points[:, pair].T, ".", ls="none", label=texts("stations.points"), **style)
    _stands(panel, geometry.stations, pair, ("^", BLACK), texts("stations.stations"))
    _stands(panel, geometry.spheres, pair, ("o", ATTENTION), texts("stations.spheres"))
    _names(panel, (*geometry.stations, *geometry.spheres), pair, float((high - low).max()))
    panel.set_xlim(low[view.right], high[view.right])
    panel.set_ylim(low[view.up], high[view.up])
    panel.set_aspect("equal")
    panel.set_xlabel(f"{LETTERS[view.right]} / mm", fontsize=8)
    panel.set_ylabel(f"{LETTERS[view.up]} / mm", fontsize=8)
    panel.set_title(texts(f"stations.{view.name}"), fontsize=8, loc="left")
    quiet(panel)


def _volume(panel: Any, geometry: MeasuringGeometry, pair: list[int], texts: Texts) -> None:
    (left, below), (right, above) = geometry.corners.min(axis=0)[pair], geometry.corners.max(axis=0)[pair]
    x, y = [left, right, right, left, left], [below, below, above, above, below]
    panel.plot(x, y, color=BLACK, lw=1.0, ls="--", label=texts("stations.volume"), zorder=1, gid="volume")


def _beams(panel: Any, station: Stand, pair: list[int], colour: str, label: str | None) -> None:
    """Some of a station's beams, evenly through its readings, as one line with gaps."""
    targets = station.targets[:: max(-(-len(station.targets) // BEAMS), 1)]
    gaps = np.full((len(targets), 3), np.nan)
    ends = np.stack([np.broadcast_to(station.place, targets.shape), targets, gaps], axis=1).reshape(-1, 3)
    if len(targets):
        panel.plot(*ends[:, pair].T, color=colour, lw=0.4, alpha=0.6, label=label, zorder=1, gid="beams")


def _stands(panel: Any, stands: tuple[Stand, ...], pair: list[int], look: tuple[str, str], label: str) -> None:
    if stands:
        places = np.array([s.place for s in stands])[:, pair]
        marker, colour = look
        style = {"ls": "none", "ms": 6.5, "color": colour, "mec": PAPER, "mew": 0.6, "zorder": 4, "gid": "stands"}
        panel.plot(*places.T, marker, label=label, **style)


def _names(panel: Any, stands: tuple[Stand, ...], pair: list[int], size: float) -> None:
    """Names beside their places; those that coincide in a view share one text."""
    if not stands:
        return
    places = np.array([s.place for s in stands])[:, pair]
    for members in near_each_other(places / size, NEAR):
        text, at = ", ".join(cut(stands[i].name, NAME_LENGTH) for i in members), places[members[0]]
        style = {"fontsize": 8, "ha": "left", "va": "bottom", "zorder": 5, "path_effects": halo()}
        panel.annotate(text, at, (4, 3), textcoords="offset points", **style)
