"""What of the record of conditions volid reckons with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from volid.exceptions import InputError

THERMAL = "thermal_limit"  # key of [conditions] [mm]
ACTIVE = "active_compensations"  # key of [conditions]: a list of texts (ISO/TR 16907 9.1)
LOAD = "load"  # key of [conditions]: a text (ISO/TR 16907 8.6, 9.1)
LARGEST_THERMAL = 1.0  # mm: a number above is one of micrometres


def thermal_limit(conditions: Mapping[str, Any]) -> float | None:
    """The largest `thermal_limit` [mm] of the record of conditions, those of single files included; None where none is stated.

    Raises `InputError` for what is no such length: a millimetre and more is µm.
    """
    found = [thermal_limit(v) for v in conditions.values() if isinstance(v, Mapping)]
    if THERMAL in conditions:
        value = conditions[THERMAL]
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < LARGEST_THERMAL:
            raise InputError(
                f"[conditions] {THERMAL} is '{value}'; expected a length in mm, 0 or above and below {LARGEST_THERMAL:g}, as ISO "
                "230-3 tests give it"
            )
        found.append(float(value))
    return max((v for v in found if v is not None), default=None)


def active_compensations(conditions: Mapping[str, Any]) -> list[str]:
    """Texts of the compensations that were active, those of single files included, each once; a lone text counts as a list."""
    return _texts(conditions, ACTIVE)


def loads(conditions: Mapping[str, Any]) -> list[str]:
    """Texts of the loads on table and spindle, those of single files included, each once; none where none is stated."""
    return _texts(conditions, LOAD)


def _texts(conditions: Mapping[str, Any], key: str) -> list[str]:
    stated = conditions.get(key, [])
    found = [str(v) for v in (stated if isinstance(stated, list | tuple) else [stated])]
    for value in conditions.values():
        found += _texts(value, key) if isinstance(value, Mapping) else []
    return list(dict.fromkeys(found))
