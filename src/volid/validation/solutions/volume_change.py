"""How much the deviation field changed over the working volume, what no comparison can see taken out (CONVENTIONS 4).

    d = (I - Q Qᵀ) G Σ aᵢ θ'ᵢ,   covariance (I - Q Qᵀ) G V Gᵀ (I - Q Qᵀ),

G the gradient of the functional point's deviation at the nominal machine, Q a rigid motion of the workpiece frame, and constant
motions of the tool frame where some solution holds them at 0. A largest value among many is larger than 0 without any change:
`expected_rms` says how much the noise alone makes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.fitting.prediction.deviations import gradient_matrix
from volid.fitting.prediction.spread import covariance_root
from volid.fitting.prediction.working_volume import border_positions, spread_positions
from volid.model.rigid_fields import column_space, without
from volid.validation.solutions.function_changes import Combination, is_open
from volid.validation.solutions.states import States
from volid.virtual.comparison import gauge_basis

EVEN = 256  # positions spread evenly, over which the RMS is taken


class Volume(NamedTuple):
    """Places over the common range, with the tool vectors of all campaigns in turn. `positions` (m, axes), `tool` (m, 3); `rows`
    (m, 3, n'): the change of the field there by θ', without the gauge.
    `axes`: their letters. The first `EVEN` places are spread evenly."""

    positions: np.ndarray
    tool: np.ndarray
    rows: np.ndarray
    axes: tuple[str, ...]


class VolumeChange(NamedTuple):
    """Numbers of the change of the field [mm]: the `largest` length of the change with its standard uncertainty `u` along its own
    direction, at `position` of `axes` with `tool`; `rms` over the volume, and `expected_rms` without any change. NaN
    where the solutions do not determine the field."""

    largest: float
    u: float
    position: tuple[float, ...]
    tool: tuple[float, ...]
    rms: float
    expected_rms: float
    axes: tuple[str, ...] = ()


NOTHING = VolumeChange(np.nan, np.nan, (), (), np.nan, np.nan)


def volume_of(of: States) -> Volume:
    """The places and rows that all numbers of the volume come from."""
    positions = np.vstack([spread_positions(of.machine, EVEN), border_positions(of.machine)])
    vectors = np.unique(np.vstack([s.solution.campaign.tool_vectors() for s in of.states]).round(6), axis=0)
    tool = vectors[np.arange(len(positions)) % len(vectors)]
    nominal = np.zeros(of.model.n_parameters)  # there what moves only the frame does so exactly
    gradient = gradient_matrix(of.model, nominal, positions, tool, np.zeros_like(positions))[:, :3]
    gauge = np.hstack([gauge_basis(s.solution, positions, tool) for s in of.states])
    rows = without(column_space(gauge), gradient.reshape(-1, of.model.n_parameters))
    return Volume(positions, tool, rows.reshape(len(positions), 3, -1), tuple(a.letter for a in of.machine.axes))


def change_in(volume: Volume, combination: Combination) -> VolumeChange:
    """The largest change and its place, RMS over the volume; NaN where some of the field is not determined."""
    flat = volume.rows.reshape(-1, volume.rows.shape[2])
    if np.any(is_open(combination, flat[np.linalg.norm(flat, axis=1) > 0.0])):
        return NOTHING
    change = volume.rows @ combination.value
    root = volume.rows @ covariance_root(combination.covariance)
    sizes = np.linalg.norm(change, axis=1)
    worst = int(np.argmax(sizes))
    return VolumeChange(
        float(sizes[worst]),
        float(np.linalg.norm(change[worst] @ root[worst]) / max(sizes[worst], 1e-300)),
        tuple(volume.positions[worst].tolist()),
        tuple(volume.tool[worst].tolist()),
        float(np.sqrt(np.mean(sizes[:EVEN] ** 2))),
        float(np.sqrt(np.sum(root[:EVEN] ** 2) / EVEN)),
        volume.axes,
    )


def largest_u(volume: Volume, covariance: np.ndarray) -> float:
    """Largest standard uncertainty of the field along any direction [mm]."""
    root = volume.rows @ covariance_root(covariance)
    return float(np.sqrt(np.max(np.linalg.eigvalsh(root @ root.transpose(0, 2, 1))[:, -1])))
