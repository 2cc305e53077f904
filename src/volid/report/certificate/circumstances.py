"""Circumstances of the results: methods, instruments, and the record of conditions of ISO/TR 16907 9.1."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from decimal import Decimal
from typing import Any

from volid.io.functions_csv import source_lines
from volid.observations import KINDS
from volid.plausibility.record import FURTHER, Item, record
from volid.report.certificate.administration import Request
from volid.report.certificate.element import UNITS, add, add_si, add_texts, add_words
from volid.report.certificate.facts import KEY

AMBIENT, COMPONENTS = "ambient_temperature_C", "component_temperatures_C"  # keys of [conditions] that hold numbers
METHODS = {  # key of the texts: standards
    "identification": ("ISO 230-1:2012", "ISO/TR 16907:2015"),
    "uncertainty": ("JCGM 100:2008",),
    "samples": ("JCGM 101:2008",),
    "volume_method": ("ISO 230-1:2012",),
}


def add_methods(part: ET.Element, request: Request) -> None:
    """`dcc:usedMethods`: how the numbers and their uncertainties were found, and what was read."""
    methods = add(part, "usedMethods")
    for key, norms in METHODS.items():
        if key == "samples" and not request.solution.samples:
            continue
        method = add(methods, "usedMethod", refType="basic_uncertainty" if key[0] == "u" else "volid_method")
        add_texts(method, "name", f"{key}_name")
        add_texts(method, "description", key)
        for norm in norms:
            add(method, "norm", norm)
    for kind in dict.fromkeys(s.kind for s in request.solution.campaign.sets):
        method = add(methods, "usedMethod", refType=f"volid_{kind}")
        add_texts(method, "name", "kind", kind=kind)
        add_words(method, "description", KINDS[kind].doc.strip().split("\n\n")[0])


def add_instruments(part: ET.Element, request: Request) -> None:
    """`dcc:measuringEquipments`, as far as instruments were stated."""
    if not request.facts.instrument:
        return
    instruments = add(part, "measuringEquipments")
    for stated in request.facts.instrument:
        one = add(instruments, "measuringEquipment", refType="basic_measurementStandard")
        add_words(one, "name", stated["name"])
        if "certificate" in stated:
            add_texts(one, "description", "instrument_certificate", number=stated["certificate"])
        if "manufacturer" in stated:
            add_words(add(one, "manufacturer"), "name", stated["manufacturer"])
        if "model" in stated:
            add(one, "model", stated["model"])
        if "serial_number" in stated:
            number = add(add(one, "identifications"), "identification")
            add(number, "issuer", "manufacturer")
            add(number, "value", stated["serial_number"])
            add_texts(number, "name", "id_serial_number")


def add_conditions(part: ET.Element, request: Request) -> None:
    """`dcc:influenceConditions`: every item of the record, those that are missing by name; temperatures as numbers too."""
    conditions = add(part, "influenceConditions")
    stated = request.solution.campaign.conditions
    for item in record(request.solution.campaign):
        if item.name not in FURTHER or item.stated:
            _condition(conditions, item, stated)


def _condition(conditions: ET.Element, item: Item, stated: Mapping[str, Any]) -> None:
    is_temperature = "temperature" in item.name
    one = add(conditions, "influenceCondition", refType="basic_temperature" if is_temperature else "volid_condition")
    add_texts(one, "name", f"recorded_{item.name or 'other'}")
    data = add(one, "data")
    if item.name == "ambient_temperature" and _is_number(stated.get(AMBIENT)):
        _temperature(data, "", stated[AMBIENT])
        return
    if item.name == "component_temperatures" and isinstance(stated.get(COMPONENTS), Mapping):
        for name, value in stated[COMPONENTS].items():
            if _is_number(value):
                _temperature(data, str(name), value)
    for key, text in item.stated if not len(data) else ():
        if not key.split(": ")[-1].startswith(KEY):
            add_words(data, "text", f"{key}: {text or 'none'}")
    for kind, name in item.measured:
        add_texts(data, "text", f"measured_{kind}", name=name)
    if not len(data):
        add_texts(data, "text", "not_recorded" if item.is_missing else "in_readings")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _temperature(data: ET.Element, name: str, celsius: float) -> None:
    """A temperature in kelvin and in degrees Celsius."""
    quantity = add(data, "quantity", refType="basic_temperature")
    if name:
        add_words(quantity, "name", name)
    else:
        add_texts(quantity, "name", "recorded_ambient_temperature")
    hybrid = add_si(quantity, "hybrid")
    number = Decimal(repr(float(celsius)))
    for value, unit in ((number + Decimal("273.15"), "\\kelvin"), (number, UNITS["°C"][0])):
        real = add_si(hybrid, "real")
        add_si(real, "value", format(value, "f"))
        add_si(real, "unit", unit)


def add_origin(part: ET.Element, request: Request) -> None:
    """`dcc:measurementMetaData`: datum, measured ranges, versions and hashes of the inputs."""
    origin = add(part, "measurementMetaData")
    lines = source_lines(request.solution, request.source or None)
    lines = {key: text for key, text in lines.items() if key not in ("conditions", "date", "source")}
    for key, text in {**lines, **request.solution.provenance}.items():
        one = add(origin, "metaData", refType="volid_provenance")
        add_words(one, "name", key)
        add_words(one, "declaration", text)
