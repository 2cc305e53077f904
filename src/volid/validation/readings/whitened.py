"""Readings whose covariance is C = 1 + G Gᵀ made independent, with the campaign's own unknowns projected out.

With GᵀG = V Λ Vᵀ and T = G V, a function f of C is f(1) + T diag((f(1 + λ) - f(1))/λ) Tᵀ. So C^(-1/2) costs no more than Gᵀ G,
and what is left, v = (1 - Q Qᵀ) C^(-1/2) r with Q an orthonormal basis of C^(-1/2) B, is N(0, 1) in n - rank(B) directions: |v|²
is the generalised chi-square of the readings against their prediction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from volid.validation.readings.equations import Linear

SMALLEST = 1e-8  # singular value of columns of length 1, over the largest: below, they depend on each other
ABSORBED = 3e-3  # length of a column of length 1 that the campaign's own unknowns leave: below, they take all of it up


@dataclass(frozen=True, eq=False)
class Whitened:
    """`linear`: the readings. `v` (n,): independent and of variance 1 in `freedom` directions, those across `basis` (n, b)."""

    linear: Linear
    turned: np.ndarray
    values: np.ndarray
    basis: np.ndarray
    v: np.ndarray

    @classmethod
    def of(cls, linear: Linear) -> Whitened:
        """The readings of a campaign, made independent."""
        values, vectors = np.linalg.eigh(linear.known.T @ linear.known)
        kept = values > 1e-20 * max(float(values.max(initial=0.0)), 1e-300)
        turned, values = linear.known @ vectors[:, kept], values[kept]
        bare = cls(linear, turned, values, np.zeros((len(linear.r), 0)), linear.r)
        basis = orthonormal(bare.whitened(linear.open), SMALLEST)
        found = cls(linear, turned, values, basis, linear.r)
        return cls(linear, turned, values, basis, found.free(linear.r))

    @property
    def freedom(self) -> int:
        """Degrees of freedom of |v|²."""
        return len(self.v) - self.basis.shape[1]

    def whitened(self, x: np.ndarray) -> np.ndarray:
        """C^(-1/2) x."""
        return self._function(x, lambda c: 1.0 / np.sqrt(c))

    def free(self, x: np.ndarray) -> np.ndarray:
        """C^(-1/2) x less what the campaign's own unknowns take up."""
        found = self.whitened(x)
        return np.asarray(found - self.basis @ (self.basis.T @ found))

    def coloured(self, x: np.ndarray) -> np.ndarray:
        """C^(1/2) x."""
        return self._function(x, np.sqrt)

    def _function(self, x: np.ndarray, function: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        factor = (function(1.0 + self.values) - 1.0) / self.values
        weight = factor if x.ndim == 1 else factor[:, None]
        return np.asarray(x + self.turned @ (weight * (self.turned.T @ x)))

    @cached_property
    def residual(self) -> np.ndarray:
        """d = r - B b with b at its best, over u of the reading, (n,)."""
        return self.coloured(self.v)

    @cached_property
    def variance(self) -> np.ndarray:
        """Variance of d, over u² of the reading, (n,): of the reading, of its prediction, less what b takes up."""
        whole = 1.0 + np.sum(self.linear.known**2, axis=1)
        return np.asarray(whole - np.sum(self.coloured(self.basis) ** 2, axis=1))

    @cached_property
    def leverage_rows(self) -> np.ndarray:
        """R (n, k) with 1 - R Rᵀ = C^(-1/2) (1 - Q Qᵀ) C^(-1/2): what a joint fit of both campaigns would leave."""
        return np.hstack([self.turned / np.sqrt(1.0 + self.values), self.whitened(self.basis)])

    def span(self, columns: np.ndarray, beside: np.ndarray) -> np.ndarray:
        """Orthonormal basis of changes of the readings, (n, k), as far as nothing takes them up; across `beside` (n, l)."""
        length = np.linalg.norm(self.whitened(columns), axis=0)
        found = self.free(columns[:, length > 0.0] / length[length > 0.0])
        return orthonormal(found - beside @ (beside.T @ found), ABSORBED, relative=False)


def orthonormal(columns: np.ndarray, least: float, relative: bool = True) -> np.ndarray:
    """Orthonormal basis of columns (n, k); `relative`: each taken with length 1, and `least` over the largest singular value."""
    if not columns.size:
        return np.zeros((len(columns), 0))
    if relative:
        length = np.linalg.norm(columns, axis=0)
        columns = columns[:, length > 0.0] / length[length > 0.0]
    left, values, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, values > least * (float(values.max(initial=0.0)) if relative else 1.0)])
