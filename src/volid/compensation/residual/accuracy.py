"""How uncertain the size of a field or of an error motion is: expanded uncertainty of ranges and of largest values.

A range is not linear in the parameters: what is uncertain makes it larger on the average, because it picks the extreme values.
For draws of the parameters around the estimate, with size V,

    U = 2 s + |b| / (sqrt(2) - 1),    s the standard deviation of V(draws),    b = mean of V(draws) - V(estimate),

k = 2 for the spread, and what V(estimate) itself may be too large by added in full, because it is not taken off (GUM F.2.4.5).
The draws add the same noise to the estimate a second time and so show that shift: as it is where V is large and g(v), the mean
of V at v times the variance, is linear in v, so that g(1) - g(0) = g(2) - g(1) = b; and the share sqrt(2) - 1 of it where V is
all noise and g goes with sqrt(v). The larger is taken. What is independent from position to position (`Solution.scatter`) is
drawn too. Not included: what the machine does not repeat, temperature. A machine without any error, measured with noise that is
independent from place to place, is the hardest case: U holds for 89 % of campaigns instead of 95 %.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from volid.compensation.base import deviation_rows
from volid.compensation.residual.prediction import parameter_draws
from volid.fitting.prediction.largest import values_at, with_largest
from volid.fitting.solution import Solution
from volid.fitting.tabulation import whole_motion
from volid.model.iso230 import parse

K = 2.0
SEEN = np.sqrt(2.0) - 1.0  # least share of the shift that draws around the estimate show
DRAWS = 400
AT_ONCE = 50  # draws of the whole field


class Sizes(NamedTuple):
    """Sizes and their expanded uncertainties U (k = 2), each (q,) [mm or rad]; NaN where the data do not determine them."""

    value: np.ndarray
    U: np.ndarray


class VolumeSizes(NamedTuple):
    """`accuracy`: ISO 230-1 V_XYZ, ranges of the six components, (6,) [mm, rad]; `largest`: length of the largest deviation of
    the functional point in the stated datum, mean of both approach directions, (1,) [mm]."""

    accuracy: Sizes
    largest: Sizes


def volume_sizes(solution: Solution, tool: tuple[float, float, float], seed: int = 0) -> VolumeSizes:
    """Volumetric accuracy and largest deviation of `volumetric_summary`, with U.

    Args:
        solution: A solution, as `volid.fit` makes it.
        tool: Tool vector, (3,) [mm].
        seed: Seed of the draws.

    Source: ISO 230-1:2012 3.8; GUM F.2.4.5.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> found = volume_sizes(solution, (0.0, 0.0, -150.0))
    >>> bool(0.0 < found.largest.U[0] < 0.1 * found.largest.value[0])
    True
    """
    vector = np.asarray(tool, dtype=float)
    places = with_largest(solution, vector)
    values = values_at(solution, places, vector)
    known = np.isfinite(values).all(axis=0)
    gradient = deviation_rows(solution, places.positions, places.directions, vector)
    centre, drawn = np.where(known, values, 0.0), _Drawn(solution, seed)
    found = np.concatenate([_sizes(centre + part) for part in drawn.fields(gradient)])
    own = np.append(known, known[:3].all())
    value = np.where(own, _sizes(centre[None])[0], np.nan)
    sizes = Sizes(value, np.where(own, expanded(value, found), np.nan))
    return VolumeSizes(Sizes(*(v[:6] for v in sizes)), Sizes(*(v[6:] for v in sizes)))


def motion_ranges(solution: Solution, points: int = 101, seed: int = 0) -> dict[str, tuple[float, float]]:
    """Range of every error motion over its measured travel, both approach directions, and its U, by symbol [mm or rad].

    Short waves of a stated pitch are in it, and of a cross effect all positions of the second axis.

    Args:
        solution: A solution, as `volid.fit` makes it.
        points: Number of points of each function.
        seed: Seed of the draws.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> value, U = motion_ranges(solution)["EXX"]  # published: E = 31.8 µm
    >>> round(1e3 * value, 1), 0.0 < U < 0.003
    (31.8, True)
    """
    drawn, found = _Drawn(solution, seed), {}
    for name in dict.fromkeys(name for name in solution.model.names if not parse(name).location):
        own = whole_motion(solution, name, points)
        spread = drawn.rows(own.rows, solution.scatter_of(name))
        value = float(np.ptp(own.values))
        found[name] = (value, float(expanded(value, np.ptp(own.values + spread, axis=1))))
    return found


def expanded(value: np.ndarray | float, drawn: np.ndarray) -> np.ndarray:
    """U = 2 s + |b| / (sqrt(2) - 1) of sizes `value` (q,) from those of draws (s, q).

    >>> import numpy as np
    >>> round(float(expanded(10.0, np.array([10.0, 12.0, 14.0]))), 2)  # s = 2, b = 2
    8.83
    """
    return np.asarray(K * drawn.std(axis=0, ddof=1) + np.abs(drawn.mean(axis=0) - value) / SEEN)


def _sizes(fields: np.ndarray) -> np.ndarray:
    """Ranges of the six components of fields (s, m, 6), and the largest length, (s, 7)."""
    largest = np.linalg.norm(fields[:, :, :3], axis=2).max(axis=1)
    return np.column_stack([np.ptp(fields, axis=1), largest])


class _Drawn:
    """Draws of θ less its estimate, (s, n), and of what is independent from position to position."""

    def __init__(self, solution: Solution, seed: int) -> None:
        self.draws = parameter_draws(solution, seed)[0][:DRAWS]
        self.scatter = solution.scatter_u()
        self.rng = np.random.default_rng([seed, 1])

    def fields(self, gradient: np.ndarray) -> Iterator[np.ndarray]:
        """What the draws add to a field with `gradient` (m, 6, n), (s, m, 6), some draws at a time."""
        rows = gradient.reshape(-1, gradient.shape[2]).T
        for start in range(0, len(self.draws), AT_ONCE):
            part = self.draws[start : start + AT_ONCE]
            found = (part @ rows).reshape(len(part), -1, 6)
            yield found + self.scatter * self.rng.standard_normal(found.shape) if self.scatter.any() else found

    def rows(self, matrix: np.ndarray, scatter: float) -> np.ndarray:
        """What the draws add to linear functions of θ, (q, n), (s, q)."""
        found = self.draws @ matrix.T
        return found + scatter * self.rng.standard_normal(found.shape) if scatter else found
