"""Blunders: readings that contradict the others, found by least absolute residuals and data snooping."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from volid.multilateration.descent import descend
from volid.multilateration.determination import decomposition
from volid.multilateration.equations import Equations, part
from volid.multilateration.reliability import normalised

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

_INSEPARABLE = 0.98  # correlation of two residuals above which a blunder in one looks like a blunder in the other


def without_blunders(
    equations: Equations, critical: float, minima: Sequence[Float[np.ndarray, "p d"]]
) -> tuple[Bool[np.ndarray, " m"], Float[np.ndarray, "p d"]]:
    """Which observations to keep, and coordinates: several searches are made, and the one that excludes fewest observations wins.

    From each of the minima one search starts with least absolute residuals, another with all observations. A reading whose
    exclusion would lower the rank is kept, because no other reading checks it.
    """
    everything = np.ones(equations.u.size, bool)
    found = []
    for x in minima:
        guess, place = _first_guess(equations, critical, x)
        found += [_snooped(equations, critical, start, place) for start in (guess, everything)]
    best = min(found, key=lambda one: (one.largest > critical, int((~one.kept).sum()), one.largest))
    return best.kept, best.coordinates


class _Snooped(NamedTuple):
    """Observations kept, coordinates, and the largest normalised residual among them over the unit weight without it."""

    kept: Bool[np.ndarray, " m"]
    coordinates: Float[np.ndarray, "p d"]
    largest: float


def _snooped(
    equations: Equations, critical: float, kept: Bool[np.ndarray, " m"], x: Float[np.ndarray, "p d"]
) -> _Snooped:
    """Data snooping: take back the reading that fits best, or else leave out the one that fits worst, until nothing changes."""
    seen: set[bytes] = set()
    largest = np.inf
    while kept.tobytes() not in seen:
        seen.add(kept.tobytes())
        x = descend(part(equations, kept), x)
        decomposed = decomposition(equations, x, kept)
        dof = int(kept.sum()) - decomposed[1].size - part(equations, kept).offsets
        z = np.abs(np.nan_to_num(normalised(equations, x, kept, decomposed)))
        squares = (equations.residuals(x, kept)[kept] ** 2).sum()
        worst = int(np.argmax(np.where(kept, z, 0)))
        largest = z[worst] / max(1.0, np.sqrt(max(squares - z[worst] ** 2, 0) / max(dof - 1, 1)))
        returned = ~kept & (z <= critical * max(1.0, np.sqrt(squares / max(dof, 1))))
        if returned.any():
            kept = kept | (returned & (z == z[returned].min()))
        elif dof > 1 and largest > critical:
            kept = kept & (np.arange(kept.size) != worst)
    return _Snooped(kept, x, float(largest))


def _first_guess(equations: Equations, critical: float, x: Float[np.ndarray, "p d"]):
    """Observations that agree with the solution of least absolute residuals, as far as rank allows; and coordinates."""
    everything = np.ones(equations.u.size, bool)
    weights = np.ones(equations.u.size)
    for _ in range(30):
        before, x = x, descend(part(equations, everything, weights), x)
        if np.abs(x - before).max() < 1e-9 * equations.extent:
            break
        weights = 1 / np.maximum(np.abs(equations.residuals(x)), 1.0)
    rank = decomposition(equations, x, everything)[1].size + equations.offsets
    z = np.abs(equations.residuals(x))
    sigma = max(1.0, 1.4826 * float(np.median(z)) * np.sqrt(z.size / max(z.size - rank, 1)))
    kept = everything
    for i in np.argsort(-z)[: int((z > critical * sigma).sum())]:
        fewer = kept & (np.arange(z.size) != i)
        offsets = part(equations, fewer).offsets
        if fewer.sum() > rank and decomposition(equations, x, fewer)[1].size + offsets == rank:
            kept = fewer
    return kept, x


def inseparable(equations: Equations, x: np.ndarray, wanted: tuple[int, ...]) -> dict[int, tuple[int, ...]]:
    """For each wanted observation the others whose residual is proportional to its own, with all observations used.

    A blunder in any of them would leave the same residuals: correlation above 0.98 (Förstner 1983).
    """
    if not wanted:
        return {}
    vectors = decomposition(equations, x, np.ones(equations.u.size, bool))[0]
    if equations.shares is not None:
        vectors = np.hstack([vectors, equations.shares.toarray().T])
    redundancy = np.maximum(1 - (vectors**2).sum(axis=1), 1e-12)
    found = {}
    for i in wanted:
        correlation = (vectors @ vectors[i]) / np.sqrt(redundancy * redundancy[i])
        others = np.flatnonzero(np.abs(correlation) > _INSEPARABLE)
        found[i] = tuple(int(j) for j in others if j != i)
    return found
