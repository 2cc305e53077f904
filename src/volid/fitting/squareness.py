"""Squareness errors as people say them: the full symbol EC(0X)Y, and whether the angle is larger or smaller than 90°.

A squareness error turns the line of an axis, direction + rotation × direction (CONVENTIONS 3): EXY gains -EC0Y·(y - y_ref). Where
the slope is towards the positive direction of the other axis, the two come nearer to each other, so

    angle between +X and +Y = 90° + EC0Y,  +X and +Z = 90° - EB0Z,  +Y and +Z = 90° + EA0Z,

and likewise for other primary and secondary axes. Positive directions are those of the tool relative to the workpiece, so an axis
that carries the workpiece has the same angle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from volid.model.error_functions import squareness_effect
from volid.model.iso230 import parse

RIGHT = "not distinguishable from 90°"
LARGER, SMALLER, NINETY = "larger", "smaller", "90"


class Angle(NamedTuple):
    """The angle between the positive directions of two linear axes: `size` is LARGER or SMALLER than 90°, or NINETY where U does
    not let the two be told apart."""

    first: str
    second: str
    size: str


def other_axis(name: str) -> str:
    """The axis to which a squareness error refers: "X" for EC0Y."""
    return squareness_effect(name)[0][1]


def squareness_symbol(name: str) -> str:
    """The full form of ISO 230-1.

    >>> squareness_symbol("EC0Y")
    'EC(0X)Y'
    """
    return f"{name[:2]}(0{other_axis(name)}){name[3]}"


def angle_in_words(name: str, value: float, expanded: float) -> str:
    """Angle between the positive directions of both axes: larger or smaller than 90° where |value| > U; "" if not determined.

    Args:
        name: Symbol of the squareness error.
        value: Its value [rad].
        expanded: Its expanded uncertainty U [rad].

    >>> angle_in_words("EC0Y", 21e-6, 2e-6)
    'angle between +X and +Y larger than 90°'
    """
    between = angle_of(name, value, expanded)
    if between is None:
        return ""
    found = RIGHT if between.size == NINETY else f"{between.size} than 90°"
    return f"angle between +{between.first} and +{between.second} {found}"


def angle_of(name: str, value: float | None, expanded: float | None) -> Angle | None:
    """The same in parts; None if not determined. Arguments as of `angle_in_words`.

    >>> angle_of("EC0Y", 21e-6, 2e-6)
    Angle(first='X', second='Y', size='larger')
    """
    if value is None or expanded is None or not (math.isfinite(value) and math.isfinite(expanded)):
        return None
    first, second = sorted((other_axis(name), parse(name).axis))
    if abs(value) <= expanded:
        return Angle(first, second, NINETY)
    nearer = squareness_effect(name)[1] * value > 0.0
    return Angle(first, second, SMALLER if nearer else LARGER)
