"""Increments of whole quanta whose running sum follows a curve as closely as quanta can.

A control that holds increments adds them up. Rounding each increment would add up its rounding errors; therefore the *cumulative*
value is rounded, and increments are the differences of rounded values:

    k_i = round(v_i / quantum),    d_i = k_i - k_(i-1),    |quantum · k_i - v_i| <= quantum / 2    for every i.

Where a control holds at most `limit` quanta per interval, what an interval needs beyond it is carried into the next ones, seen
from the reference, and the loss until it is worked off is stated.

Not modelled: where within an interval the control puts its increment out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from volid.exceptions import InputError

if TYPE_CHECKING:
    from jaxtyping import Float, Int

_CLOSED = 1e-6  # quanta: first and last value of a full turn are the same


@dataclass(frozen=True, eq=False)
class Increments:
    """Whole quanta from position to position.

    Args:
        held: Cumulative values that the control reaches, shape (n + 1,) [quanta].
        loss: Largest |quantum · held - value|, in the unit of the values.
        carried: Intervals that needed more than the limit.
    """

    held: Int[np.ndarray, " n+1"]
    loss: float
    carried: tuple[int, ...] = ()

    @property
    def steps(self) -> Int[np.ndarray, " n"]:
        """Increment of each interval, from its lower to its upper end, shape (n,) [quanta]."""
        return np.diff(self.held)


def increments(
    values: Float[np.ndarray, " n+1"],
    quantum: float,
    *,
    reference: int = 0,
    limit: int | None = None,
    closed: bool = False,
    what: str = "the table",
) -> Increments:
    """Increments whose running sum from the reference is never further from the values than half a quantum.

    Args:
        values: Cumulative values at the ends of the intervals, shape (n + 1,), in the unit of the quantum.
        quantum: Step in which the control holds values.
        reference: Index at which the control begins to add up.
        limit: Most quanta of one interval; None: any number.
        closed: Whether the values close a full turn, so that the increments must add up to 0.
        what: Name of the table for messages.

    Raises:
        InputError: the values do not close, or what the limit carries is not worked off at an end of the table.

    >>> found = increments(np.array([0.0, 0.4, 0.8, 1.2]), 1.0)
    >>> found.steps.tolist(), round(found.loss, 3)
    ([0, 1, 0], 0.4)
    """
    wanted = np.asarray(values, dtype=float) / quantum
    rounded = np.rint(wanted).astype(np.int64)
    if closed:
        rounded[-1] = _last_of_turn(wanted, rounded, what)
    held = rounded if limit is None else _within(rounded, reference, limit, what)
    beyond = () if limit is None else tuple(np.flatnonzero(np.abs(np.diff(rounded)) > limit).tolist())
    return Increments(held, float(quantum * np.abs(held - wanted).max()), beyond)


def _last_of_turn(wanted: np.ndarray, rounded: np.ndarray, what: str) -> int:
    """The first value again. Raises `InputError` where the last one is another."""
    gap = abs(float(wanted[-1] - wanted[0]))
    if gap > _CLOSED and rounded[-1] != rounded[0]:
        raise InputError(
            f"{what}: its first and last value, one turn apart, differ by {gap:.3g} steps of the control; expected the same "
            "value, because the increments of a turn must add up to 0"
        )
    return int(rounded[0])


def _within(rounded: np.ndarray, reference: int, limit: int, what: str) -> np.ndarray:
    """Values that move by at most `limit` from one to the next, outwards from the reference."""
    held = rounded.copy()
    for way, name in ((1, "last"), (-1, "first")):
        end = len(held) - 1 if way > 0 else 0
        for i in range(reference + way, end + way, way):
            held[i] = np.clip(rounded[i], held[i - way] - limit, held[i - way] + limit)
        if held[end] != rounded[end]:
            raise InputError(
                f"{what}: {abs(int(rounded[end] - held[end]))} steps of the control are left at its {name} position, "
                f"because one interval holds at most {limit}; take a larger magnification or a smaller interval"
            )
    return held
