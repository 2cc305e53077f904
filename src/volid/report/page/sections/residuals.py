"""Section "residuals" of the page: whether residuals are as large as they should be, where not, and which readings are worst."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

from markupsafe import Markup

from volid.fitting.diagnosis.verdict import SIGNIFICANT
from volid.report.contents.contents import Contents
from volid.report.contents.names import group_facts, group_words
from volid.report.contents.readings import Readings, readings_of
from volid.report.language import Texts
from volid.report.page.section import Section, svg
from volid.report.page.templates import render
from volid.report.plot.dots import RESOLUTION, finished
from volid.report.plot.panels import figure_with_panels
from volid.report.plot.residual_distribution import distribution_panel, normal_panel
from volid.report.plot.residual_regions import moving_pairs, region_panel
from volid.report.plot.residuals import (
    NAME_LENGTH,
    has_times,
    moving_axes,
    order_panel,
    position_panel,
    remarks,
    strips_panel,
)

SIZE = (3.9, 2.7)  # inch, of a panel
LISTED = 10  # readings, and groups, that are listed
LETTER = 0.055  # inch, of a name beside a panel


class Frame(NamedTuple):
    """Height of a panel, and what is left free beside it, at the left and at the right [inch]."""

    height: float = SIZE[1]
    left: float = 0.56
    right: float = 0.16


def build(contents: Contents, texts: Texts) -> Section | None:
    """Figures of the residuals, and tables by set, by group, of the worst readings, held out, and of what explains a misfit."""
    readings = readings_of(contents.solution)
    summary = contents.summary
    body = render(
        "residuals.html",
        texts,
        summary=summary,
        testable=bool(readings.used.any()),
        redundancy=_redundancy(contents, readings),
        panels=list(panels_of(readings, texts)),
        strips=list(_strips(readings)),
        groups=_groups(contents, texts),
        flagged=_flagged(contents),
        worst=_worst(contents, readings, texts),
        readings=readings,
        remarks=remarks(readings, texts),
        timed=has_times(readings),
        listed=LISTED,
    )
    return Section("residuals", texts("page.section_residuals"), body)


def panels_of(readings: Readings, texts: Texts) -> Iterator[Markup]:
    """The figures of the section one after the other: by station, over time, distributions, positions, regions."""
    names = max(len(s.name) for s in readings.strips)
    frame = Frame(max(SIZE[1], 1.0 + 0.15 * len(readings.strips)), 0.25 + LETTER * min(names, NAME_LENGTH + 1), 0.5)
    yield _drawn(partial(strips_panel, readings=readings), texts("residuals.by_station"), texts, frame)
    over = texts("residuals.over_time" if has_times(readings) else "residuals.over_order")
    yield _drawn(partial(order_panel, readings=readings), over, texts)
    if not readings.used.any():
        return
    yield _drawn(partial(distribution_panel, readings=readings), texts("residuals.distribution"), texts)
    yield _drawn(partial(normal_panel, readings=readings), texts("residuals.probability"), texts)
    axes = readings.campaign.machine.axes
    for i in moving_axes(readings):
        label = texts("residuals.over_axis", axis=axes[i].letter)
        yield _drawn(partial(position_panel, readings=readings, i=i), label, texts)
    for pair in moving_pairs(readings):
        label = texts("residuals.region_of", axes=", ".join(axes[i].letter for i in pair))
        yield _drawn(partial(region_panel, readings=readings, pair=pair), label, texts)


def _drawn(draw: Callable[..., Any], label: str, texts: Texts, frame: Frame | None = None) -> Markup:
    """One panel as SVG, its dots as a picture that is sharp in print. To find margins would take as long as to draw."""
    frame = Frame() if frame is None else frame
    figure, panel = figure_with_panels(figsize=(SIZE[0], frame.height))
    figure.set_layout_engine(None)
    figure.set_dpi(RESOLUTION)
    low, high = 0.45 / frame.height, 1.0 - 0.4 / frame.height
    figure.subplots_adjust(frame.left / SIZE[0], low, 1.0 - frame.right / SIZE[0], high)
    draw(panel, texts=texts)
    if not panel.get_title(loc="left"):
        panel.set_title(label, fontsize=8, loc="left")
    finished(figure, texts)
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


def _redundancy(contents: Contents, readings: Readings) -> float:
    """How many readings check others; from the readings that are kept where a file of an earlier version does not say it."""
    stated = contents.solution.adequacy.redundancy
    return stated if math.isfinite(stated) else float(readings.redundancy[~readings.outlier].sum())


def _flagged(contents: Contents) -> list[bool]:
    """Which groups have residuals that are significantly too large, all groups counted."""
    groups = contents.solution.adequacy.groups
    return [g.probability * len(groups) < SIGNIFICANT and g.unit_weight > 1.0 for g in groups]


def _groups(contents: Contents, texts: Texts) -> list[dict[str, Any]]:
    """Groups with their names in the language; one of an earlier version, or of a part that is not kept, stays English."""
    facts = group_facts(contents.solution.campaign)
    return [
        {"group": g, "what": group_words(facts[g.what], texts) if g.what in facts else "", "english": g.what}
        for g in contents.solution.adequacy.groups
    ]


def _worst(contents: Contents, readings: Readings, texts: Texts) -> list[dict[str, Any]]:
    """Readings set aside and readings beyond the critical value, the largest first, with the key and the number of each.

    Of readings that were read part by part only a sample is drawn: those that are not have no number.
    """
    numbered = {(readings.where(n), readings.label(n)): k for k, n in enumerate(readings.worst, 1)}
    labels = {(readings.where(n), readings.label(n)): readings.label(n, texts) for n in readings.beyond}
    found = [
        {
            **reading,
            "label": labels.get((reading["where"], reading["label"]), reading["label"]),
            "key": f"{key}.{i}",
            "aside": key == "outliers",
            "number": numbered.get((reading["where"], reading["label"])),
        }
        for key in ("outliers", "suspects")
        for i, reading in enumerate(contents.summary[key])
    ]
    return sorted(found, key=lambda reading: -abs(reading["normalised"]))
