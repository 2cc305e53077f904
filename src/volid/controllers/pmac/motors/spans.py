"""Compensation tables over the counts of motors, as Turbo PMAC holds them: one or two source motors, one target motor.

A table spans 0 … L counts in N entries, entry j at j · L / N. The value at 0 is 0 by definition, positions outside are rolled
over by L, and the control interpolates linearly. Positions below 0 stand behind the highest ones: with the travel from k = -a
to b and N = a + b + 1,

    entry j holds the value at k = j for j <= b,  and at k = j - N for j > b.

The section between b and b + 1 is then never used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, floor
from typing import TYPE_CHECKING, Any

import numpy as np

from volid.controllers.axis_values import ask_axes, of_axis, or_none
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES, ROTARY_AXES
from volid.model.machine import Machine

if TYPE_CHECKING:
    from jaxtyping import Float, Int

_ON_NODE = 1e-6  # spacings
_MOST = 20_000  # positions over a travel: more are a mistake in a file
NO_TRAVEL = 100_000.0  # mm or °
PARTS = 16  # of a count, the unit of the entries


@dataclass(frozen=True)
class Motor:
    """A motor and its axis. `number`: that of the motor; `counts`: per mm or °; `home`: where it is at 0 [mm or °].

    `travel`: lowest and highest position of the axis [mm or °]; None where no machine says it.
    """

    axis: str
    number: int
    counts: float
    home: float
    linear: bool
    travel: tuple[float, float] | None = None

    @property
    def parts(self) -> float:
        """Entries per mm or rad."""
        return PARTS * self.counts * (1.0 if self.linear else 180.0 / np.pi)


@dataclass(frozen=True)
class Span:
    """Positions of a table along one source motor.

    Args:
        motor: The source motor.
        entries: Number N of sections of the table.
        length: Its span L [counts].
        below, above: Sections on either side of motor zero; of a full turn 0 and N.
    """

    motor: Motor
    entries: int
    length: int
    below: int
    above: int

    @property
    def spacing(self) -> float:
        """Distance of the entries [mm or °]."""
        return self.length / (self.entries * self.motor.counts)

    @property
    def positions(self) -> Float[np.ndarray, " n"]:
        """Positions of the travel, rising [mm or °]."""
        return np.asarray(self.motor.home + self.spacing * np.arange(-self.below, self.above + 1))

    @property
    def order(self) -> Int[np.ndarray, " N+1"]:
        """For each entry j = 0 … N the index of its place in `positions`."""
        j = np.arange(self.entries + 1)
        return np.where(j <= self.above, j, j - self.entries) + self.below

    @property
    def zero(self) -> int:
        """Index of motor zero in `positions`."""
        return self.below


def motors_of(machine: Machine, options: Mapping[str, Any], control: str) -> dict[str, Motor]:
    """The motor of each axis, by its letter. Raises `InputError` where counts are missing, or two axes have one motor."""
    ask_axes(options["counts"], machine.letters, control, "counts")
    found: dict[str, Motor] = {}
    numbered = enumerate((*LINEAR_AXES, *ROTARY_AXES), 1)
    for i, letter in ((i, a) for i, a in numbered if a in machine.letters):
        number = or_none(options["motors"], letter) or i
        counts, home = (of_axis(options[name], letter, control, name) for name in ("counts", "home"))
        twice = next((m.axis for m in found.values() if m.number == number), None)
        if twice is not None:
            raise InputError(
                f"{control}: motor {number} drives {twice} and {letter}; state motors=X=1,Y=2,… with one for each"
            )
        low, high = machine.axis(letter).travel
        travel = (low, high) if high - low <= NO_TRAVEL else None
        found[letter] = Motor(letter, number, counts, home, machine.axis(letter).is_linear, travel)
    return found


def span_over(motor: Motor, low: float, high: float, spacing: float, period: float = 0.0) -> Span:
    """Positions that cover low … high and the travel [mm or °], about `spacing` apart: the span is a whole number of counts.

    Beyond its span a table begins again; a table that ends within the travel is therefore held up to its ends.
    """
    if period:
        n = max(round(period / spacing), 1)
        return Span(motor, n, round(period * motor.counts), 0, n)
    if motor.travel is not None:
        low, high = min(low, motor.travel[0]), max(high, motor.travel[1])
    below = max(-floor((low - motor.home) / spacing + _ON_NODE), 0)
    above = max(ceil((high - motor.home) / spacing - _ON_NODE), 0)
    n = below + above + 1
    return Span(motor, n, ceil(n * spacing * motor.counts - _ON_NODE), below, above)


def span_of(motor: Motor, entries: int, length: int, low: float, high: float) -> Span:
    """Positions of a table that was read, over the travel low … high [mm or °], rolled over as often as it takes.

    Raises `InputError` for too many.
    """
    spacing = length / (entries * motor.counts)
    low, high = reach(motor, low, high, length)
    below = -floor((low - motor.home) / spacing + _ON_NODE)
    above = ceil((high - motor.home) / spacing - _ON_NODE)
    if not 0 < below + above + 1 <= _MOST:
        raise InputError(
            f"table over motor {motor.number}: {entries} entries over {length} counts are {spacing:.3g} apart on {motor.axis}; "
            f"expected at most {_MOST} over its travel"
        )
    return Span(motor, entries, length, below, above)


def reach(motor: Motor, low: float, high: float, length: float) -> tuple[float, float]:
    """The travel low … high; where it is none that a machine has, because none is known, `length` counts from motor zero on."""
    return (low, high) if high - low <= NO_TRAVEL else (motor.home, motor.home + length / motor.counts)


def rolled(entries: Int[np.ndarray, " N+1"], span: Span) -> Int[np.ndarray, " n"]:
    """Values at the positions of a span that was read, from the entries 0 … N along the last dimension."""
    return np.asarray(entries[..., np.mod(np.arange(-span.below, span.above + 1), span.entries)])
