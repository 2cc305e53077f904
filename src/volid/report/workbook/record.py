"""Sheets of the record: result, campaign, sets, what is not determined, provenance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isnan
from typing import Any

from volid.fitting.solution import Solution
from volid.io.functions_csv import source_lines
from volid.plausibility.record import NO, YES, Item
from volid.report.contents.contents import Contents
from volid.report.contents.curves import plain_symbol
from volid.report.contents.names import part_words
from volid.report.contents.volume import volume_values
from volid.report.language import Texts
from volid.report.symbols import angle_words, in_words
from volid.report.text.basics import scale_of, unit_of
from volid.report.workbook.table import Column, Table, micro_of, micro_row

WORDS = 90  # width of a column of sentences


def result_sheet(contents: Contents, texts: Texts) -> Table:
    """The first sheet: verdict, what was measured, and the numbers most asked for."""
    columns = [
        Column(texts("workbook.what"), width=44),
        Column(texts("workbook.text"), width=WORDS),
        Column(texts("workbook.value"), "µm, µrad", spread=1),
        Column("U (k = 2)", "µm, µrad", spread=0),
        Column(texts("workbook.unit")),
    ]
    summary = contents.summary
    rows: list[list[Any]] = [[label, text, None, None, ""] for label, text in _facts(summary, texts)]
    for r in summary["squareness"]:
        words = angle_words(r["name"], r["value"], r["U"], texts) or texts("workbook.not_determined")
        rows.append([r["symbol"], words, *micro_row(r, "value", "U")])
    for v in volume_values(contents):
        scale = scale_of(v.unit)
        words = texts("workbook.blank") if isnan(v.value) else ""
        rows.append([texts(f"workbook.{v.key}"), words, scale * v.value, scale * v.U, unit_of(v.unit)])
    if summary["weakest"]:
        w = summary["weakest"]
        value = micro_of(w["U"], w["unit"])
        rows.append(
            [
                texts("workbook.weakest"),
                f"{w['name']}: {in_words(plain_symbol(w['name']), texts)}",
                None,
                value,
                unit_of(w["unit"]),
            ]
        )
    return Table(texts("workbook.sheet_result"), columns, rows)


def _facts(summary: Mapping[str, Any], texts: Texts) -> Iterator[tuple[str, str]]:
    yield texts("workbook.verdict"), texts(f"workbook.grade_{summary['grade'].replace(', ', '_').replace(' ', '_')}")
    yield texts("workbook.verdict_words"), summary["verdict"]
    yield texts("workbook.lack_of_fit"), summary["lack_of_fit"]["words"]
    if not summary["converged"]:
        yield texts("workbook.converged"), texts("workbook.not_converged")
    for question in summary["questions"]:
        yield texts("workbook.question"), question["text"]
    for cause in summary["causes"]:
        yield texts("workbook.cause"), f"{cause['what']}. {cause['cure']}"
    yield texts("workbook.machine"), f"{summary['machine']['name']} [{summary['machine']['structure']}]"
    yield texts("workbook.campaign"), summary["campaign"]
    yield texts("workbook.datum"), summary["datum"]
    for axis in summary["axes"]:
        (low, high), (first, last) = axis["travel"], axis["measured"]
        words = {"low": f"{low:g}", "high": f"{high:g}", "first": f"{first:g}", "last": f"{last:g}"}
        yield texts("workbook.axis", axis=axis["axis"]), texts("workbook.travel", unit=axis["unit"], **words)
    open_ = len(summary["not_determined"])
    yield texts("workbook.sheet_open"), texts("workbook.open_count", count=open_)
    for note in summary["notes"]:
        yield texts("workbook.note"), note


def campaign_sheet(contents: Contents, texts: Texts) -> Table:
    """The record of conditions, ISO/TR 16907 9.1: what it asks for first, and what is missing by name; then all other keys."""
    columns = [
        Column(texts("workbook.what"), width=44),
        Column(texts("workbook.key"), width=32),
        Column(texts("workbook.text"), width=WORDS),
    ]
    rows = [row for item in contents.record for row in _item(item, texts)]
    rows += [
        [texts("workbook.station", name=s.name), "", _station(s, texts)] for s in contents.solution.campaign.stations
    ]
    return Table(texts("workbook.sheet_campaign"), columns, rows)


def _item(item: Item, texts: Texts) -> Iterator[list[str]]:
    """The lines of an item of the record: what was stated, where it was measured, or that it is missing."""
    label = texts(f"workbook.recorded_{item.name or 'other'}")
    for key, text in item.stated:
        yield [
            label,
            key,
            {"": texts("workbook.none_stated"), YES: texts("page.yes"), NO: texts("page.no")}.get(text, text),
        ]
    for kind, name in item.measured:
        yield [label, "", texts(f"workbook.measured_{kind}", name=name)]
    if item.is_missing:
        yield [label, "", texts("workbook.not_recorded")]
    elif not (item.stated or item.measured):
        yield [label, "", texts("workbook.in_readings")]


def _station(station: Any, texts: Texts) -> str:
    if station.position is None:
        return texts("workbook.station_on", body=station.body)
    place = ", ".join(f"{v:g}" for v in station.position)
    return texts("workbook.station_at", body=station.body, place=place)


def sets_sheet(contents: Contents, texts: Texts) -> Table:
    """Every set of readings: how many, their u, their residuals."""
    columns = [
        Column(texts("workbook.set"), width=28),
        Column(texts("workbook.kind"), width=28),
        Column(texts("workbook.readings")),
        Column(texts("workbook.outliers")),
        Column(texts("workbook.stated_u"), "µm, µrad", spread=0),
        Column(texts("workbook.used_u"), "µm, µrad", spread=0),
        Column(texts("workbook.residual_rms"), "µm, µrad", spread=-1),
        Column(texts("workbook.unit")),
    ]
    keys = ("stated_u_rms", "u_rms", "residual_rms")
    kinds = zip(contents.summary["sets"], part_words(contents.solution.campaign, texts), strict=True)
    rows = [[r["set"], kind, r["n_readings"], r["n_outliers"], *micro_row(r, *keys)] for r, kind in kinds]
    return Table(texts("workbook.sheet_sets"), columns, rows)


def open_sheet(solution: Solution, summary: Mapping[str, Any], texts: Texts) -> Table:
    """What the data do not determine, and by how many directions; what they cannot see."""
    columns = [Column(texts("workbook.what"), width=44), Column(texts("workbook.text"), width=WORDS)]
    rows = [[texts("workbook.not_determined"), text] for text in summary["not_determined"]]
    rows += [[texts("workbook.unseen"), text] for text in summary["unseen"]]
    rows += [[texts("workbook.held"), name] for name in summary["held_tool_frame"]]
    rows += [
        [name, texts("workbook.directions", count=f"{directions:g}")]
        for name, directions in solution.undetermined.items()
        if directions
    ]
    rows = rows or [[texts("workbook.all_determined"), ""]]
    if names := (summary["volume"] or {}).get("left_out"):
        rows.append([texts("workbook.not_in_model"), ", ".join(names)])
    return Table(texts("workbook.sheet_open"), columns, rows)


def provenance_sheet(solution: Solution, source: str, texts: Texts) -> Table:
    """Where the numbers come from: versions, inputs with their hashes, options."""
    columns = [Column(texts("workbook.what"), width=44), Column(texts("workbook.text"), width=WORDS)]
    record = {**source_lines(solution, source or None), **{f"fit: {k}": v for k, v in solution.provenance.items()}}
    return Table(texts("workbook.sheet_provenance"), columns, [[key, value] for key, value in record.items()])
