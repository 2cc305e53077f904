"""An evaluation by a standard in words: a table of its quantities with U, limit and verdict, then remarks; and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import Any

from volid.report.text.basics import bullets, micro, table
from volid.standards.results import (
    FAIL,
    RULE,
    SIMPLE,
    SIMPLE_RULE,
    UNDECIDED,
    WITHHELD,
    Evaluation,
    Quantity,
    verdict_of,
)

_SHOWN = {"mm": (1e3, "µm", 2), "rad": (1e6, "µrad", 1), "mm/mm": (1e6, "µm/m", 1), "°": (3600.0, "arc sec", 2)}
_SUBJECT = "subject"


def evaluation_lines(evaluation: Evaluation) -> list[str]:
    """Title, quantities and remarks of one evaluation; lengths in µm, angles of degrees in arc seconds."""
    limits = any(q.limit is not None for q in evaluation.quantities)
    header = ["", "value", "U (k = 2)", *(["limit", "verdict"] if limits else []), "unit", "meaning"]
    rows = [_row(q, limits) for q in evaluation.quantities]
    title = f"{evaluation.standard}, {evaluation.subject}" + (f", {evaluation.source}" if evaluation.source else "")
    lines = [title, *table(header, rows, right=3 if limits else 2)]
    if limits:
        lines.append(f"verdict by {SIMPLE_RULE if evaluation.rule == SIMPLE else RULE}")
    lines += bullets("remarks", evaluation.remarks)
    for section in evaluation.sections:
        lines += ["", f"{section.title}, µm", *table(section.columns, [_cells(row) for row in section.rows])]
    return lines


def _cells(row: Sequence[str | float]) -> list[str]:
    return [cell if isinstance(cell, str) else micro(None if isnan(cell) else cell, "mm", 2) for cell in row]


def evaluations_data(evaluations: Sequence[Evaluation]) -> dict[str, Any]:
    """For JSON: quantities by symbol, in mm or degrees, each with value, U, limit and verdict.

    One evaluation stands at the top. Of several, each stands in a list under `evaluations`, and a symbol that only one of them
    has stands at the top too.
    """
    entries = [_entry(e) for e in evaluations]
    if len(entries) == 1:
        return entries[0]
    symbols = [q.symbol for e in evaluations for q in e.quantities]
    alone = {
        symbol: entry[symbol]
        for symbol in symbols
        if symbols.count(symbol) == 1
        for entry in entries
        if symbol in entry
    }
    return {"evaluations": entries, **alone}


def unproved(evaluations: Sequence[Evaluation]) -> list[str]:
    """A sentence for every limit that is exceeded, or not proved to be kept, with the numbers."""
    return [
        f"{e.subject}: {_unproved(q, e.rule)}"
        for e in evaluations
        for q in e.quantities
        if q.verdict in (FAIL, UNDECIDED)
    ]


def _unproved(quantity: Quantity, rule: str) -> str:
    """Value, U and limit, with as many digits as the verdict needs to be seen in them."""
    scale, unit, _ = _SHOWN.get(quantity.unit, (1.0, quantity.unit, 4))
    limit = f"{scale * (quantity.limit or 0.0):.6g} {unit}"
    if isnan(quantity.value):
        return f"{quantity.symbol} is not determined, so that its limit of {limit} is not judged"
    digits = next((d for d in range(1, 6) if _tells(quantity, rule, scale, d)), 6)
    U = "" if quantity.U is None else f" (U {round(scale * quantity.U, digits):.{digits}f} {unit})"
    found = f"{quantity.symbol} = {round(scale * quantity.value, digits) + 0.0:.{digits}f} {unit}{U}"
    if quantity.withheld:
        return f"{found} is not judged by its limit of {limit}: {WITHHELD[quantity.withheld]}"
    if quantity.verdict == FAIL:
        return f"{found} exceeds {limit}{' in size' if quantity.value < 0 else ''}"
    return f"{found} is within U of its limit of {limit}, so that neither pass nor fail is proved"


def _tells(quantity: Quantity, rule: str, scale: float, digits: int) -> bool:
    """Whether the numbers rounded to so many digits have the verdict of the numbers themselves."""
    if quantity.withheld:
        return True
    margin = None if rule == SIMPLE or quantity.U is None else round(scale * quantity.U, digits)
    limit = scale * (quantity.limit or 0.0)
    return verdict_of(round(scale * quantity.value, digits), limit, margin) == quantity.verdict


def evaluation_rows(evaluations: Sequence[Evaluation]) -> tuple[tuple[str, ...], list[list[Any]]]:
    """Columns and rows of the tables of all evaluations, the subject in front where there are several."""
    columns = list(dict.fromkeys(name for e in evaluations for name in e.table.columns))
    rows = []
    for e in evaluations:
        for cells in e.table.rows:
            row = dict(zip(e.table.columns, cells, strict=True))
            rows.append([e.subject, *(row.get(name, "") for name in columns)])
    return (_SUBJECT, *columns), rows


def _row(quantity: Quantity, limits: bool) -> list[str]:
    scale, unit, digits = _SHOWN.get(quantity.unit, (1.0, quantity.unit, 4))

    def cell(value: float | None) -> str:
        return "" if value is None else f"{round(scale * value, digits) + 0.0:.{digits}f}"

    judged = [cell(quantity.limit), quantity.verdict] if limits else []
    return [quantity.symbol, cell(quantity.value), cell(quantity.U), *judged, unit, quantity.text]


def _entry(evaluation: Evaluation) -> dict[str, Any]:
    return {
        "standard": evaluation.standard,
        "subject": evaluation.subject,
        "source": evaluation.source,
        **{
            q.symbol: {"value": q.value, "unit": q.unit, "U": q.U, "limit": q.limit, "verdict": q.verdict or None}
            | ({"withheld": WITHHELD[q.withheld]} if q.withheld else {})
            for q in evaluation.quantities
        },
        "remarks": list(evaluation.remarks),
        "attention": list(evaluation.attention),
        **{s.key: {"title": s.title, "columns": s.columns, "rows": s.rows} for s in evaluation.sections},
    }
