"""Second derivatives of readings, by differences of recorded gradients: what refits to second order take, whatever the engine."""

from __future__ import annotations

from typing import Any

import numpy as np

from volid.backend.reverse import Recorded, gradients
from volid.effects.prediction import predict_readings
from volid.fitting.equations.system import Block, System
from volid.model.error_values import error_values, evaluate_bases


def second_derivatives(
    system: System, chunk: Block, z: np.ndarray, rows: tuple[int, ...], steps: np.ndarray
) -> np.ndarray:
    """Gradient and Hessian of the whitened predictions in error values and slots, (k, m, d + 1, d), the gradient last.

    In the error values `rows` and all slots, d in all. `chunk`: arrays (width, m) of a block. Forward differences of the exact
    gradient, by `steps` (d,): of 0.1 µm and 0.1 µrad, where truncation is 1e-7 of a Hessian whose arms are 1 m, and rounding of
    the gradient less.
    """
    n, m = system.layout.n_coefficients, chunk.q.shape[1]
    errors = error_values(system.layout, z[:n], evaluate_bases(system.layout, chunk.q, chunk.direction))
    at = np.concatenate([errors if errors.shape[1] else np.zeros((len(errors), m)), z[n + chunk.slots]])
    split = len(at) - len(chunk.slots)
    places = [*rows, *range(split, len(at))]
    result = np.empty((chunk.form.n_readings, m, len(places) + 1, len(places)), dtype=np.float32)
    weight = chunk.weight[:, None, :]
    gradient = _gradients(system, chunk, at, split)[:, places]
    result[:, :, -1] = (gradient * weight).transpose(0, 2, 1)
    for j, (place, step) in enumerate(zip(places, steps, strict=True)):
        moved = at.copy()
        moved[place] += step
        moved_gradient = _gradients(system, chunk, moved, split)[:, places]
        result[:, :, j] = ((moved_gradient - gradient) * (weight / step)).transpose(0, 2, 1)
    return result


def _gradients(system: System, chunk: Block, values: np.ndarray, split: int) -> np.ndarray:
    """Partial derivatives (k, errors + slots, m) of the predictions at stated error values and, after `split` of them, slots."""
    notes: list[Recorded] = []
    leaves: list[Any] = [Recorded(row, notes) for row in values]
    tool, constants = tuple(chunk.tool), tuple(chunk.constants)
    found = predict_readings(system.machine, chunk.form, chunk.q, tool, leaves[:split], leaves[split:], constants)
    return np.stack([gradients(f, leaves, chunk.q.shape[1]) for f in found])
