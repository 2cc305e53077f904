"""Products with the matrix that spans the free directions, block by block: a datum ties only coefficients of few functions."""

from __future__ import annotations

import numpy as np

SMALLEST = 32  # rows; smaller blocks are put together


class FreeDirections:
    """F (size, n) with z = … + F y, cut into blocks of consecutive rows that share no column.

    A matrix without such a structure is one block. Results are those of the dense products but for rounding.
    """

    def __init__(self, free: np.ndarray) -> None:
        self.whole = free
        size, n = free.shape
        self._blocks: list[tuple[slice, np.ndarray, np.ndarray]] = []
        if not free.size:  # every unknown is held, or there is none
            return
        seen = free != 0.0
        first = np.where(seen.any(axis=0), seen.argmax(axis=0), 0)
        last = np.where(seen.any(axis=0), size - 1 - seen[::-1].argmax(axis=0), 0)
        order = np.argsort(first, kind="stable")
        reach = np.maximum.accumulate(last[order]) + 1 if n else np.zeros(0, dtype=int)
        begin = low = 0
        for end in [*(np.flatnonzero(first[order][1:] >= reach[:-1]) + 1), n]:  # columns before and after share no row
            high = int(reach[end - 1]) if end else 0
            if end == n or high - low >= SMALLEST:
                columns = order[begin:end]
                self._blocks.append((slice(low, high), columns, np.ascontiguousarray(free[low:high, columns])))
                begin, low = end, high

    def pull(self, gradient: np.ndarray) -> np.ndarray:
        """Fᵀ g, shape (n,)."""
        return np.asarray(self.whole.T @ gradient)

    def project(self, matrix: np.ndarray) -> np.ndarray:
        """Fᵀ M F, shape (n, n), of a symmetric M (size, size)."""
        n = self.whole.shape[1]
        half = np.empty((n, len(matrix)))
        for rows, columns, block in self._blocks:
            half[columns] = block.T @ matrix[rows]
        result = np.empty((n, n))
        for rows, columns, block in self._blocks:
            result[:, columns] = half[:, rows] @ block
        return result

    def move(self, z: np.ndarray, step: np.ndarray) -> np.ndarray:
        """z - F · step."""
        return np.asarray(z - self.whole @ step)
