"""Section "residuals" of the page: whether residuals are as large as they should be, where not, and which readings are worst."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from markupsafe import Markup

from volid.fitting.diagnosis.verdict import SIGNIFICANT
from volid.report.contents.contents import Contents
from volid.report.contents.readings import Readings, readings_of
from volid.report.language import Texts
from volid.report.page.section import Section, svg
from volid.report.page.templates import render
from volid.report.plot.dots import MOST, RESOLUTION
from volid.report.plot.panels import figure_with_panels
from volid.report.plot.residual_distribution import distribution_panel, normal_panel
from volid.report.plot.residual_regions import moving_pairs, region_panel
from volid.report.plot.residuals import has_times, moving_axes, order_panel, position_panel, strips_panel

SIZE = (3.9, 2.7)  # inch, of a panel
LISTED = 10  # readings, and groups, that are listed


def build(contents: Contents, texts: Texts) -> Section | None:
    """Figures of the residuals, and tables by set, by group, of the worst readings, held out, and of what explains a misfit."""
    readings = readings_of(contents.solution)
    summary = contents.summary
    body = render(
        "residuals.html",
        texts,
        summary=summary,
        testable=bool(readings.used.any()),
        redundancy=float(readings.redundancy[~readings.outlier].sum()),
        panels=list(panels_of(readings, texts)),
        strips=list(_strips(readings)),
        groups=contents.solution.adequacy.groups,
        flagged=_flagged(contents),
        worst=_worst(contents),
        readings=readings,
        drawn=MOST if len(readings.row) > MOST else 0,
        timed=has_times(readings),
        listed=LISTED,
    )
    return Section("residuals", texts("page.section_residuals"), body)


def panels_of(readings: Readings, texts: Texts) -> Iterator[Markup]:
    """The figures of the section one after the other: by station, over time, distributions, positions, regions."""
    tall = (SIZE[0], max(SIZE[1], 1.0 + 0.15 * len(readings.strips)))
    yield _drawn(lambda p: strips_panel(p, readings, texts), texts("residuals.by_station"), tall)
    over = texts("residuals.over_time" if has_times(readings) else "residuals.over_order")
    yield _drawn(lambda p: order_panel(p, readings, texts), over)
    if not readings.used.any():
        return
    yield _drawn(lambda p: distribution_panel(p, readings, texts), texts("residuals.distribution"))
    yield _drawn(lambda p: normal_panel(p, readings, texts), texts("residuals.probability"))
    axes = readings.campaign.machine.axes
    for i in moving_axes(readings):
        label = texts("residuals.over_axis", axis=axes[i].letter)
        yield _drawn(lambda p, i=i: position_panel(p, readings, i, texts), label)
    for pair in moving_pairs(readings):
        label = texts("residuals.region_of", axes=", ".join(axes[i].letter for i in pair))
        yield _drawn(lambda p, pair=pair: region_panel(p, readings, pair, texts), label)


def _drawn(draw: Callable[[Any], Any], label: str, size: tuple[float, float] = SIZE) -> Markup:
    """One panel as SVG, its dots as a picture that is sharp in print."""
    figure, panel = figure_with_panels(figsize=size)
    figure.set_dpi(RESOLUTION)
    draw(panel)
    if not panel.get_title(loc="left"):
        panel.set_title(label, fontsize=8, loc="left")
    return svg(figure, label)


def _strips(readings: Readings) -> Iterator[dict[str, Any]]:
    """A row for every set and station."""
    for strip in readings.strips:
        kept = strip.numbers[~readings.outlier[strip.numbers]]
        yield {
            "name": strip.name,
            "n": len(strip.numbers),
            "outliers": len(strip.numbers) - len(kept),
            "redundancy": float(readings.redundancy[kept].sum()),
            "rms": readings.unit_weight(strip.numbers),
            "largest": float(abs(readings.normalised[kept]).max(initial=0.0)),
        }


def _flagged(contents: Contents) -> list[bool]:
    """Which groups have residuals that are significantly too large, all groups counted."""
    groups = contents.solution.adequacy.groups
    return [g.probability * len(groups) < SIGNIFICANT and g.unit_weight > 1.0 for g in groups]


def _worst(contents: Contents) -> list[dict[str, Any]]:
    """Readings set aside and readings beyond the critical value, the largest first, with the key of each."""
    found = [
        {**reading, "key": f"{key}.{i}", "aside": key == "outliers"}
        for key in ("outliers", "suspects")
        for i, reading in enumerate(contents.summary[key])
    ]
    return sorted(found, key=lambda reading: -abs(reading["normalised"]))
