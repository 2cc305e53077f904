"""The correlations of what a fit estimated, as a matrix in blocks of functions and unknowns."""

from __future__ import annotations

from itertools import permutations
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.fitting.solution import Solution
from volid.report.contents.correlations import LISTED, STRONG, Correlations, Pair, correlations_of
from volid.report.language import ENGLISH, Texts
from volid.report.plot.asked import Asked
from volid.report.plot.dots import all_as_written, halo
from volid.report.plot.palette import BLACK, FAINT, NEUTRAL, SIGNED
from volid.report.plot.panels import figure_in_language, figure_with_panels, signs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIDE = 7.5  # inch, of the matrix
NAMED = 0.15  # inch, a block needs for its name
VISIBLE = 0.5  # from which on the sign of a block's strongest correlation is written into it


def draw(asked: Asked) -> Figure:
    """The figure of a solution."""
    return correlation_matrix(asked.solution, asked.texts)


def correlation_matrix(solution: Solution, texts: Texts = ENGLISH) -> Figure:
    """Correlation coefficients of all parameters and other unknowns in blocks; those beyond 0.95 between blocks are listed.

    Within a function neighbouring coefficients are correlated because the function is smooth; that is no weakness. Between
    blocks, what is correlated strongly is told apart badly: of two positively correlated ones the difference is known better
    than either, of two negatively correlated ones the sum. What is fixed or not determined has no correlation and is grey.

    Args:
        solution: A solution, as `volid.fit` makes it.
        texts: The language.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> [label.get_text() for label in volid.plot.correlation_matrix(solution).axes[0].get_yticklabels()][:2]
    ['EXX', 'EXX reversal']
    """
    found = correlations_of(solution)
    pairs = found.strong()
    lines = [words_of(pair, texts) for pair in pairs[:LISTED]]
    figure, panel = figure_with_panels(figsize=(SIDE + 2.2, SIDE + 1.0 + 0.17 * len(lines)))
    image = matrix_panel(panel, found)
    figure.colorbar(image, ax=panel, label=texts("correlation.coefficient"), shrink=0.7)
    figure_in_language(figure, texts)
    figure.suptitle(f"{solution.machine.name}: {texts('correlation.title')}", fontsize=10)
    more = [texts("correlation.more", n=len(pairs) - LISTED)] if len(pairs) > LISTED else []
    said = [
        texts("correlation.strong" if lines else "correlation.none", limit=signs(f"{STRONG:g}", texts)),
        *lines,
        *more,
    ]
    said += [texts("correlation.grey")] if np.isnan(found.matrix).any() else []
    figure.supxlabel("\n".join(said), fontsize=7, x=0.01, ha="left", color=NEUTRAL)
    all_as_written(figure)
    return figure


def words_of(pair: Pair, texts: Texts) -> str:
    """A pair in words: which two, how strongly, and what of them is known better."""
    key = "correlation.difference" if pair.correlation > 0.0 else "correlation.sum"
    rho = signs(f"{pair.correlation:+.3f}", texts)
    return texts(key, a=pair.parameters[0], b=pair.parameters[1], rho=rho)


def matrix_panel(panel: Any, found: Correlations) -> Any:
    """The matrix with lines between blocks and the names of those that have room; what is drawn, for a colour bar."""
    p = len(found.matrix)
    panel.set_facecolor(FAINT)
    values = np.ma.masked_invalid(found.matrix)
    edges = np.arange(p + 1)
    image = panel.pcolormesh(edges, edges, values, cmap=SIGNED, vmin=-1.0, vmax=1.0, rasterized=True)
    for block in found.blocks[1:]:
        for line in (panel.axhline, panel.axvline):
            line(block.parameters.start, color=BLACK, lw=0.3, gid="block")
    _signs(panel, found)
    ticks, names = _names(found, p)
    panel.set_xticks(ticks, names, rotation=90)
    panel.set_yticks(ticks, names)
    panel.tick_params(labelsize=7, length=0)
    panel.set_xlim(0, p)
    panel.set_ylim(p, 0)
    panel.set_aspect("equal")
    return image


def _signs(panel: Any, found: Correlations) -> None:
    """The sign of the strongest correlation within a block that has room for it, which no print in grey would tell."""
    least = NAMED / SIDE * len(found.matrix)
    wide = [b.parameters for b in found.blocks if b.parameters.stop - b.parameters.start >= least]
    for a, b in permutations(wide, 2):
        part = found.matrix[a, b]
        rho = part.flat[np.nanargmax(np.abs(part))] if np.isfinite(part).any() else 0.0
        if abs(rho) > VISIBLE:
            style = {"ha": "center", "va": "center", "fontsize": 8, "path_effects": halo(), "gid": "sign"}
            panel.text(0.5 * (b.start + b.stop), 0.5 * (a.start + a.stop), "+" if rho > 0.0 else "\u2212", **style)


def _names(found: Correlations, p: int) -> tuple[list[float], list[str]]:
    """Middles and names of the blocks, as many as can be read: those without room beside the last named one are left out."""
    ticks: list[float] = []
    names: list[str] = []
    least = NAMED / SIDE * p * 1.15
    for block in found.blocks:
        middle = 0.5 * (block.parameters.start + block.parameters.stop)
        if not ticks or middle - ticks[-1] >= least:
            ticks.append(middle)
            names.append(block.name)
    return ticks, names
