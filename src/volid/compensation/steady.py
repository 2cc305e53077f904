"""Values along a line that change by whole least increments and turn seldom, as near to given ones as that allows.

A helping axis, one that moves only because another one does, loses its own reversal at every turn, and cannot follow changes
below its least increment d (ISO/TR 16907 4 e, 10.5 d). The values f_i are therefore replaced by multiples of d within a tube
f_i ± e that rise and fall in as few pieces as any function in the tube; e is the smallest that leaves at most so many turns.
Not modelled: steps between two points, where a control interpolates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.compensation.rounding import round_to

BISECTIONS = 40
SLACK = 1e-9  # of an increment: values that are multiples stay what they are


class Steady(NamedTuple):
    """`values`, shape (n,), multiples of the least increment; `loss`: largest change from those given; `turns` of them."""

    values: np.ndarray
    loss: float
    turns: int


def steadied(values: np.ndarray, least: float, most: int) -> Steady:
    """Multiples of the least increment that turn at most `most` times.

    Args:
        values: Values along a line, shape (n,) [mm or rad].
        least: Least increment, above 0 [mm or rad].
        most: Largest number of turns, from rising to falling or back; 0 or more.

    >>> found = steadied(np.array([0.0, 2.1, 1.8, 3.9, 4.2]), 1.0, 0)
    >>> found.values.tolist(), round(found.loss, 3)
    ([0.0, 2.0, 2.0, 4.0, 4.0], 0.2)
    """
    low, high = 0.5 * least, float(np.ptp(values)) + least
    best = _within(values, low, least)
    if best is None or best.turns > most:
        best = _within(values, high, least)
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            found = _within(values, middle, least)
            if found is None or found.turns > most:
                low = middle
            else:
                high, best = middle, found
    assert best is not None  # a tube wider than the range holds a constant
    return best


def turns_of(values: np.ndarray, tiny: float = 1e-12) -> int:
    """How often values along a line, shape (n,), turn from rising to falling or back; standstills do not count.

    >>> turns_of(np.array([0.0, 1.0, 1.0, 2.0, 1.0]))
    1
    """
    steps = np.diff(values)
    ways = np.sign(steps[np.abs(steps) > tiny])
    return int(np.count_nonzero(np.diff(ways)))


def _within(values: np.ndarray, tube: float, least: float) -> Steady | None:
    """The fewest turns within the tube; None where it holds no multiple somewhere."""
    lower = np.ceil((values - tube) / least - SLACK) * least
    upper = np.floor((values + tube) / least + SLACK) * least
    if (lower > upper + SLACK * least).any():
        return None
    both = [_through(values, lower, np.maximum(lower, upper), least, rising) for rising in (True, False)]
    return min(both, key=lambda s: (s.turns, s.loss))


def _through(values: np.ndarray, lower: np.ndarray, upper: np.ndarray, least: float, rising: bool) -> Steady:
    """In the middle between the lowest and the highest function of these pieces."""
    low, high = lower.copy(), upper.copy()
    starts = _pieces(lower, upper, rising)
    for a, b in zip(starts, [*starts[1:], len(values) - 1], strict=True):
        part = slice(a, b + 1)
        up, down = (lower[part], upper[part]) if rising else (lower[part][::-1], upper[part][::-1])
        lowest, highest = np.maximum.accumulate(up), np.minimum.accumulate(down[::-1])[::-1]
        way = slice(None) if rising else slice(None, None, -1)
        low[part] = np.maximum(low[part], lowest[way])
        high[part] = np.minimum(high[part], highest[way])
        rising = not rising
    found = round_to(0.5 * (low + high), least)
    return Steady(found, float(np.abs(found - values).max()), turns_of(found, 0.5 * least))


def _pieces(lower: np.ndarray, upper: np.ndarray, rising: bool) -> list[int]:
    """Where the pieces begin that rise and fall in turn, each as long as it can be; a turn belongs to both of its pieces."""
    starts, bound = [0], lower[0] if rising else upper[0]
    for i in range(1, len(lower)):
        bound = max(bound, lower[i]) if rising else min(bound, upper[i])
        if (bound > upper[i]) if rising else (bound < lower[i]):
            rising = not rising
            starts.append(i - 1)
            bound = max(lower[i - 1], lower[i]) if rising else min(upper[i - 1], upper[i])
    return starts
