"""A simulated control: it reads tables, grids and tool data, and alters the commanded position as a real control does.

It interpolates tables and grids linearly, or smooths them over a length, keeps their end values outside them, and takes the
reversal of the approach direction that is programmed. Lever arms are those of the tool vector that the control *uses*, which may
be wrong. Rotary axes are turned against the orientation error, with a rule for poles. Corrections are rounded to the least
increment, and clamped axes do not move. Not modelled: dynamics, filters in time, the ramp at reversal, the order of cycles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from volid.compensation.active import (
    axis_table_words,
    corrected_twice,
    grid_words,
    option_words,
    table_words,
    vector_words,
)
from volid.compensation.grids.grid import AnyGrid
from volid.compensation.orientation import PoleRule, rotary_turns
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.by_axis import turned_by
from volid.compensation.tables.error_table import ITSELF, MODEL, ErrorTable
from volid.exceptions import InputError
from volid.model.iso230 import SPINDLE, parse
from volid.model.jacobian import axis_directions, influence
from volid.model.kinematics import ROWS, nominal_point, side_rotation
from volid.model.machine import Machine
from volid.model.requests import ask_increments, checked_number

if TYPE_CHECKING:
    from jaxtyping import Float

FOR = "FOR"
TURNING = (FOR, "L-VOL+", "R-VOL+")


class Expected(NamedTuple):
    """The deviations that the control expects. `point`: of the functional point (m, 3) [mm]. `orientation`: to be corrected by
    the rotary axes (m, 3) [rad]. `turn`: of the rotary axes themselves, from their own tables, (m, n_axes) [°]."""

    point: np.ndarray
    orientation: np.ndarray
    turn: np.ndarray


@dataclass(frozen=True, eq=False)
class Control:
    """A control of `machine` (nominal kinematics) with its compensation data; immutable.

    Args:
        machine: The machine whose axes it moves.
        tables: Tables of single error functions.
        grids: Spatial grids.
        tool: The tool vector that it uses, (3,) [mm]; None when it knows the true one.
        increment: Least increment by axis letter [mm or °].
        clamped: Letters of axes that do not move for a compensation.
        poles: What it does near kinematic poles, see `PoleRule`.
        smoothing: Length by axis letter over which it averages tables and grids, see `volid.compensation.smoothing` [mm or °].
        axis_tables: What single axes are moved by, as controls without a kinematic model hold it.
        correct_motion: Whether X, Y, Z compensate the motion of the functional point that turned rotary axes cause; None: yes,
            unless only the orientation is corrected (FOR alone).

    Raises:
        InputError: the machine does not have an axis, or an increment is not positive.

    >>> import numpy as np
    >>> import volid
    >>> machine = volid.load_machine("models/wYXbZt_vertical.toml")
    >>> x, values = np.array([0.0, 1000.0]), np.array([[0.0] * 6, [0.010] + [0.0] * 5])
    >>> grid = volid.Grid("L-POS", ("X",), (x,), x[:, None], values, values, x > 1e4, (0.0, 0.0, 0.0), "machine", "")
    >>> control = volid.Control(machine, grids=(grid,), increment={"X": 0.001})
    >>> control.command(np.array([[0.0, 520.0, 0.0]]), np.zeros(3)).round(6).tolist()  # Y, X, Z: 5.2 µm are taken off X
    [[0.0, 519.995, 0.0]]
    """

    machine: Machine
    tables: tuple[ErrorTable, ...] = ()
    grids: tuple[AnyGrid, ...] = ()
    tool: tuple[float, float, float] | None = None
    increment: Mapping[str, float] = field(default_factory=dict)
    clamped: Sequence[str] = ()
    poles: PoleRule = field(default_factory=PoleRule)
    correct_motion: bool | None = None
    smoothing: Mapping[str, float] = field(default_factory=dict)
    axis_tables: tuple[AxisTable, ...] = ()

    def __post_init__(self) -> None:
        for letter in (*self.increment, *self.clamped, *self.smoothing):
            self.machine.index(letter)
        ask_increments((f"increment={a}", self.machine.axis(a).is_linear, v) for a, v in self.increment.items())
        for letter, length in self.smoothing.items():
            checked_number(f"smoothing={letter}", length, above=0.0)
        for table in self.tables:
            if table.axis != SPINDLE:
                self.machine.index(table.axis)
        for grid in self.grids:
            for letter in grid.axes:
                self.machine.index(letter)
        for moved in self.axis_tables:
            for letter in (moved.output, moved.argument, *((moved.factor.axis,) if moved.factor else ())):
                self.machine.index(letter)

    @property
    def active(self) -> tuple[str, ...]:
        """Its compensations and what limits them, in words, one text each."""
        by_axis = {"least increment": self.increment, "smoothing over": self.smoothing}
        limits = option_words(self.machine, self.tool, by_axis, self.clamped)
        found = (*table_words(self.tables), *map(grid_words, self.grids), *map(axis_table_words, self.axis_tables))
        return (*found, *limits)

    @property
    def corrected_twice(self) -> list[str]:
        """What its tables and grids together correct more than once, in words."""
        return corrected_twice(self.machine, self.tables, self.grids)

    def expected(
        self,
        positions: Float[np.ndarray, "m axes"],
        tool: Float[np.ndarray, "*m 3"] | None,
        directions: Float[np.ndarray, "m axes"] | None = None,
    ) -> Expected:
        """Deviations that tables and grids give at commanded positions.

        Args:
            positions: Commanded positions, machine axis order, shape (m, n_axes) [mm or °].
            tool: tool vectors of the machine, shape (m, 3) or (3,) [mm]; None when unknown.
            directions: Directions of approach, shape (m, n_axes): +1, -1 or 0; None: the mean of both.

        Raises:
            InputError: a compensation needs a tool vector, and none is known.
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
        self,
        positions: Float[np.ndarray, "m axes"],
        tool: Float[np.ndarray, "*m 3"] | None,
        directions: Float[np.ndarray, "m axes"] | None = None,
    ) -> Float[np.ndarray, "m axes"]:
        """Positions to which the axes move instead of the commanded ones, shape (m, n_axes) [mm or °].

        Args:
            positions: Commanded positions, machine axis order, shape (m, n_axes) [mm or °].
            tool: tool vectors of the machine, shape (m, 3) or (3,) [mm]; None when unknown.
            directions: Directions of approach, shape (m, n_axes): +1, -1 or 0; None: the mean of both.

        Raises:
            InputError: a compensation needs a tool vector, and none is known.
        """
        q = np.atleast_2d(np.asarray(positions, dtype=float))
        found = self.expected(q, tool, directions)
        turns = np.zeros_like(q)
        if self._turns:
            turns = rotary_turns(self.machine, q, found.orientation, self.poles, self.clamped)
        step = self._linear_motion(q, turns, found.point, self._believed(tool, len(q)))
        step += turns + found.turn + self._by_axis(q, directions)
        step[:, [self.machine.index(a) for a in self.clamped]] = 0.0
        for letter, least in self.increment.items():
            i = self.machine.index(letter)
            step[:, i] = np.round(step[:, i] / least) * least
        return np.asarray(q + step)

    def unintended_motion(
        self, positions: Float[np.ndarray, "m axes"], tool: Float[np.ndarray, "*m 3"]
    ) -> Float[np.ndarray, "m 3"]:
        """Motion of the functional point that the turns of the rotary axes alone cause, machine frame, shape (m, 3) [mm].

        Args:
            positions: Commanded positions, machine axis order, shape (m, n_axes) [mm or °].
            tool: tool vectors of the machine, shape (m, 3) or (3,) [mm].
        """
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
                of_axis = i < len(self.machine.axes)
                x, d = (q[:, i], way[:, i]) if of_axis else (np.zeros(len(q)), np.zeros(len(q)))
                errors[:, ROWS * i + component] += table.at(x, d, self.smoothing.get(table.axis, 0.0))
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
                value = table.at(q[:, i], way[:, i], self.smoothing.get(table.axis, 0.0))
                turns[:, i] -= np.rad2deg(value) * turned_by(axis, table.function)
        return turns

    def _by_axis(self, q: np.ndarray, directions: np.ndarray | None) -> np.ndarray:
        """What tables of axes move each axis by, minus the deviation they expect, (m, n_axes) [mm or °]."""
        way = np.zeros_like(q) if directions is None else np.broadcast_to(np.asarray(directions, dtype=float), q.shape)
        at, ways = ({a: v[:, i] for i, a in enumerate(self.machine.letters)} for v in (q, way))
        step = np.zeros_like(q)
        for table in self.axis_tables:
            i = self.machine.index(table.output)
            value = table.at(at, ways)
            step[:, i] -= value if self.machine.axes[i].is_linear else np.rad2deg(value)
        return step

    def _from_grid(self, grid: AnyGrid, q: np.ndarray, tool: np.ndarray) -> np.ndarray:
        """Six components of the deviation (m, 6), with the grid's end values outside its nodes."""
        own, lever = grid.own_positions(self.machine, q), grid.lever_arms(self.machine, q, tool)
        values = grid.clamped(own, tuple(self.smoothing.get(letter, 0.0) for letter in grid.axes))
        _ask_known(grid, own, values)
        blank = np.isnan(values[:, 3:]).any(axis=1)
        if np.any(blank & (np.abs(lever).max(axis=1) > 1e-9)):
            raise InputError(
                f"control: rotations of the {grid.type} grid are blank, not determined by the data; it holds for its own tool "
                f"vector or reference point only, {vector_words(grid.reference)}"
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
            if (directions == directions[:1]).all():  # no rotary axis lies between workpiece and linear axes
                directions = directions[:1]
            step[:, linear] = np.einsum("mij,mj->mi", np.linalg.pinv(directions), wanted)
        return step

    @property
    def _corrects_motion(self) -> bool:
        if self.correct_motion is None:
            return any(grid.type != FOR for grid in self.grids) or bool(self.tables)
        return self.correct_motion


def _ask_known(grid: AnyGrid, own: np.ndarray, values: np.ndarray) -> None:
    """Raises `InputError` where the translations of a grid, (m, 6), are blank at the positions of its axes, (m, k)."""
    blank = np.isnan(values[:, :3]).any(axis=1)
    if blank.any():
        at = own[int(np.argmax(blank))]
        place = ", ".join(f"{a} = {v:g}" for a, v in zip(grid.axes, at, strict=True))
        raise InputError(
            f"control: the {grid.type} grid is blank at {place}, so that it does not say where to go; stay within the part that "
            "it holds, or make one without gaps"
        )
