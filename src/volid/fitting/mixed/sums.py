"""A linear fit as sums over each set: with or without some of the sets, without going through the readings again.

Whitened residuals v = y - J x at the minimum. Of every set g: A = JᵀJ, b = Jᵀv, c = vᵀv; of what is known beforehand Q and its
pull b₀ likewise. In coordinates in which Q + Σ A = 1, so that b₀ + Σ b = 0. Without set g the information is 1 - A_g, directions
in which that is 0 are those that no other set determines, and the minimum moves by -(1 - A_g)⁺ b_g.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtr, chdtrc

NONE_ELSE = 1e-8  # of the information of all sets: what the others say less of, they do not determine


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums of the sets `numbers`: `matrices` A (G, r, r), `vectors` b (G, r), `squares` c and `counts` of readings (G,); `known`
    Q (r, r)."""

    numbers: tuple[int, ...]
    matrices: np.ndarray
    vectors: np.ndarray
    squares: np.ndarray
    counts: np.ndarray
    known: np.ndarray

    def split(self, g: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Eigenvalues of A_g (r,) with directions as columns, and which of them other sets determine, bool (r,)."""
        values, vectors = np.linalg.eigh(self.matrices[g])
        return values, vectors, 1.0 - values > NONE_ELSE

    def without(self, g: int) -> Sums:
        """The fit to all sets but number `g` of these."""
        values, vectors, kept = self.split(g)
        root = vectors[:, kept] / np.sqrt(1.0 - values[kept])
        step = -root @ (root.T @ self.vectors[g])
        others = np.arange(len(self.numbers)) != g
        a, b = self.matrices[others], self.vectors[others]
        moved = a @ step
        return Sums(
            tuple(n for n, other in zip(self.numbers, others.tolist(), strict=True) if other),
            root.T @ a @ root,
            (b - moved) @ root,
            self.squares[others] - 2.0 * b @ step + moved @ step,
            self.counts[others],
            root.T @ self.known @ root,
        )


def sums_of(rows: np.ndarray, v: np.ndarray, number: np.ndarray, active: np.ndarray) -> Sums:
    """Sums from J L (n, r), L the root of the covariance, residuals v (n,), the `number` of the set of every reading (n,), and
    which readings take part, bool (n,)."""
    numbers = tuple(np.unique(number).tolist())
    each = [rows[number == i] for i in numbers]
    matrices = np.stack([part.T @ part for part in each])
    known = np.eye(rows.shape[1]) - matrices.sum(axis=0)
    return Sums(
        numbers,
        matrices,
        np.stack([part.T @ v[number == i] for part, i in zip(each, numbers, strict=True)]),
        np.array([float(v[number == i] @ v[number == i]) for i in numbers]),
        np.array([int(np.count_nonzero(active & (number == i))) for i in numbers]),
        0.5 * (known + known.T),
    )


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
        self.a, self.b, self.c, self.n = sums.matrices[g], sums.vectors[g], float(sums.squares[g]), int(sums.counts[g])
        values, vectors = np.linalg.eigh(self.a + sums.known)
        seen = values > NONE_ELSE
        self.smoother = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T  # (A + Q)⁺

    @property
    def redundancy(self) -> float:
        """Σ (1 - h)."""
        return self.n - float(np.trace(self.a))

    def whole(self) -> Quadratic:
        """All residuals of the set: vᵀv; its variance is 2 tr (1 - H)²."""
        variance = 2.0 * (self.n - 2.0 * float(np.trace(self.a)) + float(np.sum(self.a * self.a)))
        return Quadratic(self.c, self.redundancy, variance)

    def scatter(self) -> Quadratic:
        """vᵀ(1 - S)v with S the smoother of the set alone: what no function as smooth as those of the fit follows."""
        eye = np.eye(len(self.a))
        c = self.a @ (eye + self.smoother - self.smoother @ self.a)  # (1 - S)(1 - H) = 1 - J (…) Jᵀ
        mean = self.n - float(np.trace(c))
        variance = 2.0 * (self.n - 2.0 * float(np.trace(c)) + float(np.sum(c * c.T)))
        return Quadratic(self.c - float(self.b @ self.smoother @ self.b), mean, variance)

    def disagreement(self, own_square: float, rest_square: float) -> Quadratic:
        """bᵀ(A + Q)⁺b = vᵀSv: what the residuals have in common with an error of the machine.

        The score test of a machine that is another one for this set. Readings of this set scatter by κ², those of the others by
        κ₀²: their parts of the covariance of v are κ² (1 - H)² and κ₀² (1 - H) H.
        """
        square = self.a @ self.a
        x1, x2 = self.a - square, self.a - 2.0 * square + square @ self.a
        expected = self.smoother @ (own_square * x2 + rest_square * (x1 - x2))
        return Quadratic(
            float(self.b @ self.smoother @ self.b),
            float(np.trace(expected)),
            2.0 * float(np.sum(expected * expected.T)),
        )


def prediction(sums: Sums, g: int) -> Quadratic:
    """Chi-square of the readings of a set predicted by all others, as far as others determine them."""
    values, vectors, kept = sums.split(g)
    along = vectors.T @ sums.vectors[g]
    square = float(sums.squares[g] + np.sum(along[kept] ** 2 / (1.0 - values[kept])))
    freedom = float(sums.counts[g] - np.count_nonzero(~kept))
    return Quadratic(square, freedom, 2.0 * freedom)
