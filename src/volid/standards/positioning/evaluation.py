"""Accuracy and repeatability of positioning after ISO 230-2, linear and rotary axes.

With X_ij the deviation of approach j of target i, and per direction ("up": approached in +, "down": in -) its mean m_i and
standard deviation s_i (n - 1):

    B_i = m_i up - m_i down            B = max |B_i|                   B_mean = mean of B_i
    E = max(m) - min(m) over both directions together                  E_up, E_down: over one direction
    M = max - min of (m_i up + m_i down) / 2
    R_i = max(2 s_i up + 2 s_i down + |B_i|, 4 s_i up, 4 s_i down)     R = max R_i;  R_up = max 4 s_i up, R_down likewise
    A = max(m + 2 s) - min(m - 2 s) over both directions together      A_up, A_down: over one direction

The range of E and of A runs over the means of BOTH directions. A range from the largest mean of one direction to the smallest
of the other misses an extreme wherever both extremes are of one direction, and is not E, although reports are found that
print it.

Not modelled: drift between runs, which stays in the deviations as it does in the standard's evaluation. A quantity for which a
direction, or the scatter, is missing is absent. Source: ISO 230-2:2014.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from volid.standards.positioning.rules import attention, rules
from volid.standards.positioning.runs import DOWN, UP, WAY_NAMES, PositioningRuns, Statistics, ask_size, statistics_of
from volid.standards.positioning.uncertainty import Contribution, Uncertainty, expanded
from volid.standards.results import Evaluation, Quantity, Table

STANDARD = "ISO 230-2"
WITHOUT_U = (
    "nothing is known of the uncertainty of the test: U is left out; `uncertainty` reads the conditions it follows from"
)
MEANINGS = {
    "E": "systematic positional deviation, both directions",
    "E_up": "systematic positional deviation, approached in +",
    "E_down": "systematic positional deviation, approached in -",
    "A": "accuracy of positioning, both directions",
    "A_up": "accuracy of positioning, approached in +",
    "A_down": "accuracy of positioning, approached in -",
    "R": "repeatability of positioning, both directions",
    "R_up": "repeatability of positioning, approached in +",
    "R_down": "repeatability of positioning, approached in -",
    "M": "range of the mean bidirectional deviation",
    "B": "reversal deviation, the largest",
    "B_mean": "mean reversal deviation, mean up less mean down",
}


class PositioningResult(NamedTuple):
    """The runs, their statistics by target, and what is known of the test's uncertainty."""

    runs: PositioningRuns
    statistics: Statistics
    uncertainty: Uncertainty | None


def evaluate_positioning(runs: PositioningRuns, contributions: Sequence[Contribution] = ()) -> Evaluation:
    """All quantities of ISO 230-2 of one axis, with the table of its targets and the standard's rules that the test breaks.

    Args:
        runs: Deviations by target, direction and run.
        contributions: What makes the test uncertain; without any, U stays unknown.

    Raises:
        InputError: deviations of more than a millimetre or a tenth of a degree from their median, outside `accept_unusual`.

    Source: ISO 230-2:2014.

    >>> deviations = np.array([[[0.000, 0.002], [0.003, 0.005]], [[0.009, 0.011], [0.013, 0.015]]])
    >>> found = evaluate_positioning(PositioningRuns("X", np.array([0.0, 100.0]), deviations))
    >>> round(found["E"].value, 6), round(found["B"].value, 6), round(found["R"].value, 6)
    (0.013, 0.004, 0.009657)
    """
    ask_size(runs)
    statistics = statistics_of(runs.deviations)
    values = {name: float(v) for name, v in quantities_of(statistics).items() if np.isfinite(v)}
    uncertainty = expanded(runs, contributions, quantities_of) if contributions else None
    quantities = tuple(
        Quantity(name, value, runs.unit, uncertainty.U.get(name) if uncertainty else None, text=MEANINGS[name])
        for name, value in values.items()
    )
    remarks = (
        *rules(runs),
        *_mixed(runs, statistics),
        *runs.notes,
        *(uncertainty.remarks if uncertainty else (WITHOUT_U,)),
    )
    return Evaluation(
        STANDARD,
        runs.axis,
        quantities,
        remarks,
        attention(runs),
        Table(*_table(runs, statistics)),
        runs.source,
        PositioningResult(runs, statistics, uncertainty),
    )


def quantities_of(found: Statistics) -> dict[str, np.ndarray]:
    """Every quantity by its symbol, each of shape (…); NaN where a direction or the scatter is missing."""
    low, high = found.mean - 2.0 * found.s, found.mean + 2.0 * found.s
    unknown = np.isnan(found.s) & np.isfinite(found.mean)  # of a single such target A and R are not known
    quantities: dict[str, np.ndarray] = {}
    for symbol, upper, lower, gaps in (("E", found.mean, found.mean, None), ("A", high, low, unknown)):
        ranges = [_range(upper[..., way], lower[..., way], _any(gaps, way)) for way in (UP, DOWN)]
        both = _range(_flat(upper), _flat(lower), _any(gaps, slice(None)))
        quantities |= _in_ways(symbol, np.where(np.isfinite(ranges[0] + ranges[1]), both, np.nan), ranges)
    scatter = [_largest(4.0 * found.s[..., way], _any(unknown, way)) for way in (UP, DOWN)]
    alone = np.isfinite(found.reversal)
    reached = np.where(alone, found.repeatability, 4.0 * np.fmax(found.s[..., UP], found.s[..., DOWN]))
    both = _largest(reached, _any(unknown, slice(None)))
    quantities |= _in_ways("R", np.where(np.isfinite(scatter[0] + scatter[1]), both, np.nan), scatter)
    quantities["M"] = _range(found.both, found.both)
    quantities["B"] = _largest(np.abs(found.reversal))
    there = alone.sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        quantities["B_mean"] = np.where(alone, found.reversal, 0.0).sum(axis=-1) / there
    return quantities


def mixed_ranges(found: Statistics) -> tuple[float, float]:
    """What is no E: from the largest mean up to the smallest mean down, and from the largest mean down to the smallest up."""
    (highest_up, highest_down), (lowest_up, lowest_down) = np.nanmax(found.mean, axis=0), np.nanmin(found.mean, axis=0)
    return float(highest_up - lowest_down), float(highest_down - lowest_up)


def _in_ways(symbol: str, both: np.ndarray, ways: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    return {symbol: both} | {f"{symbol}_{name}": value for name, value in zip(WAY_NAMES, ways, strict=True)}


def _flat(values: np.ndarray) -> np.ndarray:
    return values.reshape(*values.shape[:-2], -1)


def _any(unknown: np.ndarray | None, way: int | slice) -> np.ndarray | bool:
    """Whether the scatter of any target is unknown in these directions, (…)."""
    if unknown is None:
        return False
    return np.asarray(_flat(unknown[..., way] if isinstance(way, slice) else unknown[..., [way]]).any(-1))


def _largest(values: np.ndarray, unknown: np.ndarray | bool = False) -> np.ndarray:
    """Largest over the last axis without NaN, (…); NaN where there is none, or where it is `unknown`."""
    largest = np.max(np.where(np.isnan(values), -np.inf, values), axis=-1)
    return np.where(np.isfinite(largest) & ~np.asarray(unknown), largest, np.nan)


def _range(upper: np.ndarray, lower: np.ndarray, unknown: np.ndarray | bool = False) -> np.ndarray:
    return np.asarray(_largest(upper, unknown) + _largest(-lower, unknown))


def _mixed(runs: PositioningRuns, found: Statistics) -> Iterator[str]:
    """The number that a program shows that takes the two extremes from different directions, where it is another than E."""
    if len(runs.directions) < 2:
        return
    E, mixed = float(quantities_of(found)["E"]), max(mixed_ranges(found))
    if mixed < E * (1.0 - 1e-9):
        shown = f"{1e3 * mixed:.2f} µm" if runs.unit == "mm" else f"{3600.0 * mixed:.2f} arc sec"
        yield (
            "both extremes of E are means of one direction; a program that takes the largest mean of one direction and the "
            f"smallest of the other shows {shown}, which is not E"
        )


def _table(runs: PositioningRuns, found: Statistics) -> tuple[tuple[str, ...], tuple[tuple[float, ...], ...]]:
    """Names of the columns with their unit, and a row for each target."""
    unit = "mm" if runs.unit == "mm" else "deg"
    names = ("target", "mean_up", "mean_down", "mean", "s_up", "s_down", "B", "R_up", "R_down", "R")
    values = np.column_stack(
        [runs.targets, found.mean, found.both, found.s, found.reversal, 4.0 * found.s, found.repeatability]
    )
    counts = found.n.tolist()
    rows = tuple((*row, *n) for row, n in zip(values.tolist(), counts, strict=True))
    return (*(f"{name}_{unit}" for name in names), "n_up", "n_down"), rows
