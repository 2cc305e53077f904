"""A linear fit as sums over each set: with or without some of the sets, without going through the readings again.

Whitened residuals v = y - J x at the minimum. Of every set g: A = JᵀJ = F Fᵀ, b = Jᵀv, c = vᵀv; of what is known beforehand Q and
its pull b₀ likewise. In coordinates in which Q + Σ A = 1, so that b₀ + Σ b = 0. Without set g the information is 1 - A_g,
directions in which that is 0 are those that no other set determines, and the minimum moves by -(1 - A_g)⁺ b_g.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import chdtr, chdtrc

NONE_ELSE = 1e-8  # of the information of all sets: what the others say less of, they do not determine
SEEN = 1e-10  # of the information of all sets: what a set says less of is rounding
FREE = 1e-9  # prior information that stands for none


class Spectrum(NamedTuple):
    """Of one set: `values` a (k,) and `directions` V (r, k) with A = V a Vᵀ, `along` Vᵀb (k,), and which of the directions
    `others` determine, bool (k,)."""

    values: np.ndarray
    directions: np.ndarray
    along: np.ndarray
    others: np.ndarray


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums of the sets `numbers`: `roots` F (r, k) and `vectors` b (r,) of each, `squares` c and `counts` of readings (G,);
    `known` Q (r, r)."""

    numbers: tuple[int, ...]
    roots: tuple[np.ndarray, ...]
    vectors: np.ndarray
    squares: np.ndarray
    counts: np.ndarray
    known: np.ndarray

    def split(self, g: int) -> Spectrum:
        """What a set says, direction by direction."""
        directions, sizes, _ = np.linalg.svd(self.roots[g], full_matrices=False)
        seen = sizes**2 > SEEN
        values, directions = np.minimum(sizes[seen] ** 2, 1.0), directions[:, seen]
        return Spectrum(values, directions, directions.T @ self.vectors[g], 1.0 - values > NONE_ELSE)

    @cached_property
    def prior_root(self) -> np.ndarray:
        """H (r, r) with HᵀH = (Q + `FREE`)⁻¹."""
        values, vectors = np.linalg.eigh(self.known)
        return np.asarray((vectors / np.sqrt(np.maximum(values, 0.0) + FREE)).T)

    def without(self, g: int) -> Sums:
        """The fit to all sets but number `g` of these."""
        values, vectors = np.linalg.eigh(self.roots[g] @ self.roots[g].T)
        kept = 1.0 - values > NONE_ELSE
        root = vectors[:, kept] / np.sqrt(1.0 - values[kept])
        step = -root @ (root.T @ self.vectors[g])
        others = [i for i in range(len(self.numbers)) if i != g]
        b = self.vectors[others]
        moved = np.stack([self.roots[i] @ (self.roots[i].T @ step) for i in others])
        return Sums(
            tuple(self.numbers[i] for i in others),
            tuple(root.T @ self.roots[i] for i in others),
            (b - moved) @ root,
            self.squares[others] - 2.0 * b @ step + moved @ step,
            self.counts[others],
            root.T @ self.known @ root,
        )


def sums_of(rows: np.ndarray, v: np.ndarray, number: np.ndarray, active: np.ndarray) -> Sums:
    """Sums from J L (n, r), L the root of the covariance, residuals v (n,), the `number` of the set of every reading (n,), and
    which readings take part, bool (n,)."""
    numbers = tuple(np.unique(number).tolist())
    each = [number == i for i in numbers]
    known = np.eye(rows.shape[1]) - rows.T @ rows
    return Sums(
        numbers,
        tuple(_root(rows[own]) for own in each),
        np.stack([rows[own].T @ v[own] for own in each]),
        np.array([float(v[own] @ v[own]) for own in each]),
        np.array([int(np.count_nonzero(active & own)) for own in each]),
        0.5 * (known + known.T),
    )


def _root(rows: np.ndarray) -> np.ndarray:
    """F (r, k) with F Fᵀ = JᵀJ for J (n, r); k no larger than it need be."""
    if len(rows) <= rows.shape[1]:
        return rows.T
    values, vectors = np.linalg.eigh(rows.T @ rows)
    seen = values > SEEN
    return np.asarray(vectors[:, seen] * np.sqrt(values[seen]))


@dataclass(frozen=True)
class Quadratic:
    """A quadratic form of normal variables: its value, and the mean and variance that it has by chance."""

    value: float
    mean: float
    variance: float

    @property
    def exists(self) -> bool:
        """Whether there is anything to be tested."""
        return self.mean > 0.5 and self.variance > 0.0

    @property
    def weight(self) -> float:
        """Root of the value over its mean."""
        return float(np.sqrt(max(self.value, 0.0) / self.mean)) if self.exists else float("nan")

    @property
    def freedom(self) -> float:
        """Degrees of freedom of a chi-square with this mean and variance (Satterthwaite 1946)."""
        return 2.0 * self.mean**2 / self.variance if self.exists else 0.0

    def probability(self, larger: bool = True) -> float:
        """Of a value at least (at most) as large by chance; 1 where nothing can be tested."""
        if not self.exists:
            return 1.0
        scaled = max(self.value, 0.0) * self.freedom / self.mean
        return float((chdtrc if larger else chdtr)(self.freedom, scaled))


class OneSet:
    """The tests of set number `g` of some sums."""

    def __init__(self, sums: Sums, g: int) -> None:
        self.c, self.n, self.seen = float(sums.squares[g]), int(sums.counts[g]), sums.split(g)
        half = sums.prior_root @ (self.seen.directions * np.sqrt(self.seen.values))
        sizes, turned = np.linalg.eigh(half.T @ half)
        shares = np.maximum(sizes, 0.0) / (1.0 + np.maximum(sizes, 0.0))
        scale = 1.0 / np.sqrt(self.seen.values)
        self.smoother = scale[:, None] * ((turned * shares) @ turned.T) * scale  # Vᵀ(A + Q)⁻¹V

    @property
    def redundancy(self) -> float:
        """Σ (1 - h)."""
        return self.n - float(np.sum(self.seen.values))

    def whole(self) -> Quadratic:
        """All residuals of the set: vᵀv; its variance is 2 tr (1 - H)²."""
        a = self.seen.values
        return Quadratic(self.c, self.redundancy, 2.0 * (self.n - 2.0 * float(np.sum(a)) + float(a @ a)))

    @property
    def _followed(self) -> float:
        """vᵀSv with S the smoother of the set alone."""
        return float(self.seen.along @ self.smoother @ self.seen.along)

    def scatter(self) -> Quadratic:
        """vᵀ(1 - S)v: what no function as smooth as those of the fit follows."""
        a = self.seen.values
        c = a[:, None] * (np.eye(len(a)) + self.smoother * (1.0 - a))  # (1 - S)(1 - H) = 1 - J V (c/a) VᵀJᵀ
        mean = self.n - float(np.trace(c))
        variance = 2.0 * (self.n - 2.0 * float(np.trace(c)) + float(np.sum(c * c.T)))
        return Quadratic(self.c - self._followed, mean, variance)

    def disagreement(self, own_square: float, rest_square: float) -> Quadratic:
        """vᵀSv = bᵀ(A + Q)⁻¹b: what the residuals have in common with an error of the machine.

        The score test of a machine that is another one for this set. Readings of this set scatter by κ² = `own_square`, those of
        the others by κ₀² = `rest_square`: their parts of the covariance of v are κ² (1 - H)² and κ₀² (1 - H) H.
        """
        a = self.seen.values
        expected = self.smoother * (own_square * a * (1.0 - a) ** 2 + rest_square * a**2 * (1.0 - a))
        return Quadratic(self._followed, float(np.trace(expected)), 2.0 * float(np.sum(expected * expected.T)))


def prediction(sums: Sums, g: int) -> Quadratic:
    """Chi-square of the readings of a set predicted by all others, as far as others determine them."""
    seen = sums.split(g)
    square = float(sums.squares[g] + np.sum(seen.along[seen.others] ** 2 / (1.0 - seen.values[seen.others])))
    freedom = float(sums.counts[g] - np.count_nonzero(~seen.others))
    return Quadratic(square, freedom, 2.0 * freedom)
