"""Units in which files give numbers, and how they become those of volid: mm, degrees or rad, s, °C.

x [to] = factor · x [unit] + offset. Factors are exact: the inch is 25.4 mm, 400 gon, 1,296,000 arc seconds and 2π rad are a full
turn (SI Brochure, Table 8; ISO 80000-3).
"""

from __future__ import annotations

import math
import re

_LENGTH = {"mm": 1.0, "m": 1e3, "cm": 10.0, "dm": 100.0, "µm": 1e-3, "nm": 1e-6, "inch": 25.4, "ft": 304.8}
_ANGLE = {  # in rad
    "rad": 1.0, "mrad": 1e-3, "µrad": 1e-6, "deg": math.pi / 180.0, "arcmin": math.pi / 10800.0,
    "arcsec": math.pi / 648000.0, "gon": math.pi / 200.0,
}  # fmt: skip
_SLOPE = {"mm/m": 1e-3, "µm/m": 1e-6, "mm/mm": 1.0}  # of small angles, as levels give them; rad
_TIME = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
_TEMPERATURE = {"°C": (1.0, 0.0), "K": (1.0, -273.15), "°F": (1.0 / 1.8, -32.0 / 1.8)}
_OTHER_SPELLINGS = {
    "um": "µm", "μm": "µm", "micron": "µm", "in": "inch", '"': "inch", "zoll": "inch", "inches": "inch", "pouce": "inch",
    "°": "deg", "degree": "deg", "degrees": "deg", "urad": "µrad", "μrad": "µrad", "degc": "°C",
    "degf": "°F", "°c": "°C", "°f": "°F", "um/m": "µm/m", "μm/m": "µm/m", "sec": "s", "hr": "h", "''": "arcsec",
    "″": "arcsec", "'": "arcmin", "′": "arcmin", "metre": "m", "meter": "m", "millimetre": "mm", "millimeter": "mm", "foot": "ft",
    "feet": "ft", "º": "deg",
}  # fmt: skip
_FAMILIES = (_LENGTH, _ANGLE, _SLOPE, _TIME, _TEMPERATURE)
NAMES = tuple(name for family in _FAMILIES for name in family)
_IN_BRACKETS = re.compile(r"^(?P<name>.*\S)\s*(?:\[(?P<a>[^\[\]]+)\]|\((?P<b>[^()]+)\)|\s/\s*(?P<c>\S+))$")


def spelled(text: str) -> str | None:
    """A unit under its one name, "um" as "µm", also in brackets; None for what is no unit."""
    text = text.strip().strip("[]()").strip()
    if text in NAMES:
        return text
    if text == "Grad":  # German; in lower case it may be the French grad, which is gon
        return "deg"
    lower = text.casefold()
    found = _OTHER_SPELLINGS.get(lower, lower)
    return found if found in NAMES else None


def split_unit(header: str) -> tuple[str, str | None]:
    """The name and the unit of a column: "Soll X [mm]" is ("Soll X", "mm"); without a known unit, the header and None.

    >>> split_unit("Messlänge [m]"), split_unit("EXX(+)"), split_unit("X / inch")
    (('Messlänge', 'm'), ('EXX(+)', None), ('X', 'inch'))
    """
    parts = _IN_BRACKETS.match(header)
    unit = spelled(parts["a"] or parts["b"] or parts["c"]) if parts else None
    return (parts["name"].strip(), unit) if parts and unit else (header, None)


def conversion(unit: str, wanted: str) -> tuple[float, float] | None:
    """Factor and offset from `unit` to the one that is `wanted`, such as "mm" or "mm or rad"; None where none leads there.

    >>> conversion("inch", "mm"), conversion("mm", "degrees")
    ((25.4, 0.0), None)
    """
    for to in wanted.split(" or "):
        if to == "mm" and unit in _LENGTH:
            return _LENGTH[unit], 0.0
        if to in ("rad", "degrees") and unit in (_ANGLE | _SLOPE):
            factor = (_ANGLE | _SLOPE)[unit]
            return (factor if to == "rad" else 1.0 if unit == "deg" else math.degrees(factor)), 0.0
        if to == "s" and unit in _TIME:
            return _TIME[unit], 0.0
        if to == "°C" and unit in _TEMPERATURE:
            return _TEMPERATURE[unit]
    return None
