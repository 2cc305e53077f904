"""Spatial error and compensation grids of the rotary axes (ISO/TR 16907 Table 3; type R-VOL).

At every node the six components of the rigid error of a side's rotary axes, stacked ones together, at a reference point. A
control adds, for a functional point x, e(x) = e + ω × (x - reference), where x is the nominal functional point of the linear
axes (table) or the rotated tool vector (head); one axis on each side makes two grids whose effects add up. The linear grid goes
with them, taken at the rotated tool vector. What is left is of second order: about |ω|·|e| plus |ω|²·lever arm. CONVENTIONS 5.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from volid.compensation.grids.interpolation import interpolate, period_of
from volid.compensation.grids.linear import Grid, describe_datum, grid_positions, node_lines
from volid.compensation.grids.parts import (
    HEAD,
    TABLE,
    evaluate_part,
    full_positions,
    lever_points,
    part_letters,
    part_notes,
    rotary_letters,
    rotated_tool,
    tool_reaching,
)
from volid.exceptions import InputError, NotDeterminedError
from volid.fitting.solution import Solution
from volid.model.iso230 import DIRECTIONS, ROTARY_AXES
from volid.model.machine import Machine

POINTS = 37
_IN_DEGREES = np.array([1.0] * 3 + [180.0 / np.pi] * 3)
_LEVER = {
    TABLE: "lever arm = nominal functional point of the linear axes (their positions + rotated tool vector) - reference point",
    HEAD: "lever arm = tool vector turned by the rotary axes of the head - reference point",
}


@dataclass(frozen=True, eq=False)
class RotaryGrid:
    """Rigid error of the rotary axes of one side at the nodes of a regular grid over their positions.

    `side`: "table" or "head". `axes`: one letter or two, A or B first. `nodes`: positions per axis [°]. `positions`: (n, k), the
    first axis varying fastest. `values`: ERROR values (n, 6), machine frame: translation of the point `reference_point` [mm] and
    rotation [rad]. `u`: standard uncertainties. NaN where the data do not determine a component (`determined` False).
    `outside`: (n,) True where a node lies outside what was measured. `period`: per axis, 360 for full turns, else 0.
    The head's grid includes the constants of the tool frame, which turn with it. `bands`: as of `Grid`.
    """

    type: str
    side: str
    axes: tuple[str, ...]
    nodes: tuple[np.ndarray, ...]
    positions: np.ndarray
    values: np.ndarray
    u: np.ndarray
    determined: np.ndarray
    outside: np.ndarray
    reference_point: tuple[float, float, float]
    period: tuple[float, ...]
    frame: str
    datum: str
    notes: tuple[str, ...] = ()
    bands: np.ndarray | None = None

    @property
    def compensation(self) -> np.ndarray:
        """Compensation values, minus the error values, (n, 6) [mm, rad] (CONVENTIONS 5)."""
        return -self.values

    @property
    def lever_arm(self) -> str:
        """What a control must take as lever arm, in words."""
        return _LEVER[self.side]

    def interpolate(self, positions: np.ndarray) -> np.ndarray:
        """Error values by linear interpolation, as a control does it, at (m, k) positions [°] in `axes` order; (m, 6)."""
        x = np.array(positions, dtype=float).reshape(-1, len(self.axes))
        for k, (nodes, period) in enumerate(zip(self.nodes, self.period, strict=True)):
            beyond = (x[:, k] < nodes[0]) | (x[:, k] > nodes[-1])
            if period:
                x[beyond, k] = nodes[0] + np.mod(x[beyond, k] - nodes[0], period)
        table = self.values.reshape(*(len(n) for n in reversed(self.nodes)), 6)
        return interpolate(tuple(reversed(self.nodes)), table, x[:, ::-1])

    def at_points(self, positions: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Error values at functional points: e + ω × (point - reference), and ω; (m, 6) [mm, rad].

        `positions`: (m, k) [°], `axes` order; `points`: (m, 3) [mm], see `lever_arm`.
        """
        values = self.interpolate(positions)
        values[:, :3] += np.cross(values[:, 3:], points - np.asarray(self.reference_point))
        return values

    def table_3(self, *, errors: bool = False) -> tuple[tuple[str, ...], np.ndarray]:
        """The table of ISO/TR 16907, Table 3: columns n, A (or B), C [°], ΔX, ΔY, ΔZ [mm], ΔA, ΔB, ΔC [°]; one row per node.

        Compensation values, or error values (`errors`). A grid over one axis has one column of positions.
        """
        columns = ("n", *self.axes, *(f"Δ{letter}" for letter in DIRECTIONS))
        values = (self.values if errors else self.compensation) * _IN_DEGREES
        return columns, np.column_stack([np.arange(1, len(values) + 1), self.positions, values])


def rotary_grids(
    solution: Solution,
    *,
    step: float | None = None,
    points: int | None = None,
    reference_point: tuple[float, float, float] | None = None,
    nodes: Mapping[str, np.ndarray] | None = None,
) -> tuple[RotaryGrid, ...]:
    """Spatial grids of the rotary axes over their whole travel: table first, then head, those that the machine has.

    `step` [°], or `points` per axis (default 37), or `nodes` by axis letter. `reference_point` [mm]: in the frame of the body
    that bears the rotary axes, which coincides with the machine frame when the linear axes stand at 0 (by default the `point`
    of the axis nearest the bed, for each side its own). Location errors and error motions of the side's rotary axes are in it;
    on the head side also the constants of the tool frame. Location errors of the linear axes stay in the linear grid.

    Raises `InputError` for a machine without rotary axes, a linear axis between stacked ones, or a step that makes no grid;
    `NotDeterminedError` when the data do not determine the translations. ISO/TR 16907 7.5, Table 3.
    """
    sides = [side for side in (TABLE, HEAD) if rotary_letters(solution.machine, side)]
    if not sides:
        raise InputError(
            f"grid: machine '{solution.machine.name}' has no rotary axis; R-VOL is for rotary axes, L-VOL for linear ones"
        )
    return tuple(_grid(solution, side, step, points, reference_point, nodes) for side in sides)


def reference_of_side(machine: Machine, side: str, reference: Sequence[float] | None = None) -> np.ndarray:
    """Reference point of a side's grid (3,) [mm]: by default the `point` of its axis nearest the bed."""
    own = machine.axis(rotary_letters(machine, side)[-1 if side == TABLE else 0]).point
    return np.asarray(own if reference is None else reference, dtype=float)


def _grid(
    solution: Solution,
    side: str,
    step: float | None,
    points: int | None,
    reference: Sequence[float] | None,
    own: Mapping[str, np.ndarray] | None,
) -> RotaryGrid:
    machine = solution.machine
    axes = tuple(a for a in ROTARY_AXES if a in rotary_letters(machine, side))
    nodes = node_lines(solution, axes, step, points, POINTS, own)
    x, y, z = reference_of_side(machine, side, reference)
    positions = grid_positions(nodes)
    full = full_positions(machine, axes, positions)
    tool = tool_reaching(machine, side, full, np.array([x, y, z]))
    found = evaluate_part(solution, part_letters(machine, side), full, tool, axes)
    _require_translations(solution, side, found.determined)
    return RotaryGrid(
        type="R-VOL",
        side=side,
        axes=axes,
        nodes=nodes,
        positions=positions,
        values=found.values,
        u=found.u,
        determined=found.determined,
        outside=found.outside,
        reference_point=(float(x), float(y), float(z)),
        period=tuple(period_of(machine.axis(a), n) for a, n in zip(axes, nodes, strict=True)),
        frame="machine",
        datum=describe_datum(solution),
        notes=_notes(solution, side, found.determined, found.outside),
    )


def _require_translations(solution: Solution, side: str, determined: np.ndarray) -> None:
    lost = [f"d{c}" for k, c in enumerate(DIRECTIONS[:3]) if not determined[:, k].all()]
    if lost:
        raise NotDeterminedError(
            f"grid: the data do not determine {', '.join(lost)} of the rotary axes of the {side}. "
            f"{' '.join(solution.statements)} Measure what is missing, or switch the named functions off."
        )


def _notes(solution: Solution, side: str, determined: np.ndarray, outside: np.ndarray) -> tuple[str, ...]:
    notes = part_notes(solution, part_letters(solution.machine, side))
    lost = [f"d{c}" for k, c in enumerate(DIRECTIONS[3:], start=3) if not determined[:, k].all()]
    if lost:
        notes.append(f"{', '.join(lost)} are not determined by the data and left blank; use no lever arm but 0")
    if outside.any():
        notes.append(f"{int(outside.sum())} of {len(outside)} nodes lie outside the measured positions: extrapolated")
    if solution.adequacy.rejected:
        notes.append("MODEL REJECTED BY THE DATA: " + solution.adequacy.verdict)
    return tuple(notes)


def deviation_from_grids(
    machine: Machine, linear: Grid, rotary: Sequence[RotaryGrid], positions: np.ndarray, tool: np.ndarray
) -> np.ndarray:
    """Deviation that the grids say at positions (m, n_axes) with tool vectors (m, 3) or (3,), shape (m, 6) [mm, rad].

    What a control does: the linear grid at the rotated tool vector, plus every rotary grid with its own lever arm.
    """
    values = linear.interpolate(positions[:, [machine.index(a) for a in linear.axes]])
    values[:, :3] += np.cross(values[:, 3:], rotated_tool(machine, positions, tool) - np.asarray(linear.tool))
    for grid in rotary:
        own = positions[:, [machine.index(a) for a in grid.axes]]
        values += grid.at_points(own, lever_points(machine, grid.side, positions, tool))
    return values
