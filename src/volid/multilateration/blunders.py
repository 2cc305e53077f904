"""Blunders: readings that contradict the others, found by least absolute residuals and data snooping."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from volid.multilateration.equations import Equations, decomposition, descend, normalised, part

_INSEPARABLE = 0.98  # correlation of two residuals above which a blunder in one looks like a blunder in the other


def without_blunders(equations: Equations, critical: float) -> Bool[np.ndarray, " m"]:
    """Which observations to keep: two searches are made, and the one that excludes fewer observations wins.

    One search starts from least absolute residuals, the other from all observations. A reading whose exclusion would lower the
    rank is kept, because no other reading checks it.
    """
    everything = np.ones(equations.u.size, bool)
    guess, x = _first_guess(equations, critical)
    found = [_snooped(equations, critical, start, x) for start in (guess, everything)]
    return min(found, key=lambda one: (one[1] > critical, int((~one[0]).sum()), one[1]))[0]


def _snooped(equations: Equations, critical: float, kept: Bool[np.ndarray, " m"], x: Float[np.ndarray, "p d"]):
    """Data snooping: take back the reading that fits best, or else leave out the one that fits worst, until nothing changes.

    Returns the observations kept and the largest normalised residual among them, over the unit weight without it.
    """
    seen: set[bytes] = set()
    largest = np.inf
    while kept.tobytes() not in seen:
        seen.add(kept.tobytes())
        x = descend(part(equations, kept), x)
        decomposed = decomposition(equations, x, kept)
        dof = int(kept.sum()) - decomposed[1].size
        z = np.abs(np.nan_to_num(normalised(equations, x, kept, decomposed)))
        squares = (equations.residuals(x)[kept] ** 2).sum()
        worst = int(np.argmax(np.where(kept, z, 0)))
        largest = z[worst] / max(1.0, np.sqrt(max(squares - z[worst] ** 2, 0) / max(dof - 1, 1)))
        returned = ~kept & (z <= critical * max(1.0, np.sqrt(squares / max(dof, 1))))
        if returned.any():
            kept = kept | (returned & (z == z[returned].min()))
        elif dof > 1 and largest > critical:
            kept = kept & (np.arange(kept.size) != worst)
    return kept, float(largest)


def _first_guess(equations: Equations, critical: float):
    """Observations that agree with the solution of least absolute residuals, as far as rank allows; and coordinates."""
    everything = np.ones(equations.u.size, bool)
    x, weights = equations.approximate, np.ones(equations.u.size)
    for _ in range(30):
        before, x = x, descend(part(equations, everything, weights), x)
        if np.abs(x - before).max() < 1e-9 * equations.extent:
            break
        weights = 1 / np.maximum(np.abs(equations.residuals(x)), 1.0)
    rank = decomposition(equations, x, everything)[1].size
    z = np.abs(equations.residuals(x))
    sigma = max(1.0, 1.4826 * float(np.median(z)) * np.sqrt(z.size / max(z.size - rank, 1)))
    kept = everything
    for i in np.argsort(-z)[: int((z > critical * sigma).sum())]:
        fewer = kept & (np.arange(z.size) != i)
        if fewer.sum() > rank and decomposition(equations, x, fewer)[1].size == rank:
            kept = fewer
    return kept, x


def inseparable(equations: Equations, x: np.ndarray, wanted: tuple[int, ...]) -> dict[int, tuple[int, ...]]:
    """For each wanted observation the others whose residual is proportional to its own, with all observations used.

    A blunder in any of them would leave the same residuals: correlation above 0.98 (Förstner 1983).
    """
    vectors = decomposition(equations, x, np.ones(equations.u.size, bool))[0]
    redundancy = np.maximum(1 - (vectors**2).sum(axis=1), 1e-12)
    found = {}
    for i in wanted:
        correlation = (vectors @ vectors[i]) / np.sqrt(redundancy * redundancy[i])
        others = np.flatnonzero(np.abs(correlation) > _INSEPARABLE)
        found[i] = tuple(int(j) for j in others if j != i)
    return found
