"""Increments in numbered sections of an axis, as the Fanuc pitch memory counts them from its reference position.

Section n lies between reference + (n - N - 1) · interval and reference + (n - N) · interval, N the number of the reference
position. With d_n the value of section n [quanta], the amount at reference + k · interval is

    a(k) = d_(N+1) + … + d_(N+k) for k > 0,    a(k) = -(d_(N+k+1) + … + d_N) for k < 0,    a(0) = 0.

On a full turn of m sections, number N is section N + m again and holds its value.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil, floor
from typing import TYPE_CHECKING

import numpy as np

from volid.compensation.tables.axis_table import AxisTable
from volid.controllers.tables.resampling import spacing_of
from volid.exceptions import InputError

if TYPE_CHECKING:
    from jaxtyping import Float, Int

_ON_NODE = 1e-6  # intervals
_MOST = 100_000  # sections of an axis: more are a mistake in a file


@dataclass(frozen=True)
class Sections:
    """Where the sections of one axis lie.

    Args:
        axis: Letter of the axis.
        reference: Its reference position [mm or °].
        interval: Length of a section [mm or °].
        below, above: Sections on either side of the reference position.
        turn: 360 where they close a full turn, else 0 [°].
    """

    axis: str
    reference: float
    interval: float
    below: int
    above: int
    turn: float = 0.0

    @property
    def positions(self) -> Float[np.ndarray, " n+1"]:
        """Ends of the sections, rising [mm or °]."""
        return np.asarray(self.reference + self.interval * np.arange(-self.below, self.above + 1))

    @property
    def count(self) -> int:
        """Numbers that they take: the sections, and the reference position's own where no section ends there."""
        return self.above + max(self.below, 1)


def sections_of(table: AxisTable, reference: float, interval: float | None, most: int) -> Sections:
    """Sections that cover a table; without an interval such that its positions are met, if at most so many sections do that.

    Raises `InputError` for an interval that does not divide a full turn.
    """
    if interval is not None:
        return _sections(table, reference, interval)
    found = [_sections(table, reference, spacing_of(table.positions, zero, most)) for zero in (reference, None)]
    return next((s for s in found if s.count <= most), found[-1])


def _sections(table: AxisTable, reference: float, length: float) -> Sections:
    low, high = float(table.positions[0]), float(table.positions[-1])
    if table.period:
        m = round(table.period / length)
        if m < 1 or abs(m * length - table.period) > _ON_NODE * length:
            raise InputError(
                f"table of {table.output}: its interval of {length:.9g}° does not divide the turn of {table.period:g}°; "
                "take one that does"
            )
        return Sections(table.output, reference, table.period / m, 0, m, table.period)
    below = max(-floor((low - reference) / length + _ON_NODE), 0)
    above = max(ceil((high - reference) / length - _ON_NODE), 0)
    return Sections(table.output, reference, length, below, above)


@dataclass(frozen=True)
class Numbering:
    """Numbers of the sections of one axis: that of the reference position, the lowest and the highest."""

    reference: int
    lowest: int
    highest: int


def numbered(sections: Sections, first: int) -> Numbering:
    """The numbers, when the lowest is `first`."""
    reference = first + max(sections.below - 1, 0)
    return Numbering(reference, first, reference + sections.above)


def values_of(steps: Int[np.ndarray, " n"], sections: Sections, numbers: Numbering) -> dict[int, int]:
    """Value of each number, from the increments of the sections in rising order [quanta]."""
    start = numbers.reference - sections.below + 1
    found = {start + i: int(step) for i, step in enumerate(steps)}
    if sections.turn:
        found[numbers.reference] = int(steps[-1])
    return {n: found.get(n, 0) for n in range(numbers.lowest, numbers.highest + 1)}


@dataclass(frozen=True, eq=False)
class Amounts:
    """What the control has put out at the ends of its sections.

    Args:
        sections: Where the sections lie.
        held: Amount at each end, 0 at the reference position, shape (n + 1,) [quanta].
    """

    sections: Sections
    held: Int[np.ndarray, " n+1"] = field(default_factory=lambda: np.zeros(1, dtype=np.int64))


def amounts(values: dict[int, int], numbers: Numbering, sections: Sections, place: str) -> Amounts:
    """Amounts from the numbered values. Raises `InputError` for a number that has no value."""
    wanted = range(numbers.reference - sections.below + 1, numbers.reference + sections.above + 1)
    missing = next((n for n in wanted if n not in values), None)
    if missing is not None:
        raise InputError(
            f"{place}: position number {missing} of {sections.axis} has no value; expected one for each number"
        )
    running = np.concatenate([[0], np.cumsum([values[n] for n in wanted], dtype=np.int64)])
    return Amounts(sections, running - running[sections.below])


def sections_between(axis: str, numbers: Numbering, reference: float, interval: float, turn: float) -> Sections:
    """Sections that numbers of a file describe. Raises `InputError` for numbers that describe none."""
    above, below = numbers.highest - numbers.reference, numbers.reference - numbers.lowest + 1
    if not (interval > 0.0 and above >= 0 and below >= 0 and 0 < above + below < _MOST):
        raise InputError(
            f"parameters of {axis}: reference number {numbers.reference}, lowest {numbers.lowest}, highest {numbers.highest}, "
            f"interval {interval:g}; expected lowest <= reference + 1, reference <= highest, and an interval above 0"
        )
    if turn and abs(above * interval - turn) > _ON_NODE * interval:
        raise InputError(f"parameters of {axis}: {above} sections of {interval:g} are no turn of {turn:g}")
    return Sections(axis, reference, interval, 0 if turn else below, above, turn)
