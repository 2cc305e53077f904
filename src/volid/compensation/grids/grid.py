"""Spatial grids as objects: error values at the nodes of a regular grid over the axes of one side (ISO/TR 16907 7.5).

A `Grid` is over the linear axes (Table 2), a `RotaryGrid` over the rotary axes of one side (Table 3). A control interpolates
linearly between the nodes, keeps the end values outside them, and transfers the rotations to its tool by a lever arm,

    e(q, tool) = d(q) + ω(q) × (lever point - reference),

where the lever point is the rotated tool vector (linear axes, head) or the nominal functional point (table), see `lever_points`.
What this neglects is of second order: about |ω|·|e| plus |ω|²·lever arm. CONVENTIONS 5.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from volid.backend.even_points import round_position
from volid.compensation.grids.interpolation import interpolate, into_period
from volid.compensation.grids.sides import HEAD, LINEAR, TABLE, lever_points
from volid.compensation.smoothing import smoothed
from volid.model.iso230 import DIRECTIONS
from volid.model.machine import Machine

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

IN_DEGREES = np.array(
    [1.0] * 3 + [180.0 / np.pi] * 3
)  # six components as people and controls read them: mm and degrees
_LEVER = {
    TABLE: "lever arm = nominal functional point of the linear axes (their positions + rotated tool vector) - reference point",
    HEAD: "lever arm = tool vector turned by the rotary axes of the head - reference point",
}


@dataclass(frozen=True, eq=False)
class SpatialGrid(ABC):
    """What grids of linear and of rotary axes have in common; see `Grid` and `RotaryGrid`.

    Args:
        type: compensation type of ISO/TR 16907 whose effects the values hold, such as "L-VOL".
        axes: letters, in the order X, Y, Z or A, B, C.
        nodes: positions per axis, each rising [mm or °].
        positions: Positions of all n nodes, the first axis varying fastest, shape (n, k) [mm or °].
        values: ERROR values, actual - nominal, machine frame: translations [mm] at the reference, rotations [rad]; shape (n, 6).
            NaN where the data do not determine a component.
        u: Standard uncertainties of the values, shape (n, 6); NaN where not asked for.
        outside: True where a node lies outside what was measured, shape (n,).
    """

    type: str
    axes: tuple[str, ...]
    nodes: tuple[Float[np.ndarray, " nodes"], ...]
    positions: Float[np.ndarray, "n k"]
    values: Float[np.ndarray, "n 6"]
    u: Float[np.ndarray, "n 6"]
    outside: Bool[np.ndarray, " n"]

    if (
        TYPE_CHECKING
    ):  # a property of Grid, but a field of RotaryGrid, for which a property here would be a default value

        @property
        def side(self) -> str:
            """Whose axes' errors the grid holds: "linear", "table" or "head"."""

    @property
    @abstractmethod
    def reference(self) -> Float[np.ndarray, " 3"]:
        """Where the translations hold as they stand [mm]: tool vector of a linear grid, reference point of a rotary one."""

    @property
    def periods(self) -> tuple[float, ...]:
        """Per axis 360 [°] where the nodes close a full turn, else 0."""
        return (0.0,) * len(self.axes)

    @property
    def compensation(self) -> Float[np.ndarray, "n 6"]:
        """Compensation values, minus the error values [mm, rad] (CONVENTIONS 5)."""
        return -self.values

    def interpolate(self, positions: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m 6"]:
        """Error values by linear interpolation between the nodes, as a control does it.

        Args:
            positions: Positions of the grid's axes, in the order of `axes`, shape (m, k) [mm or °]; a position beyond a full turn
                is moved back into the nodes.

        Returns:
            Error values, shape (m, 6) [mm, rad].

        Raises:
            ValueError: a position lies outside the nodes.
        """
        x = np.array(positions, dtype=float).reshape(-1, len(self.axes))
        for k, (nodes, period) in enumerate(zip(self.nodes, self.periods, strict=True)):
            x[:, k] = into_period(x[:, k], nodes[0], nodes[-1], period)
        table = self.values.reshape(*(len(n) for n in reversed(self.nodes)), 6)
        return interpolate(tuple(reversed(self.nodes)), table, x[:, ::-1])

    def clamped(
        self, positions: Float[np.ndarray, "m k"], smoothing: tuple[float, ...] = ()
    ) -> Float[np.ndarray, "m 6"]:
        """As `interpolate`, but with the end values of the grid outside its nodes.

        Args:
            positions: Positions of the grid's axes, in the order of `axes`, shape (m, k) [mm or °].
            smoothing: Lengths over which the control averages, one per axis, see `volid.compensation.smoothing` [mm or °].
        """
        if any(smoothing):
            table = np.moveaxis(self.values.reshape(*(len(n) for n in reversed(self.nodes)), 6).T, 0, -1)
            return smoothed(self.nodes, table, np.asarray(positions, dtype=float), smoothing, self.periods)
        x = np.array(positions, dtype=float).reshape(-1, len(self.axes))
        for k, (nodes, period) in enumerate(zip(self.nodes, self.periods, strict=True)):
            if not period:
                x[:, k] = np.clip(x[:, k], nodes[0], nodes[-1])
        return self.interpolate(x)

    def own_positions(self, machine: Machine, positions: Float[np.ndarray, "m axes"]) -> Float[np.ndarray, "m k"]:
        """The columns of the grid's axes, shape (m, k), of `positions` in machine axis order, shape (m, n_axes) [mm or °]."""
        return positions[:, [machine.index(a) for a in self.axes]]

    def lever_arms(
        self, machine: Machine, positions: Float[np.ndarray, "m axes"], tool: Float[np.ndarray, "*m 3"]
    ) -> Float[np.ndarray, "m 3"]:
        """Lever arms that a control uses, shape (m, 3) [mm].

        Args:
            machine: The machine whose axes move.
            positions: Positions of all axes, machine axis order, shape (m, n_axes) [mm or °].
            tool: tool vectors, shape (m, 3) or (3,) [mm].
        """
        return np.asarray(lever_points(machine, self.side, positions, tool) - self.reference)

    def _table(self, errors: bool, order: Int[np.ndarray, " n"]) -> tuple[tuple[str, ...], np.ndarray]:
        columns = ("n", *self.axes, *(f"Δ{letter}" for letter in DIRECTIONS))
        values = (self.values if errors else self.compensation) * IN_DEGREES
        numbers = np.arange(1, len(values) + 1)
        return columns, np.column_stack([numbers, round_position(self.positions[order]), values[order]])


@dataclass(frozen=True, eq=False)
class Grid(SpatialGrid):
    """Deviations at the nodes of a regular grid over the linear axes.

    On a machine with rotary axes the grid contains the errors of the linear axes alone, and `rotary_grids` contain those of the
    rotary axes. `tool` is then the *rotated* tool vector, as the rotary axes of the head turn it. For another tool, a control
    computes e(tool) = e(tool0) + rotation × (tool - tool0).

    Args:
        type: Compensation type of ISO/TR 16907 whose effects the values hold, such as "L-VOL".
        axes: Letters of the axes, in the order X, Y, Z or A, B, C.
        nodes: Rising positions of each axis, shape (number of nodes of the axis,) [mm or °].
        positions: Positions of all n nodes, the first axis varying fastest, shape (n, k) [mm or °].
        values: ERROR values, shape (n, 6) [mm, rad], as in `SpatialGrid`.
        u: Standard uncertainties of the values, shape (n, 6) [mm, rad]; NaN where they were not asked for.
        outside: True where a node lies outside what was measured, shape (n,).
        tool: Tool vector for which the translations hold, (3,) [mm].
        frame: Frame of the values, always "machine".
        datum: The datum in words.
        notes: What else a user should know.
        bands: Ends of the 95 % coverage intervals, the symmetric and the shortest one, shape (4, n, 6) [mm, rad]; None where they
            were not asked for.

    >>> import numpy as np
    >>> x, values = np.array([0.0, 100.0]), np.zeros((2, 6))
    >>> values[1, 0] = 0.010
    >>> grid = Grid("L-VOL", ("X",), (x,), x[:, None], values, values, values[:, 0] > 1, (0.0, 0.0, 0.0), "machine", "X")
    >>> grid.side, grid.interpolate(np.array([[25.0]]))[0, 0].round(6).item()
    ('linear', 0.0025)
    """

    tool: tuple[float, float, float]
    frame: str
    datum: str
    notes: tuple[str, ...] = ()
    bands: Float[np.ndarray, "4 n 6"] | None = None

    @property
    def side(self) -> str:
        """Whose axes' errors the grid holds: "linear"."""
        return LINEAR

    @property
    def reference(self) -> Float[np.ndarray, " 3"]:
        """The tool vector [mm]."""
        return np.asarray(self.tool, dtype=float)

    def table_2(self, *, errors: bool = False) -> tuple[tuple[str, ...], Float[np.ndarray, "n columns"]]:
        """The table of ISO/TR 16907, Table 2: columns n, X, Y, Z [mm], ΔX, ΔY, ΔZ [mm], ΔA, ΔB, ΔC [°]; one row per node, X
        running fastest.

        Args:
            errors: error values instead of compensation values.
        """
        return self._table(errors, np.arange(len(self.positions)))


@dataclass(frozen=True, eq=False)
class RotaryGrid(SpatialGrid):
    """Rigid error of the rotary axes of one side at the nodes of a regular grid over their positions.

    The head's grid includes the constants of the tool frame, which turn with it.

    Args:
        type: Compensation type of ISO/TR 16907 whose effects the values hold, such as "R-VOL".
        axes: Letters of the axes, in the order A, B, C.
        nodes: Rising positions of each axis, shape (number of nodes of the axis,) [°].
        positions: Positions of all n nodes, the first axis varying fastest, shape (n, k) [°].
        values: ERROR values, shape (n, 6) [mm, rad], as in `SpatialGrid`.
        u: Standard uncertainties of the values, shape (n, 6) [mm, rad]; NaN where they were not asked for.
        outside: True where a node lies outside what was measured, shape (n,).
        side: The side of the machine, "table" or "head".
        determined: False where the data do not determine a component, shape (n, 6).
        reference_point: Point whose translation the values hold, (3,) [mm].
        period: For each axis, 360 when its nodes close a full turn, else 0 [°].
        frame, datum, notes, bands: The same as in `Grid`.

    >>> import numpy as np
    >>> c, values, known = np.array([0.0, 180.0, 360.0]), np.zeros((3, 6)), np.ones((3, 6), bool)
    >>> values[1, 0], at = 0.010, (0.0, 0.0, 0.0)
    >>> given = dict(type="R-VOL", axes=("C",), nodes=(c,), positions=c[:, None], values=values, u=values, outside=~known[:, 0])
    >>> grid = RotaryGrid(**given, side="table", determined=known, reference_point=at, period=(360.0,), frame="machine", datum="")
    >>> grid.interpolate(np.array([[450.0], [-180.0]]))[:, 0].round(6).tolist()
    [0.005, 0.01]
    """

    side: str
    determined: Bool[np.ndarray, "n 6"]
    reference_point: tuple[float, float, float]
    period: tuple[float, ...]
    frame: str
    datum: str
    notes: tuple[str, ...] = ()
    bands: Float[np.ndarray, "4 n 6"] | None = None

    @property
    def reference(self) -> Float[np.ndarray, " 3"]:
        """The reference point [mm]."""
        return np.asarray(self.reference_point, dtype=float)

    @property
    def periods(self) -> tuple[float, ...]:
        """Per axis 360 [°] where the nodes close a full turn, else 0."""
        return self.period

    @property
    def lever_arm(self) -> str:
        """What a control must take as lever arm, in words."""
        return _LEVER[self.side]

    def at_points(
        self, positions: Float[np.ndarray, "m k"], points: Float[np.ndarray, "m 3"]
    ) -> Float[np.ndarray, "m 6"]:
        """Error values at functional points: e + ω × (point - reference), and ω.

        Args:
            positions: Positions of the grid's axes, in the order of `axes`, shape (m, k) [°].
            points: functional points, shape (m, 3) [mm]; `lever_arm` says how they are counted.

        Returns:
            Error values, shape (m, 6) [mm, rad].

        Raises:
            ValueError: a position lies outside the nodes.
        """
        values = self.interpolate(positions)
        values[:, :3] += np.cross(values[:, 3:], points - self.reference)
        return values

    def table_3(self, *, errors: bool = False) -> tuple[tuple[str, ...], Float[np.ndarray, "n columns"]]:
        """The table of ISO/TR 16907, Table 3: columns n, A (or B), C [°], ΔX, ΔY, ΔZ [mm], ΔA, ΔB, ΔC [°]; one row per node,
        the last axis running fastest.

        A grid over one axis has one column of positions.

        Args:
            errors: error values instead of compensation values.
        """
        return self._table(errors, np.lexsort(self.positions.T[::-1]))


AnyGrid = Grid | RotaryGrid
