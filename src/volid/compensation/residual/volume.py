"""Numbers about the working volume: ISO 230-1 volumetric accuracy, and the deviation before and after compensation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from volid.backend.even_points import even_points
from volid.compensation.grids.linear import Grid
from volid.compensation.grids.rotary import RotaryGrid, deviation_from_grids
from volid.fitting.prediction.deviations import deviation_values, gradient_matrix
from volid.fitting.prediction.working_volume import volume_positions
from volid.fitting.solution import Solution
from volid.model.rigid_motion import rigid_motion_rows

POINTS = 512
SAMPLES = 200


class VolumeSummary(NamedTuple):
    """The working volume in a few numbers, for one tool vector; lengths [mm], rotations [rad], NaN if undetermined.

    `accuracy`: ranges of the six components, ISO 230-1 V_XYZ. `before_max`, `before_rms`: deviation of the functional point
    (3-D length) in the stated datum, `before_at` its place, machine axis order.
    """

    accuracy: np.ndarray
    before_max: float
    before_rms: float
    before_at: np.ndarray


class ResidualPrediction(NamedTuple):
    """Deviation (3-D length, [mm]) expected to remain after a grid is active, a rigid motion of the workpiece removed.

    From the uncertainty of the solution (`SAMPLES` draws), the grid's linear interpolation and the half of the reversal that it
    leaves: `rms` and `maximum` are means over the draws, `interval` the central 95 % interval of the maximum,
    `interpolation` the largest interpolation deviation alone.
    """

    rms: float
    maximum: float
    interval: tuple[float, float]
    interpolation: float


def _travel(solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    low = np.array([axis.travel[0] for axis in solution.machine.axes])
    return low, np.array([axis.length for axis in solution.machine.axes])


def volumetric_summary(solution: Solution, tool: tuple[float, float, float]) -> VolumeSummary:
    """Volumetric accuracy and largest deviation over the travel. ISO 230-1:2012 3.8.

    At the positions of `working_volume`.
    """
    positions = volume_positions(solution.machine)
    found = solution.evaluate(positions, np.asarray(tool, dtype=float))
    size = np.linalg.norm(found.values[:, :3], axis=1)
    accuracy = np.ptp(found.values, axis=0)
    if not np.isfinite(size).all():
        return VolumeSummary(accuracy, np.nan, np.nan, np.full(positions.shape[1], np.nan))
    worst = int(np.argmax(size))
    return VolumeSummary(accuracy, float(size[worst]), float(np.sqrt(np.mean(size**2))), positions[worst])


def without_rigid_motion(solution: Solution, positions: np.ndarray, tool: np.ndarray, field: np.ndarray) -> np.ndarray:
    """Fields (..., m, 3) less their least-squares rigid motion of the workpiece frame (CONVENTIONS 4, last rule)."""
    rows = rigid_motion_rows(solution.machine, positions, tool)[:, :3, :].reshape(-1, 6)
    rows = rows / np.linalg.norm(rows, axis=0)
    q, _ = np.linalg.qr(rows)
    flat = field.reshape(*field.shape[:-2], -1)
    return np.asarray((flat - (flat @ q) @ q.T).reshape(field.shape))


def predict_residual(
    solution: Solution, grid: Grid, seed: int = 0, *, rotary: Sequence[RotaryGrid] = ()
) -> ResidualPrediction:
    """What should remain of the deviation when a control applies `grid`: uncertainty and interpolation together.

    e_after = e_true - e_interpolated, with e_true drawn from the solution's covariance, for the tool vector of `grid` and random
    approach directions, whose reversal a grid leaves. `rotary`:
    the grids of the rotary axes; without them a five-axis machine keeps the errors of its rotary axes. Least increment,
    repeatability and temperature are not included. ISO/TR 16907 11.1.
    """
    low, length = _travel(solution)
    unit = even_points(POINTS, len(low), seed)
    positions = low + unit * length
    tool = np.broadcast_to(np.asarray(grid.tool), (POINTS, 3))
    theta = np.asarray(solution.parameters)
    still, ways = np.zeros_like(positions), np.random.default_rng(seed).choice([-1.0, 1.0], positions.shape)
    held = deviation_from_grids(solution.machine, grid, rotary, positions, tool)[:, :3]
    mean, exact = (deviation_values(solution.model, theta, positions, tool, d)[:, :3] - held for d in (still, ways))
    interpolation = without_rigid_motion(solution, positions, tool, mean)
    gradient = gradient_matrix(solution.model, theta, positions, tool, ways)
    values, vectors = np.linalg.eigh(solution.parameter_covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = np.random.default_rng(seed).standard_normal((SAMPLES, root.shape[1])) @ root.T
    translations = gradient[:, :3].reshape(-1, draws.shape[1])
    fields = (draws @ translations.T).reshape(SAMPLES, POINTS, 3) + exact
    size = np.linalg.norm(without_rigid_motion(solution, positions, tool, fields), axis=2)
    largest = size.max(axis=1)
    bounds = np.quantile(largest, [0.025, 0.975])
    return ResidualPrediction(
        float(np.sqrt(np.mean(size**2))),
        float(largest.mean()),
        (float(bounds[0]), float(bounds[1])),
        float(np.linalg.norm(interpolation, axis=1).max()),
    )
