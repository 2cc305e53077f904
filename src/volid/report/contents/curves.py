"""Error motions as curves: one per function and direction of approach, with u, and coverage intervals where there are samples.

The numbers are those of `Solution.functions`; files that are handed over group them here.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from volid.fitting.results import FunctionValue
from volid.fitting.short_waves import wave_size
from volid.fitting.solution import Solution
from volid.fitting.tabulation import points_with_waves
from volid.model.iso230 import DIRECTIONS, ErrorName, parse

K = 2.0
_CARRIER = re.compile(r"\(0[ABC]\)")
SIGNS = {1: " (+)", -1: " (−)", 0: ""}


@dataclass(frozen=True, eq=False)
class Curve:
    """An error motion for one direction of approach.

    Args:
        name: Its ISO 230-1 symbol.
        direction: +1, -1, or 0 where both are alike.
        positions: Positions of its axis, shape (m,) [mm or degrees].
        values: Values there, shape (m,) [mm or rad]; NaN where the data do not determine them.
        u: Their standard uncertainties, shape (m,).
        low, high: Ends of the 95 % coverage intervals, symmetric in probability, shape (m,); None without samples.
    """

    name: str
    direction: int
    positions: np.ndarray
    values: np.ndarray
    u: np.ndarray
    low: np.ndarray | None = field(default=None)
    high: np.ndarray | None = field(default=None)

    @property
    def error(self) -> ErrorName:
        """The symbol taken apart."""
        return parse(self.name)

    @property
    def known(self) -> np.ndarray:
        """Which values the data determine, bool (m,): none where only the reference is left, at which every function is 0."""
        known = np.isfinite(self.values) & np.isfinite(self.u)
        return known & (known.sum() > 1 or len(known) == 1)

    @property
    def title(self) -> str:
        """The symbol with the direction of approach: "EXX (+)"."""
        return self.name + SIGNS[self.direction]


def curves(solution: Solution) -> list[Curve]:
    """Every error motion of the solution, axis by axis in the order X, Y, Z, A, B, C, as `Solution.functions` tabulates it."""
    rows = [row for row in solution.functions() if not parse(row.name).location]
    ends = _intervals(solution, rows)
    places: dict[tuple[str, int], list[int]] = {}
    for i, row in enumerate(rows):
        places.setdefault((row.name, row.direction), []).append(i)
    order = sorted(places, key=lambda key: (DIRECTIONS.index(key[0][2]), parse(key[0]).component, -key[1]))
    return [_curve(*key, [rows[i] for i in places[key]], [e[places[key]] for e in ends]) for key in order]


@dataclass(frozen=True)
class HiddenWaves:
    """Short waves of an axis that the positions of its curves are too far apart to show.

    Args:
        axis: Its letter.
        pitch: Their period [mm].
        sizes: Largest size of the wave and its U (k = 2), by symbol of the error motion [mm].
    """

    axis: str
    pitch: float
    sizes: dict[str, tuple[float, float]]

    def values(self, german: bool) -> dict[str, str]:
        """What a sentence about them says: axis, pitch [mm], and sizes [µm]."""
        said = {
            "axis": self.axis,
            "pitch": f"{self.pitch:g}",
            "sizes": "; ".join(
                f"{name} {1e3 * size:.1f} µm (U {1e3 * U:.1f} µm)" for name, (size, U) in self.sizes.items()
            ),
        }
        return {key: text.replace(".", ",") for key, text in said.items()} if german else said


def hidden_waves(solution: Solution, found: Sequence[Curve]) -> list[HiddenWaves]:
    """Axes of which some curve stands at fewer positions than its waves of a stated pitch need: to interpolate misses them."""
    sizes: dict[str, dict[str, tuple[float, float]]] = {}
    for own in (c for c in found if c.known.any()):
        if points_with_waves(solution, own.name, len(own.positions)) > len(own.positions):
            size, u = wave_size(solution, own.name)
            sizes.setdefault(own.error.axis, {})[own.name] = size, K * u
    return [HiddenWaves(axis, solution.machine.axis(axis).pitch, own) for axis, own in sizes.items()]


def _intervals(solution: Solution, rows: list[FunctionValue]) -> list[np.ndarray]:
    """Low and high ends of the coverage intervals, each (q,); none without samples."""
    if not solution.samples or not rows:
        return []
    from volid.uncertainty.intervals import function_intervals

    found = function_intervals(solution, rows)
    return [found.low, found.high]


def _curve(name: str, direction: int, rows: list[FunctionValue], ends: list[np.ndarray]) -> Curve:
    columns = (np.array([getattr(row, key) for row in rows]) for key in ("position", "value", "u"))
    return Curve(name, direction, *columns, *ends)


def plain_symbol(symbol: str) -> str:
    """The symbol of a location error without the axis that it refers to.

    >>> plain_symbol("EX(0A)C")
    'EX0C'
    """
    return _CARRIER.sub("0", symbol)
