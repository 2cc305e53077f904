"""The record of a campaign as ISO/TR 16907 9.1 asks for it: which of its items are stated, in which words, and which are missing.

`[conditions]` has free keys; an item is found by the words with which its keys begin. Where axes stood and with which tool
vectors is part of every reading, so that these items are never missing; what was stated about them stands beside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from volid.campaign import Campaign

# item of ISO/TR 16907 9.1: how its keys in [conditions] begin
ITEMS: dict[str, tuple[str, ...]] = {
    "warm_up": ("warm_up", "machine_condition", "condition_of_the_machine"),
    "positions": ("axis_positions", "positions"),
    "tool_length": ("tool_length", "tool_vector"),
    "tool_offset": ("tool_offset", "offset"),
    "load": ("load",),
    "feed": ("feed",),
    "acceleration": ("acceleration",),
    "ambient_temperature": ("ambient", "air_temperature", "room_temperature"),
    "component_temperatures": ("component_temperature", "machine_temperature", "material_temperature"),
    "active_compensations": ("active_compensation",),
}
# what a report needs besides: who, when, with what, by which standard it is traceable (ISO/TR 16907 11.4)
FURTHER: dict[str, tuple[str, ...]] = {
    "date": ("date", "measured_on"),
    "operator": ("operator", "measured_by"),
    "instrument": ("instrument",),
    "traceability": ("traceability", "calibration", "certificate"),
}
IN_READINGS = ("positions", "tool_length", "tool_offset")  # items that every reading states


YES, NO = "yes", "no"
SYNTHETIC = "synthetic"  # key by which data say that they were simulated
UNITS = {
    "_mm": "mm",
    "_C": "°C",
    "_m_s2": "m/s²",
    "_m_min": "m/min",
    "_mm_min": "mm/min",
    "_kg": "kg",
    "_min": "min",
    "_hPa": "hPa",
    "_percent": "%",
}


@dataclass(frozen=True)
class Item:
    """One item of the record.

    Args:
        name: A key of `ITEMS` or `FURTHER`; "" for a key of the campaign's own.
        stated: What `[conditions]` say, as pairs of key and text; of several files with the file's name before the key.
        measured: Where values of it were logged: ("log", name of the environment) or ("column", name of the set).
    """

    name: str
    stated: tuple[tuple[str, str], ...] = ()
    measured: tuple[tuple[str, str], ...] = ()

    @property
    def is_missing(self) -> bool:
        """Whether nothing is known of it."""
        return not self.stated and not self.measured and self.name not in ("", *IN_READINGS)


def record(campaign: Campaign) -> tuple[Item, ...]:
    """The items of ISO/TR 16907 9.1, what a report needs besides, and all further keys, in this order.

    >>> import volid
    >>> found = record(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> [item.name for item in found if item.is_missing][:3]
    ['warm_up', 'load', 'feed']
    """
    stated = list(_flat(campaign.conditions))
    named = {**ITEMS, **FURTHER}
    of = {
        key: next((n for n, begins in named.items() if key.split(": ")[-1].startswith(begins)), "") for key, _ in stated
    }
    own = tuple((key, text) for key, text in stated if not of[key])
    found = [
        Item(name, tuple((key, text) for key, text in stated if of[key] == name), tuple(_measured(campaign, name)))
        for name in named
    ]
    return (*found, Item("", own)) if own else tuple(found)


def _flat(conditions: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, str]]:
    """Keys and texts; the conditions of single files, and tables, with their name before them."""
    for key, value in conditions.items():
        if isinstance(value, Mapping) and _is_file(key, value):
            yield from _flat(value, f"{key}: ")
        else:
            yield f"{before}{key}", _with_unit(key, value)


def _is_file(key: str, value: Mapping[str, Any]) -> bool:
    """Whether a table is the record of one file, not one of values such as component temperatures."""
    known = tuple(begin for begins in (*ITEMS.values(), *FURTHER.values()) for begin in begins)
    return not key.startswith(known) and any(str(k).startswith(known) for k in value)


def _with_unit(key: str, value: Any) -> str:
    """The text of a value, with the unit that its key ends in where it holds numbers: ambient_temperature_C = 20.0 is 20 °C."""
    ends = sorted((end for end in UNITS if key.endswith(end)), key=len)
    text = _text(value)
    return f"{text} {UNITS[ends[-1]]}" if ends and any(c.isdigit() for c in text) else text


def _text(value: Any) -> str:
    """A value in words: vectors in parentheses, nothing for an empty list, YES or NO."""
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {_text(v)}" for k, v in value.items())
    if isinstance(value, bool):
        return YES if value else NO
    if isinstance(value, list | tuple):
        parts = [f"({_text(v)})" if isinstance(v, list | tuple) else _text(v) for v in value]
        return ("; " if any(isinstance(v, str) for v in value) else ", ").join(parts)
    return f"{value:g}" if isinstance(value, float) else str(value)


def _measured(campaign: Campaign, item: str) -> Iterator[tuple[str, str]]:
    """What holds measured values of an item: logs of the environment, and columns of sets, with their names."""
    if item == "ambient_temperature":
        yield from (("log", e.name) for e in campaign.environments if e.has_air)
    elif item == "component_temperatures":
        yield from (("log", f"{e.name}: {', '.join(e.materials)}") for e in campaign.environments if e.materials)
        yield from (("column", s.name) for s in campaign.sets if s.temperature is not None)
