"""The deviation field as a deformed lattice, drawn on paper: before a compensation, and what is left after it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from volid.exceptions import cut
from volid.fitting.solution import Solution
from volid.report.contents.deviation_field import DeviationFields, deviation_fields
from volid.report.contents.lattice import Lattice, grouped
from volid.report.language import ENGLISH, Texts
from volid.report.plot.isometric import SEEN, draw_box, prepare, projected
from volid.report.plot.palette import ATTENTION, BLACK, FAINT, SIZES
from volid.report.plot.panels import figure_with_panels, in_language, shown_vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NODES = 9  # along the longest axis of a figure
REACH = 0.8  # of a cell: how far the largest deviation is drawn


class Scale(NamedTuple):
    """What drawings that are compared have in common: deviations are drawn `factor` times, colours go to `largest` [mm]."""

    factor: float
    largest: float


def deviation_volume(
    solution: Solution,
    tool: Sequence[float] | None = None,
    names: Sequence[str] | None = None,
    *,
    factor: float | None = None,
    texts: Texts = ENGLISH,
) -> Figure:
    """The lattice of the working volume, deformed by the deviation of the functional point, before and after a compensation.

    The three faces that are seen carry the lattice; deviations are enlarged, colour is their 3-D length, the same scale for both.
    Values are of the estimate, mean of both approach directions, in the stated datum; rotary axes stand at 0.

    Args:
        solution: A solution, as `volid.fit` makes it.
        tool: Tool vector, shape (3,) [mm]; None: the most used one.
        names: Types that act together; None: those that correct most of what the machine can have.
        factor: How many times the deviations are drawn; None: so that the largest spans most of a cell.
        texts: The language.

    Raises:
        ValueError: the data determine the deviation nowhere.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
    >>> len(deviation_volume(solution).axes)
    3
    """
    asked = None if names is None else [names]
    found = deviation_fields(solution, solution.most_used_tool() if tool is None else tool, asked, most=NODES)
    if not found.is_known:
        raise ValueError("the data do not determine the deviation for this tool vector anywhere")
    scale = scale_of(found, factor)
    figure, panels = figure_with_panels(1, 2, figsize=(11, 4.0))
    for panel, state in zip(panels, (0, len(found.states) - 1), strict=True):
        draw_field(panel, found, state, scale, texts)
        panel.set_title(state_title(found, state, texts), fontsize=9, loc="left")
    colour_bar(figure, panels, scale, texts)
    drawn = texts("field.drawn", factor=texts_number(scale.factor, texts))
    with_tool = texts("field.with_tool", tool=shown_vector(found.tools[0].tolist(), texts))
    figure.suptitle("\n".join([cut(solution.machine.name), f"{drawn}, {with_tool}"]), fontsize=10)
    return figure


def scale_of(found: DeviationFields, factor: float | None = None) -> Scale:
    """One scale for all states of the first tool vector and rotary position; without deviations the factor is 1."""
    largest = float(np.nanmax(np.linalg.norm(found.values[0, 0, 0], axis=-1)))
    best = REACH * found.lattice.spacing / max(largest, 1e-9)
    return Scale(factor or _round_down(best), max(largest, 1e-9))


def _round_down(x: float) -> float:
    """Largest of 1, 1.5, 2, 3, 5, 7 times a power of ten that does not exceed x."""
    power = 10.0 ** np.floor(np.log10(x))
    return float(power * max(f for f in (1.0, 1.5, 2.0, 3.0, 5.0, 7.0) if f <= x / power + 1e-9))


def draw_field(panel: Any, found: DeviationFields, state: int, scale: Scale, texts: Texts = ENGLISH) -> None:
    """Draw the seen faces of the lattice, deformed by a state of the first tool vector and rotary position, into a panel."""
    from matplotlib.collections import LineCollection

    lattice, values = found.lattice, found.values[0, 0, state]
    points = lattice.points
    pairs = np.array(grouped([line for line in lattice.lines if on_seen_face(lattice, line)]))
    prepare(panel, points)
    draw_box(panel, points.min(axis=0), points.max(axis=0), texts)
    panel.add_collection(LineCollection(list(projected(points)[pairs]), colors=FAINT, linewidths=0.5, zorder=0))
    length = np.linalg.norm(values, axis=1)
    known = np.isfinite(length[pairs]).all(axis=1)
    moved = projected(points + scale.factor * np.nan_to_num(values))
    lines = LineCollection(list(moved[pairs[known]]), cmap=SIZES, linewidths=1.6, capstyle="round", zorder=2)
    lines.set_array(length[pairs[known]].mean(axis=1) * 1e3)
    lines.set_clim(0.0, 1e3 * scale.largest)
    panel.add_collection(lines)
    worst = found.largest(0, 0, state)
    if worst >= 0:
        panel.plot(*moved[worst], "o", ms=8, mfc="none", mec=BLACK, mew=1.4, zorder=3)
        panel.plot(*np.array([projected(points)[worst], moved[worst]]).T, color=ATTENTION, lw=1.4, zorder=3)


def on_seen_face(lattice: Lattice, line: np.ndarray) -> bool:
    """Whether a line of the lattice lies on a face of the box that is seen."""
    places = lattice.points[line]
    ends = [lattice.nodes[k][-1 if end else 0] for k, end in enumerate(SEEN)]
    return any(bool((places[:, k] == end).all()) for k, end in enumerate(ends))


def colour_bar(figure: Figure, panels: Any, scale: Scale, texts: Texts = ENGLISH, **options: Any) -> None:
    """The scale of the colours, once for all panels that share it."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    colours = ScalarMappable(Normalize(0.0, 1e3 * scale.largest), SIZES)
    bar = figure.colorbar(colours, ax=panels, shrink=0.7, **options)
    bar.set_label(texts("field.length"), fontsize=8)
    bar.ax.tick_params(labelsize=8)
    in_language(bar.ax.xaxis, texts)
    in_language(bar.ax.yaxis, texts)


def state_name(names: Sequence[str], texts: Texts) -> str:
    """A state in words: the types that act, or that none does."""
    return " + ".join(names) if names else texts("field.without")


def state_title(found: DeviationFields, state: int, texts: Texts) -> str:
    """A state with its largest deviation among the nodes."""
    worst = found.largest(0, 0, state)
    name = state_name(found.states[state], texts)
    if worst < 0:
        return f"{name}: {texts('field.nowhere')}"
    size = 1e3 * float(np.linalg.norm(found.values[0, 0, state, worst]))
    return texts(
        "field.state_largest", state=name, size=texts_number(size, texts, 1 if size >= 1.0 else 2 if size >= 0.1 else 3)
    )


def texts_number(value: float, texts: Texts, digits: int = 0) -> str:
    """A number as people of the language write it: 5,000.1 or 5.000,1."""
    plain = f"{value:,.{digits}f}"
    return plain if texts.language == "en" else plain.translate(str.maketrans(",.", ".,"))
