"""The deviation field over the working volume, linear in the parameters, what of it is a rigid motion, and its numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.backend.even_points import even_points
from volid.compensation.base import Base, model_errors
from volid.compensation.orientation import SPINDLE_AXIS, orientation_between
from volid.exceptions import NotDeterminedError
from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.prediction.deviations import ESTIMABLE
from volid.fitting.solution import Solution
from volid.model.jacobian import influence, rigid_motion_rows
from volid.model.kinematics import nominal_point, side_rotation
from volid.model.machine import Machine

POINTS = 512
LENGTHS = ("largest", "95 %", "RMS", "X", "Y", "Z")
ANGLES = ("A", "B", "C", "tool axis")
QUANTITIES = (*LENGTHS, *ANGLES)


class Places(NamedTuple):
    """Where the working volume is looked at: positions and approach directions, (m, n_axes)."""

    positions: np.ndarray
    directions: np.ndarray


def volume_places(machine: Machine, points: int = POINTS, seed: int = 0) -> Places:
    """Points spread evenly over the travel (Halton), approach directions at random."""
    low = np.array([a.travel[0] for a in machine.axes])
    length = np.array([a.length for a in machine.axes])
    positions = low + even_points(points, len(low), seed) * length
    return Places(positions, np.random.default_rng(seed).choice([-1.0, 1.0], positions.shape))


class Field:
    """The deviation field for one tool vector, linear in θ, and how to take its rigid motion out."""

    def __init__(self, solution: Solution, places: Places, tool: np.ndarray, base: Base) -> None:
        self.places, self.tool, self.machine = places, np.asarray(tool, dtype=float), solution.machine
        self.gradient = _gradient(solution, places, self.tool, base)
        self.estimate = self.gradient @ np.asarray(solution.parameters)
        self.tool_axis = side_rotation(self.machine, places.positions, False) @ SPINDLE_AXIS
        self.rigid = rigid_motion_rows(solution.machine, places.positions, self.tool)
        scale = np.linalg.norm(self.rigid[:, :3].reshape(-1, 6), axis=0)
        self.inverse = np.linalg.pinv(self.rigid[:, :3].reshape(-1, 6) / scale) / scale[:, None]
        self.angles_known = self._require_determined(solution)

    def without_rigid_motion(self, fields: np.ndarray) -> np.ndarray:
        """Fields (s, m, 6) less the rigid motion that fits their translations best."""
        motion = fields[:, :, :3].reshape(len(fields), -1) @ self.inverse.T
        return np.asarray(fields - np.einsum("mij,sj->smi", self.rigid, motion))

    def _require_determined(self, solution: Solution) -> bool:
        """Whether the orientation is determined. Raises `NotDeterminedError` when the functional point's deviation is not."""
        if not solution.null_space.shape[1]:
            return True
        units = parameter_units(solution.model)
        null, _ = np.linalg.qr(np.asarray(solution.null_space) / units[:, None])
        moved = self.without_rigid_motion((self.gradient @ (units[:, None] * null)).transpose(2, 0, 1))
        whole = np.abs(self.gradient * units)
        if np.abs(moved[:, :, :3]).max() > ESTIMABLE * whole[:, :3].max():
            where = ", ".join(f"{v:g}" for v in self.tool)
            raise NotDeterminedError(
                f"residual: the data do not determine the deviation for tool vector ({where}) mm. {' '.join(solution.statements)}"
            )
        return bool(np.abs(moved[:, :, 3:]).max() <= ESTIMABLE * whole[:, 3:].max())


def _gradient(solution: Solution, places: Places, tool: np.ndarray, base: Base) -> np.ndarray:
    parts = []
    for start in range(0, len(places.positions), 256):
        rows = slice(start, start + 256)
        errors = model_errors(solution, places.positions[rows], places.directions[rows], lambda _: True, base.turn)
        parts.append(influence(solution.machine, places.positions[rows], tool) @ errors)
    return np.concatenate(parts)


def moved_by(machine: Machine, commanded: np.ndarray, altered: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """What the altered command does nominally to functional point and orientation, machine frame, (m, 6) [mm, rad]."""
    change = nominal_point(machine, altered, tool) - nominal_point(machine, commanded, tool)
    point = np.einsum("mji,mj->mi", side_rotation(machine, commanded, True), change)
    return np.concatenate([point, orientation_between(machine, commanded, altered)], axis=1)


def quantities(fields: np.ndarray, tool_axis: np.ndarray) -> np.ndarray:
    """The numbers of `QUANTITIES` of fields (s, m, 6), (s, 10); `tool_axis`: unit vectors (m, 3), machine frame."""
    size = np.linalg.norm(fields[:, :, :3], axis=2)
    overall = [size.max(axis=1), np.quantile(size, 0.95, axis=1), np.sqrt(np.mean(size**2, axis=1))]
    tilt = np.linalg.norm(np.cross(tool_axis, fields[:, :, 3:]), axis=2)
    return np.column_stack([*overall, np.abs(fields).max(axis=1), tilt.max(axis=1)])
