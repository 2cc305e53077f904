"""Section "functions" of the page: error motions as small multiples with U, axis by axis, and their ranges as numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from volid.fitting.solution import Solution
from volid.model.iso230 import parse
from volid.model.machine import Axis
from volid.report.contents.contents import Contents
from volid.report.language import Texts
from volid.report.page.numbers import Numbers, places_of
from volid.report.page.section import Section, svg
from volid.report.plot.curves import Curve, K, cross_effect, curves, limits, shown_axes
from volid.report.plot.functions import (
    cross_names,
    draw_cross_effect,
    draw_function,
    largest_of,
    legend_of_ways,
    remarks,
)
from volid.report.plot.panels import SMALL_SIZE, small_panel
from volid.report.symbols import in_words

POINTS = 101  # of a curve
LEGEND = 0.22  # inches of the legend's height
MAP_SIZE = (3.4, 2.5)


def build(contents: Contents, texts: Texts) -> Section | None:
    """The section; None behind a barrier, and where the model has no error motions."""
    solution = contents.solution
    axes = shown_axes(solution)
    if solution.adequacy.barrier or not axes:
        return None
    found = curves(solution, axes, POINTS)
    ends = limits(c for c in found.values() if c.known > 0.0)
    numbers = {row["name"]: row for row in contents.summary["functions"]}
    parts = [_introduction(found, axes, ends, texts)]
    for axis in axes:
        own = {name: c for name, c in found.items() if c.axis.letter == axis.letter}
        parts += [_axis(axis, own, ends, texts), _table(axis, [numbers[name] for name in own], texts)]
    parts.append(_maps(solution, texts))
    return Section("functions", texts("page.section_functions"), Markup("\n").join(parts))


def _introduction(found: Mapping[str, Curve], axes: list[Axis], ends: Mapping[str, Any], texts: Texts) -> Markup:
    """What the panels show, the one legend, and what they do not show, each said once."""
    text = texts("functions.introduction", scales=texts("functions.same_scales"))
    lines = Markup("").join(Markup("<li>{}</li>").format(line) for line in remarks(found, axes, texts))
    listed = Markup('<ul class="note">{}</ul>').format(lines) if lines else ""
    return Markup('<p>{}</p>\n<div class="legend">{}</div>\n{}').format(text, _legend(found, ends, texts), listed)


def _legend(found: Mapping[str, Curve], ends: Mapping[str, Any], texts: Texts) -> Markup:
    """The legend of all panels as a figure of its own."""
    by_ways = {way.direction: c for c in found.values() if c.known > 0.0 for way in c.ways}
    scratch = [small_panel()[1] for _ in by_ways]
    for panel, c in zip(scratch, by_ways.values(), strict=True):
        draw_function(panel, c, texts, ends)
    handles, labels = legend_of_ways(scratch, texts)
    figure, panel = small_panel((SMALL_SIZE[0], LEGEND * len(labels)), (0.0, 0.0, 0.0, 0.0))
    panel.set_axis_off()
    panel.legend(handles, labels, fontsize=8, frameon=False, loc="center left", borderaxespad=0.0)
    return svg(figure, "; ".join(labels))


def _axis(axis: Axis, own: Mapping[str, Curve], ends: Mapping[str, Any], texts: Texts) -> Markup:
    """The panels of an axis: those of its functions that the data determine somewhere."""
    panels = [_panel(c, ends, texts) for c in own.values() if c.known > 0.0]
    heading = Markup("<h3>{}</h3>").format(texts("functions.axis_heading", axis=axis.letter))
    body = Markup("\n").join(Markup("<div>{}</div>").format(panel) for panel in panels)
    return Markup('{}\n<div class="panels">\n{}\n</div>').format(heading, body) if panels else heading


def _panel(shown: Curve, ends: Mapping[str, Any], texts: Texts) -> Markup:
    figure, panel = small_panel()
    draw_function(panel, shown, texts, ends)
    panel.set_ylabel(shown.unit, fontsize=8, labelpad=2)
    panel.set_xlabel(f"{shown.axis.letter} / {shown.axis.unit}", fontsize=8, labelpad=1)
    return svg(figure, f"{shown.name}: {in_words(shown.name, texts)}")


def _table(axis: Axis, rows: list[Mapping[str, Any]], texts: Texts) -> Markup:
    """Ranges and largest U of an axis's functions, with the largest reversal where a function has one."""
    reversal = any(row["largest_reversal"] is not None for row in rows)
    keys = ["function", "range", "u", *(["reversal"] if reversal else [])]
    words = [texts(f"functions.table_{key}") for key in keys]
    head = Markup('<th scope="col">{}</th>').format(words[0])
    head += Markup("").join(Markup('<th scope="col" class="n">{}</th>').format(word) for word in words[1:])
    body = Markup("\n").join(_row(row, reversal, texts) for row in rows)
    low, high = (Numbers(texts).position(end, axis.unit) for end in axis.travel)
    caption = Markup(texts("functions.table_caption")).format(axis=axis.letter, low=low, high=high)
    return Markup(
        '<table class="ranges"><caption>{}</caption>\n<thead><tr>{}</tr></thead>\n<tbody>\n{}\n</tbody></table>'
    ).format(caption, head, body)


def _row(row: Mapping[str, Any], reversal: bool, texts: Texts) -> Markup:
    numbers, name, unit = Numbers(texts), row["name"], row["unit"]
    key, u = f"functions.{name}", row["largest_u"]
    expanded = None if u is None else K * u
    places = places_of(expanded, unit)
    cells: list[Markup | str] = [
        numbers.number(row["range"], unit, f"{key}.range", places),
        numbers.number(expanded, unit, f"{key}.largest_U", places),
    ]
    if reversal:
        has = row["largest_reversal"] is not None
        cells.append(numbers.number(row["largest_reversal"], unit, f"{key}.largest_reversal", places) if has else "–")
    named = Markup('<th scope="row"><b>{}</b> {}</th>').format(name, in_words(name, texts))
    return Markup("<tr>{}{}</tr>").format(
        named, Markup("").join(Markup('<td class="n">{}</td>').format(c) for c in cells)
    )


def _maps(solution: Solution, texts: Texts) -> Markup:
    """The error motions of two axes as maps, all of one unit at one scale."""
    names = cross_names(solution)
    if not names:
        return Markup("")
    fields = {name: cross_effect(solution, name) for name in names}
    panels = []
    for name in names:
        alike = largest_of(fields[n][2] for n in names if parse(n).is_rotation == parse(name).is_rotation)
        figure, panel = small_panel(MAP_SIZE, (0.6, 0.42, 0.9, 0.26))
        areas = draw_cross_effect(panel, solution, name, fields[name], alike, texts)
        box = panel.get_position()
        bar = figure.add_axes((box.x1 + 0.03, box.y0, 0.03, box.height))
        figure.colorbar(areas, cax=bar).set_label(parse(name).report_unit, fontsize=8)
        bar.tick_params(labelsize=8)
        panels.append(Markup("<div>{}</div>").format(svg(figure, f"{name}: {in_words(name, texts)}")))
    heading = texts("functions.cross_heading")
    return Markup('<h3>{}</h3>\n<div class="panels">\n{}\n</div>').format(heading, Markup("\n").join(panels))
