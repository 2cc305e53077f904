"""Coverage intervals of tables from Monte Carlo samples: error functions, location errors, deviations at given places.

Deviations are taken as linear in the parameters around the solution, e = e0 + G (x - x0). What this neglects is of second order
in the uncertainties (rotations uncertain by 5 µrad over 1 m: 0.03 nm). Long tables are evaluated piece by piece, so that memory
stays bounded.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from volid.fitting.prediction.deviations import THREADS, gradient_matrix
from volid.fitting.results import FunctionValue
from volid.fitting.solution import Solution
from volid.model.axis_lines import line_row
from volid.model.error_model import LOCATION, ErrorModel
from volid.uncertainty.coverage import Intervals, coverage_intervals
from volid.uncertainty.trials.samples import Samples

PIECE = 256  # points of one piece: 6 components of 10,000 samples are 125 MB


class Bands(NamedTuple):
    """Coverage intervals at m places, each (m, 6) [mm, rad]; fields as of `Intervals`."""

    low: np.ndarray
    high: np.ndarray
    shortest_low: np.ndarray
    shortest_high: np.ndarray


def function_rows(solution: Solution, rows: Sequence[FunctionValue]) -> np.ndarray:
    """Rows a of tabulated functions and location errors with value = a·θ, shape (q, n)."""
    found = np.zeros((len(rows), solution.model.n_parameters))
    for name, direction in dict.fromkeys((r.name, r.direction) for r in rows):
        numbers = [i for i, r in enumerate(rows) if (r.name, r.direction) == (name, direction)]
        if (name, LOCATION) in solution.model.by_name:
            found[numbers] = line_row(solution.model, name)
        else:
            found[numbers] = solution.motion_rows(name, np.array([rows[i].position for i in numbers]), direction)
    return found


def function_intervals(solution: Solution, rows: Sequence[FunctionValue], probability: float = 0.95) -> Intervals:
    """Coverage intervals of tabulated functions, each (q,) [mm or rad]; NaN where the data do not determine the value.

    Raises `ValueError` when the solution has no samples, or fewer than an interval needs.
    """
    samples = _samples(solution)
    matrix = np.pad(function_rows(solution, rows), ((0, 0), (0, len(solution.nuisance_table))))
    parts = [coverage_intervals(values, probability) for _, values in samples.linear(matrix)]
    own = np.array([0.0 if np.isnan(r.position) else solution.scatter_of(r.name) for r in rows])
    centre = function_rows(solution, rows) @ np.asarray(solution.parameters)
    columns = widened(np.array([np.concatenate(c) for c in zip(*parts, strict=True)]), centre, own, probability)
    not_determined = np.array([not np.isfinite(r.value) for r in rows])
    return Intervals(*(np.where(not_determined, np.nan, column) for column in columns))


def deviation_intervals(
    solution: Solution,
    values: np.ndarray,
    positions: np.ndarray,
    tool: np.ndarray,
    direction: np.ndarray,
    *,
    part: ErrorModel | None = None,
    probability: float = 0.95,
) -> Bands:
    """Coverage intervals of deviations `values` (m, 6) at `positions` (m, n_axes) with `tool` (m, 3), NaN where those are NaN.

    `part`: the model with some axes' errors only, as grids hold them. Raises `ValueError` as `function_intervals`.
    """
    samples, model = _samples(solution), solution.model if part is None else part
    theta, k = np.asarray(solution.parameters), len(solution.nuisance_table)
    result = np.empty((4, len(positions), 6))

    def fill(start: int) -> None:
        rows = slice(start, start + PIECE)
        gradient = gradient_matrix(model, theta, positions[rows], tool[rows], direction[rows]).reshape(-1, len(theta))
        parts = [coverage_intervals(v, probability) for _, v in samples.linear(np.pad(gradient, ((0, 0), (0, k))))]
        ends = np.concatenate([np.stack(part) for part in parts], axis=1) - gradient @ theta
        result[:, rows] = ends.reshape(4, -1, 6) + values[rows]

    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(fill, range(0, len(positions), PIECE)))
    return Bands(*widened(result, values, solution.scatter_u(model), probability))


def widened(ends: np.ndarray, centre: np.ndarray, u: np.ndarray, probability: float) -> np.ndarray:
    """Intervals (4, …) around values `centre`, each side in quadrature longer by an independent normal part of u."""
    if not np.any(u > 0.0):
        return ends
    more = ndtri(0.5 + 0.5 * probability) * u
    sides = ends - centre
    return np.asarray(centre + np.sign(sides) * np.hypot(sides, more))


def _samples(solution: Solution) -> Samples:
    if solution.samples is None:
        raise ValueError("the solution has no Monte Carlo samples")
    return solution.samples
