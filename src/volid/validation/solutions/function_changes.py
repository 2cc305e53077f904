"""Which functions changed: one chi-square test per function over all that is known of it, and Holm's rule over the functions.

A function is looked at in many positions, but its values there are few independent numbers. From the rows R of its values, the
contrasts T R θ' are taken that the readings determine rather than the smoothness (less than half of their variance as if
nothing were shared comes from that of this function, `KNOWN`), and whose difference has a variance worth the name. With d =
T R Σ aᵢ θ'ᵢ and its covariance V,

    χ² = dᵀ V⁻¹ d,   r degrees of freedom without a change.

The smallest of all probabilities counts with the number of functions, the next with one less, … (Holm 1979), so that in 95
of 100 comparisons of an unchanged machine no function is called changed. Not modelled: that the u of readings may be wrong
themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtrc, chdtri
from scipy.stats import ncx2

from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.prediction.spread import linear_uncertainty
from volid.model.error_model import MEAN, ErrorModel
from volid.model.iso230 import parse
from volid.validation.solutions.outputs import Outputs
from volid.validation.solutions.shared import Shared

LEVEL = 0.05  # of all functions together
POWER = 0.9
KNOWN = 0.5  # share of the variance from the smoothness above which a contrast says nothing of the readings
NEGLIGIBLE = 1e-10  # of the largest eigenvalue: rounding
ROUNDING = 1e-9  # of the largest singular value of a function's rows
SAME = 1e-3  # share of the variance as if nothing were shared, below which a difference is none (one solution holds the other)
OPEN = 1e-4  # of what its parameters can: a change of an open direction that leaves a value determined
TOUCHED = 1e-8  # the same of a contrast: what is open may be millimetres, and a contrast is known to a hundredth of a micrometre
BENT = 0.01  # of what a function's parameters can, in a direction that its smoothness ties to the others
FIXED = 1e-6  # of the largest u of a function: the datum fixes the value
SLOPE = 1e-3  # of a line: more of it left means that the function has no slope of its own
WIDTH = 0.5  # of the range: a bump whose detection is stated
CENTRES = (0.25, 0.5, 0.75)


@dataclass(frozen=True, eq=False)
class FunctionChange:
    """What a combination of solutions says of one function. Lengths in mm, rotations in rad.

    `largest_change` with its standard uncertainty `u`, at position `at` (NaN of a constant) approached in `direction`; NaN
    where no value of the function is determined. `chi_square` with `degrees_of_freedom` contrasts, of `probability` without
    a change; `significant` after Holm's rule. `smallest_found`: the size of a change (of a function: a bump over half of
    the range, at the least favourable place) that is found in nine of ten comparisons, inf where none is. `positions`,
    `directions`, `values`, `values_u`: the change in full; `beside`: where the second axis of a function of two stands,
    first at its reference.
    """

    name: str
    unit: str
    largest_change: float
    u: float
    at: float
    direction: int
    chi_square: float
    degrees_of_freedom: int
    probability: float
    smallest_found: float
    positions: np.ndarray
    directions: np.ndarray
    values: np.ndarray
    values_u: np.ndarray
    beside: np.ndarray
    significant: bool = False


@dataclass(frozen=True, eq=False)
class Combination:
    """Σ aᵢ θ'ᵢ of solutions: `weights` a (k,), and how much of a change each has seen, `seen` (k,) (0 before, 1 after)."""

    shared: Shared
    weights: np.ndarray
    seen: np.ndarray

    @cached_property
    def value(self) -> np.ndarray:
        """Σ aᵢ θ'ᵢ, (n',)."""
        return np.asarray(sum(a * s.theta for a, s in zip(self.weights, self.shared.of.states, strict=True)))

    @cached_property
    def covariance(self) -> np.ndarray:
        """Its covariance, what is shared taken out, (n', n')."""
        return self.shared.covariance(self.weights)

    @cached_property
    def total(self) -> np.ndarray:
        """Its covariance as if nothing were shared, (n', n')."""
        return self.shared.total(self.weights)

    @cached_property
    def response(self) -> np.ndarray:
        """Expected value by a unit change of θ', (n', n')."""
        parts = zip(self.weights, self.seen, strict=True)
        return np.asarray(sum(a * t * self.shared.response(i) for i, (a, t) in enumerate(parts) if t != 0.0))

    @property
    def is_smooth(self) -> bool:
        """Whether some solution has functions whose smoothness was estimated."""
        return any(len(s.solution.smooth_rows) for s in self.shared.of.states)

    @cached_property
    def open_directions(self) -> np.ndarray:
        """What some solution that takes part does not determine, in units of 0.1 mm and 0.1 mrad, orthonormal, (n', d)."""
        return self.shared.of.open_directions(np.flatnonzero(self.weights))


def is_open(combination: Combination, rows: np.ndarray) -> np.ndarray:
    """Which values `rows` (m, n') change along what some solution does not determine, (m,)."""
    units = parameter_units(combination.shared.of.model)
    along = np.linalg.norm((rows * units) @ combination.open_directions, axis=1)
    return np.asarray(along > OPEN * np.maximum(np.linalg.norm(rows * units, axis=1), 1e-12))


def contrasts(combination: Combination, outputs: Outputs) -> np.ndarray:
    """T (r, m): independent contrasts of the values of a function that the readings determine, each with unit variance as if
    nothing were shared."""
    units, rows = parameter_units(combination.shared.of.model), outputs.rows
    own, sizes, ways = np.linalg.svd(rows * units, full_matrices=False)
    kept = sizes > ROUNDING * max(float(sizes.max(initial=0.0)), 1e-300)
    own, sizes, ways = own[:, kept], sizes[kept], ways[kept]  # beyond, rows are rounding, and would count as determined
    along = ways @ combination.open_directions
    vectors, shares, _ = np.linalg.svd(along, full_matrices=True)
    if np.any(shares > BENT) and combination.is_smooth:  # held at 0 there, its smoothness bends the rest of it
        return np.zeros((0, len(rows)))
    free = vectors[:, int(np.sum(shares > TOUCHED)) :].T if along.shape[1] else np.eye(len(ways))
    left = (free / sizes) @ own.T
    inner = left @ rows
    values, vectors = np.linalg.eigh(inner @ combination.total @ inner.T)
    kept = values > NEGLIGIBLE * max(float(values.max(initial=0.0)), 1e-300)
    white = (vectors[:, kept] / np.sqrt(values[kept])).T
    smooth = white @ (inner @ combination.shared.smooth_errors(combination.weights, outputs.name))
    shares, turned = np.linalg.eigh(smooth @ smooth.T)
    return np.asarray(turned[:, shares < KNOWN].T @ white @ left)


@dataclass(frozen=True, eq=False)
class Contrasts:
    """`rows` (r, n'): contrasts on θ' with unit variance and no correlation, what is shared taken out."""

    rows: np.ndarray

    def chi_square(self, value: np.ndarray) -> float:
        """Of Σ aᵢ θ'ᵢ, or without noise of an expected change."""
        return float(np.sum((self.rows @ value) ** 2))


def whitened(combination: Combination, outputs: Outputs) -> Contrasts:
    """The contrasts of a function, with what is shared taken out; those of which nothing is left are dropped."""
    inner = contrasts(combination, outputs) @ outputs.rows
    values, vectors = np.linalg.eigh(inner @ combination.covariance @ inner.T)
    kept = values > SAME
    return Contrasts((vectors[:, kept] / np.sqrt(values[kept])).T @ inner)


def noncentrality(freedom: int, level: float) -> float:
    """λ of the noncentral chi-square that exceeds the limit of `level` with probability `POWER`.

    >>> bool(abs(noncentrality(1, 0.05) - 10.507) < 0.01)  # (1.960 + 1.282)², one degree of freedom
    True
    """
    limit = float(chdtri(freedom, level))
    return float(brentq(lambda size: ncx2.sf(limit, freedom, size) - POWER, 1e-9, 10.0 * limit + 100.0))


def values_of(combination: Combination, outputs: Outputs) -> tuple[np.ndarray, np.ndarray]:
    """Values of one function and their standard uncertainties, (m,) each; NaN where some solution does not determine them."""
    values, u = outputs.rows @ combination.value, linear_uncertainty(outputs.rows, combination.covariance)
    open_rows = is_open(combination, outputs.rows)
    return np.where(open_rows, np.nan, values), np.where(open_rows, np.nan, u)


def function_change(combination: Combination, outputs: Outputs, level: float | None = None) -> FunctionChange:
    """The test of one function; `level`: of a single one, for the smallest change that is found; None: that is NaN."""
    values, u = values_of(combination, outputs)
    test = whitened(combination, outputs)
    freedom, chi_square = len(test.rows), test.chi_square(combination.value)
    worst = _largest(values, u, linear_uncertainty(outputs.rows, combination.total))
    return FunctionChange(
        name=outputs.name,
        unit=outputs.unit,
        largest_change=float(values[worst]),
        u=float(u[worst]),
        at=float(outputs.positions[worst]) if np.isfinite(values[worst]) else np.nan,
        direction=int(outputs.directions[worst]),
        chi_square=chi_square,
        degrees_of_freedom=freedom,
        probability=float(chdtrc(freedom, chi_square)) if freedom else np.nan,
        smallest_found=np.nan if level is None else _smallest(combination, outputs, test, level),
        positions=outputs.positions,
        directions=outputs.directions,
        values=values,
        values_u=u,
        beside=outputs.beside,
    )


def _largest(values: np.ndarray, u: np.ndarray, total: np.ndarray) -> int:
    """Number of the largest value, those that the datum fixes left out; of one that is not determined if there is no other.

    `total`: u as if nothing were shared, of values that are not determined too."""
    free = total > FIXED * np.max(total)
    if not free.any():  # nothing moves it, as in a comparison of a solution with itself
        free = np.ones(len(values), dtype=bool)
    size = np.where(free, np.where(np.isfinite(values), np.abs(values), -1.0), -2.0)
    return int(np.argmax(size))


def _smallest(combination: Combination, outputs: Outputs, test: Contrasts, level: float) -> float:
    """The size of change found with `POWER`: of a constant itself, of a function a bump at the least favourable place."""
    if not len(test.rows):
        return np.inf
    needed = noncentrality(len(test.rows), level)
    sizes = []
    for change in _unit_changes(combination.shared.of.model, outputs):
        largest = float(np.max(np.abs(outputs.rows @ change)))
        found = test.chi_square(combination.response @ change)
        sizes.append(largest * np.sqrt(needed / found) if found > 0.0 else np.inf)
    return float(max(sizes))


def _unit_changes(model: ErrorModel, outputs: Outputs) -> list[np.ndarray]:
    """Changes of θ' (n',): a constant by 1, a function by bumps over half of its range, as the datum leaves them."""
    rows = outputs.rows
    if len(rows) == 1:
        return [rows[0] / float(rows[0] @ rows[0])]
    low, high = model.machine.axis(parse(outputs.name).axis).travel
    share = (outputs.positions - low) / (high - low)
    bumps = []
    for centre in CENTRES:
        away = (share - centre) / WIDTH
        bumps.append(np.where(np.abs(away) < 0.5, 0.5 + 0.5 * np.cos(2 * np.pi * away), 0.0))
    return list(nearest_changes(model, outputs, np.array(bumps)).T)


def nearest_changes(model: ErrorModel, outputs: Outputs, shapes: np.ndarray) -> np.ndarray:
    """Changes of a function's own θ', (n', k), nearest to shapes (k, m) of its values, as far as the datum leaves them to it.

    A constant is a motion of the workpiece, and the slope of a straightness function a squareness: they are no part of it.
    """
    own = model.by_name[outputs.name, MEAN].parameters
    rows = outputs.rows[:, own]
    x = outputs.positions - np.mean(outputs.positions)
    elsewhere = np.stack([np.ones_like(x), x], axis=1)
    design = np.hstack([rows, elsewhere[:, :1]])
    left = x - design @ np.linalg.lstsq(design, x, rcond=1e-9)[0]
    if np.linalg.norm(left) > SLOPE * np.linalg.norm(x):
        design = np.hstack([rows, elsewhere])
    found = np.zeros((outputs.rows.shape[1], len(shapes)))
    found[own] = np.linalg.lstsq(design, shapes.T, rcond=1e-9)[0][: rows.shape[1]]
    return found


def by_holm(probabilities: np.ndarray, level: float = LEVEL) -> np.ndarray:
    """Which of several tests are significant together, bool (k,); NaN is none. Holm, Scand. J. Statist. 6 (1979) 65.

    >>> by_holm(np.array([0.04, 0.01, np.nan, 0.03])).tolist()
    [False, True, False, False]
    """
    tested = np.flatnonzero(np.isfinite(probabilities))
    order = tested[np.argsort(probabilities[tested], kind="stable")]
    passed = probabilities[order] <= level / (len(order) - np.arange(len(order)))
    first = len(order) if passed.all() else int(np.argmin(passed))
    found = np.zeros(len(probabilities), dtype=bool)
    found[order[:first]] = True
    return found
