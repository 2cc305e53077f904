"""What the data determine: a scaled rank decision, and its null space (in words: `statements`).

The decision is made on the Jacobian at the nominal machine, where the model is linear in its errors and the combinations that
are not determined are exact. It is one of geometry: machine parameters are measured in 0.1 mm and 0.1 mrad, and a combination
counts as determined when its singular value is above `LEAST` of the largest, however large all u are together. Nuisance
parameters are eliminated first (QR with their columns in front), so the null space is one of the machine alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from volid.campaign import Campaign
from volid.fitting.diagnosis.statements import Weak, explain, explain_weak, involvement
from volid.fitting.equations.problem import Problem
from volid.model.error_model import LOCATION, ErrorModel
from volid.model.iso230 import parse

UNIT = 0.1  # mm; the rotations' unit follows by dividing by 1 m
ROTATION_UNIT = 1e-4  # rad
LEAST = 1.5e-5  # of the largest singular value: what determines less is a coincidence of rounded positions
SPAN = 100.0  # of the median singular value: a single very precise reading does not make the others count for nothing
WEAK = 1e-4  # of the largest: determined, with a large u
RELATIVE = 1e-9  # the same for the other unknowns, which are in units of their own
ROUNDING = (
    1e-10  # of what a parameter does to readings: what other unknowns leave of that, where they explain all of it
)


@dataclass(frozen=True)
class Identifiability:
    """Result of the rank decision.

    `basis`: columns span the determined directions of the problem's free parameters, shape (n_free, rank).
    `null_space`: combinations of the model's θ that are not determined, shape (n_parameters, k), in θ's units.
    `tool_rotation`: directions of the constant tool rotation that are not determined and held at 0, shape (3, r).
    `statements`: the combinations that are not determined, in words. `nuisance_defect`: number of combinations of nuisance
    parameters that are not determined. `weak`: what is determined, but so little that its u is large, in words.
    """

    basis: np.ndarray
    null_space: np.ndarray
    tool_rotation: np.ndarray
    statements: tuple[str, ...] = ()
    nuisance_defect: int = 0
    undetermined: dict[str, float] = field(default_factory=dict)
    weak: tuple[Weak, ...] = ()

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
    largest = max(float(values[-1]), 1e-300) if n else 1.0
    if n and largest < 1e-8 * float(
        np.max(np.diagonal(scaled)[:n])
    ):  # the other unknowns explain all: rounding is left
        return None
    high = values > 1e-8 * largest
    low = np.abs(values) < 1e-11 * largest
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


class _Split(NamedTuple):
    """Right singular vectors as columns: what is `determined`, the `weak` ones among these, and the `null` space."""

    determined: np.ndarray
    null: np.ndarray
    weak: np.ndarray


def _split(matrix: np.ndarray, least: float) -> _Split:
    """Right singular vectors above and below `least` of the largest singular value."""
    if matrix.shape[1] == 0:
        return _Split(*[np.zeros((0, 0))] * 3)
    _, values, vt = np.linalg.svd(matrix, full_matrices=True)
    values = np.concatenate([values, np.zeros(vt.shape[0] - len(values))])
    seen = values[values > RELATIVE * max(values[0], 1e-300)]
    reference = max(min(values[0], SPAN * float(np.median(seen))) if len(seen) else 0.0, 1e-300)
    kept = values > least * reference
    weak = kept & (values < WEAK * reference)
    return _Split(vt[kept].T, vt[~kept].T, vt[weak].T)


def _by_triangle(problem: Problem, units: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Machine part of R in physical units, Jacobi scale of the nuisance columns, and their determined and null parts."""
    triangle = _triangle(problem)
    m = triangle.shape[1] - problem.model.n_parameters
    norms = np.linalg.norm(triangle[:, :m], axis=0)
    jacobi = 1.0 / np.where(norms > 0, norms, 1.0)
    kept, deficient, _ = _split(triangle[:m, :m] * jacobi, RELATIVE)
    machine = triangle[:, m:] * units
    if deficient.size:  # part of the machine's signal may sit where the nuisance columns are deficient
        q, _ = np.linalg.qr(triangle[:, :m] * jacobi @ kept)
        machine = machine - q @ (q.T @ machine)
    else:
        machine = machine[m:]
    return _above_rounding(machine, triangle[:, m:] * units), jacobi, kept, deficient


def _above_rounding(left: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """What other unknowns leave of the machine's part of R, 0 where that is rounding beside the `whole`."""
    if not left.size:
        return left
    _, sizes, vt = np.linalg.svd(left, full_matrices=False)
    least = ROUNDING * float(np.linalg.norm(whole, axis=0).max(initial=0.0))
    return np.asarray(np.where(sizes > least, sizes, 0.0)[:, None] * vt)


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
    tool, free = _held(model, machine)
    determined, null, weak = _split(machine @ free, LEAST)
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
        weak=explain_weak(model, free @ weak, campaign),
    )


def _held(model: ErrorModel, machine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions of the tool frame's constants that are held at 0 (s, r), and a basis of the parameters without them.

    Rotations and translations that no reading sees, and translations that are the same as location errors of rotary axes,
    whatever is read. A rotation that is part of a combination with error functions is not held: the next reading may determine
    it.
    """
    n, frame = machine.shape[1], model.tool_frame
    columns = np.array([f.parameters.start for f in frame], dtype=int)
    if not len(columns):
        return np.zeros((0, 0)), np.eye(n)
    least = LEAST * max(float(np.linalg.norm(machine, axis=0).max(initial=0.0)), 1e-300)
    places = [f.parameters.start for f in model.functions if f.part == LOCATION and f not in frame]
    shifts = np.flatnonzero([not parse(f.name).is_rotation for f in frame])
    alone = _unseen(machine[:, columns], least)
    same = np.zeros((len(columns), 0))
    if len(shifts) and len(places):
        span, sizes, _ = np.linalg.svd(machine[:, places], full_matrices=False)
        span = span[:, sizes > least]
        own = machine[:, columns[shifts]]
        found = _unseen(own - span @ (span.T @ own), least)
        same = np.zeros((len(columns), found.shape[1]))
        same[shifts] = found
    both, sizes, _ = np.linalg.svd(np.hstack([alone, same]), full_matrices=True)
    rank = int(np.sum(sizes > 1e-6))
    others = np.setdiff1d(np.arange(n), columns)
    free = np.zeros((n, len(columns) - rank))
    free[columns] = both[:, rank:]
    return both[:, :rank], np.concatenate([np.eye(n)[:, others], free], axis=1)


def _unseen(matrix: np.ndarray, least: float) -> np.ndarray:
    """Right singular vectors whose singular value is below `least`, as columns."""
    _, values, directions = np.linalg.svd(matrix, full_matrices=True)
    values = np.concatenate([values, np.zeros(len(directions) - len(values))])
    return np.asarray(directions[values <= least].T)
