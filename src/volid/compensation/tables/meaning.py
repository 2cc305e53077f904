"""What the numbers of a table are, in words: error motions, location errors or both, and whose sense they have.

A control adds the errors of its kinematic model as tool relative to workpiece, so tables hold the parameters. The symbol of a
location error, EX0C, means the axis average line instead, which an axis that carries the workpiece displaces the other way
(`volid.model.axis_lines`); no table stands under that symbol, and each with location errors says how its numbers relate to it.
"""

from __future__ import annotations

import re

from volid.compensation.tables.error_table import ErrorTable
from volid.compensation.types import POR, ROTARY_EFFECTS, TYPES
from volid.model.axis_lines import MACHINE, PARAMETER, carrier_of, full_symbol
from volid.model.iso230 import ROTATIONS, describe, parse
from volid.model.machine import Machine


def meaning_of(table: ErrorTable, machine: Machine) -> str:
    """The function of a table in words; for one with location errors also how the axis average line stands."""
    error, effects = parse(table.function), _effects(table)
    along = ROTATIONS.index(error.axis) if error.axis in ROTATIONS else error.component
    if (
        error.component % 3 == along % 3 or POR not in effects
    ):  # along and about its own line an axis has no location error
        return describe(table.function)
    constant = f"E{error.direction}0{error.axis}"
    located = f"{describe(constant)} ({PARAMETER}; the axis average line has {_symbol(machine, constant)} = "
    sign = "minus " if machine.axis(error.axis).primed else ""
    if effects == {POR}:
        return f"{located}{sign}the error value)"
    return f"{describe(table.function)}, and {located}{sign}the mean error value)"


def _symbol(machine: Machine, constant: str) -> str:
    """The symbol of an axis's own location error: relative to its carrier, if it has one."""
    carrier = carrier_of(machine, parse(constant).axis)
    return full_symbol(constant, MACHINE if carrier is None else carrier)


def _effects(table: ErrorTable) -> set[str]:
    """The effects of rotary axes that a table holds."""
    names = re.split(r" \+ | on top of ", table.type)
    return {e for n in names if n in TYPES for e in TYPES[n].effects} & set(ROTARY_EFFECTS)
