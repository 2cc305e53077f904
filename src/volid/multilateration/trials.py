"""Monte Carlo for distance networks: every trial draws all distances within their u and adjusts the network anew.

Where a coordinate hardly changes the distances (a point near the plane of the stations that see it), the distances depend on
its square. Its distribution is then far from normal, and u from propagation, which holds only at the adjusted coordinates, is
misleading.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from volid.backend.rms import rms
from volid.exceptions import InputError
from volid.multilateration.network_solution import NetworkSolution

BATCH = 512  # trials that are adjusted together
_ITERATIONS = 1000  # only trials at a fold, where the distances do not meet, need more than some ten
_STEP = 1e-9  # of the extent of the network: below, a trial has arrived
_FLAT = 1e-14  # relative decrease of the sum of squares: below, a trial has arrived
_DAMPING, _LESS, _MORE = 1e-6, 0.2, 5.0  # Levenberg-Marquardt: first, after a success, after a failure


class NetworkTrials(NamedTuple):
    """Adjusted coordinates of all trials; `network_trials` makes them.

    `coordinates`: shape (M, p, d), points in the order of the solution, in the unit of the distances. `converged`: shape (M,),
    whether the adjustment of a trial converged.
    """

    coordinates: Float[np.ndarray, "M p d"]
    converged: Bool[np.ndarray, " M"]


def network_trials(solution: NetworkSolution, trials: int = 10_000, seed: int = 0) -> NetworkTrials:
    """Adjusted coordinates of many networks whose distances are those of the solution plus normal noise of their u.

    Each trial minimises Σ ((d_i - |x_to - x_from|)/u_i)² by Levenberg-Marquardt from the adjusted coordinates; steps of least
    norm keep a free network where it is. Blunders stay left out. Trial i of a seed is the same whatever the number of trials.
    Errors common to several distances are not drawn.

    Args:
        solution: The adjusted network.
        trials: Number M of trials, at least 2.
        seed: Seed of the random numbers, an integer from 0.

    Raises:
        InputError: fewer than 2 trials, or a negative seed.

    Reference:
        JCGM 102:2011, 7 (propagation of distributions with several output quantities).

    Example:
        >>> from volid.multilateration import adjust_network
        >>> corners = {"A": (0, 0), "B": (400, 0), "P": (210, 290)}
        >>> readings = [("A", "P", 360.5551), ("B", "P", 360.5551)]
        >>> found = network_trials(adjust_network("ABP", "AB", readings, 0.001, corners, 2), trials=2000, seed=1)
        >>> found.coordinates.shape, bool(found.converged.all()), found.coordinates[:, 2].std(axis=0).round(4)
        ((2000, 3, 2), True, array([0.0013, 0.0008]))
    """
    if trials < 2:
        raise InputError(f"Monte Carlo: {trials} trials; expected at least 2")
    if seed < 0:
        raise InputError(f"seed is {seed}; expected a whole number >= 0")
    kept = np.setdiff1d(np.arange(len(solution.observations)), solution.blunders)
    number = {name: i for i, name in enumerate(solution.points)}
    start = np.array([number[solution.observations[i][0]] for i in kept])
    end = np.array([number[solution.observations[i][1]] for i in kept])
    free = np.flatnonzero([name in solution.unknown for name in solution.points])
    exact = np.linalg.norm(solution.coordinates[end] - solution.coordinates[start], axis=1)
    found, converged = [], []
    for first in range(0, trials, BATCH):
        count = min(BATCH, trials - first)
        noise = np.stack(
            [
                np.random.Generator(np.random.Philox(key=[seed, first + i])).standard_normal(len(kept))
                for i in range(count)
            ]
        )
        x, good = _adjust(solution.coordinates, free, start, end, exact + noise * solution.u[kept], solution.u[kept])
        found.append(x)
        converged.append(good)
    return NetworkTrials(np.concatenate(found), np.concatenate(converged))


def _adjust(
    place: np.ndarray, free: np.ndarray, start: np.ndarray, end: np.ndarray, readings: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Least-squares coordinates (M, p, d) for readings (M, m), all trials at once, and which arrived."""
    m, rows = len(readings), np.arange(len(u))
    x = np.broadcast_to(place, (m, *place.shape)).copy()
    extent = rms(np.linalg.norm(place - place.mean(axis=0), axis=1))
    damping, arrived = np.full(m, _DAMPING), np.zeros(m, dtype=bool)

    def misfit(x: np.ndarray, readings: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        beams = x[:, end] - x[:, start]
        lengths = np.linalg.norm(beams, axis=2)
        residuals = (readings - lengths) / u
        return residuals, np.sum(residuals**2, axis=1), beams / np.maximum(lengths, 1e-12 * extent)[..., None]

    for _ in range(_ITERATIONS):
        going = np.flatnonzero(~arrived)
        if not going.size:
            break
        residuals, cost, directions = misfit(x[going], readings[going])
        full = np.zeros((going.size, len(u), *place.shape))
        directions = directions / u[:, None]
        full[:, rows, end], full[:, rows, start] = directions, -directions
        jacobian = full[:, :, free].reshape(going.size, len(u), -1)
        normal = np.einsum("tik,til->tkl", jacobian, jacobian, optimize=True)
        scale = np.trace(normal, axis1=1, axis2=2) / normal.shape[1]
        normal += (damping[going] * scale)[:, None, None] * np.eye(normal.shape[1])
        right = np.einsum("tik,ti->tk", jacobian, residuals, optimize=True)
        step = np.linalg.solve(normal, right[..., None])[..., 0].reshape(going.size, free.size, -1)
        moved = x[going]
        moved[:, free] += step
        _, lower, _ = misfit(moved, readings[going])
        better = lower <= cost
        x[going[better]] = moved[better]
        damping[going] = np.where(better, np.maximum(_LESS * damping[going], 1e-15), _MORE * damping[going])
        small = np.abs(step).max(axis=(1, 2)) < _STEP * extent
        arrived[going] = small | (better & (cost - lower < _FLAT * np.maximum(cost, 1e-6)))
    return x, arrived
