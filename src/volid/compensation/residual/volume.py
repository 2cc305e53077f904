"""Numbers about the working volume: ISO 230-1 volumetric accuracy, and the deviation before and after compensation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from volid.backend.rms import rms
from volid.compensation.grids.grid import Grid, RotaryGrid
from volid.compensation.grids.rotary import deviation_from_grids
from volid.compensation.residual.fields import volume_places
from volid.fitting.prediction.deviations import deviation_values, gradient_matrix
from volid.fitting.prediction.spread import covariance_root
from volid.fitting.prediction.working_volume import volume_positions
from volid.fitting.solution import Solution
from volid.model.rigid_fields import WorkpieceMotion

POINTS = 512
SAMPLES = 200


class VolumeSummary(NamedTuple):
    """The working volume in a few numbers, for one tool vector; lengths [mm], rotations [rad], NaN where not determined.

    `accuracy`: ranges of the six components, ISO 230-1 V_XYZ. `before_max`, `before_rms`: deviation of the functional point
    (3-D length) in the stated datum, `before_at` its place, machine axis order.
    """

    accuracy: np.ndarray
    before_max: float
    before_rms: float
    before_at: np.ndarray


class ResidualPrediction(NamedTuple):
    """Deviation (3-D length, [mm]) expected to remain after a grid is active, a rigid motion of the workpiece removed.

    It comes from the uncertainty of the solution (`SAMPLES` draws), the grid's linear interpolation, and the half of the reversal
    that a grid leaves. `rms` and `maximum` are means over the draws, `interval` is the central 95 % interval of the maximum, and
    `interpolation` is the largest interpolation deviation alone.
    """

    rms: float
    maximum: float
    interval: tuple[float, float]
    interpolation: float


def volumetric_summary(solution: Solution, tool: tuple[float, float, float]) -> VolumeSummary:
    """Volumetric accuracy and largest deviation over the travel, at the positions of `volume_positions`.

    Args:
        solution: A solution, as `volid.fit` makes it.
        tool: tool vector, (3,) [mm].

    Source: ISO 230-1:2012 3.8.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> found = volid.volumetric_summary(solution, (0.0, 0.0, -150.0))
    >>> found.accuracy.shape, found.before_at.shape, bool(found.before_rms < found.before_max)
    ((6,), (5,), True)
    """
    positions = volume_positions(solution.machine)
    found = solution.evaluate(positions, np.asarray(tool, dtype=float))
    size = np.linalg.norm(found.values[:, :3], axis=1)
    accuracy = np.ptp(found.values, axis=0)
    if not np.isfinite(size).all():
        return VolumeSummary(accuracy, np.nan, np.nan, np.full(positions.shape[1], np.nan))
    worst = int(np.argmax(size))
    return VolumeSummary(accuracy, float(size[worst]), rms(size), positions[worst])


def predict_residual(
    solution: Solution, grid: Grid, seed: int = 0, *, rotary: Sequence[RotaryGrid] = ()
) -> ResidualPrediction:
    """The deviation that is expected to remain when a control applies `grid`, from uncertainty and interpolation together.

    e_after = e_true - e_interpolated, with e_true drawn from the solution's covariance, for the tool vector of `grid` and random
    approach directions, because a grid does not compensate reversal. Least increment, repeatability and temperature are not
    included.

    Args:
        solution: A solution, as `volid.fit` makes it.
        grid: Grid of the linear axes, over their entire travel.
        seed: Seed of the random numbers for the draws, the places and the approach directions.
        rotary: Grids of the rotary axes; without them a five-axis machine keeps the errors of its rotary axes.

    Source: ISO/TR 16907 11.1.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> grid = volid.linear_grid(solution, points=2, tool=(0.0, 0.0, -150.0))
    >>> found = volid.predict_residual(solution, grid, rotary=volid.rotary_grids(solution, points=25))
    >>> 0.0 < found.rms < found.interval[0] < found.maximum < found.interval[1] < 0.1
    True
    """
    machine, (positions, ways) = solution.machine, volume_places(solution.machine, POINTS, seed)
    tool = np.broadcast_to(np.asarray(grid.tool), (POINTS, 3))
    theta, still = np.asarray(solution.parameters), np.zeros_like(positions)
    compensated = deviation_from_grids(machine, grid, rotary, positions, tool)[:, :3]
    mean, exact = (
        deviation_values(solution.model, theta, positions, tool, d)[:, :3] - compensated for d in (still, ways)
    )
    without = WorkpieceMotion(machine, positions, tool).removed_from
    gradient = gradient_matrix(solution.model, theta, positions, tool, ways)
    root = covariance_root(solution.parameter_covariance)
    draws = np.random.default_rng(seed).standard_normal((SAMPLES, root.shape[1])) @ root.T
    spread = (draws @ gradient[:, :3].reshape(-1, draws.shape[1]).T).reshape(SAMPLES, POINTS, 3)
    spread += solution.scatter_u()[:3] * np.random.default_rng([seed, 1]).standard_normal(spread.shape)
    size = np.linalg.norm(without(spread + exact), axis=2)
    largest = size.max(axis=1)
    low, high = np.quantile(largest, [0.025, 0.975]).tolist()
    interpolation = float(np.linalg.norm(without(mean[None])[0], axis=1).max())
    return ResidualPrediction(rms(size), float(largest.mean()), (low, high), interpolation)
