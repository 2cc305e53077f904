"""The deviation field on plane sections of the working volume."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.exceptions import cut
from volid.fitting.solution import Solution
from volid.model.iso230 import LINEAR_AXES
from volid.model.machine import Axis
from volid.report.language import ENGLISH, Texts
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.palette import BLACK, NEUTRAL, SIZES
from volid.report.plot.panels import (
    figure_with_places,
    heading,
    in_language,
    level_lines,
    note_below,
    shown_vector,
    signs,
)
from volid.report.text.basics import vector

if TYPE_CHECKING:
    from jaxtyping import Float
    from matplotlib.figure import Figure

MESHES, FINE = 8, 6  # meshes along an axis, and steps of a mesh
LONGER = 5.0  # inches of the longest axis of a section
SHARE = 0.9  # of a mesh, which the largest deviation spans
STRENGTH = 0.6  # of the colours, on which the grids must be seen
EDGES = (0.75, 1.1, 0.95, 0.85)  # inches at the left, below, between panels and above


@dataclass(frozen=True, eq=False)
class Section:
    """The deviation on a plane of two linear axes, all others standing still.

    Args:
        axes: Letters of the axes, across and up.
        at: Where the others stand, by letter [mm or degrees].
        across, up: Commanded positions, shape (n, n) [mm].
        deviations: Deviation of the functional point in X, Y, Z, shape (n, n, 3) [mm]; NaN where not determined.
    """

    axes: tuple[str, str]
    at: Mapping[str, float]
    across: Float[np.ndarray, "n n"]
    up: Float[np.ndarray, "n n"]
    deviations: Float[np.ndarray, "n n 3"]

    @property
    def length(self) -> Float[np.ndarray, "n n"]:
        """3-D length of the deviation [mm]."""
        return np.asarray(np.linalg.norm(self.deviations, axis=-1))

    def moved(self, factor: float) -> tuple[np.ndarray, np.ndarray]:
        """Where the points of the plane get to, seen along its normal, with deviations times `factor` [mm]."""
        first, second = (self.deviations[..., LINEAR_AXES.index(a)] for a in self.axes)
        return self.across + factor * first, self.up + factor * second


def section(
    solution: Solution, axes: tuple[str, str], tool: Sequence[float], at: Mapping[str, float] | None = None
) -> Section:
    """The deviation on a plane of two linear axes, in the mean of both directions of approach.

    Args:
        solution: The solution.
        axes: Letters of the linear axes, across and up.
        tool: Tool vector, shape (3,) [mm].
        at: Where the other axes stand [mm or degrees]; by default linear ones in the middle of their travel, to a mm, rotary ones
            at 0, or in the middle where they do not reach 0.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/direct_measurement/campaign.toml"))
    >>> found = section(solution, ("X", "Y"), solution.most_used_tool())
    >>> dict(found.at), found.length.shape
    ({'Z': 400.0}, (49, 49))
    """
    machine = solution.machine
    rest = {a.letter: (at or {}).get(a.letter, _rest(a)) for a in machine.axes if a.letter not in axes}
    ends = (np.linspace(*machine.axis(letter).travel, MESHES * FINE + 1) for letter in axes)
    across, up = np.meshgrid(*ends, indexing="ij")
    places: dict[str, Any] = {**rest, axes[0]: across, axes[1]: up}
    positions = machine.order(**places).reshape(-1, len(machine.axes))
    values = solution.evaluate(positions, np.asarray(tool, dtype=float)).values[:, :3]
    return Section(axes, rest, across, up, values.reshape(*across.shape, 3))


def _rest(axis: Axis) -> float:
    low, high = axis.travel
    middle = 0.5 * (low + high)
    middle = float(round(middle)) if axis.length > 20.0 else middle
    return 0.0 if not axis.is_linear and low <= 0.0 <= high else middle


def volume_sections(
    solution: Solution,
    tool: tuple[float, float, float],
    scale: float | None = None,
    *,
    at: Mapping[str, float] | None = None,
    texts: Texts = ENGLISH,
) -> Figure:
    """Deviation of the functional point on the planes of the linear axes, as projections that share their axes and their scale.

    The commanded grid is thin and grey. The actual one is strong, with the deviations in the plane enlarged `scale` times. The
    colour is the 3-D length of the deviation [µm], with lines at round values.

    Args:
        solution: The solution.
        tool: Tool vector, shape (3,) [mm].
        scale: Magnification of the deviations in the plane; None: the largest spans most of a mesh.
        at: Where the axes stand that do not move in a plane, as of `section`.
        texts: The language.

    Raises:
        NothingToDrawError: with fewer than two linear axes over whose travels the deviation is determined.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
    >>> figure = volid.plot.volume_sections(solution, (0.0, 0.0, -150.0))
    >>> [panel.get_title(loc="left") for panel in figure.axes[:3]]
    ['XY plane, Z = −250 mm', 'XZ plane, Y = 300 mm', 'YZ plane, X = 500 mm']
    """
    found = [section(solution, pair, tool, at) for pair in _planes(solution)]
    largest = max((float(np.nanmax(s.length)) for s in found if np.isfinite(s.length).any()), default=0.0)
    if largest <= 0.0:
        raise NothingToDrawError(
            f"the deviation for tool vector {vector(tool)} mm is not determined on these sections, or it is 0"
        )
    factor = scale or enlargement(found)
    figure, panels, bar = _arranged(found, factor)
    for panel, s in zip(panels, found, strict=True):
        areas = draw_section(panel, s, factor, largest, texts)
    figure.colorbar(areas, cax=bar).set_label(texts("figures.length"), fontsize=8)
    bar.tick_params(labelsize=8)
    in_language(bar.yaxis, texts)
    handles = [panels[0].lines[0], panels[0].lines[-1]]
    labels = [texts("figures.commanded"), texts("figures.actual", factor=grouped(factor))]
    heading(figure, texts("figures.sections_title", machine=cut(solution.machine.name)), handles, labels)
    note_below(figure, _circumstances(tool, found, largest, texts))
    return figure


def _planes(solution: Solution) -> list[tuple[str, str]]:
    """Pairs of linear axes that were measured over a range, XY, XZ, YZ. Raises `NothingToDrawError`."""
    letters = [a for a in LINEAR_AXES if a in solution.machine.letters and solution.machine.axis(a).length > 0.0]
    if len(letters) < 2:
        raise NothingToDrawError("fewer than two linear axes were measured over a range")
    return list(combinations(letters, 2))


def enlargement(found: Sequence[Section]) -> float:
    """Round magnification with which the largest deviation in a plane spans most of a mesh."""
    meshes = [np.ptp(axis) / MESHES for s in found for axis in (s.across, s.up)]
    inside = max(float(np.nanmax(np.abs(np.stack(s.moved(1.0)) - np.stack([s.across, s.up])))) for s in found)
    return round_down(SHARE * min(meshes) / inside) if inside > 0.0 else 1.0


def round_down(x: float) -> float:
    """Largest of 1, 2, 5 times a power of ten that does not exceed x.

    >>> round_down(4999.0), round_down(0.2)
    (2000.0, 0.2)
    """
    power = 10.0 ** np.floor(np.log10(x))
    return float(power * max(f for f in (1.0, 2.0, 5.0) if f <= x / power + 1e-9))


def _arranged(found: Sequence[Section], factor: float) -> tuple[Figure, list[Any], Any]:
    """Panels as projections: XY above XZ, YZ beside it, all at one scale; of one plane one panel. At the right the colour bar."""
    ends = _ends(found, factor)
    length = {letter: high - low for letter, (low, high) in ends.items()}
    unit = LONGER / max(length.values())
    first, second = found[0].axes
    third = found[-1].axes[1] if len(found) > 1 else ""
    left, below, apart, above = EDGES
    wide = [unit * length[first], *([unit * length[second]] if third else [])]
    tall = [unit * length[second], *([unit * length[third]] if third else [])]
    beside, higher = left + wide[0] + apart, below + (tall[1] + apart if third else 0.0)
    places = [(left, higher, wide[0], tall[0])]
    if third:
        places += [(left, below, wide[0], tall[1]), (beside, below, wide[1], tall[1])]
    right, top = left + sum(wide) + (apart if third else 0.0) + 0.25, higher + tall[0]
    size = (max(right + 0.9, 6.0), top + above)
    figure, (*panels, bar) = figure_with_places(size, [*places, (right, below, 0.18, top - below)])
    for panel, s in zip(panels, found, strict=True):
        panel.set_xlim(*ends[s.axes[0]])
        panel.set_ylim(*ends[s.axes[1]])
    return figure, panels, bar


def _ends(found: Sequence[Section], factor: float) -> dict[str, tuple[float, float]]:
    """Ends of the drawn range of every axis: commanded and moved grid of all planes, with a little room [mm]."""
    ends: dict[str, tuple[float, float]] = {}
    for s in found:
        for letter, commanded, moved in zip(s.axes, (s.across, s.up), s.moved(factor), strict=True):
            every = np.concatenate([commanded.ravel(), moved[np.isfinite(moved)]])
            low, high = ends.get(letter, (np.inf, -np.inf))
            ends[letter] = min(low, float(every.min())), max(high, float(every.max()))
    room = 0.02 * max(high - low for low, high in ends.values())
    return {letter: (low - room, high + room) for letter, (low, high) in ends.items()}


def draw_section(panel: Any, shown: Section, factor: float, largest: float, texts: Texts = ENGLISH) -> Any:
    """A section in a panel: areas of equal length, the commanded grid, and the actual one with deviations times `factor`.

    Args:
        panel: Axes of matplotlib.
        shown: As `section` gives it.
        factor: Magnification of the deviations in the plane.
        largest: End of the scale of lengths [mm].
        texts: The language.

    Returns the areas, for a colour bar.
    """
    areas = level_lines(panel, shown.across, shown.up, 1e3 * shown.length, 1e3 * largest, SIZES)
    areas.set_alpha(STRENGTH)
    for grid, style in (
        ((shown.across, shown.up), {"color": NEUTRAL, "lw": 0.6}),
        (shown.moved(factor), {"color": BLACK, "lw": 1.2}),
    ):
        panel.plot(grid[0][:, ::FINE], grid[1][:, ::FINE], **style)
        panel.plot(grid[0][::FINE].T, grid[1][::FINE].T, **style)
    panel.set_xlabel(f"{shown.axes[0]} / mm", fontsize=8)
    panel.set_ylabel(f"{shown.axes[1]} / mm", fontsize=8)
    panel.tick_params(labelsize=8)
    in_language(panel.xaxis, texts)
    in_language(panel.yaxis, texts)
    cut = [f"{a} = {signs(f'{at:g}', texts)} mm" for a, at in shown.at.items() if a in LINEAR_AXES]
    panel.set_title(texts("figures.plane", plane="".join(shown.axes), at=", ".join(cut)), fontsize=8, loc="left")
    return areas


def _circumstances(tool: Sequence[float], found: Sequence[Section], largest: float, texts: Texts) -> list[str]:
    """What the sections hold for: tool vector, rotary axes, largest length."""
    turned = [f"{a} = {signs(f'{at:g}', texts)}°" for a, at in found[0].at.items() if a not in LINEAR_AXES]
    lines = [texts("figures.tool", tool=shown_vector(tool, texts), axes="".join(f"; {t}" for t in turned))]
    lines.append(texts("figures.largest_here", largest=signs(f"{1e3 * largest:.1f}", texts)))
    if not all(np.isfinite(s.length).all() for s in found):
        lines.append(texts("figures.blank"))
    return lines


def grouped(factor: float) -> str:
    """A magnification with its thousands apart."""
    return f"{factor:,.0f}".replace(",", "\u202f") if factor >= 1.0 else f"{factor:g}"


def draw(asked: Asked) -> Figure:
    """For the collection of figures."""
    return volume_sections(asked.solution, asked.tool, texts=asked.texts)
