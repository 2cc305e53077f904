"""Names of errors after ISO 230-1: parse, describe, and their units.

`EXY` is an error motion (first letter: direction, second: the axis that moves), `EC0Y` a location error or squareness
(constant), `EA0S` a constant of the tool frame (spindle).
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from volid.exceptions import InputError

DIRECTIONS = ("X", "Y", "Z", "A", "B", "C")
TRANSLATIONS = DIRECTIONS[:3]
ROTATIONS = DIRECTIONS[3:]
LINEAR_AXES = ("X", "Y", "Z")
ROTARY_AXES = ("A", "B", "C")
SPINDLE = "S"

_PATTERN = re.compile(r"E([XYZABC])(0?)([XYZABCS])")


@dataclass(frozen=True)
class ErrorName:
    """An ISO 230-1 error symbol taken apart: direction, causing axis, and whether it is a constant (location error)."""

    direction: str
    axis: str
    location: bool

    def __str__(self) -> str:
        return f"E{self.direction}{'0' if self.location else ''}{self.axis}"

    @property
    def component(self) -> int:
        """Row of the six components X, Y, Z, A, B, C."""
        return DIRECTIONS.index(self.direction)

    @property
    def is_rotation(self) -> bool:
        """True for A, B, C (rad), False for X, Y, Z (mm)."""
        return self.direction in ROTATIONS

    @property
    def unit(self) -> str:
        """Unit in files and in the interface."""
        return "rad" if self.is_rotation else "mm"

    @property
    def report_unit(self) -> str:
        """Unit in reports and plots."""
        return "µrad" if self.is_rotation else "µm"


def parse(name: str) -> ErrorName:
    """Take an ISO 230-1 symbol apart.

    Raises `InputError` when `name` is no such symbol.

    >>> parse("EC0Y").axis
    'Y'
    """
    match = _PATTERN.fullmatch(name)
    if match is None or (match[3] == SPINDLE and not match[2]):
        raise InputError(
            f"'{name}' is not an ISO 230-1 error symbol; expected E + direction (X, Y, Z, A, B, C) + axis, such as EXX, "
            "EBZ, a constant such as EC0Y, or a tool-frame constant such as EA0S"
        )
    return ErrorName(match[1], match[3], bool(match[2]))


def motion(direction: str, axis: str) -> str:
    """Symbol of the error motion of `axis` in `direction`: ("Y", "X") gives "EYX"."""
    return f"E{direction}{axis}"


def describe(name: str) -> str:
    """The symbol in words, as ISO 230-1 puts it.

    Error motions describe the tool relative to the workpiece, location errors where the line of a rotary axis stands.

    >>> describe("EYX")
    'straightness of X in Y direction'
    """
    error = parse(name)
    if error.axis == SPINDLE:
        kind = "rotation" if error.is_rotation else "position"
        return f"tool frame (spindle) {kind} {'about' if error.is_rotation else 'in'} {_line(error.direction)}"
    if error.location:
        return _describe_location(error)
    if error.axis in LINEAR_AXES:
        return _describe_linear(error)
    return _describe_rotary(error)


def _line(direction: str) -> str:
    return dict(zip(ROTATIONS, LINEAR_AXES, strict=True)).get(direction, direction)


def _describe_location(error: ErrorName) -> str:
    if error.axis in LINEAR_AXES:
        return f"squareness: rotation of the {error.axis} axis about {_line(error.direction)}"
    if error.direction == error.axis:
        return f"zero position of {error.axis}"
    if error.is_rotation:
        return f"error of the orientation of {error.axis} about {_line(error.direction)}"
    return f"error of the position of {error.axis} in {error.direction} direction"


def _describe_linear(error: ErrorName) -> str:
    if not error.is_rotation:
        if error.direction == error.axis:
            return f"positioning of {error.axis}"
        return f"straightness of {error.axis} in {error.direction} direction"
    if _line(error.direction) == error.axis:
        return f"roll of {error.axis}"
    return f"angular error motion of {error.axis} about {_line(error.direction)}"


def _describe_rotary(error: ErrorName) -> str:
    if error.direction == error.axis:
        return f"angular positioning of {error.axis}"
    if error.is_rotation:
        return f"tilt error motion of {error.axis} about {_line(error.direction)}"
    if error.direction == _line(error.axis):
        return f"axial error motion of {error.axis}"
    return f"radial error motion of {error.axis} in {error.direction} direction"
