"""Section "constants" of the page: squareness and location errors with U, in words and as sketches."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from volid.model.iso230 import DIRECTIONS, ROTARY_AXES, ROTATIONS, SPINDLE, TRANSLATIONS, parse
from volid.model.machine import Machine
from volid.report.contents.contents import Contents
from volid.report.language import Texts
from volid.report.page.section import Section, svg
from volid.report.page.templates import render
from volid.report.plot.axis_lines import LinePlace, line_places, stands_in_its_frame
from volid.report.plot.squareness import Angle, angles_of, sketch_panel, sketch_panels
from volid.report.symbols import angle_words, constant_words, plain_symbol

MINUS = "\N{MINUS SIGN}"
_GROUPS = ("squareness", "location_errors", "tool_frame")


def build(contents: Contents, texts: Texts) -> Section | None:
    """Tables of the constants, sketches of those that can be drawn, and the names of those that are not determined."""
    summary, machine = contents.summary, contents.solution.machine
    groups = {key: [_row(entry, key, machine, texts) for entry in summary[key]] for key in _GROUPS}
    rows = [row for group in groups.values() for row in group]
    if not rows:
        return None
    body = render(
        "constants.html",
        texts,
        groups={key: group for key, group in groups.items() if group},
        unknown=[row["symbol"] for row in rows if row["value"] is None],
        held=summary["held_tool_frame"],
        sketches=_sketches(contents, texts),
        inclined=[a.letter for a in machine.axes if a.axis_frame],
    )
    return Section("constants", texts("page.section_constants"), body)


def both_symbols(name: str, full: str | None) -> str:
    """The symbol that other tables have, and beside it the full form of ISO 230-1, as the sketches have it.

    >>> both_symbols("EC0Y", "EC(0X)Y"), both_symbols("EX(0A)C", None)
    ('EC0Y, EC(0X)Y', 'EX(0A)C')
    """
    return name if full in (None, name) else f"{name}, {full}"


def _sketches(contents: Contents, texts: Texts) -> list[dict[str, Markup]]:
    """Small drawings with their keys, those of angles first."""
    found: list[dict[str, Markup]] = []
    sketches: list[Angle | LinePlace] = [*angles_of(contents.solution), *line_places(contents.solution)]
    for sketch in sketches:
        figure, (panel,) = sketch_panels()
        sketch_panel(panel, sketch, texts)
        is_angle = isinstance(sketch, Angle)
        label = panel.get_title().replace("\n", ", ")
        found.append({"drawing": svg(figure, label), "kind": Markup("angle" if is_angle else "line")})
    return found


def _row(entry: Mapping[str, Any], key: str, machine: Machine, texts: Texts) -> dict[str, Any]:
    """A constant of the summary with its symbol, its meaning, and what its sign says."""
    name = plain_symbol(entry["name"])
    return {
        **entry,
        "symbol": both_symbols(entry["name"], entry.get("symbol")),
        "meaning": constant_words(entry["name"], texts),
        "sign": _sign(name, entry, machine, texts),
        "key": f"{key}.{entry['name']}",
    }


def _sign(name: str, entry: Mapping[str, Any], machine: Machine, texts: Texts) -> str:
    """What the sign of a constant says of the machine; "" where it is not determined or says nothing more."""
    value, expanded = entry["value"], entry["U"]
    if value is None or expanded is None:
        return ""
    error = parse(name)
    if error.axis not in (*ROTARY_AXES, SPINDLE):
        return angle_words(name, value, expanded, texts)
    if error.axis != SPINDLE and not stands_in_its_frame(machine.axis(error.axis)):
        return ""
    return side_in_words(name, value, expanded, texts)


def side_in_words(name: str, value: float, expanded: float, texts: Texts) -> str:
    """Where a line is displaced to, or which way its positive end leans: ω × w (`volid.report.plot.axis_lines`)."""
    error = parse(name)
    along = 2 if error.axis == SPINDLE else ROTARY_AXES.index(error.axis)
    component = DIRECTIONS.index(error.direction) % 3
    if component == along:
        return ""
    if abs(value) <= expanded:
        return texts("constants.nothing")
    if error.direction not in ROTATIONS:
        return texts("constants.displaced", side=_signed(value, TRANSLATIONS[component]))
    about_second = component == (along + 2) % 3
    towards = (along + 1) % 3 if about_second else (along + 2) % 3
    side = _signed(value if about_second else -value, TRANSLATIONS[towards])
    return texts("constants.leaning", end=f"+{TRANSLATIONS[along]}", side=side)


def _signed(value: float, letter: str) -> str:
    return f"{'+' if math.copysign(1.0, value) > 0.0 else MINUS}{letter}"
