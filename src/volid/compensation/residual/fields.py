"""The deviation field over the working volume, linear in the parameters; its rigid motion, and the numbers that describe it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.backend.rms import rms
from volid.compensation.base import Base, deviation_rows
from volid.compensation.orientation import SPINDLE_AXIS, orientation_between
from volid.exceptions import NotDeterminedError
from volid.fitting.diagnosis.identifiability import parameter_units, undetermined_directions
from volid.fitting.prediction.deviations import determined
from volid.fitting.prediction.working_volume import spread_positions
from volid.fitting.solution import Solution
from volid.model.kinematics import nominal_point, side_rotation
from volid.model.machine import Machine
from volid.model.rigid_fields import WorkpieceMotion

POINTS = 512
LENGTHS = ("largest", "95 %", "RMS", "X", "Y", "Z")
ANGLES = ("A", "B", "C", "tool axis")
QUANTITIES = (*LENGTHS, *ANGLES)


class Places(NamedTuple):
    """Where the deviation in the working volume is evaluated: positions and approach directions, (m, n_axes)."""

    positions: np.ndarray
    directions: np.ndarray


def volume_places(machine: Machine, points: int = POINTS, seed: int = 0) -> Places:
    """Points spread evenly over the travel (Halton), approach directions at random."""
    positions = spread_positions(machine, points, seed)
    return Places(positions, np.random.default_rng(seed).choice([-1.0, 1.0], positions.shape))


class Field:
    """The deviation field for one tool vector, linear in θ, and how to take its rigid motion out."""

    def __init__(self, solution: Solution, places: Places, tool: np.ndarray, base: Base) -> None:
        self.places, self.tool, self.machine = places, np.asarray(tool, dtype=float), solution.machine
        self.gradient = deviation_rows(solution, places.positions, places.directions, self.tool, base.turn)
        self.estimate = self.gradient @ np.asarray(solution.parameters)
        self.scatter = solution.scatter_u()
        self.tool_axis = side_rotation(self.machine, places.positions, False) @ SPINDLE_AXIS
        self.without_rigid_motion = WorkpieceMotion(self.machine, places.positions, self.tool).removed_from
        self.angles_known = self._require_determined(solution)

    def _require_determined(self, solution: Solution) -> bool:
        """Whether the orientation is determined. Raises `NotDeterminedError` when the functional point's deviation is not."""
        if not solution.null_space.shape[1]:
            return True
        units = parameter_units(solution.model)
        null = undetermined_directions(solution.null_space, units)
        moved = self.without_rigid_motion((self.gradient @ (units[:, None] * null)).transpose(2, 0, 1))
        possible = np.abs(self.gradient * units)
        if not determined(np.abs(moved[:, :, :3]).max(), possible[:, :3].max()):
            where = ", ".join(f"{v:g}" for v in self.tool)
            raise NotDeterminedError(
                f"residual: the data do not determine the deviation for tool vector ({where}) mm. {' '.join(solution.statements)}"
            )
        return bool(determined(np.abs(moved[:, :, 3:]).max(), possible[:, 3:].max()))


def moved_by(machine: Machine, commanded: np.ndarray, altered: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """What the altered command does nominally to functional point and orientation, machine frame, (m, 6) [mm, rad]."""
    change = nominal_point(machine, altered, tool) - nominal_point(machine, commanded, tool)
    point = np.einsum("mji,mj->mi", side_rotation(machine, commanded, True), change)
    return np.concatenate([point, orientation_between(machine, commanded, altered)], axis=1)


def quantities(fields: np.ndarray, tool_axis: np.ndarray) -> np.ndarray:
    """The numbers of `QUANTITIES` of fields (s, m, 6), (s, 10); `tool_axis`: unit vectors (m, 3), machine frame."""
    size = np.linalg.norm(fields[:, :, :3], axis=2)
    overall = [size.max(axis=1), np.quantile(size, 0.95, axis=1), rms(size, axis=1)]
    tilt = np.linalg.norm(np.cross(tool_axis, fields[:, :, 3:]), axis=2)
    return np.column_stack([*overall, np.abs(fields).max(axis=1), tilt.max(axis=1)])
