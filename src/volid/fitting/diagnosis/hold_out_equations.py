"""Normal equations of cross-validation folds in the free columns of several parts of the unknowns, and what they predict.

This is the dense algebra behind the choice of resolution. Without another pass over the readings, every candidate for one part is
judged by the chi-square of each fold, predicted from the other folds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from volid.fitting.diagnosis.identifiability import WEAKEST


class Part(NamedTuple):
    """Free columns of some unknowns: the rows of the full unknowns in which they are not zero, and their values there."""

    rows: np.ndarray | slice
    block: np.ndarray


class Projected:
    """Equations (k, N, N) and (k, N) of the folds, and of the prior as the last, in the free columns B of several parts.

    `left` Bᵀ M, shape (k, n, N); `both` Bᵀ M B, shape (k, n, n); `right` Bᵀ v, shape (k, n). Removing or exchanging one part is
    little work compared with setting up all of them.
    """

    def __init__(self, matrices: np.ndarray, vectors: np.ndarray) -> None:
        k, n = vectors.shape
        self.matrices, self.vectors = matrices, vectors
        self.parts: dict[str, Part] = {}
        self.left, self.both, self.right = np.zeros((k, 0, n)), np.zeros((k, 0, 0)), np.zeros((k, 0))

    def put(self, name: str, part: Part) -> None:
        """Adds a part, in place of what had its name."""
        if name in self.parts:
            self.left, self.both, self.right = self.without(name)
            del self.parts[name]
        block = part.block.T @ self.matrices[:, part.rows]
        cross = self.left[:, :, part.rows] @ part.block
        corner = block[:, :, part.rows] @ part.block
        self.left = np.concatenate([self.left, block], axis=1)
        self.both = np.block([[self.both, cross], [cross.transpose(0, 2, 1), corner]])
        self.right = np.concatenate([self.right, self.vectors[:, part.rows] @ part.block], axis=1)
        self.parts[name] = part

    def without(
        self, name: str, columns: np.ndarray | slice = slice(None)
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """`left`, in some of its columns, `both` and `right` of all other parts."""
        widths = [part.block.shape[1] for part in self.parts.values()]
        i = list(self.parts).index(name)
        rows = slice(sum(widths[:i]), sum(widths[: i + 1]))
        both = np.delete(np.delete(self.both, rows, axis=1), rows, axis=2)
        return np.delete(self.left[:, :, columns], rows, axis=1), both, np.delete(self.right, rows, axis=1)


class Reduced(NamedTuple):
    """A fold's equations, with the unknowns of the other parts (o) and those of one function (f) separated."""

    oo: np.ndarray
    of: np.ndarray
    ff: np.ndarray
    vo: np.ndarray
    vf: np.ndarray


def held_out_chi_square(training: Reduced, held_out: Reduced, square: float, blocks: list[np.ndarray]) -> np.ndarray:
    """Chi-square of the held-out fold for each candidate block: others eliminated, then a small quadratic form."""
    factor = cho_factor(training.oo, check_finite=False)
    solved = cho_solve(factor, np.column_stack([training.vo, training.of]), check_finite=False)
    a, slope = solved[:, 0], solved[:, 1:]
    schur = training.ff - training.of.T @ slope
    vector = training.vf - training.of.T @ a
    onto = held_out.oo @ solved
    constant = square - 2.0 * held_out.vo @ a + a @ onto[:, 0]
    linear = held_out.of.T @ a - slope.T @ (onto[:, 0] - held_out.vo) - held_out.vf
    cross = slope.T @ held_out.of
    quadratic = held_out.ff - cross - cross.T + slope.T @ onto[:, 1:]
    result = []
    for block in blocks:
        inner = block.T @ schur @ block + WEAKEST**2 * np.eye(block.shape[1])
        w = block @ np.linalg.solve(inner, block.T @ vector)
        result.append(constant + 2.0 * linear @ w + w @ quadratic @ w)
    return np.array(result)
