"""Whether readings agree with their prediction: three independent chi-squares, and what they would have found.

The readings against their prediction, |v|² (see `whitened`), are split into what simple changes would do (scale, location errors,
tool length), what any smooth change of an error function would do, and all the rest. The parts are across each other, so they are
independent: each is asked at 1 - level^(1/k), and a right solution passes all k with probability `level`. A single chi-square of
thousands of readings would hardly notice a single wrong number; the first part consists of little else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtrc, chdtri, chndtr

from volid.validation.readings.changes import Change, bumps, shapes, simple_changes
from volid.validation.readings.whitened import ABSORBED, Whitened

SIMPLE, SMOOTH, REST = "simple changes", "smooth changes of functions", "all the rest"
POWER = 0.9  # with which the smallest change is found
HUGE = 1.0  # mm at the functional point: a change that is found only from there on is none that a campaign is for
LARGEST = 1e6  # times the change that one number alone would show with five standard deviations: not found at all


@dataclass(frozen=True)
class Test:
    """One chi-square: `what` it asks about, `chi_square`, its `freedom`, the `limit` that a right solution passes, and the
    `probability` of a chi-square at least this large if the solution is right."""

    __test__ = False  # pytest takes classes called Test for its own

    what: str
    chi_square: float
    freedom: int
    limit: float
    probability: float

    @property
    def passed(self) -> bool:
        """Whether it is within its limit."""
        return self.chi_square <= self.limit


@dataclass(frozen=True)
class Smallest:
    """The smallest change that would have been found with a probability of 90 %: `sort`, `name`, `value` in `unit` (infinite:
    none would be found), and `at_point` [mm]: what it moves the functional point by at the end of its lever."""

    sort: str
    name: str
    value: float
    unit: str
    at_point: float


class Split(NamedTuple):
    """Orthonormal bases (n, k) of the parts of |v|² that have a name, and the changes that they are of."""

    whitened: Whitened
    bases: tuple[np.ndarray, ...]
    changes: tuple[Change, ...]

    @classmethod
    def of(cls, whitened: Whitened) -> Split:
        changes = tuple(simple_changes(whitened.linear))
        nothing = np.zeros((len(whitened.v), 0))
        columns = np.stack([c.column for c in changes], axis=1) if changes else nothing
        first = whitened.span(columns, nothing)
        return cls(whitened, (first, whitened.span(shapes(whitened.linear), first)), changes)

    def parts(self, x: np.ndarray) -> np.ndarray:
        """|x|² by part, (3,), of x as `Whitened.free` gives it."""
        named = [float(np.sum((basis.T @ x) ** 2)) for basis in self.bases]
        return np.array([*named, max(float(x @ x) - sum(named), 0.0)])

    @property
    def freedom(self) -> np.ndarray:
        """Degrees of freedom by part, (3,)."""
        named = [basis.shape[1] for basis in self.bases]
        return np.array([*named, max(self.whitened.freedom - sum(named), 0)])

    def limits(self, level: float) -> np.ndarray:
        """Limits of the parts, (3,); 0 for one without freedom."""
        each = 1.0 - level ** (1.0 / max(int((self.freedom > 0).sum()), 1))
        return np.array([float(chdtri(k, each)) if k else 0.0 for k in self.freedom])


def tests(split: Split, level: float) -> tuple[Test, ...]:
    """The chi-squares that have any freedom."""
    numbers = zip(
        (SIMPLE, SMOOTH, REST), split.parts(split.whitened.v), split.freedom, split.limits(level), strict=True
    )
    return tuple(Test(w, float(x), int(k), float(a), float(chdtrc(k, x))) for w, x, k, a in numbers if k > 0)


def together(found: Sequence[Test]) -> float:
    """Probability that the least probable of independent tests is as improbable as here, if the solution is right."""
    return float(1.0 - (1.0 - min((t.probability for t in found), default=1.0)) ** len(found))


def smallest_changes(split: Split, level: float) -> tuple[Smallest, ...]:
    """What would have been found with a probability of 90 %: of every simple change, and of a bump in each positioning."""
    found = [_stated(c.sort, c.name, smallest(split, c.column, level), c.unit, c.lever) for c in split.changes]
    for letter, columns in bumps(split.whitened.linear):
        size = max(smallest(split, column, level) for column in columns.T)
        what = f"bump in E{letter}{letter}, wherever it is"
        found.append(_stated("bump", what, size, "mm", 1.0))
    return tuple(found)


def _stated(sort: str, name: str, size: float, unit: str, lever: float) -> Smallest:
    size = size if size * lever < HUGE else float("inf")
    return Smallest(sort, name, size, unit, size * lever)


def smallest(split: Split, column: np.ndarray, level: float) -> float:
    """The smallest size of a change with these sensitivities (n,) over u that is found with a probability of 90 %; else inf."""
    left = split.whitened.free(column)
    seen = float(np.linalg.norm(left))
    if seen <= ABSORBED * float(np.linalg.norm(split.whitened.whitened(column))):
        return float("inf")
    parts, freedom, limits = split.parts(left), split.freedom, split.limits(level)

    def missing(size: float) -> float:
        return found_with(size**2 * parts, freedom, limits) - POWER

    top = 5.0 / seen
    while missing(top) < 0.0:
        top *= 2.0
        if top > LARGEST / seen:
            return float("inf")
    return float(brentq(missing, 0.0, top, rtol=1e-4))


def found_with(noncentrality: np.ndarray, freedom: np.ndarray, limits: np.ndarray) -> float:
    """Probability that some part exceeds its limit: 1 - Π P(χ'²(freedom, noncentrality) ≤ limit)."""
    passed = [float(chndtr(a, k, max(x, 0.0))) for x, k, a in zip(noncentrality, freedom, limits, strict=True) if k > 0]
    return 1.0 - float(np.prod(passed))
