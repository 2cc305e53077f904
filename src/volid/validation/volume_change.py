"""How much the deviation field changed over the working volume, what no comparison can see taken out (CONVENTIONS 4).

    d = (I - Q Qᵀ) G Σ aᵢ θ'ᵢ,   covariance (I - Q Qᵀ) G V Gᵀ (I - Q Qᵀ),

G the gradient of the functional point's deviation, Q a rigid motion of the workpiece frame, and constant motions of the tool
frame where some solution holds them at 0. A largest value among many is larger than 0 without any change: `expected_rms` says how
much the noise alone makes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.fitting.prediction.deviations import gradient_matrix
from volid.fitting.prediction.spread import covariance_root
from volid.fitting.prediction.working_volume import border_positions, spread_positions
from volid.model.rigid_fields import column_space, without
from volid.validation.changes import Combination, is_open
from volid.virtual.comparison import gauge_basis

EVEN = 256  # positions spread evenly, over which the RMS is taken


class Field(NamedTuple):
    """The change at m places. `positions` (m, axes), `tool` (m, 3); `change` (m, 3) [mm]; `root` (3m, r): its covariance is
    root · rootᵀ; `even`: how many of the places, the first, are spread evenly."""

    positions: np.ndarray
    tool: np.ndarray
    change: np.ndarray
    root: np.ndarray
    even: int


class VolumeChange(NamedTuple):
    """Numbers of the change of the field [mm]: the `largest` length of the change with its standard uncertainty `u` along its own
    direction, at `position` with `tool`; `rms` over the volume, and `expected_rms` without any change. NaN where the solutions do
    not determine the field."""

    largest: float
    u: float
    position: tuple[float, ...]
    tool: tuple[float, ...]
    rms: float
    expected_rms: float


def change_of_field(combination: Combination) -> Field | None:
    """The change over the working volume for the tool vectors of all campaigns in turn; None where nothing of it is
    determined."""
    of = combination.shared.of
    even, border = spread_positions(of.machine, EVEN), border_positions(of.machine)
    positions = np.vstack([even, border])
    vectors = np.unique(np.vstack([s.solution.campaign.tool_vectors() for s in of.states]).round(6), axis=0)
    tool = vectors[np.arange(len(positions)) % len(vectors)]
    nominal = np.zeros(of.model.n_parameters)  # there what moves only the frame does so exactly
    gradient = gradient_matrix(of.model, nominal, positions, tool, np.zeros_like(positions))[:, :3]
    gauge = np.hstack([gauge_basis(s.solution, positions, tool) for s in of.states])
    flat = without(column_space(gauge), gradient.reshape(-1, of.model.n_parameters))
    if np.any(is_open(combination, flat[np.linalg.norm(flat, axis=1) > 0.0])):
        return None
    change = (flat @ combination.value).reshape(-1, 3)
    return Field(positions, tool, change, flat @ covariance_root(combination.covariance), EVEN)


def numbers_of(field: Field | None) -> VolumeChange:
    """The largest change and its place, RMS over the volume."""
    if field is None:
        return VolumeChange(np.nan, np.nan, (), (), np.nan, np.nan)
    sizes = np.linalg.norm(field.change, axis=1)
    worst = int(np.argmax(sizes))
    along = field.change[worst] / max(sizes[worst], 1e-300)
    u = float(np.linalg.norm(along @ field.root.reshape(-1, 3, field.root.shape[1])[worst]))
    rms = float(np.sqrt(np.mean(sizes[: field.even] ** 2)))
    expected = float(np.sqrt(np.sum(field.root[: 3 * field.even] ** 2) / field.even))
    return VolumeChange(
        float(sizes[worst]),
        u,
        tuple(field.positions[worst].tolist()),
        tuple(field.tool[worst].tolist()),
        rms,
        expected,
    )
