"""Elements of a digital calibration certificate: names in their name spaces, texts in two languages, numbers as D-SI wants them.

D-SI states metre, radian, degree and kelvin without prefixes. Numbers in mm become metres by moving the decimal point of their
shortest decimal form, so that no digit changes and reading them back gives the same number.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from decimal import Decimal
from typing import Any

from volid.exceptions import shown
from volid.report.language import LANGUAGES, Texts

DCC, SI = "https://ptb.de/dcc", "https://ptb.de/si"
SCHEMA_INSTANCE = "http://www.w3.org/2001/XMLSchema-instance"
SCHEMA = "3.3.0"
K, PROBABILITY = 2, 0.95
# unit of volid: unit of D-SI, and how many places its decimal point moves
UNITS = {
    "mm": ("\\metre", -3),
    "rad": ("\\radian", 0),
    "°": ("\\degree", 0),
    "°C": ("\\degreecelsius", 0),
    "": ("\\one", 0),
}


def add(parent: ET.Element, name: str, text: str | None = None, **attributes: str) -> ET.Element:
    """A new element `name` of the name space of certificates within `parent`."""
    child = ET.SubElement(parent, f"{{{DCC}}}{name}", attributes)
    child.text = None if text is None else plain(text)
    return child


def add_si(parent: ET.Element, name: str, text: str | None = None) -> ET.Element:
    """A new element `name` of the name space of D-SI within `parent`."""
    child = ET.SubElement(parent, f"{{{SI}}}{name}")
    child.text = text
    return child


def plain(text: str) -> str:
    """A text in one line without blanks at its ends, control characters escaped; "-" for an empty one, which is not allowed."""
    return " ".join(shown(text).split()) or "-"


def add_texts(parent: ET.Element, name: str, key: str, /, **values: Any) -> ET.Element:
    """An element whose contents are a text of texts/certificate.toml in every language."""
    child = add(parent, name)
    for language in LANGUAGES:
        add(child, "content", Texts(language)(f"certificate.{key}", **values), lang=language)
    return child


def add_words(parent: ET.Element, name: str, *words: str) -> ET.Element:
    """An element whose contents are texts of no stated language: names, or what the library says."""
    child = add(parent, name)
    for text in words:
        add(child, "content", text)
    return child


def decimal(value: float, unit: str) -> str:
    """A number in the unit of D-SI, in the fewest digits that give the same number again.

    >>> decimal(0.0123, "mm"), decimal(-2.5e-05, "rad"), decimal(0.0, "mm")
    ('0.0000123', '-0.000025', '0')
    """
    number = Decimal(repr(float(value))).scaleb(UNITS[unit][1])
    return "0" if not number else format(number.normalize(), "f")


def decimals(values: Iterable[float], unit: str) -> str:
    """Numbers as a list of D-SI: one blank between two of them."""
    return " ".join(decimal(value, unit) for value in values)


def add_real(parent: ET.Element, value: float, unit: str, expanded: float | None = None) -> None:
    """One number, with its expanded uncertainty U (k = 2)."""
    real = add_si(parent, "real")
    add_si(real, "value", decimal(value, unit))
    add_si(real, "unit", UNITS[unit][0])
    if expanded is not None:
        stated = add_si(add_si(real, "measurementUncertaintyUnivariate"), "expandedMU")
        add_si(stated, "valueExpandedMU", decimal(expanded, unit))
        add_si(stated, "coverageFactor", str(K))
        add_si(stated, "coverageProbability", str(PROBABILITY))


def add_list(
    parent: ET.Element,
    values: Sequence[float],
    unit: str,
    u: Sequence[float] = (),
    ends: Sequence[Sequence[float]] = (),
) -> None:
    """Numbers of one unit, with expanded uncertainties 2 u, or, with their `ends`, with 95 % coverage intervals."""
    found = add_si(parent, "realListXMLList")
    add_si(found, "valueXMLList", decimals(values, unit))
    add_si(found, "unitXMLList", UNITS[unit][0])
    if not len(u):
        return
    stated = add_si(found, "measurementUncertaintyUnivariateXMLList")
    if ends:
        interval = add_si(stated, "coverageIntervalMUXMLList")
        add_si(interval, "valueStandardMUXMLList", decimals(u, unit))
        add_si(interval, "intervalMinXMLList", decimals(ends[0], unit))
        add_si(interval, "intervalMaxXMLList", decimals(ends[1], unit))
        add_si(interval, "coverageProbabilityXMLList", str(PROBABILITY))
        return
    expanded = add_si(stated, "expandedMUXMLList")
    add_si(expanded, "valueExpandedMUXMLList", decimals((K * value for value in u), unit))
    add_si(expanded, "coverageFactorXMLList", str(K))
    add_si(expanded, "coverageProbabilityXMLList", str(PROBABILITY))
