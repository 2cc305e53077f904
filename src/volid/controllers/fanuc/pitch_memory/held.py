"""What a control does with the pitch memory of an axis that it holds: a table of error values.

See `volid.controllers.fanuc.pitch_memory.memory` for the formula.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from volid.compensation.tables.axis_table import AxisTable
from volid.controllers.axis_values import of_axis
from volid.controllers.base import COMPENSATION
from volid.controllers.fanuc.pitch_memory.memory import MEANING, NAME
from volid.controllers.fanuc.pitch_memory.sections import Numbering, amounts, sections_between
from volid.exceptions import InputError
from volid.model.machine import Axis


def table_of(
    axis: Axis, settings: Mapping[str, float], values: Mapping[int, int], options: Mapping[str, Any]
) -> AxisTable:
    """The table of error values that the control applies. Raises `InputError` for parameters that describe none."""
    given = {
        "3605#0": 0.0,
        "3623": 1.0,
        "3625": 0.0,
        "3627": 0.0,
        "1851": 0.0,
        "detection unit": of_axis(options["detection_unit"], axis.letter, NAME, "detection_unit"),
        "reference position": of_axis(options["reference_position"], axis.letter, NAME, "reference_position"),
        "reference return": 1.0 if of_axis(options["reference_return"], axis.letter, NAME, "") == "+" else -1.0,
        **settings,
    }
    both = bool(given["3605#0"])
    needed = ("3620", "3621", "3622", "3624", *(("3626",) if both else ()))
    for name in needed:
        if name not in given:
            raise InputError(f"parameters of {axis.letter}: {name} is missing, {MEANING[name]}")
    if both and given["3623"] != 1.0 and given["3627"]:
        raise InputError(
            f"parameters of {axis.letter}: 3623 is {given['3623']:g} and 3627 {given['3627']:g}; public sources do not say "
            "whether 3627 is multiplied by the magnification; expected a magnification of 1 beside it"
        )
    numbers = Numbering(*(round(given[n]) for n in ("3620", "3621", "3622")))
    turn = 0.0 if axis.is_linear else given["3625"]
    sections = sections_between(axis.letter, numbers, given["reference position"], given["3624"], turn)
    one = amounts(dict(values), numbers, sections, "the list of values")
    step = (-1.0 if options["sign"] == COMPENSATION else 1.0) / (1.0 if axis.is_linear else 180.0 / np.pi)
    up = down = step * given["detection unit"] * given["3623"] * one.held
    ahead = given["reference return"] > 0
    if both:
        there = round(given["3626"]) - numbers.lowest
        other = amounts(dict(values), Numbering(*(n + there for n in _tuple(numbers))), sections, "the list of values")
        down = step * given["detection unit"] * given["3623"] * other.held
        offset = step * given["detection unit"] * given["3627"]
        up, down = (up, down + offset) if ahead else (up + offset, down)
    else:
        lost = abs(step) * given["detection unit"] * given["1851"]
        up, down = (up, down + lost) if ahead else (up - lost, down)
    return AxisTable(axis.letter, axis.letter, sections.positions, up, down, period=turn)


def _tuple(numbers: Numbering) -> tuple[int, int, int]:
    return numbers.reference, numbers.lowest, numbers.highest
