"""Degrees of freedom of a fit some of whose unknowns no reading determines."""

from __future__ import annotations

import numpy as np

from volid.fitting.equations.problem import Problem

SMALLEST = 1e-9  # singular value of rows of length 1, over the largest


def degrees_of_freedom(n_readings: int, problem: Problem, free: np.ndarray) -> int:
    """Readings and what is known beforehand (W z = t: smoothness, calibrations) less the unknowns; z moves along `free` F.

    What is known of directions that no reading determines is met of itself, since nothing contradicts it, and does not count. Of
    the r rows of W there count r - (rank W P - rank W F), where P spans all that may move.
    """
    rows = np.asarray(problem.system.prior_root)
    open_directions = problem.free.shape[1] > free.shape[1]
    lost = _rank(rows, problem.free) - _rank(rows, free) if len(rows) and open_directions else 0
    return n_readings + len(rows) - lost - free.shape[1]


def _rank(rows: np.ndarray, directions: np.ndarray) -> int:
    """Of the rows along the directions, each row taken in a unit of its own."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    along = (rows / np.where(length > 0.0, length, 1.0)) @ directions
    if not along.size:
        return 0
    values = np.linalg.svd(along, compute_uv=False)
    return int((values > SMALLEST * max(float(values[0]), SMALLEST)).sum())
