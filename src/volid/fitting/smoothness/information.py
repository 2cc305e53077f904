"""What the readings alone say of the error functions, from the normal equations of a fit: nuisance parameters eliminated."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.equations.problem import Problem
from volid.fitting.equations.system import Normal
from volid.fitting.smoothness.evidence import Information


def information(problem: Problem, basis: np.ndarray, z: np.ndarray, normal: Normal, smooth: np.ndarray) -> Information:
    """Information on θ at z, of everything but the smoothness.

    `basis`: determined directions (n_free, r) of the problem's free parameters, machine first. `normal`: normal equations at z in
    these directions. `smooth`: rows (q, n) of the smoothness on θ that the problem holds, which are taken out again.
    """
    units = parameter_units(problem.model)
    n = problem.model.n_parameters
    own = np.flatnonzero(np.any(basis[:n] != 0.0, axis=0))
    scaled = basis[:n, own] / units[:, None]
    theta = _parameters(problem, z)
    rows = smooth @ basis[:n, own]
    matrix = np.array(normal.matrix)
    gradient = np.array(normal.gradient)
    matrix[np.ix_(own, own)] -= rows.T @ rows
    gradient[own] -= rows.T @ (smooth @ theta)
    rest = np.setdiff1d(np.arange(len(matrix)), own)
    corner, vector = matrix[np.ix_(own, own)], gradient[own]
    if len(rest):
        jacobi = 1.0 / np.sqrt(np.diagonal(matrix)[rest])
        inner = cho_factor(matrix[np.ix_(rest, rest)] * jacobi[:, None] * jacobi, lower=True)
        cross = matrix[np.ix_(own, rest)] * jacobi
        half = solve_triangular(inner[0], cross.T, lower=True)
        corner = corner - half.T @ half
        vector = vector - cross @ cho_solve(inner, jacobi * gradient[rest])
    at = scaled.T @ (theta / units)
    return Information(corner, corner @ at - vector, scaled, units)


def _parameters(problem: Problem, z: np.ndarray) -> np.ndarray:
    """θ from the coefficients in z."""
    return np.asarray(problem.model.projection @ z[: problem.model.layout.n_coefficients])
