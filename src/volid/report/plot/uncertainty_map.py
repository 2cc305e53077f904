"""The uncertainty of the deviation field on plane sections of the working volume."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from volid.exceptions import cut
from volid.fitting.solution import Solution
from volid.model.machine import Machine
from volid.report.language import ENGLISH, Texts
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.dots import finished, quiet
from volid.report.plot.palette import ATTENTION, NEUTRAL, PAPER, SIZES
from volid.report.plot.panels import figure_with_panels, heading, shown_vector, signs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

K = 2.0
NODES = 33  # along either direction of a section
LEVELS = 9  # at most, of U
WIDTH = 11.0  # inch, of the figure


class Section(NamedTuple):
    """U on one plane section: letters of its axes, positions `across` and `up` (n,) [mm], U (n, n) [mm] with NaN where it is not
    known, first index across; `cut`: position of every other axis by letter [mm or degrees]."""

    axes: tuple[str, str]
    across: np.ndarray
    up: np.ndarray
    expanded: np.ndarray
    cut: dict[str, float]

    @property
    def has_area(self) -> bool:
        """Whether U is known on more than lines and single points."""
        known = np.isfinite(self.expanded)
        return bool((known[1:, 1:] & known[1:, :-1] & known[:-1, 1:] & known[:-1, :-1]).any())


def draw(asked: Asked) -> Figure:
    """The figure of a solution."""
    return uncertainty_sections(asked.solution, asked.tool, asked.texts)


def uncertainty_sections(solution: Solution, tool: tuple[float, float, float], texts: Texts = ENGLISH) -> Figure:
    """Expanded uncertainty U = 2 √(u_X² + u_Y² + u_Z²) of the deviation of the functional point, on sections through the middle.

    All sections have one scale of colours; cut positions and tool are stated. The sections span the travels of the machine
    file. Hatched is what was not measured, or what the data do not determine.

    Args:
        solution: A solution, as `volid.fit` makes it.
        tool: Tool vector, shape (3,) [mm].
        texts: The language.

    Raises:
        NothingToDrawError: for a machine with one linear axis, and where nothing is determined for this tool.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
    >>> volid.plot.uncertainty_sections(solution, (0.0, 0.0, -150.0)).axes[0].get_title(loc="left")
    'Z = −250 mm'
    """
    sections = sections_of(solution, tool)
    largest = largest_of(sections)
    shown = [s for s in sections if s.has_area]
    spans = [(float(np.ptp(s.across)), float(np.ptp(s.up))) for s in shown]
    widths = [max(width, 0.25 * max(max(spans))) for width, _ in spans]
    height = (WIDTH - 2.2) / sum(widths) * max(up for _, up in spans)
    figure, panels = figure_with_panels(
        1, len(shown), figsize=(WIDTH, min(max(height, 1.8), 6.0) + 1.3), squeeze=False, width_ratios=widths
    )
    for panel, section in zip(panels[0], shown, strict=True):
        image = section_panel(panel, section, largest, said_cut(section, solution.campaign.machine, texts))
    figure.colorbar(image, ax=panels[0], label="U (k = 2) / µm", shrink=0.9)
    heading(figure, f"{cut(solution.machine.name)}: {texts('uncertainty_map.title', tool=shown_vector(tool, texts))}")
    if not all(np.isfinite(s.expanded).all() for s in shown):
        figure.supxlabel(texts("uncertainty_map.hatched"), fontsize=8, color=ATTENTION)
    finished(figure, texts)
    return figure


def sections_of(solution: Solution, tool: tuple[float, float, float]) -> list[Section]:
    """The sections of a solution, with their U. Raises `NothingToDrawError`."""
    machine = solution.campaign.machine
    letters = [a for a in "XYZ" if a in machine.letters]
    if len(letters) < 2:
        raise NothingToDrawError("a section of the working volume needs two linear axes")
    found = [_section(solution, tool, pair) for pair in combinations(letters, 2)]
    if not any(s.has_area for s in found):
        raise NothingToDrawError("the deviation is not determined for this tool vector on any section")
    return found


def largest_of(sections: list[Section]) -> float:
    """The largest U of all sections [mm]."""
    return max(float(np.nanmax(s.expanded, initial=0.0)) for s in sections)


def _section(solution: Solution, tool: tuple[float, float, float], pair: tuple[str, str]) -> Section:
    machine = solution.campaign.machine
    cut = cut_positions(machine, pair)
    across, up = (_nodes(solution, letter) for letter in pair)
    a, b = np.meshgrid(across, up, indexing="ij")
    positions = machine.order(**{**{k: np.full(a.shape, v) for k, v in cut.items()}, pair[0]: a, pair[1]: b})
    found = solution.evaluate(positions.reshape(-1, len(machine.axes)), np.asarray(tool, dtype=float))
    u = np.where(found.determined[:, :3] & ~found.outside[:, None], found.u[:, :3], np.nan)
    return Section(pair, across, up, K * np.linalg.norm(u, axis=1).reshape(a.shape), cut)


def _nodes(solution: Solution, letter: str) -> np.ndarray:
    """Positions over a travel, the ends of what was measured among them, so that its edge is drawn where it is."""
    low, high = solution.campaign.machine.axis(letter).travel
    ends = solution.measured_range()[solution.machine.index(letter)]
    return np.unique(np.concatenate([np.linspace(low, high, NODES), np.clip(ends, low, high)]))


def cut_positions(machine: Machine, pair: tuple[str, str]) -> dict[str, float]:
    """Positions of all axes but two: linear ones at mid-travel, rotary ones at 0 or the end of their travel that is nearest."""
    found = {}
    for axis in machine.axes:
        low, high = axis.travel
        if axis.letter not in pair:
            found[axis.letter] = 0.5 * (low + high) if axis.is_linear else min(max(0.0, low), high)
    return found


def section_panel(panel: Any, section: Section, largest: float, title: str) -> Any:
    """U of one section in µm, from 0 to `largest` [mm] for all sections; what is drawn, for a colour bar."""
    from matplotlib.patches import Rectangle
    from matplotlib.ticker import MaxNLocator

    levels = MaxNLocator(LEVELS).tick_values(0.0, 1e3 * max(largest, 1e-9))
    corner, size = (section.across[0], section.up[0]), (np.ptp(section.across), np.ptp(section.up))
    panel.add_patch(Rectangle(corner, *size, fill=False, hatch="////", ec=NEUTRAL, lw=0.0, zorder=0, gid="unknown"))
    values = np.ma.masked_invalid(1e3 * section.expanded.T)
    image = panel.contourf(section.across, section.up, values, levels=levels, cmap=SIZES, zorder=1)
    panel.contour(section.across, section.up, values, levels=levels, colors=PAPER, linewidths=0.4, zorder=2)
    panel.set_aspect("equal")
    panel.set_xlabel(f"{section.axes[0]} / mm", fontsize=8)
    panel.set_ylabel(f"{section.axes[1]} / mm", fontsize=8)
    panel.set_title(title, fontsize=8, loc="left")
    quiet(panel)
    return image


def said_cut(section: Section, machine: Machine, texts: Texts) -> str:
    """Where the section cuts: "Z = -250 mm, A = 0°"."""
    units = {letter: "°" if machine.axis(letter).unit in ("deg", "°") else " mm" for letter in section.cut}
    cuts = (f"{letter} = {signs(f'{value:g}', texts)}{units[letter]}" for letter, value in section.cut.items())
    return ", ".join(cuts)
