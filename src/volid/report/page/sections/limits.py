"""Section "limits" of the page: the limits that were given, and conformity by a stated decision rule."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

from volid.report.contents.contents import Contents
from volid.report.contents.quantities import LARGEST
from volid.report.language import Texts
from volid.report.page.section import Section
from volid.report.page.templates import render
from volid.report.symbols import constant_words, plain_symbol, shown_symbol
from volid.standards.results import SIMPLE, WITHHELD, Quantity


def build(contents: Contents, texts: Texts) -> Section | None:
    """Value, U, limit and verdict of everything that has a limit; nothing without limits."""
    if not contents.judged:
        return None
    judged = [q for q in contents.evaluation.quantities if q.limit is not None]
    rule = "simple" if contents.evaluation.rule == SIMPLE else "guard_band"
    rows = [_row(q, texts) for q in judged]
    withheld = {
        key: [row["words"] if not row["symbol"] else row["symbol"] for row in rows if row["withheld"] == key]
        for key in WITHHELD
    }
    shown = {"rows": rows, "rule": rule, "source": contents.limits, "withheld": withheld}
    body = render("limits.html", texts, contents=contents, **shown)
    return Section("limits", texts("page.section_limits"), body)


def _row(quantity: Quantity, texts: Texts) -> dict[str, Any]:
    words = texts("limits.largest") if quantity.symbol == LARGEST else _words(quantity.symbol, texts)
    symbol = "" if quantity.symbol == LARGEST else shown_symbol(quantity.symbol)
    key, withheld = f"evaluation.{quantity.symbol}", quantity.withheld
    places = places_as_stated(quantity.limit or 0.0, quantity.unit)
    return {"quantity": quantity, "symbol": symbol, "words": words, "key": key, "withheld": withheld, "places": places}


def places_as_stated(limit: float, unit: str) -> int:
    """Decimal places, in the unit of the page, that show a limit as it was stated, and one at least: it is exact.

    >>> places_as_stated(0.01225, "mm"), places_as_stated(15e-6, "rad")
    (2, 1)
    """
    moved = {"mm": 3, "rad": 6}.get(unit, 0)
    exponent = Decimal(repr(float(limit))).scaleb(moved).normalize().as_tuple().exponent
    return max(1, -int(exponent))


def _words(symbol: str, texts: Texts) -> str:
    """What a symbol means as something that is limited: the size of a constant, the range of a component or a motion."""
    if symbol.startswith("V_"):
        return texts("limits.accuracy", component=symbol[2:])
    name = plain_symbol(symbol)
    return texts("limits.size" if "0" in name else "limits.range", what=constant_words(symbol, texts))
