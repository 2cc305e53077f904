"""Numbers about the working volume: ISO 230-1 volumetric accuracy, and the deviation before and after compensation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from volid.backend.rms import rms
from volid.compensation.control import Control
from volid.compensation.grids.grid import Grid, RotaryGrid
from volid.compensation.residual.fields import Field, field_over, quantities, tool_axes
from volid.compensation.residual.prediction import (
    MOST_SAMPLES,
    mean_left_by,
    parameter_draws,
    prediction,
    with_worst_places,
)
from volid.compensation.residual.repeats import repeats_of
from volid.fitting.prediction.largest import values_at, whole_volume, with_largest
from volid.fitting.solution import Solution


class VolumeSummary(NamedTuple):
    """The working volume in a few numbers, for one tool vector; lengths [mm], rotations [rad], NaN where not determined.

    `accuracy`: ranges of the six components, ISO 230-1 V_XYZ. `before_max`, `before_rms`: largest and RMS deviation of the
    functional point (3-D length) in the stated datum, mean of both approach directions; `before_at` the place of the largest,
    machine axis order.
    """

    accuracy: np.ndarray
    before_max: float
    before_rms: float
    before_at: np.ndarray


class ResidualPrediction(NamedTuple):
    """Deviation (3-D length, [mm]) expected to remain after a grid is active, a rigid motion of the workpiece removed.

    It comes from the uncertainty of the solution, the grid's linear interpolation, the half of the reversal that a grid
    leaves, and
    the machine's repeatability as far as the campaign shows it. `rms` and `maximum` are means over the draws, `interval` is
    the 95 % coverage interval of the maximum, and
    `interpolation` is the largest interpolation deviation alone. They are those of the column "L-VOL" of `forecast` for the
    same grids.
    """

    rms: float
    maximum: float
    interval: tuple[float, float]
    interpolation: float


def volumetric_summary(solution: Solution, tool: tuple[float, float, float]) -> VolumeSummary:
    """Volumetric accuracy and largest deviation over the working volume, corners and edges included.

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
    solution.ask(tool)
    places = with_largest(solution, np.asarray(tool, dtype=float))
    found = values_at(solution, places, np.asarray(tool, dtype=float))
    size = np.linalg.norm(found[:, :3], axis=1)
    accuracy = np.ptp(found, axis=0)
    if not np.isfinite(size).all():
        return VolumeSummary(accuracy, np.nan, np.nan, np.full(places.positions.shape[1], np.nan))
    worst = int(np.argmax(size))
    return VolumeSummary(accuracy, float(size[worst]), rms(size[places.even]), places.positions[worst])


def predict_residual(
    solution: Solution, grid: Grid, seed: int = 0, *, rotary: Sequence[RotaryGrid] = (), most_draws: int = MOST_SAMPLES
) -> ResidualPrediction:
    """The deviation that is expected to remain when a control applies `grid`, from uncertainty and interpolation together.

    e_after = e_true - e_interpolated, with e_true from the Monte Carlo samples of the solution or drawn from its covariance, for
    the tool vector of `grid` and both approach directions, because a grid does not compensate reversal. The repeatability that
    the campaign shows or states is in it, as in `forecast`; least increment and temperature are not.

    Args:
        solution: A solution, as `volid.fit` makes it.
        grid: Grid of the linear axes, over their entire travel.
        seed: Seed of the random numbers for the draws.
        rotary: Grids of the rotary axes; without them a five-axis machine keeps the errors of its rotary axes.
        most_draws: At most so many draws of the parameters.

    Raises:
        NotDeterminedError: the data do not determine the deviation for this tool vector.
        InputError: the grid needs rotations that are blank.

    Source: ISO/TR 16907 11.1.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/five_axis_rtest/campaign.toml"))
    >>> grid = volid.linear_grid(solution, points=2, tool=(0.0, 0.0, -150.0))
    >>> found = volid.predict_residual(solution, grid, rotary=volid.rotary_grids(solution, points=25))
    >>> 0.0 < found.rms < found.interval[0] < found.maximum < found.interval[1] < 0.1
    True
    """
    acting = Control(solution.machine, grids=(grid, *rotary))
    return _predicted(
        solution, np.asarray(grid.tool, dtype=float), acting, parameter_draws(solution, seed, most_draws)[0]
    )


def predict_uncompensated(
    solution: Solution, tool: tuple[float, float, float], most_draws: int = MOST_SAMPLES
) -> ResidualPrediction:
    """The same without any compensation, for a tool vector (3,) [mm]: the column "none" of `forecast`.

    It differs from `volumetric_summary` by the rigid motion of the workpiece, and holds for both approach directions. Raises
    `NotDeterminedError`.
    """
    return _predicted(
        solution, np.asarray(tool, dtype=float), Control(solution.machine), parameter_draws(solution, 0, most_draws)[0]
    )


def predict_left(
    solution: Solution, acting: Control, tool: tuple[float, float, float], most_draws: int = MOST_SAMPLES
) -> ResidualPrediction:
    """The same with a control that holds tables, grids or both, for a tool vector (3,) [mm].

    Raises `NotDeterminedError`, and `InputError` where a grid is blank.
    """
    return _predicted(solution, np.asarray(tool, dtype=float), acting, parameter_draws(solution, 0, most_draws)[0])


def _predicted(solution: Solution, tool: np.ndarray, acting: Control, draws: np.ndarray) -> ResidualPrediction:
    (field,) = with_worst_places(field_over(solution, whole_volume(solution.model), tool), [acting])
    found = prediction(field, acting, draws, repeats_of(solution))
    (largest, _, mean, *_), (low, *_), (high, *_) = found.value, found.low, found.high
    return ResidualPrediction(float(mean), float(largest), (float(low), float(high)), _interpolation(field, acting))


def _interpolation(field: Field, acting: Control) -> float:
    """The largest length [mm] that is left of the mean of both approach directions, if the solution were exact."""
    q, machine = field.places.positions, field.machine
    left = mean_left_by(field, acting)[None]
    return float(quantities(field.motion().removed_from(left), tool_axes(machine, q))[0, 0])
