"""Section "compensation" of the page: what each type of ISO/TR 16907 is expected to leave, side by side."""

from __future__ import annotations

from typing import Any

from markupsafe import Markup

from volid.compensation.residual.fields import QUANTITIES
from volid.compensation.residual.forecast import Column, Forecast
from volid.report.contents.contents import Contents
from volid.report.language import Texts
from volid.report.page.section import Section, svg
from volid.report.page.sections.verdict import BAD, headline_of
from volid.report.page.templates import render

_LARGEST, _MOST, _RMS = (QUANTITIES.index(name) for name in ("largest", "95 %", "RMS"))
_TILT = QUANTITIES.index("tool axis")


def build(contents: Contents, texts: Texts) -> Section | None:
    """A table of the types with 95 % intervals, and the figure; the reason where there is no prediction."""
    found = contents.outlook
    body = render(
        "compensation.html",
        texts,
        outlook=found,
        rows=[_row(column) for column in found.forecast.columns] if found.forecast else [],
        figures=_figures(found.forecast, texts) if found.forecast else [],
        contents=contents,
        holds=headline_of(contents.summary).tone != BAD,
    )
    return Section("compensation", texts("page.section_compensation"), body)


def _row(column: Column) -> dict[str, Any]:
    """Numbers of one list of types for the first tool vector [mm, rad]."""
    p = column.predictions[0]
    values, low, high = p.value.tolist(), p.low.tolist(), p.high.tolist()
    return {
        "name": column.name,
        "largest": values[_LARGEST],
        "interval": (low[_LARGEST], high[_LARGEST]),
        "most": values[_MOST],
        "rms": values[_RMS],
        "tilt": values[_TILT],
        "tilt_interval": (low[_TILT], high[_TILT]),
    }


def _figures(found: Forecast, texts: Texts) -> list[Markup]:
    """What remains, and the orientation, as two small figures, which stand beside each other where there is room."""
    from volid.report.plot.forecast import draw_lengths, draw_orientations
    from volid.report.plot.panels import figure_with_panels

    made = []
    for draw, label in ((draw_lengths, "compensation.lengths"), (draw_orientations, "compensation.orientation")):
        figure, panel = figure_with_panels(figsize=(5.2, 0.34 * len(found.columns) + 1.4))
        draw(panel, found, texts)
        panel.legend(fontsize=8, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        made.append(svg(figure, texts(label)))
    return made
