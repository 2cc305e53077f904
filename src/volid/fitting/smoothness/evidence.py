"""The parameters of the smoothness by maximum of the marginal likelihood, and how well they are known.

Readings y = A-rows θ + noise are linear around the solution; information A = JᵀJ and vector b = Jᵀy, with the nuisance parameters
eliminated. With prior precision Q(φ) of θ, the log of the density of the readings given φ is, up to a constant,

    log p(y | φ) = ½ log|Q|₊ - ½ log|A + Q| + ½ bᵀ (A + Q)⁻¹ b,

|·|₊ the product of the eigenvalues that are not 0 (free functions). Its gradient needs ∂Q/∂φ, which has one block per process.
To it comes the wide prior of φ (`processes`). Rasmussen and Williams, 2006, 5.4; MacKay, Neural Computation 4 (1992) 415.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotri

from volid.fitting.smoothness.processes import Process, prior_covariance, stacked_rows

ITERATIONS = 60
PRECISE_ENOUGH = 0.05  # gain in the log density that a further step promises, at which the search ends
LONGEST_STEP = 1.5  # of a logarithm
DAMPING = 0.3  # of the curvature, where a step does not gain
DRAWS = 4  # pairs of φ over which the covariance is averaged
SEEN = 1e-7  # of the largest singular value of the pseudo-readings: below, a direction is free
NOTHING = 1e-4  # of the largest variance of pseudo-readings' noise
FREE = 1e-9  # eigenvalue of a prior precision over the largest: below, the direction is free


class Information(NamedTuple):
    """What the readings say of θ = `units` · T y.

    `matrix` A (r, r) and `vector` b (r,) of y; `basis` T (n, r), orthonormal: the directions of θ / `units` (n,) that they
    determine.
    """

    matrix: np.ndarray
    vector: np.ndarray
    basis: np.ndarray
    units: np.ndarray


@dataclass(frozen=True, eq=False)
class Smoothness:
    """Estimated smoothness: `phi` and its `covariance` over all processes in turn, `likelihood` log p there.

    `basis` T (n, r) spans what is determined of θ / `units` (n,), as y. `widening` M (r, r): with C the covariance of y, C M C
    is what the mean of that over the uncertainty of φ exceeds C, at φ, by.
    """

    processes: tuple[Process, ...]
    phi: np.ndarray
    covariance: np.ndarray
    likelihood: float
    widening: np.ndarray
    basis: np.ndarray
    units: np.ndarray

    def of(self, i: int) -> np.ndarray:
        """φ of process number `i`."""
        return self.phi[_places(self.processes)[i]]

    def rows(self, n: int) -> np.ndarray:
        """All pseudo-readings, shape (r, n), on θ (n,)."""
        return stacked_rows(self.processes, [self.phi[place] for place in _places(self.processes)], n)

    def pull(self, theta: np.ndarray) -> np.ndarray:
        """How the gradient of the prior at θ (n,) changes over one standard deviation of every independent part of φ, (n, h).

        Column i is Σⱼ ∂Q/∂φⱼ θ Lⱼᵢ with L Lᵀ = `covariance`; through the covariance C of θ it moves the estimate by -C times it.
        """
        columns = np.zeros((len(theta), len(self.phi)))
        for process, place in zip(self.processes, _places(self.processes), strict=True):
            _, slopes = process.precision_with_slopes(self.phi[place])
            own = process.parameters
            columns[own, place] = np.stack([slope @ theta[own] for slope in slopes], axis=1)
        return np.asarray(columns @ np.linalg.cholesky(self.covariance))

    def noise(self, theta: np.ndarray) -> np.ndarray:
        """G (r, h): because φ is uncertain, the pseudo-readings at θ (n,) have the covariance 1 + G Gᵀ.

        First order, the estimate of θ moving with φ, and the covariance of θ growing on average: along what is determined,
        Wᵀ G Gᵀ W = pull · pullᵀ + M, of which what is not positive is left out.
        """
        if not len(self.units):  # not estimated
            return np.zeros((len(self.rows(len(theta))), 0))
        directions = self.units[:, None] * self.basis
        pull = directions.T @ self.pull(theta)
        inverse = self._inverse(directions)
        values, vectors = np.linalg.eigh(inverse.T @ (pull @ pull.T + self.widening) @ inverse)
        kept = values > NOTHING * max(float(values[-1]), 1e-300)
        return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))

    def _inverse(self, directions: np.ndarray) -> np.ndarray:
        """Pseudo-inverse (r, rows) of the pseudo-readings along `directions` (n, r); block by block where these are θ / units."""
        n, r = directions.shape
        if n != r or np.count_nonzero(self.basis) != n:
            return np.linalg.pinv(self.rows(n) @ directions, rcond=SEEN)
        blocks = [
            (p.parameters, np.linalg.pinv(p.rows(self.of(i)) * self.units[p.parameters], rcond=SEEN))
            for i, p in enumerate(self.processes)
        ]
        inverse, done = np.zeros((n, sum(b.shape[1] for _, b in blocks))), 0
        for own, block in blocks:
            inverse[own, done : done + block.shape[1]] = block
            done += block.shape[1]
        return inverse


def _places(processes: Sequence[Process]) -> list[slice]:
    edges = np.cumsum([0, *(len(p.median) for p in processes)])
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]


def first_guess(processes: tuple[Process, ...]) -> Smoothness:
    """The medians of the prior, before any reading is looked at."""
    phi = np.concatenate([p.median for p in processes]) if processes else np.zeros(0)
    covariance = prior_covariance(processes) if processes else np.zeros((0, 0))
    none = np.zeros((0, 0))
    return Smoothness(processes, phi, covariance, float("nan"), none, none, np.zeros(0))


class _Component(NamedTuple):
    """Processes linked by combinations that are not determined: `columns` of θ, `basis` of what is determined of them, and
    `bound` (r, k): directions of that basis which the prior does not leave free."""

    members: tuple[int, ...]
    columns: np.ndarray
    basis: np.ndarray
    bound: np.ndarray


class _Evidence:
    """-log p(y | φ) - log p(φ) with its gradient, for an optimiser; after a call, θ and its covariance there."""

    def __init__(self, processes: tuple[Process, ...], information: Information) -> None:
        self.processes, self.places = processes, _places(processes)
        self.median = np.concatenate([p.median for p in processes])
        self.known = np.linalg.inv(prior_covariance(processes))
        self.basis, self.units = information.basis, [float(information.units[p.parameters.start]) for p in processes]
        self.vector, self.matrix = information.vector, information.matrix
        self.all_units = information.units
        self.plain = self.basis.shape[0] == self.basis.shape[1]
        if self.plain:  # everything is determined: y = θ / units, and blocks are slices
            self.vector, self.matrix = self.basis @ self.vector, self.basis @ self.matrix @ self.basis.T
            self.basis = np.eye(len(self.basis))
        self.components = _components(processes, information._replace(basis=self.basis))
        self.estimate, self.covariance, self.precision = np.zeros(len(self.basis)), np.zeros((0, 0)), np.zeros((0, 0))

    def __call__(self, phi: np.ndarray) -> tuple[float, np.ndarray]:
        prior = self._precisions(phi)
        value, gradient = self._posterior(prior)
        for component in self.components:
            own_value, own_gradient = self._prior(component, prior)
            value, gradient = value - own_value, gradient - own_gradient
        away = phi - self.median
        return value + 0.5 * float(away @ self.known @ away), gradient + self.known @ away

    def _precisions(self, phi: np.ndarray) -> list[tuple[np.ndarray, list[np.ndarray]]]:
        """Prior precision of θ / units and its derivatives, process by process."""
        found = []
        for process, at, unit in zip(self.processes, self.places, self.units, strict=True):
            q, slopes = process.precision_with_slopes(phi[at])
            found.append((unit**2 * q, [unit**2 * slope for slope in slopes]))
        return found

    def _posterior(self, prior: list[tuple[np.ndarray, list[np.ndarray]]]) -> tuple[float, np.ndarray]:
        """½ log|A + Q| - ½ bᵀ (A + Q)⁻¹ b, and its gradient."""
        matrix = self.matrix.copy()
        for process, (q, _) in zip(self.processes, prior, strict=True):
            if self.plain:
                matrix[process.parameters, process.parameters] += q
            else:
                own = self.basis[process.parameters]
                matrix += own.T @ q @ own
        self.precision = matrix
        scale = 1.0 / np.sqrt(np.diagonal(matrix))
        factor, lower = cho_factor(matrix * scale[:, None] * scale, lower=True, check_finite=False)
        estimate = scale * cho_solve((factor, lower), scale * self.vector, check_finite=False)
        inverse, _ = dpotri(factor, lower=1)
        inverse = np.tril(inverse) + np.tril(inverse, -1).T
        self.covariance = inverse * scale[:, None] * scale
        self.estimate = self.basis @ estimate
        value = float(np.sum(np.log(np.diagonal(factor))) - np.sum(np.log(scale)) - 0.5 * self.vector @ estimate)
        gradient = []
        for process, (_, slopes) in zip(self.processes, prior, strict=True):
            theta = self.estimate[process.parameters]
            spread = self._own_covariance(process) + np.outer(theta, theta)
            gradient += [0.5 * float(np.sum(spread * slope)) for slope in slopes]
        return value, np.array(gradient)

    def widening(self, phi: np.ndarray, root: np.ndarray) -> np.ndarray:
        """M, (r, r), with C M C the mean of the covariance of y over φ ~ N(φ, L Lᵀ), `root` L, minus C, that at φ.

        Over `DRAWS` pairs φ ± L x, x standard normal numbers, always the same.
        """
        total = np.zeros_like(self.matrix)
        for x in np.random.default_rng(DRAWS).standard_normal((DRAWS, len(phi))):
            total += self._covariance_at(phi + root @ x) + self._covariance_at(phi - root @ x)
        centre = self._covariance_at(phi)
        return np.asarray(self.precision @ (total / (2 * DRAWS) - centre) @ self.precision)

    def _covariance_at(self, phi: np.ndarray) -> np.ndarray:
        self._posterior(self._precisions(phi))
        return self.covariance

    def _own_covariance(self, process: Process) -> np.ndarray:
        if self.plain:
            return self.covariance[process.parameters, process.parameters]
        own = self.basis[process.parameters]
        return np.asarray(own @ self.covariance @ own.T)

    def _prior(
        self, component: _Component, prior: list[tuple[np.ndarray, list[np.ndarray]]]
    ) -> tuple[float, np.ndarray]:
        """½ log|Q|₊ of one component, and its gradient over all φ."""
        across = component.basis @ component.bound
        gradient = np.zeros(len(self.median))
        rows = {i: across[np.searchsorted(component.columns, _range(self.processes[i]))] for i in component.members}
        matrix = sum(rows[i].T @ prior[i][0] @ rows[i] for i in component.members)
        factor = cho_factor(matrix, lower=True, check_finite=False)
        inverse = cho_solve(factor, np.eye(len(matrix)), check_finite=False)
        for i in component.members:
            spread = rows[i] @ inverse @ rows[i].T
            gradient[self.places[i]] = [0.5 * float(np.sum(spread * slope)) for slope in prior[i][1]]
        return float(np.sum(np.log(np.diagonal(factor[0])))), gradient

    def fisher(self, phi: np.ndarray) -> np.ndarray:
        """Expected curvature at φ: ½ tr(D ∂ᵢQ D ∂ⱼQ) with D = Q⁻ - C, C the covariance of θ; and that of the prior of φ."""
        prior = self._precisions(phi)
        known = -self.covariance if self.plain else -self.basis @ self.covariance @ self.basis.T
        for component in self.components:
            across = component.basis @ component.bound
            rows = [(i, np.searchsorted(component.columns, _range(self.processes[i]))) for i in component.members]
            matrix = sum(across[at].T @ prior[i][0] @ across[at] for i, at in rows)
            known[np.ix_(component.columns, component.columns)] += across @ np.linalg.solve(matrix, across.T)
        return self.known + _shared_information(self.processes, known, [own for _, own in prior])


def _shared_information(
    processes: tuple[Process, ...], known: np.ndarray, slopes: list[list[np.ndarray]]
) -> np.ndarray:
    """½ tr(D ∂ᵢQ D ∂ⱼQ) for all pairs, D `known` (n, n): blocks are padded to one size, so that products go all at once."""
    size, count = max(len(s[0]) for s in slopes), len(processes)
    blocks = np.zeros((count, count, size, size))
    for i, p in enumerate(processes):
        for j, q in enumerate(processes):
            own = known[p.parameters, q.parameters]
            blocks[i, j, : own.shape[0], : own.shape[1]] = own
    owner = np.repeat(np.arange(count), [len(s) for s in slopes])
    padded = np.zeros((len(owner), size, size))
    for k, slope in enumerate(s for own in slopes for s in own):
        padded[k, : len(slope), : len(slope)] = slope
    product = (padded[:, None] @ blocks[owner])[:, owner]
    return np.asarray(0.5 * np.einsum("acxy,cayx->ac", product, product))


def _range(process: Process) -> np.ndarray:
    return np.arange(process.parameters.start, process.parameters.stop)


def _components(processes: tuple[Process, ...], information: Information) -> list[_Component]:
    """Processes apart from each other, or together where a direction that is not determined links them."""
    projector = information.basis @ information.basis.T
    linked = np.array(
        [[bool(np.abs(projector[p.parameters, q.parameters]).max() > 1e-9) for q in processes] for p in processes]
    )
    left, found = list(range(len(processes))), []
    while left:
        members = {left.pop(0)}
        while more := [i for i in left if linked[i, list(members)].any()]:
            members.update(more)
            left = [i for i in left if i not in members]
        found.append(_component(processes, information, tuple(sorted(members))))
    return [c for c in found if c.bound.shape[1]]


def _component(processes: tuple[Process, ...], information: Information, members: tuple[int, ...]) -> _Component:
    columns = np.sort(np.concatenate([_range(processes[i]) for i in members]))
    own = _orthonormal(information.basis[columns])
    matrix = np.zeros((len(columns), len(columns)))
    for i in members:
        at = np.searchsorted(columns, _range(processes[i]))
        unit = float(information.units[processes[i].parameters.start])
        matrix[np.ix_(at, at)] = unit**2 * processes[i].precision(processes[i].median)
    values, vectors = np.linalg.eigh(own.T @ matrix @ own)
    return _Component(members, columns, own, vectors[:, values > FREE * max(float(values.max(initial=0.0)), 1e-300)])


def _orthonormal(rows: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the column space of `rows`, (n, r) with n at least its rank."""
    left, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(left[:, sizes > 0.5])


def estimate(processes: tuple[Process, ...], information: Information, start: np.ndarray | None = None) -> Smoothness:
    """Smoothness of the processes from what the readings say; `start`: φ at which to begin, default the medians.

    The most probable φ by Fisher scoring; then every size s grows to its root mean square, log s + σ² for a log s that is
    uncertain by σ: where readings say little of a function, what is most probable is smaller than what must be reckoned with.

    Steps H⁻¹ g with the expected curvature H, no longer than a factor of e^1.5 in any parameter, damped where the
    density does not grow (Levenberg and Marquardt).
    """
    if not processes:
        return first_guess(processes)
    evidence = _Evidence(processes, information)
    phi = evidence.median if start is None else start
    value, gradient = evidence(phi)
    curvature, damping = evidence.fisher(phi), 0.0
    for _ in range(ITERATIONS):
        step = -np.linalg.solve(curvature + damping * np.diag(np.diagonal(curvature)), gradient)
        step *= min(1.0, LONGEST_STEP / max(float(np.max(np.abs(step))), 1e-300))
        if -float(gradient @ step) < PRECISE_ENOUGH:
            break
        new_value, new_gradient = evidence(phi + step)
        if new_value > value:
            damping = max(DAMPING, 4.0 * damping)
            continue
        phi, value, gradient = phi + step, new_value, new_gradient
        curvature, damping = evidence.fisher(phi), (0.3 * damping if damping > 0.1 * DAMPING else 0.0)
    evidence(phi)
    covariance = np.linalg.inv(curvature)
    sizes = [place.start for place in _places(processes)]
    phi = phi.copy()
    phi[sizes] += np.diagonal(covariance)[sizes]
    value, _ = evidence(phi)
    root = np.linalg.cholesky(covariance)
    root[sizes] = 0.0  # their root mean square is taken already
    widening = evidence.widening(phi, root)
    return Smoothness(processes, phi, covariance, -value, widening, evidence.basis, information.units)
