"""What the data determine: a scaled rank decision, and its null space (in words: `statements`).

The decision is made on the Jacobian at the nominal machine, where the model is linear in its errors and the combinations that are
not determined are exact. Machine parameters are measured in 0.1 mm and 0.1 mrad: a combination counts as determined when its
standard uncertainty stays below ten such units (1 mm, 1 mrad) and its singular value above 1e-9 of the largest. Nuisance
parameters are eliminated first (QR with their columns in front), so the null space is one of the machine alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from volid.campaign import Campaign
from volid.fitting.diagnosis.statements import explain, involvement
from volid.fitting.equations.problem import Problem
from volid.model.error_model import ErrorModel
from volid.model.iso230 import parse

UNIT = 0.1  # mm; the rotations' unit follows by dividing by 1 m
ROTATION_UNIT = 1e-4  # rad
WEAKEST = 0.1  # singular value in these units: standard uncertainty of 1 mm or 1 mrad
RELATIVE = 1e-9
# A combination that is hardly determined (tools 0.1 mm beside the spindle axis) has small components in functions that are well
# determined. They mean nothing: setting such a combination to 0 changes those functions by less than their uncertainty.
HELD = 0.1  # cosine to the null space from which a tool rotation is part of it


@dataclass(frozen=True)
class Identifiability:
    """Result of the rank decision.

    `basis`: columns span the determined directions of the problem's free parameters, shape (n_free, rank).
    `null_space`: combinations of the model's θ that are not determined, shape (n_parameters, k), in θ's units.
    `tool_rotation`: directions of the constant tool rotation that are not determined and held at 0, shape (3, r).
    `statements`: the combinations that are not determined, in words. `nuisance_defect`: number of combinations of nuisance
    parameters that are not determined.
    """

    basis: np.ndarray
    null_space: np.ndarray
    tool_rotation: np.ndarray
    statements: tuple[str, ...] = ()
    nuisance_defect: int = 0
    undetermined: dict[str, float] = field(default_factory=dict)

    @property
    def full_rank(self) -> bool:
        """True when every function of the model is determined (a constant tool rotation may be held at 0)."""
        return self.null_space.shape[1] == 0


def parameter_units(model: ErrorModel) -> np.ndarray:
    """Physical unit of every free model parameter: 0.1 mm or 0.1 mrad."""
    units = np.empty(model.n_parameters)
    for f in model.functions:
        units[f.parameters] = ROTATION_UNIT if parse(f.name).is_rotation else UNIT
    return units


def undetermined_directions(null_space: np.ndarray, units: np.ndarray) -> np.ndarray:
    """Combinations (n, d) of θ that are not determined, as orthonormal directions of θ / `units`, shape (n, d)."""
    return np.asarray(np.linalg.qr(np.asarray(null_space) / units[:, None])[0])


def _clear_cut(matrix: np.ndarray, n: int, units: np.ndarray) -> np.ndarray | None:
    """Square root of the machine's Schur complement, when JᵀJ alone decides every direction with a wide gap; else None.

    JᵀJ shows singular values only down to 1e-8 of the largest. That is enough when all directions lie far above that or at its
    noise. Otherwise the QR factorisation decides.
    """
    scaled = matrix * np.outer(*[np.concatenate([units, np.ones(matrix.shape[0] - n)])] * 2)
    nuisance = np.diagonal(scaled)[n:]
    if np.any(nuisance <= 0):
        return None
    jacobi = 1.0 / np.sqrt(nuisance)
    inner = scaled[n:, n:] * np.outer(jacobi, jacobi)
    if len(inner) and np.linalg.eigvalsh(inner)[0] < 1e-9:
        return None
    cross = scaled[:n, n:] * jacobi
    schur = scaled[:n, :n] - (cross @ cho_solve(cho_factor(inner), cross.T) if len(inner) else 0.0)
    values, vectors = np.linalg.eigh(schur)
    largest = max(float(values[-1]), 1.0) if n else 1.0
    high = values > max(100.0 * WEAKEST**2, 1e-8 * largest)
    low = np.abs(values) < min(0.01 * WEAKEST**2, 1e-11 * largest)
    if not np.all(high | low):
        return None
    return np.asarray(np.sqrt(np.where(high, values, 0.0))[:, None] * vectors.T)


def _triangle(problem: Problem) -> np.ndarray:
    """R of the QR factorisation of the whitened Jacobian in free parameters, nuisance columns first; streamed."""
    n = problem.model.n_parameters
    order = np.concatenate([np.arange(n, problem.free.shape[1]), np.arange(n)])
    free = problem.free[:, order]
    triangle = np.zeros((0, free.shape[1]))
    for chunks in problem.equations.jacobian(problem.start):
        for chunk in np.asarray(chunks):
            triangle = np.asarray(np.linalg.qr(np.vstack([triangle, chunk.T @ free]), mode="r"))
    prior = np.asarray(problem.system.prior_root) @ free
    return np.asarray(np.linalg.qr(np.vstack([triangle, prior, np.zeros((free.shape[1], free.shape[1]))]), mode="r"))


def _split(matrix: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """Right singular vectors above and below `least` and the relative threshold: (determined, null)."""
    if matrix.shape[1] == 0:
        return np.zeros((0, 0)), np.zeros((0, 0))
    _, values, vt = np.linalg.svd(matrix, full_matrices=True)
    values = np.concatenate([values, np.zeros(vt.shape[0] - len(values))])
    kept = values > max(least, RELATIVE * max(values[0], 1e-300))
    return vt[kept].T, vt[~kept].T


def _by_triangle(problem: Problem, units: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Machine part of R in physical units, Jacobi scale of the nuisance columns, and their determined and null parts."""
    triangle = _triangle(problem)
    m = triangle.shape[1] - problem.model.n_parameters
    norms = np.linalg.norm(triangle[:, :m], axis=0)
    jacobi = 1.0 / np.where(norms > 0, norms, 1.0)
    kept, deficient = _split(triangle[:m, :m] * jacobi, 0.0)
    machine = triangle[:, m:] * units
    if deficient.size:  # part of the machine's signal may sit where the nuisance columns are deficient
        q, _ = np.linalg.qr(triangle[:, :m] * jacobi @ kept)
        machine = machine - q @ (q.T @ machine)
    else:
        machine = machine[m:]
    return machine, jacobi, kept, deficient


def analyse(problem: Problem, campaign: Campaign) -> Identifiability:
    """Decide which combinations of the free parameters the data determine, at the problem's start (nominal machine)."""
    model = problem.model
    n, n_free = model.n_parameters, problem.free.shape[1]
    units = parameter_units(model)
    matrix = problem.free.T @ problem.equations.normal(problem.start).matrix @ problem.free
    m = n_free - n
    machine = _clear_cut(matrix, n, units)
    jacobi, kept, deficient = np.ones(m), np.eye(m), np.zeros((m, 0))
    if machine is None:
        machine, jacobi, kept, deficient = _by_triangle(problem, units)
    tool_columns = np.array([f.parameters.start for f in model.tool_frame], dtype=int)
    tool, free = _hold_tool_rotation(machine, tool_columns)
    determined, null = _split(machine @ free, WEAKEST)
    basis = np.zeros((n_free, determined.shape[1] + kept.shape[1]))
    basis[:n, : determined.shape[1]] = units[:, None] * (free @ determined)
    basis[n:, determined.shape[1] :] = jacobi[:, None] * kept
    scaled_null = free @ null
    return Identifiability(
        basis=basis,
        null_space=units[:, None] * scaled_null,
        tool_rotation=tool,
        statements=explain(model, scaled_null, campaign, tool.shape[1] > 0),
        nuisance_defect=deficient.shape[1],
        undetermined=involvement(model, scaled_null),
    )


def _hold_tool_rotation(machine: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions of the tool rotation that are not determined (r columns), and a basis of the parameters with these at 0."""
    n = machine.shape[1]
    _, null = _split(machine, WEAKEST)
    share = null[columns] if null.size else np.zeros((len(columns), 0))
    if not share.size:
        return np.zeros((len(columns), 0)), np.eye(n)
    u, values, _ = np.linalg.svd(share, full_matrices=True)
    rank = int(np.sum(values > HELD))
    identity = np.eye(n)
    others = np.setdiff1d(np.arange(n), columns)
    free = np.zeros((n, len(columns) - rank))
    free[columns] = u[:, rank:]
    return u[:, :rank], np.concatenate([identity[:, others], free], axis=1)
