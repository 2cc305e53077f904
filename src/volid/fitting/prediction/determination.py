"""Whether the data determine a deviation: as it stands, or up to a rigid motion of the workpiece frame.

With unknown stations a field may be known in shape for the measured tool vector although the functions that place it are
not: then its combinations that are not determined move the field like one rigid body (CONVENTIONS 4, last rules). Such values
are given with these combinations at zero, which fixes one frame for all tool vectors and positions, and marked `rigid`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.fitting.diagnosis.identifiability import parameter_units, undetermined_directions
from volid.fitting.prediction.deviations import (
    determined,
    deviation_values,
    gradient_matrix,
    is_determined,
    standard_uncertainties,
)
from volid.model.error_model import ErrorModel
from volid.model.jacobian import rigid_motion_rows
from volid.model.rigid_fields import WorkpieceMotion

NODES = 4  # per axis, of the field that is compared with a rigid motion
MOST_TOOLS = 16


class Determination(NamedTuple):
    """`known`: bool (m, 6), per component. `rigid`: bool (m,), True where a rigid motion of the workpiece frame is open."""

    known: np.ndarray
    rigid: np.ndarray


def determination(
    model: ErrorModel, null_space: np.ndarray, positions: np.ndarray, tool: np.ndarray, direction: np.ndarray
) -> Determination:
    """What the data determine at m points, approached in `direction` (0: mean), with `null_space` (n_parameters, k)."""
    units = parameter_units(model)
    known = is_determined(model, null_space, units, positions, tool, direction)
    rigid = np.zeros(len(positions), dtype=bool)
    if known.all():
        return Determination(known, rigid)
    null = undetermined_directions(null_space, units)
    null = units[:, None] * null
    for rows in _by_tool(tool):
        open_rows = rows[~known[rows, :3].all(axis=1)]
        motion = _rigid_motion(model, null, tool[rows[0]]) if open_rows.size else None
        if motion is not None:  # one tool vector's field has one frame
            known[rows] = _moves_along(model, null, motion, positions[rows], tool[rows], direction[rows])
            rigid[rows] = True
    return Determination(known, rigid)


def _by_tool(tool: np.ndarray) -> list[np.ndarray]:
    """Rows of each distinct tool vector; none when there are more than `MOST_TOOLS`."""
    tools, index = np.unique(np.round(tool, 9), axis=0, return_inverse=True)
    return [
        np.flatnonzero(np.asarray(index).ravel() == i) for i in range(len(tools) if len(tools) <= MOST_TOOLS else 0)
    ]


def known_deviations(
    model: ErrorModel,
    theta: np.ndarray,
    covariance: np.ndarray | None,
    null_space: np.ndarray,
    positions: np.ndarray,
    tool: np.ndarray,
    direction: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, Determination]:
    """Deviations and u, (m, 6), NaN where not determined: what is open is held at 0, once for all points (CONVENTIONS 4).

    Without a `covariance` u is NaN; the values are the same.
    """
    values = deviation_values(model, theta, positions, tool, direction)
    u = np.full_like(values, np.nan)
    if covariance is not None:
        u = standard_uncertainties(model, theta, covariance, positions, tool, direction)
    found = determination(model, null_space, positions, tool, direction)
    return np.where(found.known, values, np.nan), np.where(found.known, u, np.nan), found


class _Mesh(NamedTuple):
    """Points spread over the travel for one tool vector, and what a rigid motion does to a field there."""

    positions: np.ndarray
    tool: np.ndarray
    rigid: WorkpieceMotion


def _mesh(model: ErrorModel, tool: np.ndarray) -> _Mesh:
    nodes = np.meshgrid(*(np.linspace(*axis.travel, NODES) for axis in model.machine.axes), indexing="ij")
    positions = np.stack([m.ravel() for m in nodes], axis=1)
    tools = np.broadcast_to(tool, (len(positions), 3))
    return _Mesh(positions, tools, WorkpieceMotion(model.machine, positions, tools))


def _translation_gradient(model: ErrorModel, theta: np.ndarray, mesh: _Mesh) -> np.ndarray:
    gradient = gradient_matrix(model, theta, mesh.positions, mesh.tool, np.zeros_like(mesh.positions))
    return gradient[:, :3].reshape(-1, model.n_parameters)


def _rigid_motion(model: ErrorModel, null: np.ndarray, tool: np.ndarray) -> np.ndarray | None:
    """M, shape (6, k): rigid motion (t, ω) that each combination that is not determined makes of the field for one tool vector.

    None when some combination changes the field's shape.
    """
    mesh = _mesh(model, tool)
    gradient = _translation_gradient(model, np.zeros(model.n_parameters), mesh)
    change = gradient @ null
    motion = mesh.rigid.inverse @ change
    left = np.abs(mesh.rigid.translations @ motion - change).max()
    possible = np.abs(gradient * parameter_units(model)).max()
    return motion if determined(left, possible) else None


def _moves_along(
    model: ErrorModel,
    null: np.ndarray,
    motion: np.ndarray,
    positions: np.ndarray,
    tool: np.ndarray,
    direction: np.ndarray,
) -> np.ndarray:
    """Components that follow the rigid motions `motion` along every combination that is not determined, bool (m, 6)."""
    gradient = gradient_matrix(model, np.zeros(model.n_parameters), positions, tool, direction)
    left = np.abs(gradient @ null - rigid_motion_rows(model.machine, positions, tool) @ motion).max(axis=2)
    possible = np.abs(gradient * parameter_units(model)).max(axis=(0, 2))
    return determined(left, possible)
