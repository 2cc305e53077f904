"""Monte Carlo beside propagation: coverage bands of functions, and distributions of what is not linear."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.exceptions import cut
from volid.fitting.results import FunctionValue
from volid.fitting.solution import Solution
from volid.model.iso230 import parse
from volid.report.language import ENGLISH, Texts
from volid.report.plot.asked import Asked, NothingToDrawError
from volid.report.plot.curves import scale_of
from volid.report.plot.palette import BLACK, BLUE, FAINT, NEUTRAL, ORANGE, SKY
from volid.report.plot.panels import figure_with_panels, heading, in_language, note_below, shown_vector
from volid.report.symbols import in_words
from volid.uncertainty.coverage import coverage_intervals
from volid.uncertainty.intervals import function_intervals
from volid.uncertainty.outputs import FIELD, headline_outputs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KEYS = ("largest_deviation", "rms_deviation", "range_x", "range_y", "range_z")  # texts of `FIELD`, in its order


def coverage_bands(
    solution: Solution,
    names: Sequence[str],
    truth: Mapping[str, Callable[[np.ndarray], np.ndarray]] | None = None,
    points: int = 61,
    *,
    texts: Texts = ENGLISH,
) -> Figure:
    """Error motions minus their estimate: shortest 95 % intervals by Monte Carlo, ± 1.96 u by propagation, and the truth.

    Panels of the same unit have the same scale.

    Args:
        solution: A solution with samples.
        names: ISO 230-1 symbols of error motions.
        truth: Known functions by symbol, position [mm or degrees] -> mm or rad.
        points: Positions over the travel.
        texts: The language.

    Raises:
        ValueError: the solution has no samples.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> solution = volid.monte_carlo(solution, trials=64)
    >>> volid.plot.coverage_bands(solution, ["EXX"]).axes[0].get_title(loc="left")
    'EXX: positioning of X'
    """
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    size = (max(4.0 * columns, 5.5), 2.3 * rows + 1.0)
    figure, panels = figure_with_panels(rows, columns, figsize=size, squeeze=False)
    for panel in panels.ravel()[len(names) :]:
        panel.set_visible(False)
    for panel, name in zip(panels.ravel(), names, strict=False):
        axis = solution.machine.axis(parse(name).axis)
        x = np.linspace(*axis.travel, points)
        values = [r for r in solution.motion(name, x) if r.direction >= 0]
        _band(panel, solution, values, (truth or {}).get(name), texts)
        panel.set_xlabel(f"{axis.letter} / {axis.unit}", fontsize=8)
        panel.set_title(f"{name}: {in_words(name, texts)}", fontsize=8, loc="left", color=NEUTRAL)
        panel.set_ylabel(f"{parse(name).report_unit}", fontsize=8)
        _finish(panel, texts)
    _share(panels.ravel(), names)
    title = texts("figures.coverage_title", machine=cut(solution.machine.name))
    heading(figure, title, *panels[0][0].get_legend_handles_labels())
    note_below(figure, [texts("functions.same_scales")])
    return figure


def _band(panel: Any, solution: Solution, rows: list[FunctionValue], truth: Any, texts: Texts) -> None:
    x, scale = np.array([r.position for r in rows]), scale_of(rows[0].name)
    value, u = (np.array([getattr(r, key) for r in rows]) for key in ("value", "u"))
    found = function_intervals(solution, rows)
    low, high = scale * (found.shortest_low - value), scale * (found.shortest_high - value)
    panel.fill_between(x, low, high, color=BLUE, alpha=0.3, lw=0, label=texts("figures.monte_carlo"))
    for sign in (-1.96, 1.96):
        label = texts("figures.propagation") if sign < 0 else None
        panel.plot(x, sign * scale * u, color=ORANGE, lw=1.2, ls="--", label=label)
    if truth is not None:
        panel.plot(x, scale * (truth(x) - value), color=BLACK, lw=1.2, ls=":", label=texts("functions.truth"))
    panel.axhline(0.0, color=FAINT, lw=0.8, zorder=0)


def _share(panels: Iterable[Any], names: Sequence[str]) -> None:
    """One scale for each unit."""
    for rotation in (False, True):
        alike = [p for p, n in zip(panels, names, strict=False) if parse(n).is_rotation == rotation]
        ends = np.array([p.get_ylim() for p in alike])
        for panel in alike:
            panel.set_ylim(ends[:, 0].min(), ends[:, 1].max())


def _finish(panel: Any, texts: Texts) -> None:
    panel.tick_params(labelsize=8)
    in_language(panel.xaxis, texts)
    in_language(panel.yaxis, texts)


def volume_distribution(solution: Solution, tool: Sequence[float], *, texts: Texts = ENGLISH) -> Figure:
    """Histograms of the deviation field's numbers from the samples, with 95 % intervals: largest, RMS, ranges.

    Args:
        solution: A solution with samples.
        tool: Tool vector, shape (3,) [mm].
        texts: The language.

    Raises:
        ValueError: the solution has no samples, or the field is not determined for `tool` [mm].

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> len(volid.plot.volume_distribution(volid.monte_carlo(solution, trials=64), (0.0, 0.0, 0.0)).axes)
    5
    """
    outputs = headline_outputs(solution, np.asarray(tool, dtype=float))
    if solution.samples is None or not len(outputs.field):
        raise ValueError("no samples, or a deviation field that is not determined for this tool vector")
    values = 1e3 * solution.samples.outputs(outputs.field_values)
    centre = np.concatenate([np.asarray(solution.parameters), np.asarray(solution.nuisance)])
    estimate = 1e3 * outputs.field_values(centre[None])[0]
    found = coverage_intervals(values)
    figure, panels = figure_with_panels(1, len(FIELD), figsize=(13, 3.2))
    bins = int(np.clip(1.5 * np.sqrt(len(values)), 10, 60))
    for k, panel in enumerate(panels):
        panel.hist(values[:, k], bins=bins, color=SKY, density=True, label=texts("figures.samples", count=len(values)))
        panel.axvline(estimate[k], color=BLACK, lw=1.4, label=texts("figures.estimate"))
        for end, label in ((found.shortest_low[k], texts("figures.shortest")), (found.shortest_high[k], None)):
            panel.axvline(end, color=ORANGE, lw=1.2, ls="--", label=label)
        panel.set_xlabel(f"{texts(f'figures.{KEYS[k]}')} / µm", fontsize=8)
        panel.set_yticks([])
        panel.locator_params(axis="x", nbins=4)
        _finish(panel, texts)
    title = texts("figures.distribution_title", machine=cut(solution.machine.name))
    heading(figure, title, *panels[0].get_legend_handles_labels())
    note_below(figure, [texts("figures.tool_only", tool=shown_vector(tool, texts))])
    return figure


def draw(asked: Asked) -> Figure:
    """For the collection of figures."""
    if asked.solution.samples is None:
        raise NothingToDrawError("the solution has no samples of Monte Carlo refits (`volid.monte_carlo` makes them)")
    try:
        return volume_distribution(asked.solution, asked.tool, texts=asked.texts)
    except ValueError as error:
        raise NothingToDrawError(str(error)) from None
