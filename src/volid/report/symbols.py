"""The symbols of ISO 230-1 in the words of a language, and a squareness error as an angle larger or smaller than 90°."""

from __future__ import annotations

import re

from volid.fitting.squareness import angle_of
from volid.model.iso230 import LINEAR_AXES, ROTARY_AXES, ROTATIONS, SPINDLE, ErrorName, parse
from volid.report.language import Texts

_OTHER = re.compile(r"\(0([A-Z])\)")  # the axis that a constant is stated against
_LINES = dict(zip(ROTATIONS, LINEAR_AXES, strict=True))


def in_words(name: str, texts: Texts) -> str:
    """A symbol in words, as `volid.model.iso230.describe` puts it in English.

    Args:
        name: The symbol, such as "EYX" or "EC0Y".
        texts: The language.

    Raises `InputError` when `name` is no such symbol. Source: ISO 230-1, ISO 230-7.

    >>> in_words("EYX", Texts("de"))
    'Geradheitsabweichung von X in Richtung Y'
    """
    error = parse(name)
    line = _LINES.get(error.direction, error.direction)
    return texts(f"symbols.{_kind(error)}", axis=error.axis, direction=error.direction, line=line)


def constant_words(name: str, texts: Texts) -> str:
    """A constant in words, also one that ISO 230-1 states against another axis, such as "EY(0A)C".

    Args:
        name: The symbol, such as "EY0C" or "EY(0A)C".
        texts: The language.

    >>> constant_words("EY(0A)C", Texts("en"))
    'error of the position of C in Y direction, relative to A'
    """
    words, other = in_words(plain_symbol(name), texts), _OTHER.search(name)
    stated = other and other[1] in ROTARY_AXES
    return texts("symbols.relative", words=words, axis=other[1]) if other and stated else words


def plain_symbol(name: str) -> str:
    """The symbol without the axis that it is stated against.

    >>> plain_symbol("EY(0A)C"), plain_symbol("EC0Y")
    ('EY0C', 'EC0Y')
    """
    return _OTHER.sub("0", name)


def shown_symbol(name: str) -> str:
    """A symbol as it is printed: the volumetric accuracy V_X as V X, with a blank that does not break; others as they are.

    >>> shown_symbol("V_X"), shown_symbol("EXX")
    ('V\\xa0X', 'EXX')
    """
    return name.replace("V_", "V\N{NO-BREAK SPACE}") if name.startswith("V_") else name


def _kind(error: ErrorName) -> str:
    """What sort of error it is: a key of texts/symbols.toml."""
    if error.axis == SPINDLE:
        return "tool_rotation" if error.is_rotation else "tool_position"
    if error.location:
        return _constant(error)
    return _of_linear(error) if error.axis in LINEAR_AXES else _of_rotary(error)


def _constant(error: ErrorName) -> str:
    if error.axis in LINEAR_AXES:
        return "squareness"
    if error.direction == error.axis:
        return "zero"
    return "orientation" if error.is_rotation else "position"


def _of_linear(error: ErrorName) -> str:
    if not error.is_rotation:
        return "positioning" if error.direction == error.axis else "straightness"
    return "roll" if _LINES[error.direction] == error.axis else "angular"


def _of_rotary(error: ErrorName) -> str:
    if error.direction == error.axis:
        return "angular_positioning"
    if error.is_rotation:
        return "tilt"
    return "axial" if error.direction == _LINES[error.axis] else "radial"


def angle_words(name: str, value: float | None, expanded: float | None, texts: Texts) -> str:
    """Whether the angle between the axes of a squareness error is larger or smaller than 90°; "" where not determined.

    Args:
        name: Symbol of the squareness error.
        value: Its value [rad].
        expanded: Its expanded uncertainty U [rad].
        texts: The language.

    >>> angle_words("EC0Y", 21e-6, 2e-6, Texts("de"))
    'Winkel zwischen +X und +Y größer als 90°'
    """
    found = angle_of(name, value, expanded)
    return "" if found is None else texts(f"symbols.angle_{found.size}", first=found.first, second=found.second)
