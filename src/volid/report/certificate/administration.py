"""Administrative data of a certificate: software, dates, machine, laboratory, persons, customer, statements."""

from __future__ import annotations

import hashlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

from volid.fitting.solution import Solution
from volid.io.basics.provenance import provenance, sha256
from volid.report.certificate.element import add, add_texts, add_words
from volid.report.certificate.facts import Facts

UNKNOWN_COUNTRY = "ZZ"  # of ISO 3166-1's codes for users: no country has it
_RELEASE = re.compile(r"\d{1,3}(\.\d{1,3}){0,3}")


@dataclass(frozen=True)
class Request:
    """What a certificate is made of: the solution, the facts stated, name of the solution's file ("" for none), and the language
    that stands first."""

    solution: Solution
    facts: Facts
    source: str = ""
    lang: str = "en"

    @property
    def evaluated(self) -> str:
        """Day on which the solution was computed, YYYY-MM-DD; today for one that no command computed."""
        return self.solution.provenance.get("date", "")[:10] or datetime.now(UTC).date().isoformat()

    @property
    def digest(self) -> str:
        """SHA-256 of the solution's file; without one, of its numbers."""
        if self.source:
            return sha256(self.source)
        found = hashlib.sha256()
        for values in (self.solution.parameters, self.solution.nuisance, self.solution.covariance):
            found.update(bytes(memoryview(values).cast("B")))
        return found.hexdigest()

    def missing(self) -> tuple[str, ...]:
        """Keys of what nobody stated and a certificate would have."""
        facts = self.facts
        absent = {
            "country": not facts.country,
            "identifier": not facts.identifier,
            "begin": not facts.begin,
            "end": not facts.end,
            "place": not facts.place,
            "laboratory": "name" not in facts.laboratory,
            "customer": "name" not in facts.customer,
            "person": not facts.person,
            "serial_number": "serial_number" not in facts.machine,
            "instrument": not facts.instrument,
        }
        return tuple(key for key, is_absent in absent.items() if is_absent)


def release_of(version: str) -> str:
    """A version as certificates write one.

    >>> release_of("0.1.0.dev3"), release_of("unknown")
    ('v0.1.0', 'v0')
    """
    found = _RELEASE.match(version)
    return f"v{found.group() if found else 0}"


def add_software(parent: ET.Element, name: str, version: str) -> None:
    """volid with its version, in a list of software `name`."""
    software = add(add(parent, name), "software")
    add_words(software, "name", "volid")
    add(software, "release", release_of(version))
    add(software, "type", "application")
    add_words(software, "description", f"volid {version}")


def administrative_data(root: ET.Element, request: Request) -> ET.Element:
    """`dcc:administrativeData` without its statements, which come last."""
    part, facts = add(root, "administrativeData"), request.facts
    add_software(part, "dccSoftware", provenance()["volid"])
    _core_data(part, request)
    _items(part, request)
    laboratory = add(part, "calibrationLaboratory")
    if "code" in facts.laboratory:
        add(laboratory, "calibrationLaboratoryCode", facts.laboratory["code"])
    _contact(laboratory, "contact", facts.laboratory)
    _persons(part, facts)
    _contact(part, "customer", facts.customer)
    return part


def _core_data(part: ET.Element, request: Request) -> None:
    core, facts, solution = add(part, "coreData"), request.facts, request.solution
    languages = (request.lang, *(code for code in ("en", "de") if code != request.lang))
    add(core, "countryCodeISO3166_1", facts.country or UNKNOWN_COUNTRY)
    for code in languages:
        add(core, "usedLangCodeISO639_1", code)
    add(core, "mandatoryLangCodeISO639_1", request.lang)
    add(core, "uniqueIdentifier", facts.identifier or f"volid-{request.digest[:32]}")
    identifications = add(core, "identifications")
    _identification(identifications, "other", request.digest, "sha256")
    if solution.campaign.title:
        _identification(identifications, "other", solution.campaign.title, "campaign")
    end = facts.end or max(request.evaluated, facts.begin)
    add(core, "beginPerformanceDate", facts.begin or end)
    add(core, "endPerformanceDate", end)
    add(core, "performanceLocation", facts.place or "other")


def _identification(parent: ET.Element, issuer: str, value: str, key: str) -> None:
    found = add(parent, "identification")
    add(found, "issuer", issuer)
    add(found, "value", value)
    add_texts(found, "name", f"id_{key}")


def _items(part: ET.Element, request: Request) -> None:
    """The machine."""
    item, facts, machine = add(add(part, "items"), "item"), request.facts.machine, request.solution.campaign.machine
    add_words(item, "name", machine.name)
    axes = "; ".join(f"{a.letter} {a.travel[0]:g} … {a.travel[1]:g} {a.unit}" for a in machine.axes)
    add_texts(item, "description", "machine", axes=axes)
    if "manufacturer" in facts:
        add_words(add(item, "manufacturer"), "name", facts["manufacturer"])
    if "model" in facts:
        add(item, "model", facts["model"])
    numbers = add(item, "identifications")
    if "serial_number" in facts:
        _identification(numbers, "manufacturer", facts["serial_number"], "serial_number")
    if "inventory_number" in facts:
        _identification(numbers, "customer", facts["inventory_number"], "inventory_number")
    _identification(numbers, "other", machine.structure, "structure")


def _contact(part: ET.Element, name: str, stated: Mapping[str, str]) -> None:
    contact = add(part, name)
    if "name" in stated:
        add_words(contact, "name", stated["name"])
    else:
        add_texts(contact, "name", "not_stated")
    for key, element in (("email", "eMail"), ("phone", "phone")):
        if key in stated:
            add(contact, element, stated[key])
    location = add(contact, "location")
    parts = {
        "city": "city",
        "country": "countryCode",
        "post_code": "postCode",
        "street": "street",
        "number": "streetNo",
    }
    for key, element in parts.items():
        if key in stated:
            add(location, element, stated[key])
    if not len(location):
        add_texts(location, "further", "not_stated")


def _persons(part: ET.Element, facts: Facts) -> None:
    persons = add(part, "respPersons")
    for stated in facts.person:
        one = add(persons, "respPerson")
        add_words(add(one, "person"), "name", stated["name"])
        if "role" in stated:
            add(one, "role", stated["role"])
    if not facts.person:
        add_texts(add(add(persons, "respPerson"), "person"), "name", "not_stated")
