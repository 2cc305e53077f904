"""Recovery pooled over 100 campaigns: with every tool vector at every station, where the constant tool rotation is determined
too, and with a single one at each.

The machines and readings of `test_recovery`: 6 stations, 400 distances each, u = 0.3 µm + 0.3 µm/m, a truth that is no spline.
One plan per machine, and 100 machines measured with it: each has its own error functions, location errors, tool rotation and
noise, by the exact chain. The first is fitted with default settings; the other readings are then refitted exactly, not
linearised, in that model (`Refitter`, whose own estimate of its error is checked; that it finds the minimum of the fit is tested
in test_monte_carlo). What differs from 100 real fits, each with its own plan and its own choice of spline resolution: positions
are the same, and the resolution is that of the first campaign. Three real fits per machine stand in `test_recovery`, thirty
with -m long.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from exact_chain import gauge_basis, random_truth
from scipy.stats import chi2
from support.machines import MACHINES
from support.recovery import LARGEST, MANY, TOOL_ROTATION, volume
from support.trackers import simulated

from volid.fitting.fit import fit
from volid.fitting.prediction.deviations import deviation_values, gradient_matrix
from volid.fitting.solution import Solution
from volid.uncertainty.trials.refit import Refits, Refitter

pytestmark = pytest.mark.slow


@dataclass
class Pool:
    """Many refitted campaigns of one machine.

    `normalised`: (n, 256, 3), difference of the deviation fields over u, gauge removed from both. `rms`: 3-D root mean square
    difference [mm]. `turns`: (n, 3), (estimate - truth)/u of EA0S, EB0S, EC0S.
    """

    solution: Solution
    refits: Refits
    normalised: np.ndarray
    rms: float
    turns: np.ndarray


def measured(exact, tracker, rng):
    """Another machine with the same plan: its truth, and its readings (m,) [mm]."""
    truth = random_truth(exact, rng)
    places = np.array([tracker.station_positions[name] for name in tracker.station])
    dead = [tracker.dead_paths[beam] for beam in zip(tracker.station.tolist(), tracker.segment.tolist(), strict=True)]
    length = np.linalg.norm(exact.functional_point(tracker.q, tracker.tool, truth) - places, axis=1)
    return truth, length + dead + tracker.u * rng.standard_normal(len(length))


@cache
def pool(machine, every: bool = True) -> Pool:
    exact = MACHINES[machine]
    campaign, truth, tracker = simulated(exact, 2000, n_per_station=400, every_station_sees_every_tool=every)
    solution = fit(campaign)
    rng = np.random.default_rng(2001)
    others = [measured(exact, tracker, rng) for _ in range(MANY - 1)]
    truths = [truth, *(t for t, _ in others)]
    readings = np.stack([tracker.distance, *(r for _, r in others)])[:, :, None]
    refitter = Refitter(solution)
    refits = refitter.refit(refitter.noise_of([readings]))
    normalised, rms = fields(solution, machine, truths, refits.x, tool_rotation=not every)
    places = [next(f.parameters.start for f in solution.model.functions if f.name == n) for n in TOOL_ROTATION]
    true = np.array([[t.constants[n] for n in TOOL_ROTATION] for t in truths])
    u = np.sqrt(np.diagonal(np.asarray(solution.covariance))[places])
    u = np.where(u > 0.0, u, np.nan)  # held at 0: nothing is stated
    return Pool(solution, refits, normalised, rms, (refits.x[:, places] - true) / u)


def fields(solution, machine, truths, x, tool_rotation):
    """Normalised differences (n, 256, 3) and 3-D root mean square difference of the deviation fields to the exact chain."""
    exact, (q, tool) = MACHINES[machine], volume(machine)
    still, n = np.zeros_like(q), solution.model.n_parameters
    found = np.stack([deviation_values(solution.model, row[:n], q, tool, still)[:, :3] for row in x])
    true = np.stack([exact.deviation(q, tool, truth)[:, :3] for truth in truths])
    removed = gauge_basis(q, tool, exact, tool_rotation=tool_rotation)
    difference = (found - true).reshape(len(x), -1)
    difference = (difference - difference @ removed @ removed.T).reshape(found.shape)
    rows = gradient_matrix(solution.model, np.asarray(solution.parameters), q, tool, still)[:, :3].reshape(
        3 * len(q), n
    )
    values, vectors = np.linalg.eigh(solution.parameter_covariance)
    root = rows @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    u = np.linalg.norm(root - removed @ (removed.T @ root), axis=1).reshape(-1, 3)
    return difference / u, float(np.sqrt(np.mean(np.sum(difference**2, axis=2))))


@pytest.mark.parametrize(
    "machine, every", [*((m, True) for m in MACHINES), ("gantry", False), ("horizontal", False)]
)  # the vertical one with a single tool at each station: a hundred real fits in `test_recovery`
def test_pooled_over_100_campaigns(machine, every):
    found = pool(machine, every)
    assert found.refits.error.max() < 1e-4, "standard uncertainties from the minimum"
    assert found.solution.held_tool_rotation == (() if every else TOOL_ROTATION) and found.solution.fully_determined
    assert 0.9 < np.sqrt(np.mean(found.normalised**2)) < 1.1
    assert found.rms < LARGEST[machine]
    # the readings reach the noise: what the splines cannot follow is small
    dof = found.solution.statistics.n_readings - found.solution.statistics.n_parameters
    assert 0.99 < np.mean(found.refits.chi_square) / dof < 1.02


@pytest.mark.parametrize("machine", MACHINES)
def test_constant_tool_rotation_comes_out_right(machine):
    """Values of unit variance; bias of the splines allowed for as above: up to 1.1²."""
    turns = pool(machine).turns
    low, high = chi2.ppf([1e-3, 1 - 1e-3], turns.size) / turns.size
    assert low < np.mean(turns**2) < 1.1**2 * high
    assert np.abs(turns.mean(axis=0)).max() < 3.9 / np.sqrt(len(turns)), "no systematic difference"
