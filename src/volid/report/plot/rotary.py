"""Maps over the angles of two rotary axes: rotary grids, and residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from volid.compensation.grids.grid import RotaryGrid
from volid.compensation.grids.rotary import rotary_grids
from volid.exceptions import cut
from volid.fitting.solution import Solution
from volid.observations import KINDS
from volid.report.language import ENGLISH, Texts
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.palette import FAINT, SERIES, SIGNED, SIZES, STYLES
from volid.report.plot.panels import (
    figure_with_panels,
    heading,
    in_language,
    level_lines,
    note_below,
    shown_vector,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NODES = 73  # of an axis, for a figure


def angle_map(solution: Solution, number: int = 0, held_out: bool = True, *, texts: Texts = ENGLISH) -> Figure:
    """Residuals of a set over the angles of its two rotary axes: length of the residual vector, RMS over the readings there.

    Args:
        solution: The solution.
        number: Of the set.
        held_out: Whether each rotary position is predicted from all others, else within the fit.
        texts: The language.

    Raises:
        NothingToDrawError: for a machine with fewer than two rotary axes.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> volid.plot.angle_map(solution).axes[0].get_xlabel()
    'C / °'
    """
    rotary = [axis for axis in solution.machine.axes if not axis.is_linear][:2]
    if len(rotary) < 2:
        raise NothingToDrawError("the machine has fewer than two rotary axes")
    name = solution.campaign.sets[number].name
    figure, panel = figure_with_panels(1, 1, figsize=(9, 4.0))
    angles, size = _rms_by_angles(solution, number, held_out)
    spots = panel.scatter(*angles.T, c=size, s=60, marker="s", cmap=SIZES, vmin=0.0)
    panel.set_xlabel(f"{rotary[0].letter} / °")
    panel.set_ylabel(f"{rotary[1].letter} / °")
    words = texts("figures.residual_held_out" if held_out else "figures.residual_fit", set=name)
    panel.set_title(words, fontsize=9, loc="left", parse_math=False)
    bar = figure.colorbar(spots, ax=panel, label=texts("figures.residual_rms"))
    for axis in (panel.xaxis, panel.yaxis, bar.ax.yaxis):
        in_language(axis, texts)
    heading(figure, texts("figures.angle_map_title", machine=cut(solution.machine.name)))
    return figure


def _rms_by_angles(solution: Solution, number: int, held_out: bool) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of angles (k, 2) [degrees], and RMS length of the residual vectors there (k,) [µm]."""
    readings = solution.campaign.sets[number]
    source = solution.readings.held_out if held_out else solution.readings.residuals
    rotary = [i for i, axis in enumerate(solution.machine.axes) if not axis.is_linear][:2]
    angles, index = np.unique(np.round(readings.positions[:, rotary], 3), axis=0, return_inverse=True)
    square = np.sum(np.asarray(source[number]) ** 2, axis=1)
    count = np.bincount(index.ravel())
    return angles, 1e3 * np.sqrt(np.bincount(index.ravel(), weights=square) / count)


def rotary_grid(grid: RotaryGrid, machine_name: str = "", *, texts: Texts = ENGLISH) -> Figure:
    """The six components of a rotary spatial grid over its axes, ERROR values: translations at one scale, rotations at another.

    A grid of two axes is drawn as maps with lines at the levels of its two colour bars, one of a single axis as lines.

    Args:
        grid: As `volid.rotary_grids` gives it.
        machine_name: For the title.
        texts: The language.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> grids = volid.rotary_grids(solution, points=5)
    >>> len(volid.plot.rotary_grid(grids[0]).axes)  # six maps and two colour bars
    8
    """
    draw_grid = _maps if len(grid.axes) > 1 else _lines
    figure = draw_grid(grid, texts)
    title = texts("figures.rotary_title", machine=machine_name, type=grid.type, side=texts(f"figures.{grid.side}"))
    labels = figure.axes[0].get_legend_handles_labels()
    heading(figure, title.removeprefix(": "), *labels)
    notes = [texts("figures.rotary_point", point=shown_vector(grid.reference_point, texts), frame=_frame(grid, texts))]
    note_below(figure, [*notes, *([texts("figures.lines_of_levels")] if len(grid.axes) > 1 else [])])
    return figure


def _frame(grid: RotaryGrid, texts: Texts) -> str:
    return texts("figures.machine_frame") if grid.frame == "machine" else grid.frame


def _values(grid: RotaryGrid, rotations: bool) -> np.ndarray:
    """Three components at the nodes of all axes, shape (…, 3), the last axis of the grid first [µm or µrad]."""
    shape = tuple(len(n) for n in reversed(grid.nodes))
    part = 1e6 * grid.values[:, 3:] if rotations else 1e3 * grid.values[:, :3]
    return part.reshape(*shape, 3)


def _maps(grid: RotaryGrid, texts: Texts) -> Figure:
    figure, panels = figure_with_panels(2, 3, figsize=(12, 6.6), sharex=True, sharey=True)
    for rotations, row in enumerate(panels):
        values = _values(grid, bool(rotations))
        largest = float(np.nanmax(np.abs(values), initial=0.0)) or 1.0
        for k, panel in enumerate(row):
            areas = level_lines(panel, grid.nodes[1], grid.nodes[0], values[..., k].T, largest, SIGNED)
            key = "figures.rotation" if rotations else "figures.translation"
            panel.set_title(texts(key, line="XYZ"[k]), fontsize=9, loc="left")
        bar = figure.colorbar(areas, ax=row, label=texts("figures.rotations" if rotations else "figures.translations"))
        in_language(bar.ax.yaxis, texts)
        row[0].set_ylabel(f"{grid.axes[0]} / °")
    for panel in panels[-1]:
        panel.set_xlabel(f"{grid.axes[1]} / °")
    return figure


def _lines(grid: RotaryGrid, texts: Texts) -> Figure:
    figure, panels = figure_with_panels(1, 2, figsize=(10, 3.8))
    for rotations, panel in enumerate(panels):
        _three_lines(panel, grid.nodes[0], _values(grid, bool(rotations)), texts)
        panel.set_title(texts("figures.rotations" if rotations else "figures.translations"), fontsize=9, loc="left")
        panel.set_xlabel(f"{grid.axes[0]} / °")
        in_language(panel.xaxis, texts)
        in_language(panel.yaxis, texts)
    return figure


def _three_lines(panel: Any, x: np.ndarray, values: np.ndarray, texts: Texts) -> None:
    panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)
    for k in range(3):
        label = texts("figures.in_and_about", line="XYZ"[k])
        panel.plot(x, values[..., k], color=SERIES[k], ls=STYLES[k], lw=1.4, label=label)


def draw(asked: Asked) -> dict[str, Figure]:
    """For the collection of figures: the rotary grid of every side, and the residuals of each set over the angles."""
    solution, texts = asked.solution, asked.texts
    if all(axis.is_linear for axis in solution.machine.axes):
        raise NothingToDrawError("the machine has no rotary axes")
    found = {
        g.side: rotary_grid(g, cut(solution.machine.name), texts=texts) for g in rotary_grids(solution, points=NODES)
    }
    for number, readings in enumerate(solution.campaign.sets):
        if _has_vectors(solution, number):
            found[f"residuals_{_plain(readings.name)}"] = angle_map(solution, number, texts=texts)
    return found


def _has_vectors(solution: Solution, number: int) -> bool:
    """Whether a set has held-out residuals of one length unit at several positions of two rotary axes."""
    rotary = [i for i, axis in enumerate(solution.machine.axes) if not axis.is_linear][:2]
    readings, held_out = solution.campaign.sets[number], solution.readings.held_out
    if len(rotary) < 2 or not held_out or not np.isfinite(held_out[number]).any():
        return False
    units = {part.unit for part in KINDS[readings.kind].parts(readings)}
    return units == {"mm"} and all(np.ptp(readings.positions[:, i]) > 0.0 for i in rotary)


def _plain(name: str) -> str:
    """The name of a set as part of a file's name."""
    return "".join(c if c.isalnum() else "_" for c in name)
