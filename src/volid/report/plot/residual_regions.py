"""Residuals by region of the volume: in cells over pairs of axes, their RMS over what is expected, with a test of every cell."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.special import chdtrc

from volid.exceptions import cut
from volid.fitting.solution import Solution
from volid.report.contents.readings import Readings, readings_of
from volid.report.language import ENGLISH, Texts
from volid.report.plot.dots import finished, quiet
from volid.report.plot.palette import ATTENTION, BLACK, FAINT, RATIOS
from volid.report.plot.panels import figure_with_panels, heading, signs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CELLS = 4  # along every axis
SIGNIFICANT = 1e-3  # probability by chance, of all cells together, from which on a cell is framed
HIGHEST = 2.0  # RMS over expected that has the darkest colour; its inverse the other one
TICKS = (0.5, 0.7, 1.0, 1.4, 2.0)  # of the scale


class Cells(NamedTuple):
    """Cells over two axes: `edges` along both, each (c + 1,); `weight` (c, c): RMS over expected, NaN where nothing is checked;
    `n` (c, c): readings; `flagged` (c, c): significantly above 1."""

    edges: tuple[np.ndarray, np.ndarray]
    weight: np.ndarray
    n: np.ndarray
    flagged: np.ndarray


def residuals_by_region(solution: Solution, texts: Texts = ENGLISH) -> Figure:
    """RMS of the residuals over what is expected of them, in cells over every pair of axes that move; number of readings within.

    A cell is framed where its chi-square would be as large by chance with a probability below 0.001, all cells counted. Rotary
    axes are paired with each other, linear ones with each other.

    Args:
        solution: A solution, as `volid.fit` makes it.
        texts: The language.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
    >>> [panel.get_xlabel() for panel in volid.plot.residuals_by_region(solution).axes[:3]]
    ['X / mm', 'X / mm', 'Y / mm']
    """
    readings = readings_of(solution)
    pairs = moving_pairs(readings) if readings.used.any() else []
    figure, panels = figure_with_panels(
        1, max(len(pairs), 1), figsize=(max(3.5 * len(pairs) + 0.8, 6.5), 3.4), squeeze=False
    )
    for panel, pair in zip(panels[0], pairs, strict=False):
        image = region_panel(panel, readings, pair, texts)
    if pairs:
        label = texts("residuals.rms_column")
        bar = figure.colorbar(
            image,
            ax=panels[0],
            label=label,
            extend="both",
            shrink=0.9,
            ticks=TICKS,
            format=lambda x, _: signs(f"{x:g}", texts),
        )
        bar.minorticks_off()
    else:
        why = "one_line" if readings.used.any() else "nothing_checks"
        panels[0][0].text(0.5, 0.5, texts(f"residuals.{why}"), ha="center", va="center", fontsize=9)
        panels[0][0].set_axis_off()
    heading(figure, f"{cut(solution.machine.name)}: {texts('residuals.by_region')}")
    finished(figure, texts)
    return figure


def moving_pairs(readings: Readings) -> list[tuple[int, int]]:
    """Pairs of axes that both move, linear ones in the order X, Y, Z, then rotary ones."""
    axes = readings.campaign.machine.axes
    moved = np.ptp(readings.positions, axis=0) > 0.0
    found: list[tuple[int, int]] = []
    for linear in (True, False):
        numbers = sorted(
            (i for i, a in enumerate(axes) if moved[i] and a.is_linear == linear), key=lambda i: axes[i].letter
        )
        found += combinations(numbers, 2)
    return [pair for pair in found if np.linalg.matrix_rank(np.cov(readings.positions[:, pair].T)) == len(pair)]


def cells_over(readings: Readings, pair: tuple[int, int], tests: int = 1) -> Cells:
    """The cells over two axes; `tests`: how many cells are tested together."""
    columns = readings.positions[:, pair].T
    edges = [np.linspace(c.min(), c.max(), CELLS + 1) for c in columns]
    index = [
        np.clip(np.searchsorted(e, c, side="right") - 1, 0, CELLS - 1) for e, c in zip(edges, columns, strict=True)
    ]
    cell = index[0] * CELLS + index[1]
    used = readings.used
    dof, squares, n = (
        np.bincount(cell[used], values, CELLS**2).reshape(CELLS, CELLS)
        for values in (
            readings.redundancy[used],
            readings.normalised[used] ** 2 * readings.redundancy[used],
            np.ones(int(used.sum())),
        )
    )
    tested = dof >= 1.0
    weight = np.where(tested, np.sqrt(squares / np.where(tested, dof, 1.0)), np.nan)
    probability = np.where(tested, chdtrc(np.where(tested, dof, 1.0), squares), 1.0)
    return Cells((edges[0], edges[1]), weight, n, tested & (weight > 1.0) & (probability * tests < SIGNIFICANT))


def region_panel(panel: Any, readings: Readings, pair: tuple[int, int], texts: Texts) -> Any:
    """The cells over two axes: colour and number are the RMS over expected; what is drawn, for a colour bar."""
    from matplotlib.colors import LinearSegmentedColormap, LogNorm
    from matplotlib.patches import Rectangle

    cells = cells_over(readings, pair, tests=CELLS**2 * len(moving_pairs(readings)))
    style = {"cmap": LinearSegmentedColormap.from_list("ratios", RATIOS), "norm": LogNorm(1.0 / HIGHEST, HIGHEST)}
    image = panel.pcolormesh(*cells.edges, cells.weight.T, edgecolors=FAINT, lw=0.5, rasterized=True, **style)
    _hatched(panel, cells)
    middles = [0.5 * (e[1:] + e[:-1]) for e in cells.edges]
    for i, j in np.ndindex(CELLS, CELLS):
        weight, x, y = cells.weight[i, j], middles[0][i], middles[1][j]
        mark = " !" if cells.flagged[i, j] else ""
        if np.isfinite(weight):
            said = f"{signs(f'{weight:.2f}', texts)}{mark}\nn {cells.n[i, j]:.0f}"
            panel.text(x, y, said, ha="center", va="center", fontsize=7, color=BLACK)
        if cells.flagged[i, j]:
            corner = (float(cells.edges[0][i]), float(cells.edges[1][j]))
            width, height = (float(e[k + 1] - e[k]) for e, k in zip(cells.edges, (i, j), strict=True))
            frame = Rectangle(corner, width, height, fill=False, ec=ATTENTION, lw=2.0, ls="--", gid="flagged", zorder=3)
            panel.add_patch(frame)
    axes = readings.campaign.machine.axes
    panel.set_xlabel(f"{axes[pair[0]].letter} / {axes[pair[0]].unit}", fontsize=8)
    panel.set_ylabel(f"{axes[pair[1]].letter} / {axes[pair[1]].unit}", fontsize=8)
    quiet(panel)
    return image


def _hatched(panel: Any, cells: Cells) -> None:
    """Cells in which no reading is checked: without a colour, which would say that all is as expected."""
    from matplotlib.patches import Rectangle

    for i, j in np.argwhere(~np.isfinite(cells.weight)):
        corner = (float(cells.edges[0][i]), float(cells.edges[1][j]))
        width, height = (float(e[k + 1] - e[k]) for e, k in zip(cells.edges, (i, j), strict=True))
        panel.add_patch(Rectangle(corner, width, height, fill=False, hatch="////", ec=FAINT, lw=0.0, gid="unchecked"))
