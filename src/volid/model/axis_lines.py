"""What ISO 230-1 means by the symbol of a location error: where the axis average line stands in the machine frame.

The parameters of the model describe the tool relative to the workpiece, in the stator of their own axis. The line of an axis is
displaced and tilted by the errors of all rotary axes between the bed and it, δ(x) = ± Σ (e + ω × (x - p)). The sign is + on the
tool side, and - on the workpiece side, because the physical line moves the other way (CONVENTIONS 3). The error motions have zero
mean, so these are axis average lines (ISO 230-7). The zero of an axis (EC0C) turns with the same sign.

This is the only place where the sign is taken: whatever prints a number under such a symbol asks for its rows here. Squareness
errors and constants of the tool frame are their parameters themselves.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from volid.model.error_model import LOCATION, ErrorModel
from volid.model.iso230 import DIRECTIONS, parse
from volid.model.machine import Axis, Machine

MACHINE = "machine"
AXIS_LINE = "axis average line in the machine frame, other axes at 0"
PARAMETER = "parameter, tool relative to workpiece"


class LineRow(NamedTuple):
    """One constant as a linear function of θ: `symbol` with the datum axis in brackets, plain `name`, and `row` (n,)."""

    symbol: str
    name: str
    relative_to: str
    row: np.ndarray


def full_symbol(name: str, relative_to: str) -> str:
    """The symbol with its datum axis in brackets, EB(0A)C, or as ISO 230-1 has it for the machine frame, EB0C.

    >>> full_symbol("EB0C", "A"), full_symbol("EB0C", "machine")
    ('EB(0A)C', 'EB0C')
    """
    return name if relative_to == MACHINE else f"{name[:2]}(0{relative_to}){name[3]}"


def is_of_a_line(symbol: str) -> bool:
    """Whether a symbol is that of a location error or zero of a rotary axis, EX0C or EX(0A)C."""
    return re.fullmatch(r"E[XYZABC](0|\(0[ABC]\))[ABC]", symbol) is not None


def line_parameters(machine: Machine, axis: Axis, at: tuple[float, float, float]) -> dict[str, np.ndarray]:
    """Displacement of the axis's line at point `at` and its rotation, machine frame, by one unit of each parameter; (6,) each."""
    first, sign = machine.index(axis.letter), -1.0 if axis.primed else 1.0
    found = {}
    for i, carrier in enumerate(machine.axes):
        between = i >= first if axis.primed else i <= first
        if carrier.is_linear or carrier.primed != axis.primed or not between:
            continue
        lever = np.asarray(at) - np.asarray(carrier.error_point)
        for k, direction in enumerate(DIRECTIONS):
            vector = sign * carrier.frame[:, k % 3]
            effect = np.concatenate([vector, 0.0 * vector] if k < 3 else [np.cross(vector, lever), vector])
            found[f"E{direction}0{carrier.letter}"] = effect
    return found


def line_coefficients(machine: Machine, name: str, relative_to: str = MACHINE) -> dict[str, float]:
    """ISO's value of a location error is the sum of these coefficients times the parameters of the same symbols.

    Args:
        machine: The machine.
        name: Symbol of any constant; for others than location errors and zeros of rotary axes it is the parameter itself.
        relative_to: "machine", or letter of a rotary axis of the same side.

    >>> import volid
    >>> machine = volid.load_machine("models/wCAYXbZt_trunnion.toml")
    >>> line_coefficients(machine, "EY0A"), line_coefficients(machine, "EC0Y")
    ({'EY0A': -1.0}, {'EC0Y': 1.0})
    """
    if not is_of_a_line(name):
        return {name: 1.0}
    axis, component = machine.axis(parse(name).axis), parse(name).component
    effects = line_parameters(machine, axis, axis.point)
    if relative_to != MACHINE:
        datum = line_parameters(machine, machine.axis(relative_to), axis.point)
        effects = {n: effects.get(n, np.zeros(6)) - datum.get(n, np.zeros(6)) for n in effects | datum}
    half = slice(0, 3) if component < 3 else slice(3, 6)
    found = {n: float(axis.frame[:, component % 3] @ effect[half]) for n, effect in effects.items()}
    return {n: value for n, value in found.items() if value != 0.0}


def line_row(model: ErrorModel, name: str, relative_to: str = MACHINE) -> np.ndarray:
    """ISO's value as row on θ, (n,); parameters that the model leaves out are 0."""
    row = np.zeros(model.n_parameters)
    for parameter, coefficient in line_coefficients(model.machine, name, relative_to).items():
        f = model.by_name.get((parameter, LOCATION))
        if f is not None:
            row[f.parameters] = coefficient
    return row


def line_values(machine: Machine, parameters: Mapping[str, float]) -> dict[str, float]:
    """ISO's values of constants whose parameters are given by symbol, such as those of a virtual machine [mm, rad]."""
    return {
        name: sum(c * parameters.get(n, 0.0) for n, c in line_coefficients(machine, name).items())
        for name in parameters
    }


def carrier_of(machine: Machine, letter: str) -> str | None:
    """The rotary axis that carries another one: the next towards the bed on its side; None for an axis on the machine itself."""
    axis, first = machine.axis(letter), machine.index(letter)
    nearer = machine.axes[first + 1 :] if axis.primed else machine.axes[:first][::-1]
    return next((a.letter for a in nearer if not a.is_linear and a.primed == axis.primed), None)


def constant_rows(model: ErrorModel) -> Iterator[LineRow]:
    """Every constant of a model: first in the machine frame, and those of a carried axis also relative to its carrier.

    These may be known better, or alone: how two axes of a head stand to each other, when the place of the head is that of the
    workpiece.
    """
    for name, part in model.by_name:
        if part != LOCATION:
            continue
        yield LineRow(name, name, MACHINE, line_row(model, name))
        carrier = carrier_of(model.machine, parse(name).axis) if is_of_a_line(name) else None
        if carrier is not None:
            yield LineRow(full_symbol(name, carrier), name, carrier, line_row(model, name, carrier))
