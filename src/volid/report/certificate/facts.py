"""What a certificate says of who, where, when and with what: from the record of conditions, or given by the caller.

```
[conditions.dcc]                               # or a file of its own, without this heading
country = "DE"                                 # of the laboratory, ISO 3166-1
identifier = "K-2026-0417"                     # unique, of the laboratory
begin = 2026-03-11                             # of the calibration
end = 2026-03-12
place = "customer"                             # or "laboratory", "laboratoryBranch", "customerBranch", "other"
laboratory = { name = "…", street = "…", number = "…", post_code = "…", city = "…", country = "DE", email = "…", phone = "…" }
customer = { name = "…", city = "…" }          # the laboratory may also have a code
machine = { manufacturer = "…", model = "…", serial_number = "…", inventory_number = "…" }
person = [{ name = "…", role = "…" }]
instrument = [{ name = "…", manufacturer = "…", model = "…", serial_number = "…", certificate = "…" }]
```
Nothing is invented: what the schema demands and nobody states is written as "not stated", and named.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime
from typing import Any

from volid.campaign import Campaign
from volid.exceptions import InputError

KEY = "dcc"  # table of [conditions]
PLACES = ("laboratory", "customer", "laboratoryBranch", "customerBranch", "other")
ADDRESS = ("name", "street", "number", "post_code", "city", "country", "email", "phone", "code")
MACHINE = ("manufacturer", "model", "serial_number", "inventory_number")
INSTRUMENT = ("name", "manufacturer", "model", "serial_number", "certificate")
PERSON = ("name", "role")
COUNTRY = re.compile("[A-Z]{2}")

Texts = Mapping[str, str]


@dataclass(frozen=True)
class Facts:
    """What was stated; "" , () and {} stand for what was not.

    Args:
        country: Code of ISO 3166-1 of the laboratory's country.
        identifier: Unique identifier.
        begin: First day of the calibration, YYYY-MM-DD.
        end: Its last day.
        place: Where it was carried out, one of `PLACES`.
        laboratory, customer: Names and addresses.
        machine: Manufacturer, model and numbers.
        person: Responsible persons.
        instrument: Measuring instruments.
    """

    country: str = ""
    identifier: str = ""
    begin: str = ""
    end: str = ""
    place: str = ""
    laboratory: Texts = field(default_factory=dict)
    customer: Texts = field(default_factory=dict)
    machine: Texts = field(default_factory=dict)
    person: tuple[Texts, ...] = ()
    instrument: tuple[Texts, ...] = ()


def facts_of(campaign: Campaign, given: Mapping[str, Any] | None = None, where: str = "`data`") -> Facts:
    """The facts of a campaign's record, and those `given`, which stand before them; `where` names these in messages.

    Raises `InputError` naming a key that is not known, or whose value is not what is expected.
    """
    recorded = campaign.conditions.get(KEY, {})
    if not isinstance(recorded, Mapping):
        raise InputError(f"[conditions] {KEY} is no table; expected keys such as country, laboratory, person")
    found = {**_read(recorded, f"[conditions.{KEY}]"), **_read(given or {}, where)}
    found.setdefault("begin", _recorded_date(campaign))
    found.setdefault("instrument", _recorded_instrument(campaign))
    facts = Facts(**found)
    if facts.begin and facts.end and facts.end < facts.begin:
        raise InputError(
            f"{where}: end {facts.end} is before begin {facts.begin}; expected the last day of the calibration"
        )
    return facts


def check_facts(given: Mapping[str, Any], where: str) -> None:
    """Raises `InputError` naming a key that is not known, or whose value is not what is expected."""
    _read(given, where)


def _read(table: Mapping[str, Any], where: str) -> dict[str, Any]:
    readers = {
        "country": _country, "identifier": _text, "begin": _day, "end": _day, "place": _place,
        "laboratory": _keys(ADDRESS), "customer": _keys(ADDRESS), "machine": _keys(MACHINE),
        "person": _several(PERSON), "instrument": _several(INSTRUMENT),
    }  # fmt: skip
    for key in table:
        if key not in readers:
            raise InputError(f"{where}: '{key}' is not known; expected one of {', '.join(readers)}")
    return {key: readers[key](value, f"{where} {key}") for key, value in table.items()}


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str | int) or isinstance(value, bool) or not str(value).strip():
        raise InputError(f"{where} is {value!r}; expected a text")
    return str(value).strip()


def _country(value: Any, where: str) -> str:
    if not COUNTRY.fullmatch(_text(value, where)):
        raise InputError(f"{where} is '{value}'; expected two capital letters of ISO 3166-1, such as DE")
    return str(value)


def _place(value: Any, where: str) -> str:
    if value not in PLACES:
        raise InputError(f"{where} is '{value}'; expected one of {', '.join(PLACES)}")
    return str(value)


def _day(value: Any, where: str) -> str:
    if isinstance(value, date):  # of a TOML file; a time of day is cut off
        return (value.date() if isinstance(value, datetime) else value).isoformat()
    try:
        return datetime.fromisoformat(_text(value, where)).date().isoformat()
    except ValueError:
        raise InputError(f"{where} is '{value}'; expected a date such as 2026-03-12") from None


def _keys(known: Sequence[str]) -> Any:
    def read(value: Any, where: str) -> dict[str, str]:
        if not isinstance(value, Mapping):
            raise InputError(f"{where} is {value!r}; expected a table with keys such as {', '.join(known[:3])}")
        for key in value:
            if key not in known:
                raise InputError(f"{where}: '{key}' is not known; expected one of {', '.join(known)}")
        found = {key: _text(text, f"{where} {key}") for key, text in value.items()}
        if "country" in found:
            _country(found["country"], f"{where} country")
        return found

    return read


def _several(known: Sequence[str]) -> Any:
    def read(value: Any, where: str) -> tuple[dict[str, str], ...]:
        entries = value if isinstance(value, list | tuple) else [value]
        found = tuple(_keys(known)(entry, where) for entry in entries)
        for entry in found:
            if "name" not in entry:
                raise InputError(f'{where}: an entry has no name; expected name = "…"')
        return found

    return read


def _recorded_date(campaign: Campaign) -> str:
    """`date` of the record of conditions, "" where it states none that can be read."""
    value = campaign.conditions.get("date", "")
    try:
        return _day(value, "date") if value else ""
    except InputError:
        return ""


def _recorded_instrument(campaign: Campaign) -> tuple[dict[str, str], ...]:
    """`instrument` of the record of conditions, a text or several."""
    value = campaign.conditions.get("instrument", ())
    names = [value] if isinstance(value, str) else [v for v in value if isinstance(v, str)]
    return tuple({"name": name.strip()} for name in names if name.strip())
