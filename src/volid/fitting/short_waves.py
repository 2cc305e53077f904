"""What is independent from position to position, and waves of a stated pitch; `Solution` describes the functions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from volid.fitting.prediction.spread import linear_uncertainty
from volid.model.error_model import MEAN, WAVES, ErrorModel
from volid.model.iso230 import LINEAR_AXES, parse
from volid.model.splines import design_matrix

if TYPE_CHECKING:
    from volid.fitting.solution import Solution

PHASES = 64  # of a wave, over which its root mean square is taken


def carries(name: str, key: str) -> bool:
    """Whether an error motion may have scatter that is stated for a direction, or for one function."""
    error = parse(name)
    translation = not error.location and not error.is_rotation and error.axis in LINEAR_AXES
    return translation and key in (name, name[1])


def scatter_u(solution: Solution, model: ErrorModel) -> np.ndarray:
    """Standard deviation by component of a deviation, (6,) [mm, rad], of the functions that `model` does not leave out."""
    u = np.zeros(6)
    for key, size in solution.scatter.items():
        own = [f for f in model.functions if carries(f.name, key) and f.part == MEAN]
        if any(np.any(model.parametrisation[:, f.parameters] != 0.0) for f in own):
            k = "XYZ".index(own[0].name[1])
            u[k] = np.hypot(u[k], size)
    return solution.factor * u


def wave_size(solution: Solution, name: str) -> tuple[float, float]:
    """Largest size of the short waves of an error motion and their largest u [mm].

    Raises `KeyError` where it has none in the model.
    """
    function = solution.model.by_name[name, WAVES]
    (spline,) = function.splines
    x = np.linspace(spline.low, spline.high, PHASES, endpoint=False)
    rows = design_matrix(spline, x) @ solution.model.parametrisation[function.coefficients, function.parameters]
    waves = rows @ np.asarray(solution.parameters)[function.parameters]
    u = linear_uncertainty(rows, solution.parameter_covariance[function.parameters, function.parameters])
    return float(np.abs(waves).max()), float(np.max(u))


def without_waves(solution: Solution) -> Solution:
    """The solution whose waves are no part of the values, but of every u."""
    model, theta = solution.model, np.asarray(solution.parameters)
    waves = [f for f in model.functions if f.part == WAVES]
    if not waves or solution.smooth is None:
        return solution
    kept, scatter = np.ones(model.n_parameters), dict(solution.scatter)
    for f in waves:
        (spline,) = f.splines
        x = np.linspace(spline.low, spline.high, PHASES, endpoint=False)
        rows = design_matrix(spline, x) @ model.parametrisation[f.coefficients, f.parameters]
        known = solution.parameter_covariance[f.parameters, f.parameters] / solution.factor**2
        square = float(np.mean((rows @ theta[f.parameters]) ** 2 + np.sum((rows @ known) * rows, axis=1)))
        scatter[f.name] = float(np.sqrt(scatter.get(f.name, 0.0) ** 2 + square))
        kept[f.parameters] = 0.0
    plain = replace(model, parametrisation=model.parametrisation * kept)
    return replace(solution, model=plain, smooth=replace(solution.smooth, scatter=scatter))
