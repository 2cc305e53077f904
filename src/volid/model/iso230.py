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


_WORDS = {
    "positioning": "positioning of {axis}",
    "straightness": "straightness of {axis} in {direction} direction",
    "roll": "roll of {axis}",
    "angular": "angular error motion of {axis} about {line}",
    "angular_positioning": "angular positioning of {axis}",
    "tilt": "tilt error motion of {axis} about {line}",
    "axial": "axial error motion of {axis}",
    "radial": "radial error motion of {axis} in {direction} direction",
    "squareness": "squareness: rotation of the {axis} axis about {line}",
    "zero_position": "zero position of {axis}",
    "orientation": "error of the orientation of {axis} about {line}",
    "position": "error of the position of {axis} in {direction} direction",
    "tool_rotation": "tool frame (spindle) rotation about {line}",
    "tool_position": "tool frame (spindle) position in {line}",
}


def describe(name: str) -> str:
    """The symbol in words, as ISO 230-1 puts it.

    Error motions describe the tool relative to the workpiece, location errors where the line of a rotary axis stands.

    >>> describe("EYX")
    'straightness of X in Y direction'
    """
    sort, values = sort_of(name)
    return _WORDS[sort].format(**values)


def sort_of(name: str) -> tuple[str, dict[str, str]]:
    """What sort of error a symbol names, and the letters that its description needs: axis, direction, and line turned about.

    >>> sort_of("EAX")
    ('roll', {'axis': 'X', 'direction': 'A', 'line': 'X'})
    """
    error = parse(name)
    if error.axis == SPINDLE:
        sort = "tool_rotation" if error.is_rotation else "tool_position"
    elif error.location:
        sort = _location_sort(error)
    else:
        sort = _linear_sort(error) if error.axis in LINEAR_AXES else _rotary_sort(error)
    return sort, {"axis": error.axis, "direction": error.direction, "line": _line(error.direction)}


def _line(direction: str) -> str:
    return dict(zip(ROTATIONS, LINEAR_AXES, strict=True)).get(direction, direction)


def _location_sort(error: ErrorName) -> str:
    if error.axis in LINEAR_AXES:
        return "squareness"
    if error.direction == error.axis:
        return "zero_position"
    return "orientation" if error.is_rotation else "position"


def _linear_sort(error: ErrorName) -> str:
    if error.is_rotation:
        return "roll" if _line(error.direction) == error.axis else "angular"
    return "positioning" if error.direction == error.axis else "straightness"


def _rotary_sort(error: ErrorName) -> str:
    if error.is_rotation:
        return "angular_positioning" if error.direction == error.axis else "tilt"
    return "axial" if error.direction == _line(error.axis) else "radial"
