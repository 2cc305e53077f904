"""The deviation field over the working volume, linear in the parameters; its rigid motion, and the numbers that describe it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from volid.backend.rms import rms
from volid.compensation.base import deviation_rows
from volid.compensation.orientation import SPINDLE_AXIS, orientation_between
from volid.exceptions import NotDeterminedError
from volid.fitting.diagnosis.identifiability import parameter_units, undetermined_directions
from volid.fitting.prediction.deviations import determined
from volid.fitting.prediction.largest import Places
from volid.fitting.prediction.working_volume import POINTS, spread_positions
from volid.fitting.solution import Solution
from volid.model.kinematics import nominal_point, side_rotation
from volid.model.machine import Machine
from volid.model.rigid_fields import EVERY, WorkpieceMotion

LENGTHS = ("largest", "95 %", "RMS", "X", "Y", "Z")
ANGLES = ("A", "B", "C", "tool axis")
QUANTITIES = (*LENGTHS, *ANGLES)


def volume_places(machine: Machine, points: int = POINTS, seed: int = 0) -> Places:
    """Points spread evenly over the travel (Halton), approach directions at random."""
    positions = spread_positions(machine, points, seed)
    return Places(positions, np.random.default_rng(seed).choice([-1.0, 1.0], positions.shape))


@dataclass(frozen=True, eq=False)
class Field:
    """The deviation field of a solution for one tool vector (3,) [mm], linear in θ, over m places.

    `own`: gradient (k, 6, n) at the last k places; the others are those of `head`, a field that several ones continue.

    It is in the stated datum. A frame aligned otherwise, as a compensation may have it, moves the workpiece alone, and the rigid
    motion of the workpiece is taken out of what remains.
    """

    solution: Solution
    tool: np.ndarray
    places: Places
    own: np.ndarray
    head: Field | None = None

    @property
    def machine(self) -> Machine:
        """The machine, every travel cut to the measured range."""
        return self.solution.machine

    @property
    def gradient(self) -> np.ndarray:
        """What the parameters do at all places, (m, 6, n)."""
        return self.own if self.head is None else np.concatenate([self.head.gradient, self.own])

    @cached_property
    def estimate(self) -> np.ndarray:
        """The deviation that the solution itself has, (m, 6) [mm, rad]."""
        found = np.asarray(self.own @ np.asarray(self.solution.parameters))
        return found if self.head is None else np.concatenate([self.head.estimate, found])

    def motion(self) -> WorkpieceMotion:
        """The rigid motion of the workpiece frame, fitted to the places that are spread evenly."""
        return WorkpieceMotion(self.machine, self.places.positions, self.tool, self.places.even)

    def and_also(self, more: Places) -> Field:
        """The field over more places too, which the rigid motion, means and quantiles do not refer to."""
        if not len(more.positions):
            return self
        added = deviation_rows(self.solution, more.positions, more.directions, self.tool)
        return Field(self.solution, self.tool, self.places.and_also(more), added, self)


def field_over(solution: Solution, places: Places, tool: np.ndarray) -> Field:
    """The deviation field over some places. Raises `NotDeterminedError`: the functional point's deviation is not determined."""
    tool = np.asarray(tool, dtype=float)
    found = Field(solution, tool, places, deviation_rows(solution, places.positions, places.directions, tool))
    if not _known(found, slice(0, 3)):
        where = ", ".join(f"{v:g}" for v in tool)
        raise NotDeterminedError(
            f"residual: the data do not determine the deviation for tool vector ({where}) mm. {' '.join(solution.statements)}"
        )
    return found


def angles_known(field: Field) -> bool:
    """Whether the data determine the orientation too."""
    return _known(field, slice(3, 6))


def _known(field: Field, rows: slice) -> bool:
    """Whether the data determine some components of the field, its rigid motion taken out."""
    null_space = field.solution.null_space
    if not null_space.shape[1]:
        return True
    units = parameter_units(field.solution.model)
    null = undetermined_directions(null_space, units)
    moved = field.motion().removed_from((field.gradient @ (units[:, None] * null)).transpose(2, 0, 1))
    possible = np.abs(field.gradient[:, rows] * units).max()
    return bool(determined(np.abs(moved[:, :, rows]).max(), possible))


def tool_axes(machine: Machine, positions: np.ndarray) -> np.ndarray:
    """Nominal directions of the tool's axis, machine frame, unit vectors (m, 3)."""
    return np.asarray(side_rotation(machine, positions, False) @ SPINDLE_AXIS)


def moved_by(machine: Machine, commanded: np.ndarray, altered: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """What the altered command does nominally to functional point and orientation, machine frame, (m, 6) [mm, rad]."""
    change = nominal_point(machine, altered, tool) - nominal_point(machine, commanded, tool)
    point = np.einsum("mji,mj->mi", side_rotation(machine, commanded, True), change)
    return np.concatenate([point, orientation_between(machine, commanded, altered)], axis=1)


def sizes(fields: np.ndarray, tool_axis: np.ndarray) -> np.ndarray:
    """Place by place of fields (s, m, 6): length, |X|, |Y|, |Z| [mm], |A|, |B|, |C|, tilt of the tool's axis [rad]; (s, m, 8)."""
    x, y, z, a, b, c = np.moveaxis(fields, 2, 0)
    i, j, k = tool_axis.T
    found = np.empty((*fields.shape[:2], 8))
    found[:, :, 0] = np.sqrt(x * x + y * y + z * z)
    np.abs(fields, out=found[:, :, 1:7])
    found[:, :, 7] = np.sqrt((j * c - k * b) ** 2 + (k * a - i * c) ** 2 + (i * b - j * a) ** 2)
    return found


def quantities(fields: np.ndarray, tool_axis: np.ndarray, even: slice = EVERY) -> np.ndarray:
    """The numbers of `QUANTITIES` of fields (s, m, 6), (s, 10); `tool_axis`: unit vectors (m, 3), machine frame.

    The largest of all places, RMS and 95 % of the `even` ones.
    """
    found = sizes(fields, tool_axis)
    largest, spread = found.max(axis=1), found[:, even, 0]
    return np.column_stack([largest[:, 0], np.quantile(spread, 0.95, axis=1), rms(spread, axis=1), largest[:, 1:]])
