"""Section "field" of the page: the deviation field on the deformed volume, in 3-D, and drawn for paper."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup

from volid.report.contents.contents import Contents
from volid.report.contents.deviation_field import DeviationFields, deviation_fields
from volid.report.language import Texts
from volid.report.page.packing import colours, packed
from volid.report.page.section import Section, svg
from volid.report.page.templates import render
from volid.report.plot.field import (
    Scale,
    colour_bar,
    draw_field,
    scale_of,
    state_name,
    state_title,
    texts_number,
)
from volid.report.plot.panels import figure_with_panels, shown_vector

PANEL = (4.1, 3.3)  # inch: one small figure
MIDDLE = (("L-POS", "L-STR", "L-SQU"), ("R-POR",))  # what is drawn between none and all
WORDS = (
    "length", "deviations", "state_place", "place_here", "with_u", "nowhere", "node", "without", "u_note", "drawing",
)  # fmt: skip


def build(contents: Contents, texts: Texts) -> Section | None:
    """The section; without drawings where the data determine no deviation, None behind a barrier."""
    if contents.barrier:
        return None
    forecast = contents.outlook.forecast
    made = {c.name: c.compensation for c in forecast.columns} if forecast else {}
    found = deviation_fields(contents.solution, contents.tool, made=made)
    title = texts("page.section_field")
    if not found.is_known:
        body = render("field.html", texts, found=None, reasons=contents.solution.statements)
        return Section("field", title, body)
    scale = scale_of(found)
    body = render(
        "field.html", texts,
        found=found, reasons=contents.solution.statements,
        drawn=[_drawing(found, s, scale, texts) for s in drawn_states(found)], bar=_bar(scale, texts),
        factor=texts_number(scale.factor, texts), left_out=contents.summary["volume"]["left_out"],
        states=_names(found, texts), tools=[shown_vector(t, texts) for t in found.tools.tolist()],
        places=_places(found), notes=_notes(found, texts), tool=shown_vector(contents.tool, texts),
    )  # fmt: skip
    return Section("field", title, body, _data(found, scale, texts))


def drawn_states(found: DeviationFields) -> list[int]:
    """Numbers of the states that are drawn on paper: none, one between, and that which corrects most."""
    between = [found.states.index(names) for names in MIDDLE if names in found.states]
    return sorted({0, *between[:1], len(found.states) - 1})


def _drawing(found: DeviationFields, state: int, scale: Scale, texts: Texts) -> Markup:
    figure, panel = figure_with_panels(figsize=PANEL)
    draw_field(panel, found, state, scale)
    title = state_title(found, state, texts)
    panel.set_title(title, fontsize=9, loc="left")
    return svg(figure, title)


def _bar(scale: Scale, texts: Texts) -> Markup:
    figure, panel = figure_with_panels(figsize=(4.1, 0.7))
    panel.set_axis_off()
    colour_bar(figure, panel, scale, texts, orientation="horizontal", fraction=1.0, aspect=30)
    return svg(figure, texts("field.length"))


def _names(found: DeviationFields, texts: Texts) -> list[str]:
    return [state_name(names, texts) for names in found.states]


def _places(found: DeviationFields) -> list[str]:
    """Rotary positions in words; one, empty, for a machine without rotary axes."""
    return [", ".join(f"{a} {v:g}°".replace("-", "−") for a, v in place.items()) for place in found.places]


def _notes(found: DeviationFields, texts: Texts) -> list[str]:
    """Which types are not shown, and why."""
    idle = ", ".join(" + ".join(names) for names in found.idle)
    lost = ", ".join(" + ".join(names) for names, _ in found.lost)
    notes = [texts("field.idle", names=idle)] if idle else []
    notes += [texts("field.lost", names=lost)] if lost else []
    return notes + ([texts("field.rigid_open")] if found.rigid.any() else [])


def _data(found: DeviationFields, scale: Scale, texts: Texts) -> dict[str, Any]:
    """Everything that the script draws, lengths of deviations in µm."""
    k, p, s = found.values.shape[:3]
    return {
        "nodes": [np.round(n, 4).tolist() for n in found.lattice.nodes],
        "spacing": found.lattice.spacing,
        "states": _names(found, texts),
        "fields": [packed(1e3 * found.values[i, j, n]) for i in range(k) for j in range(p) for n in range(s)],
        "u": [packed(2e3 * found.u[i, j]) for i in range(k) for j in range(p)],
        "motions": [[float(f"{1e3 * v:.7g}") for v in m.ravel()] for m in found.motions.reshape(-1, 3, 4)],
        "counts": [k, p, s],
        "rotary": len(found.places[0]) > 0,
        "factor": scale.factor,
        "colours": colours(),
        "words": {key: texts(f"field.{key}") for key in WORDS},
        "axes": ["X / mm", "Y / mm", "Z / mm"],
    }
