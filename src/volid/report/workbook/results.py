"""Sheets of what was found about the machine: constants, error motions, the working volume, compensation, the budget.

Lengths are in µm, rotations in µrad, positions in mm or degrees, U has k = 2.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from volid.compensation.residual.fields import ANGLES, QUANTITIES
from volid.compensation.residual.forecast import NONE, Forecast
from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.io.functions_csv import round_place
from volid.model.axis_lines import MACHINE
from volid.model.iso230 import DIRECTIONS
from volid.report.certificate.statements import rule_words
from volid.report.contents.contents import Contents
from volid.report.contents.curves import Curve, curves, hidden_waves, plain_symbol
from volid.report.contents.volume import volume_values
from volid.report.language import Texts
from volid.report.symbols import angle_words, in_words
from volid.report.text.basics import scale_of, unit_of
from volid.report.workbook.table import Chart, Column, Table, micro_of, micro_row
from volid.standards.results import Evaluation

K = 2.0
MIXED = "µm, µrad"
_OWN_WORDS = {"largest": "remaining_largest", "tool axis": "tool_axis"}  # quantities that are no symbols


def squareness_sheet(summary: Mapping[str, Any], texts: Texts) -> Table:
    """Squareness errors, with the angle in words."""
    columns = [
        Column(texts("workbook.symbol")),
        Column(texts("workbook.description"), width=48),
        Column(texts("workbook.value"), "µrad", spread=1),
        Column("U (k = 2)", "µrad", spread=0),
        Column(texts("workbook.angle"), width=44),
    ]
    rows = [
        [
            r["symbol"],
            in_words(r["name"], texts),
            *micro_row(r, "value", "U")[:2],
            angle_words(r["name"], r["value"], r["U"], texts) or texts("workbook.not_determined"),
        ]
        for r in summary["squareness"]
    ]
    return Table(texts("workbook.sheet_squareness"), columns, rows)


def location_sheet(summary: Mapping[str, Any], texts: Texts) -> Table:
    """Location errors of rotary axes, and constants of the tool frame."""
    columns = [
        Column(texts("workbook.symbol")),
        Column(texts("workbook.description"), width=48),
        Column(texts("workbook.relative_to")),
        Column(texts("workbook.axis_line"), MIXED, spread=1),
        Column("U (k = 2)", MIXED, spread=0),
        Column(texts("workbook.parameter"), MIXED, 24, spread=-1),
        Column(texts("workbook.unit")),
    ]
    rows: list[list[Any]] = []
    for r in summary["location_errors"]:
        line, expanded, parameter, unit = micro_row(r, "line", "U", "parameter")
        rows.append(
            [
                r["name"],
                in_words(plain_symbol(r["name"]), texts),
                _carrier(r["relative_to"], texts),
                line,
                expanded,
                parameter,
                unit,
            ]
        )
    for r in summary["tool_frame"]:
        value, expanded, unit = micro_row(r, "value", "U")
        rows.append([r["name"], in_words(r["name"], texts), texts("workbook.tool_frame"), value, expanded, value, unit])
    return Table(texts("workbook.sheet_locations"), columns, rows)


def _carrier(relative_to: str, texts: Texts) -> str:
    """What a location error refers to, in words: the machine frame, or the line of an axis."""
    return texts("workbook.machine_frame") if relative_to == MACHINE else relative_to


def function_sheets(solution: Solution, texts: Texts) -> Iterator[Table]:
    """One sheet per axis with its error motions over its positions, each followed by its U, and two charts."""
    found = curves(solution)
    hidden = hidden_waves(solution, found)
    for axis in sorted(solution.machine.axes, key=lambda a: DIRECTIONS.index(a.letter)):
        own = [c for c in found if c.error.axis == axis.letter]
        values = [w.values(texts.language == "de") for w in hidden if w.axis == axis.letter]
        if own:
            notes = [texts("certificate.short_waves", **said) for said in values]
            yield replace(_function_sheet(axis.letter, axis.unit, own, texts), notes=notes)


def _function_sheet(letter: str, unit: str, own: Sequence[Curve], texts: Texts) -> Table:
    position = Column(texts("workbook.position", axis=letter), unit)
    places = sorted({round_place(float(x)) for curve in own for x in curve.positions})
    blocks = [_block(curve, texts) for curve in own]
    rows: list[list[Any]] = [[x] for x in places]
    starts = [1]
    for curve, (columns, values) in zip(own, blocks, strict=True):
        at = {round_place(float(x)): row for x, row in zip(curve.positions, values.tolist(), strict=True)}
        for row in rows:
            row += at.get(row[0], [None] * len(columns))
        starts.append(starts[-1] + len(columns))
    name = f"{texts('workbook.sheet_functions')} {letter}"
    charts = [
        replace(_chart(own, starts, rotations, letter, texts), x=position.heading, reach=(places[0], places[-1]))
        for rotations in (False, True)
        if any(c.error.is_rotation == rotations for c in own)
    ]
    return Table(name, [position, *(c for columns, _ in blocks for c in columns)], rows, charts)


def _block(curve: Curve, texts: Texts) -> tuple[list[Column], np.ndarray]:
    """Columns of a function and their numbers (m, columns): value, U, and coverage intervals where there are samples."""
    unit = curve.error.report_unit
    columns = [Column(curve.title, unit, spread=1), Column(f"U({curve.title})", unit, spread=0)]
    numbers = [np.where(curve.known, value, np.nan) for value in (curve.values, K * curve.u)]
    if curve.low is not None and curve.high is not None:
        low, high = texts("workbook.low"), texts("workbook.high")
        columns += [Column(f"{curve.title} {low}", unit, spread=-1), Column(f"{curve.title} {high}", unit, spread=-2)]
        numbers += [curve.low, curve.high]
    return columns, scale_of(curve.error.unit) * np.stack(numbers, axis=1)


def _chart(own: Sequence[Curve], starts: Sequence[int], rotations: bool, letter: str, texts: Texts) -> Chart:
    drawn = [(c, start) for c, start in zip(own, starts[:-1], strict=True) if c.error.is_rotation == rotations]
    title = texts("workbook.chart_rotations" if rotations else "workbook.chart_translations", axis=letter)
    unit = drawn[0][0].error.report_unit
    return Chart(title, "", unit, [(c.title, 0, start, start + 1) for c, start in drawn], (0.0, 0.0))


def volume_sheet(contents: Contents, texts: Texts) -> Table:
    """Volumetric accuracy and the largest deviation, with U, and what an L-VOL grid leaves."""
    columns = [
        Column(texts("workbook.quantity"), width=60),
        Column(texts("workbook.value"), MIXED, spread=_spread),
        Column("U (k = 2)", MIXED, spread=_spread),
        Column(texts("workbook.low"), MIXED, spread=_spread),
        Column(texts("workbook.high"), MIXED, spread=_spread),
        Column(texts("workbook.unit")),
        Column(texts("workbook.place"), width=40),
    ]
    summary, letters = contents.summary, contents.solution.machine.letters
    x, y, z = contents.tool
    rows: list[list[Any]] = [[texts("workbook.tool", x=f"{x:g}", y=f"{y:g}", z=f"{z:g}"), *[None] * 6]]
    for v in volume_values(contents):
        numbers = (scale_of(v.unit) * v.value, scale_of(v.unit) * v.U)
        place = [f"{a} {p:g}" for a, p in zip(letters, v.place, strict=False)]
        rows.append(
            [
                texts(f"workbook.{v.key}"),
                *numbers,
                None,
                None,
                unit_of(v.unit),
                ", ".join(place) or (texts("workbook.blank") if np.isnan(v.value) else ""),
            ]
        )
    return Table(texts("workbook.sheet_volume"), columns, [*rows, *_expected(summary["volume"], texts)])


def _spread(row: Sequence[Any]) -> float | None:
    """U of a row, or half of its interval."""
    _, _, expanded, low, high, *_ = row
    return expanded if low is None or high is None else 0.5 * (high - low)


def _expected(volume: Mapping[str, Any], texts: Texts) -> Iterator[list[Any]]:
    """The largest deviation without the rigid motion of the workpiece, and what is expected to remain; or why it is not known."""
    for key in ("free", "after"):
        found = volume["before"]["without_rigid_motion"] if key == "free" else volume["after"]
        if found is not None:
            ends = [micro_of(end, "mm") for end in found["max_interval_95"]]
            label = texts(f"workbook.{key}_max", type=found.get("type", ""))
            yield [label, micro_of(found["max"], "mm"), None, *ends, "µm", ""]
            label = texts(f"workbook.{key}_rms", type=found.get("type", ""))
            yield [label, micro_of(found["rms"], "mm"), None, None, None, "µm", ""]
    if volume["left_out"]:
        yield [texts("workbook.left_out", names=", ".join(volume["left_out"])), *[None] * 6]
    if volume["not_predicted"]:
        yield [texts("workbook.not_predicted", reason=volume["not_predicted"]), *[None] * 6]


def _half(row: Sequence[Any]) -> float:
    """Half of the interval of a row of the forecast."""
    return 0.5 * (float(row[7]) - float(row[6]))


def limits_sheet(found: Evaluation, texts: Texts) -> Table:
    """Quantities that were judged by limits, with the decision rule."""
    columns = [
        Column(texts("workbook.symbol"), width=20),
        Column(texts("workbook.value"), MIXED, spread=1),
        Column("U (k = 2)", MIXED, spread=0),
        Column(texts("workbook.limit"), MIXED),
        Column(texts("workbook.unit")),
        Column(texts("workbook.conformity"), width=16),
        Column(texts("workbook.rule"), width=90),
    ]
    rows: list[list[Any]] = []
    for q in (q for q in found.quantities if q.limit is not None):
        numbers = [micro_of(v, q.unit) for v in (q.value, q.U, q.limit)]
        rule = rule_words(q, found.rule, texts)
        rows.append([q.symbol, *numbers, unit_of(q.unit), texts(f"limits.{q.verdict}"), rule])
    return Table(texts("workbook.sheet_limits"), columns, rows)


def forecast_sheet(found: Forecast, texts: Texts) -> Table:
    """What each type of compensation leaves over the working volume, one row per tool vector and quantity."""
    columns = [
        Column(texts("workbook.type"), width=20),
        *(Column(f"{texts('workbook.tool_vector')} {c}", "mm") for c in "xyz"),
        Column(texts("workbook.quantity")),
        Column(texts("workbook.remaining"), MIXED, spread=_half),
        Column(texts("workbook.low"), MIXED, spread=_half),
        Column(texts("workbook.high"), MIXED, spread=_half),
        Column(texts("workbook.exact"), MIXED, 24, spread=_half),
        Column(texts("workbook.unit")),
    ]
    rows: list[list[Any]] = []
    for column in found.columns:
        own = texts("workbook.without") if column.name == NONE else column.name
        for tool, p in zip(found.tools.tolist(), column.predictions, strict=True):
            for k, name in enumerate(QUANTITIES):
                unit = "rad" if name in ANGLES else "mm"
                value, low, high, exact = (float(v[k]) * scale_of(unit) for v in p)
                label = texts(f"workbook.{_OWN_WORDS[name]}") if name in _OWN_WORDS else name
                rows.append([own, *tool, label, value, low, high, exact, unit_of(unit)])
    return Table(texts("workbook.sheet_compensation"), columns, rows)


def _tenths(row: Sequence[Any]) -> float:
    """What shows one decimal place."""
    return 1.0


def budget_sheet(solution: Solution, tool: Sequence[float], texts: Texts) -> Table:
    """The uncertainty budget: which source contributes how much to which output."""
    from volid.uncertainty.budget import budget, budget_lines, headline_rows
    from volid.uncertainty.outputs import headline_outputs

    columns = [
        Column(texts("workbook.output"), width=20),
        Column(texts("workbook.at_position"), "mm, °"),
        Column("u (k = 1)", MIXED, spread=0),
        Column(texts("workbook.source"), width=48),
        Column(texts("workbook.contribution"), MIXED, spread=0),
        Column(texts("workbook.share"), "%", spread=_tenths),
        Column(texts("workbook.unit")),
    ]
    try:
        found = budget(solution)
    except InputError as reason:  # a solution that was fitted part by part
        return Table(texts("workbook.sheet_budget"), columns, [[None, None, None, str(reason), None, None, None]])
    lines = budget_lines(found, headline_rows(solution, headline_outputs(solution, np.asarray(tool))))
    rows = [
        [
            x.output, round_place(x.position), scale_of(x.unit) * x.u, x.source, scale_of(x.unit) * x.contribution,
            100.0 * x.share, unit_of(x.unit),
        ]
        for x in lines
    ]  # fmt: skip
    return Table(texts("workbook.sheet_budget"), columns, rows)
