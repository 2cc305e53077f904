"""A simulated control: it reads tables, grids and tool data, and alters the commanded position as a real control does.

Tables and grids by linear interpolation, end values held outside them, reversal by approach direction; lever arms with the
tool vector that the control *believes* in; rotary axes turned against the orientation error, with a rule for poles;
corrections rounded to the least increment; clamped axes stay. Not modelled: dynamics, the ramp at reversal, the order of cycles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from volid.compensation.grids.grid import AnyGrid
from volid.compensation.orientation import PoleRule, rotary_turns
from volid.compensation.tables.error_table import ITSELF, MODEL, ErrorTable
from volid.exceptions import InputError
from volid.model.iso230 import SPINDLE, parse
from volid.model.jacobian import axis_directions, influence
from volid.model.kinematics import ROWS, nominal_point, side_rotation
from volid.model.machine import Machine

FOR = "FOR"
TURNING = (FOR, "L-VOL+", "R-VOL+")


class Expected(NamedTuple):
    """What the control expects of its machine: `point`: deviation of the functional point (m, 3) [mm]; `orientation`: what it
    hands to the rotary axes (m, 3) [rad]; `turn`: what the tables of the rotary axes themselves say, (m, n_axes) [°]."""

    point: np.ndarray
    orientation: np.ndarray
    turn: np.ndarray


@dataclass(frozen=True, eq=False)
class Control:
    """A control of `machine` (nominal kinematics) with its compensation data; immutable.

    `tool`: the tool vector it believes in (3,) [mm]; None: it knows the true one. `increment`: least increment by axis
    letter [mm or °]. `clamped`: letters that do not move for a compensation. `poles`: see `PoleRule`. `correct_motion`:
    whether X, Y, Z make up for what turned rotary axes do to the functional point; None: yes, unless orientation is all that
    is corrected (FOR alone).
    """

    machine: Machine
    tables: tuple[ErrorTable, ...] = ()
    grids: tuple[AnyGrid, ...] = ()
    tool: tuple[float, float, float] | None = None
    increment: Mapping[str, float] = field(default_factory=dict)
    clamped: Sequence[str] = ()
    poles: PoleRule = field(default_factory=PoleRule)
    correct_motion: bool | None = None

    def __post_init__(self) -> None:
        for letter in (*self.increment, *self.clamped):
            self.machine.index(letter)
        for letter, value in self.increment.items():
            if not value > 0:
                raise InputError(f"`increment={letter}={value:g}`; expected a number > 0")
        for table in self.tables:
            if table.axis != SPINDLE:
                self.machine.index(table.axis)
        for grid in self.grids:
            for letter in grid.axes:
                self.machine.index(letter)

    def expected(
        self, positions: np.ndarray, tool: np.ndarray | None, directions: np.ndarray | None = None
    ) -> Expected:
        """Deviations that tables and grids say, at commanded positions (m, n_axes) for the machine's tool vector.

        Raises `InputError` when a compensation needs a tool vector and none is known.
        """
        q = np.atleast_2d(np.asarray(positions, dtype=float))
        way = np.zeros_like(q) if directions is None else np.broadcast_to(np.asarray(directions, dtype=float), q.shape)
        believed = self._believed(tool, len(q))
        point = self._from_tables(q, believed, way)
        orientation = np.zeros((len(q), 3))
        for grid in self.grids:
            values = self._from_grid(grid, q, believed)
            if grid.type in TURNING:
                orientation += values[:, 3:]
            if grid.type != FOR:
                point += values[:, :3]
        return Expected(point, orientation, self._own_turns(q, way))

    def command(
        self, positions: np.ndarray, tool: np.ndarray | None, directions: np.ndarray | None = None
    ) -> np.ndarray:
        """Positions that the axes really get, (m, n_axes) [mm, °], for commanded ones and the machine's tool vector (3,) or
        (m, 3)."""
        q = np.atleast_2d(np.asarray(positions, dtype=float))
        found = self.expected(q, tool, directions)
        turns = np.zeros_like(q)
        if self._turns:
            turns = rotary_turns(self.machine, q, found.orientation, self.poles, self.clamped)
        step = self._linear_motion(q, turns, found.point, self._believed(tool, len(q)))
        step += turns + found.turn
        step[:, [self.machine.index(a) for a in self.clamped]] = 0.0
        for letter, least in self.increment.items():
            i = self.machine.index(letter)
            step[:, i] = np.round(step[:, i] / least) * least
        return np.asarray(q + step)

    def unintended_motion(self, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
        """What the turns of the rotary axes alone do to the functional point, machine frame (m, 3) [mm]."""
        q = np.atleast_2d(np.asarray(positions, dtype=float))
        if not self._turns:
            return np.zeros((len(q), 3))
        turns = rotary_turns(self.machine, q, self.expected(q, tool).orientation, self.poles, self.clamped)
        tools = np.broadcast_to(np.asarray(tool, dtype=float), (len(q), 3))
        moved = nominal_point(self.machine, q + turns, tools) - nominal_point(self.machine, q, tools)
        return np.asarray(np.einsum("mji,mj->mi", side_rotation(self.machine, q, True), moved))

    @property
    def _turns(self) -> bool:
        return any(grid.type in TURNING for grid in self.grids)

    def _believed(self, tool: np.ndarray | None, m: int) -> np.ndarray:
        vector = self.tool if self.tool is not None else tool
        if vector is None:
            needing = [t.function for t in self.tables if t.applied == MODEL and parse(t.function).is_rotation]
            needing += [g.type for g in self.grids if g.type != FOR]
            if needing:
                raise InputError(
                    f"control: {', '.join(dict.fromkeys(needing))} needs the tool vector, because rotations act through it; "
                    "give the control its tool data, such as (0, 0, -150) mm"
                )
            vector = np.zeros(3)
        return np.broadcast_to(np.asarray(vector, dtype=float), (m, 3))

    def _from_tables(self, q: np.ndarray, tool: np.ndarray, way: np.ndarray) -> np.ndarray:
        errors = np.zeros((len(q), ROWS * (len(self.machine.axes) + 1)))
        for table in self.tables:
            if table.applied == MODEL:
                i, component = self._place(table), parse(table.function).component
                own = i < len(self.machine.axes)
                x, d = (q[:, i], way[:, i]) if own else (np.zeros(len(q)), np.zeros(len(q)))
                errors[:, ROWS * i + component] += table.at(x, d)
        if not errors.any():
            return np.zeros((len(q), 3))
        return np.asarray(np.einsum("mij,mj->mi", influence(self.machine, q, tool)[:, :3], errors))

    def _place(self, table: ErrorTable) -> int:
        return len(self.machine.axes) if table.axis == SPINDLE else self.machine.index(table.axis)

    def _own_turns(self, q: np.ndarray, way: np.ndarray) -> np.ndarray:
        """R-POS: minus the angular positioning error, counted along the axis's own line."""
        turns = np.zeros_like(q)
        for table in self.tables:
            if table.applied == ITSELF:
                i = self._place(table)
                axis = self.machine.axes[i]
                along = axis.frame.T @ np.asarray(axis.unit_vector)
                value = table.at(q[:, i], way[:, i])
                turns[:, i] -= np.rad2deg(value) * along[parse(table.function).component - 3]
        return turns

    def _from_grid(self, grid: AnyGrid, q: np.ndarray, tool: np.ndarray) -> np.ndarray:
        """Six components of the deviation (m, 6); end values held outside the grid."""
        values, lever = grid.held(grid.own_positions(self.machine, q)), grid.lever_arms(self.machine, q, tool)
        blank = np.isnan(values[:, 3:]).any(axis=1)
        if np.any(blank & (np.abs(lever).max(axis=1) > 1e-9)):
            raise InputError(
                f"control: rotations of the {grid.type} grid are blank, not determined by the data; it holds for its own tool "
                "vector or reference point only"
            )
        values[:, 3:] = np.nan_to_num(values[:, 3:])
        values[:, :3] += np.cross(values[:, 3:], lever)
        return values

    def _linear_motion(self, q: np.ndarray, turns: np.ndarray, point: np.ndarray, tool: np.ndarray) -> np.ndarray:
        """Moves of the linear axes (m, n_axes): minus the deviation, and what the turns ask for, through the axes' directions."""
        linear = [i for i, a in enumerate(self.machine.axes) if a.is_linear]
        step = np.zeros_like(q)
        wanted = -point
        after = q
        if self._corrects_motion and turns.any():
            after = q + turns
            moved = nominal_point(self.machine, after, tool) - nominal_point(self.machine, q, tool)
            wanted = wanted - np.einsum("mji,mj->mi", side_rotation(self.machine, q, True), moved)
            # the axes move the point in the frame of the turned table
            before, now = (side_rotation(self.machine, x, True) for x in (q, after))
            wanted = np.einsum("mji,mjk,mk->mi", now, before, wanted)
        if linear:
            directions = axis_directions(self.machine, after)[:, :, linear]
            step[:, linear] = np.einsum("mij,mj->mi", np.linalg.pinv(directions), wanted)
        return step

    @property
    def _corrects_motion(self) -> bool:
        if self.correct_motion is None:
            return any(grid.type != FOR for grid in self.grids) or bool(self.tables)
        return self.correct_motion


class Motion(NamedTuple):
    """What a compensation asks of the axes: `largest` |correction| per axis (n_axes,) [mm, °]; `slope`: largest change of a
    correction per unit of another axis's motion (n_axes, n_axes): row the corrected axis, column the moving one."""

    largest: np.ndarray
    slope: np.ndarray


def asked_motion(control: Control, positions: np.ndarray, tool: np.ndarray, fraction: float = 1e-3) -> Motion:
    """Largest corrections at positions (m, n_axes), and how fast they change, by steps of `fraction` of each travel."""
    machine = control.machine
    start = control.command(positions, tool) - positions
    slope = np.zeros((len(machine.axes), len(machine.axes)))
    for j, axis in enumerate(machine.axes):
        moved = positions.copy()
        inwards = np.where(positions[:, j] + fraction * axis.length > axis.travel[1], -1.0, 1.0)
        moved[:, j] += inwards * fraction * axis.length
        change = control.command(moved, tool) - moved - start
        slope[:, j] = np.abs(change).max(axis=0) / (fraction * axis.length)
    return Motion(np.abs(start).max(axis=0), slope)


def asked_speed(motion: Motion, feeds: np.ndarray) -> np.ndarray:
    """Largest speed of the corrections, (n_axes,), when axis j moves with feeds[j] [mm/min or °/min], one axis at a time."""
    return np.asarray((motion.slope * feeds).max(axis=1))


def check_motion(
    machine: Machine, motion: Motion, speed: np.ndarray, motions: Mapping[str, float], speeds: Mapping[str, float]
) -> None:
    """Raises `InputError` when an axis is asked for more than `motions` [mm, °] or `speeds` [mm/min, °/min] allow."""
    for name, found, limits, unit in (("moves", motion.largest, motions, ""), ("speed", speed, speeds, "/min")):
        for letter, limit in limits.items():
            i = machine.index(letter)
            if found[i] > limit:
                raise InputError(
                    f"the compensation asks axis {letter} for {name} of {found[i]:.4g} {machine.axes[i].unit}{unit}, "
                    f"more than the limit "
                    f"of {limit:g}; keep out of poles (`poles`), or allow more"
                )
