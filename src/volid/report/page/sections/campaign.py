"""Section "campaign" of the page: the record of ISO/TR 16907 9.1, what of it is missing, instruments and sets of readings."""

from __future__ import annotations

from typing import Any

from volid.campaign import Campaign
from volid.observations import KINDS
from volid.plausibility.record import NO, SYNTHETIC, YES
from volid.report.contents.contents import Contents
from volid.report.contents.names import part_words
from volid.report.language import Texts
from volid.report.page.section import Section
from volid.report.page.templates import render

MOST_TOOLS = 8  # tool vectors that are written out


def build(contents: Contents, texts: Texts) -> Section | None:
    """The record, axes and measured ranges, sets with u and residuals."""
    campaign = contents.solution.campaign
    named = [item for item in contents.record if item.name]
    kinds = part_words(campaign, texts)
    body = render(
        "campaign.html",
        texts,
        campaign=campaign,
        summary=contents.summary,
        items=[item for item in named if not item.is_missing],
        missing=[item for item in named if item.is_missing],
        further=[pair for item in contents.record if not item.name for pair in item.stated],
        keys={SYNTHETIC: texts("names.synthetic")},
        words={"": texts("campaign.none"), YES: texts("page.yes"), NO: texts("page.no")},
        tools=_tools(campaign),
        sets=[_set(row, campaign, kind) for row, kind in zip(contents.summary["sets"], kinds, strict=True)],
    )
    return Section("campaign", texts("page.section_campaign"), body)


def _tools(campaign: Campaign) -> dict[str, Any]:
    """The tool vectors of the readings: how many, the first ones, and the shortest and longest length [mm]."""
    found = campaign.tool_vectors() if any(KINDS[s.kind].sees_tool(s) for s in campaign.sets) else ()
    lengths = [float((t @ t) ** 0.5) for t in found]
    shown = [t.tolist() for t in found[:MOST_TOOLS]]
    return {"count": len(found), "shown": shown, "lengths": (min(lengths), max(lengths)) if lengths else None}


def _set(row: dict[str, Any], campaign: Campaign, kind: str) -> dict[str, Any]:
    """A row of the summary with the stations of its set."""
    (readings,) = [s for s in campaign.sets if s.name == row["set"]]
    stations = list(dict.fromkeys(map(str, readings.labels.get("station", ()))))
    return {**row, "kind": kind, "stations": stations, "source": readings.source}
