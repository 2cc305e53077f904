"""Statements of a certificate: that it is none, what is missing, the verdict on the model, the datum, conformity with limits."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

from volid.report.certificate.administration import Request
from volid.report.certificate.element import add, add_real, add_texts, add_words
from volid.report.contents.curves import HiddenWaves, curves, hidden_waves
from volid.report.language import LANGUAGES, Texts
from volid.standards.results import FAIL, PASS, SIMPLE, Evaluation, Quantity

CONDITIONAL = ("conditionalPass", "conditionalFail")  # of the schema


def add_statements(part: ET.Element, request: Request, conformity: Evaluation) -> None:
    """`dcc:statements` within the administrative data."""
    statements, solution = add(part, "statements"), request.solution
    _declared(statements, "unsigned")
    if missing := request.missing():
        _missing(statements, missing, request.evaluated)
    grade = solution.adequacy.grade.replace(", ", "_").replace(" ", "_")
    verdict = _declared(statements, f"grade_{grade}")
    _words(verdict, solution.adequacy.verdict)
    if not solution.statistics.converged:
        _declared(statements, "not_converged")
    for text in (*solution.statements, *solution.unseen):
        _words(_declared(statements, "limitation"), text)
    for hidden in hidden_waves(solution, curves(solution)):
        _waves(statements, hidden)
    for quantity in conformity.quantities:
        if quantity.limit is not None:
            _conformity(statements, quantity, conformity.rule)


def _declared(statements: ET.Element, key: str) -> ET.Element:
    statement = add(statements, "statement")
    add_texts(statement, "name", f"{key}_name")
    add_texts(statement, "declaration", key)
    return statement


def _waves(statements: ET.Element, hidden: HiddenWaves) -> None:
    """That values between the listed positions miss short waves, which their U do not contain."""
    statement = add(statements, "statement")
    add_texts(statement, "name", "short_waves_name")
    declaration = add(statement, "declaration")
    for language in LANGUAGES:
        said = Texts(language)("certificate.short_waves", **hidden.values(language == "de"))
        add(declaration, "content", said, lang=language)


def _words(statement: ET.Element, text: str) -> None:
    """What the library says, in English, as the description of a statement."""
    if text:
        statement.insert(1, _description(text))


def _description(text: str) -> ET.Element:
    holder = ET.Element("holder")
    return add_words(holder, "description", text)


def _missing(statements: ET.Element, missing: tuple[str, ...], evaluated: str) -> None:
    """What nobody stated, by name, and what stands in its place."""
    statement = add(statements, "statement")
    add_texts(statement, "name", "missing_name")
    declaration = add(statement, "declaration")
    for language in LANGUAGES:
        texts = Texts(language)
        names = ", ".join(texts(f"certificate.missing_{key}") for key in missing)
        parts = [texts("certificate.missing", names=names)]
        parts += [texts(f"certificate.in_place_{key}", day=evaluated) for key in missing if key in IN_PLACE]
        add(declaration, "content", " ".join(parts), lang=language)


IN_PLACE = ("country", "identifier", "end", "place")  # what stands for something that the schema demands


def _conformity(statements: ET.Element, quantity: Quantity, rule: str) -> None:
    statement = add(statements, "statement", refType="basic_conformity")
    add_words(statement, "name", quantity.symbol)
    if quantity.text:
        add_words(statement, "description", quantity.text)
    if rule != SIMPLE:
        add(statement, "norm", "ISO 14253-1:2017")
    known = math.isfinite(quantity.value)
    declaration = add(statement, "declaration")
    for language in LANGUAGES:
        add(declaration, "content", rule_words(quantity, rule, Texts(language), coded=True), lang=language)
    if known and not quantity.withheld:
        add(statement, "conformity", _status(quantity))
    data = add(statement, "data")
    numbers = (("measured", quantity.value, quantity.U), ("limit", quantity.limit, None))
    for key, value, expanded in numbers if known else numbers[1:]:
        one = add(
            data, "quantity", refType="basic_measuredValue" if key == "measured" else "basic_conformityLimitUpper"
        )
        add_texts(one, "name", f"conformity_{key}")
        add_real(one, float(value or 0.0), quantity.unit, expanded)


def rule_words(quantity: Quantity, rule: str, texts: Texts, coded: bool = False) -> str:
    """How conformity was decided, or why it is not stated; `coded`: with the verdicts as the schema of certificates has them."""
    words = [(texts(f"limits.{verdict}"), verdict) for verdict in (PASS, FAIL)]
    passed, failed = (f"{own} ({code})" if coded and own != code else own for own, code in words)
    more = texts("certificate.conditional", passed=CONDITIONAL[0], failed=CONDITIONAL[1]) if coded else ""
    said = {"passed": passed, "failed": failed, "conditional": more}
    return texts(f"certificate.{declaration_key(quantity, rule)}", **said)


def declaration_key(quantity: Quantity, rule: str) -> str:
    """Which text of texts/certificate.toml says how conformity was decided, or why it is not stated."""
    if quantity.withheld:
        return f"no_conformity_{quantity.withheld}"
    if not math.isfinite(quantity.value):
        return "no_conformity"
    return "rule_simple" if rule == SIMPLE else "rule_guard_band"


def _status(quantity: Quantity) -> str:
    """The verdict as the schema has it; between the guard bands what the value alone would be, on condition (ILAC-G8 4.2.3)."""
    if quantity.verdict in (PASS, FAIL):
        return quantity.verdict
    return CONDITIONAL[0] if abs(quantity.value) <= (quantity.limit or 0.0) else CONDITIONAL[1]
