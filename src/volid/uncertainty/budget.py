"""Uncertainty budget: which source contributes how much to an output.

With H = Σ_s J_sᵀ J_s over the sources s (whitened readings of a set, pseudo-readings of an effect, a calibrated length, an
earlier solution), the estimate is x = C Σ_s J_sᵀ l_s, C = H⁻¹, so that C = Σ_s C J_sᵀ J_s C: the contributions of independent
sources to u² of any output add up to the whole. GUM 5.1.2, written for a least-squares adjustment.
"""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from volid.fitting.problem import normal_equations
from volid.fitting.solution import Solution
from volid.uncertainty.refit import Refitter


@dataclass(frozen=True, eq=False)
class Budget:
    """`sources`: names. `covariances`: (s, p, p), share of each source in the covariance of x = (θ, ν)."""

    sources: tuple[str, ...]
    covariances: np.ndarray

    def contributions(self, rows: np.ndarray) -> np.ndarray:
        """Standard uncertainty that each source brings to linear outputs `rows` (q, p): (s, q), in the outputs' units."""
        return np.sqrt(np.maximum(np.einsum("qi,sij,qj->sq", rows, self.covariances, rows, optimize=True), 0.0))

    def root_mean_square(self, rows: np.ndarray) -> list[tuple[str, float, float]]:
        """(source, RMS contribution over the outputs `rows`, its share of the variance), largest first."""
        values = np.sqrt(np.mean(self.contributions(rows) ** 2, axis=1))
        total = max(float(np.sum(values**2)), 1e-300)
        table = [(s, float(v), float(v**2) / total) for s, v in zip(self.sources, values, strict=True)]
        return sorted(table, key=lambda row: -row[1])


def budget(solution: Solution) -> Budget:
    """The budget of a solution: one source per set of readings, per effect, per calibrated length, and the earlier solution."""
    refitter = Refitter(solution)
    frozen, covariance = refitter.frozen, np.asarray(solution.covariance)
    basis = np.asarray(frozen.basis)
    sources, parts = [], []
    numbers = [int(np.asarray(n).ravel()[0]) for n in frozen.numbers]
    first = np.cumsum([0, *(s.readings.size for s in refitter.campaign.sets)])
    for i, s in enumerate(refitter.campaign.sets):
        blocks = tuple(
            b for b, number in zip(frozen.system.blocks, numbers, strict=True) if first[i] <= number < first[i + 1]
        )
        alone = (jnp.zeros((0, frozen.system.size)), blocks)
        system = eqx.tree_at(lambda t: (t.prior_root, t.blocks), frozen.system, alone)
        matrix = basis.T @ np.asarray(normal_equations(system, frozen.z).matrix) @ basis
        sources.append(f"readings of set '{s.name}'")
        parts.append(covariance @ matrix @ covariance)
    for name, rows in _prior_sources(solution, refitter):
        reach = rows @ covariance
        sources.append(name)
        parts.append(reach.T @ reach)
    return Budget(tuple(sources), np.array(parts))


def _prior_sources(solution: Solution, refitter: Refitter) -> list[tuple[str, np.ndarray]]:
    """Name and pseudo-reading rows (r, p) of every source of prior knowledge."""
    entries = [solution.nuisance_table[j] for j in refitter.known]
    names = [f"effect '{e.effect}'" if e.effect else e.name for e in entries]
    rows = np.asarray(refitter.frozen.prior)
    result = [(n, rows[[i for i, m in enumerate(names) if m == n]]) for n in dict.fromkeys(names)]
    if len(rows) > len(names):
        result.append(("earlier solution", rows[len(names) :]))
    return result
