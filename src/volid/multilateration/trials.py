"""Monte Carlo for distance networks: every trial draws all distances within their u and adjusts the network anew.

Where a coordinate hardly changes the distances (a point near the plane of the stations that see it), the distances depend on
its square. Its distribution is then far from normal, and u from propagation, which holds only at the adjusted coordinates, is
misleading.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.multilateration.determination import determine
from volid.multilateration.equations import ABSOLUTE, Equations
from volid.multilateration.network_solution import NetworkSolution

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

BATCH = 512  # trials that are adjusted together
_ITERATIONS = 1000  # only trials at a fold, where the distances do not meet, need more than some ten
_AROUND = 10  # steps without second derivatives: they lead away from saddles
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

    Each trial minimises Σ ((d_i - |x_to - x_from| - δ_g(i))/u_i)² by Levenberg-Marquardt from the adjusted coordinates; steps
    of least norm keep a free network where it is. Along directions that the second order alone limits, trials begin on either
    side, at
    random: the height of a point in the plane of its stations then has both signs, and is 0 in the trials whose distances do not
    meet. Blunders stay left out. Trial i of a seed is the same whatever the number of trials.
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
    equations = _noiseless(solution)
    found = determine(equations, solution.coordinates)
    bent = np.concatenate([found.weak_reach, found.reach[np.isfinite(found.reach)]])
    place, converged = [], []
    for first in range(0, trials, BATCH):
        generators = [
            np.random.Generator(np.random.Philox(key=[seed, i])) for i in range(first, min(first + BATCH, trials))
        ]
        noise = np.stack([generator.standard_normal(equations.u.size) for generator in generators])
        sides = np.stack([generator.standard_normal(bent.size) for generator in generators])
        start = np.broadcast_to(solution.coordinates, (len(noise), *solution.coordinates.shape)).copy()
        start[:, equations.free] += ((sides * bent) @ found.held.T).reshape(len(noise), -1, start.shape[2])
        x, good = _adjust(equations, start, equations.readings + noise * equations.u)
        place.append(x)
        converged.append(good)
    return NetworkTrials(np.concatenate(place), np.concatenate(converged))


def _noiseless(solution: NetworkSolution) -> Equations:
    """The equations of the observations kept, their readings being the distances between the adjusted coordinates."""
    kept = np.setdiff1d(np.arange(len(solution.observations)), solution.blunders)
    number = {name: i for i, name in enumerate(solution.points)}
    start, end = (np.array([number[solution.observations[i][k]] for i in kept]) for k in (0, 1))
    labels = {label: i for i, label in enumerate(solution.offsets)}
    groups = solution.groups or (None,) * len(solution.observations)
    x = solution.coordinates
    return Equations(
        x - x.mean(axis=0),
        np.array([name in solution.unknown for name in solution.points]),
        start,
        end,
        np.linalg.norm(x[end] - x[start], axis=1),
        solution.u[kept],
        np.array([labels.get(groups[i], ABSOLUTE) for i in kept]),
    )


def _adjust(equations: Equations, x: np.ndarray, readings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least-squares coordinates (M, p, d) for readings (M, m), all trials at once, from x, and which arrived."""
    arrived, damping = np.zeros(len(x), dtype=bool), np.full(len(x), _DAMPING)
    for i in range(_ITERATIONS):
        going = np.flatnonzero(~arrived)
        if not going.size:
            break
        now = _misfit(equations, x[going], readings[going])
        step = _step(equations, now, damping[going], exact=i >= _AROUND)
        moved = x[going]
        moved[:, equations.free] += step
        lower = _misfit(equations, moved, readings[going]).cost
        better = lower <= now.cost
        x[going[better]] = moved[better]
        damping[going] = np.where(better, np.maximum(_LESS * damping[going], 1e-15), _MORE * damping[going])
        small = np.abs(step).max(axis=(1, 2)) < _STEP * equations.extent
        arrived[going] = small | (better & (now.cost - lower < _FLAT * np.maximum(now.cost, 1e-6)))
    return x, arrived


class _Misfit(NamedTuple):
    """Residuals over u (M, m), their sum of squares (M,), lengths (M, m) and unit vectors (M, m, d)."""

    residuals: np.ndarray
    cost: np.ndarray
    lengths: np.ndarray
    directions: np.ndarray


def _misfit(equations: Equations, x: np.ndarray, readings: np.ndarray) -> _Misfit:
    beams = x[:, equations.end] - x[:, equations.start]
    lengths = np.maximum(np.linalg.norm(beams, axis=2), 1e-12 * equations.extent)
    residuals = equations.centred(((readings - lengths) / equations.u).T).T
    return _Misfit(residuals, np.sum(residuals**2, axis=1), lengths, beams / lengths[..., None])


def _step(equations: Equations, now: _Misfit, damping: np.ndarray, exact: bool) -> np.ndarray:
    """Levenberg-Marquardt steps (M, free points, d); `exact` with the second derivatives, without which folds take hundreds."""
    jacobian = _jacobian(equations, now.directions / equations.u[:, None])
    normal = np.einsum("tik,til->tkl", jacobian, jacobian, optimize=True)
    scale = np.trace(normal, axis1=1, axis2=2) / normal.shape[1]
    if exact:
        normal += _second_order(equations, now)
    normal += (damping * scale)[:, None, None] * np.eye(normal.shape[1])
    right = np.einsum("tik,ti->tk", jacobian, now.residuals, optimize=True)
    return np.linalg.solve(normal, right[..., None])[..., 0].reshape(len(right), int(equations.free.sum()), -1)


def _jacobian(equations: Equations, directions: np.ndarray) -> np.ndarray:
    """Derivative of the predicted readings over u by the free coordinates, (M, m, k)."""
    trials, m, d = directions.shape
    rows, full = np.arange(m), np.zeros((trials, m, equations.free.size, d))
    full[:, rows, equations.end], full[:, rows, equations.start] = directions, -directions
    jacobian = full[:, :, equations.free].reshape(trials, m, -1)
    if equations.shares is None:
        return jacobian
    return equations.centred(jacobian.transpose(1, 0, 2).reshape(m, -1)).reshape(m, trials, -1).transpose(1, 0, 2)


def _second_order(equations: Equations, now: _Misfit) -> np.ndarray:
    """What the second derivatives of the distances add to JᵀJ, (M, k, k): -(ε/ρ)(I - e eᵀ)/u² in the blocks of each distance."""
    trials, _, d = now.directions.shape
    bend = -now.residuals / (now.lengths * equations.u)
    blocks = bend[..., None, None] * (np.eye(d) - now.directions[..., :, None] * now.directions[..., None, :])
    count, ends = equations.free.size, (equations.start, equations.end)
    full = np.zeros((count, count, trials, d, d))
    for a, b, sign in ((0, 0, 1), (1, 1, 1), (0, 1, -1), (1, 0, -1)):
        np.add.at(full, (ends[a], ends[b]), sign * blocks.transpose(1, 0, 2, 3))
    free = full[np.ix_(equations.free, equations.free)].transpose(2, 0, 3, 1, 4)
    return free.reshape(trials, free.shape[1] * d, -1)
