"""Sides of a machine, one spatial grid each: the linear axes, the rotary axes of the table, the rotary axes of the head.

Which axes' errors a side's grid holds, and where its lever arms begin and end, by the nominal chain (CONVENTIONS 5). With both
rotary axes on one side (stacked) one grid holds them, on a split machine there is one for each side, and their effects add up.
"""

from __future__ import annotations

import numpy as np

from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES, ROTARY_AXES, SPINDLE
from volid.model.kinematics import carry
from volid.model.machine import Machine

LINEAR, TABLE, HEAD = "linear", "table", "head"


def rotary_letters(machine: Machine, side: str) -> tuple[str, ...]:
    """Rotary axes of the table (primed) or of the head (not primed), workpiece to tool."""
    return tuple(a.letter for a in machine.axes if not a.is_linear and a.primed == (side == TABLE))


def rotary_sides(machine: Machine) -> tuple[str, ...]:
    """The sides that have rotary axes, table first."""
    return tuple(side for side in (TABLE, HEAD) if rotary_letters(machine, side))


def axes_of(machine: Machine, side: str) -> tuple[str, ...]:
    """Axes over whose positions a side's grid reaches, in the order of its columns: X, Y, Z or A, B, C."""
    if side == LINEAR:
        return tuple(a for a in LINEAR_AXES if a in machine.letters)
    return tuple(a for a in ROTARY_AXES if a in rotary_letters(machine, side))


def part_letters(machine: Machine, side: str) -> frozenset[str]:
    """Axes whose errors a side's grid holds.

    The constants of the tool frame, S, turn with a swivelling head and are then part of its grid; without one they are constant
    like a linear axis's, and part of the linear grid.
    """
    head = rotary_letters(machine, HEAD)
    if side == LINEAR:
        linear = frozenset(a.letter for a in machine.linear)
        return linear if head else linear | {SPINDLE}
    return frozenset((*head, SPINDLE)) if side == HEAD else frozenset(rotary_letters(machine, TABLE))


def full_positions(machine: Machine, letters: tuple[str, ...], positions: np.ndarray) -> np.ndarray:
    """Positions (n, k) of `letters` as positions of all axes: other linear axes at their reference, other rotary ones at 0."""
    full = np.tile([a.reference if a.is_linear else 0.0 for a in machine.axes], (len(positions), 1))
    full[:, [machine.index(a) for a in letters]] = positions
    return full


def side_body(machine: Machine, side: str) -> int:
    """Number of the body that bears a side's rotary axes: the stator of the one nearest the bed.

    Raises `InputError` when a linear axis lies between them: then their errors depend on its position too.
    """
    places = [machine.index(a) for a in rotary_letters(machine, side)]
    if places != list(range(places[0], places[-1] + 1)):
        raise InputError(
            f"rotary grid: in '{machine.structure}' a linear axis lies between the rotary axes of the {side}; their errors "
            "then depend on its position too, and no grid over the rotary positions alone holds them"
        )
    return places[-1] + 1 if side == TABLE else places[0]


def lever_points(machine: Machine, side: str, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Where the functional point nominally is, as a side's grid counts lever arms, shape (m, 3) [mm].

    Linear: the rotated tool vector. Table: linear positions plus (rotated) tool vector. Head: the rotated tool vector, turned
    about the axes' own lines. The lever arm of a grid is this less the grid's reference. `positions` (m, n_axes), `tool` (m, 3)
    or (3,).
    """
    if side == LINEAR:
        return rotated_tool(machine, positions, tool)
    return carry(machine, positions, tool, len(machine.axes), side_body(machine, side))


def rotated_tool(machine: Machine, positions: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Tool vector that the linear grid takes, (m, 3) [mm]: turned by the rotary axes of the head."""
    if rotary_letters(machine, HEAD):
        return lever_points(machine, HEAD, positions, tool)
    return np.broadcast_to(np.asarray(tool, dtype=float), (len(positions), 3))


def tool_reaching(machine: Machine, side: str, positions: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Tool vectors (m, 3) [mm] at which a side's grid is evaluated: with them its lever arms are 0.

    Linear: the reference itself, all rotary axes being at 0. Table and head: what puts the functional point at `reference` of
    the body that bears the rotary axes.
    """
    if side == LINEAR:
        return np.broadcast_to(np.asarray(reference, dtype=float), (len(positions), 3))
    return carry(machine, positions, reference, side_body(machine, side), len(machine.axes))


def default_reference(machine: Machine, side: str) -> np.ndarray:
    """Reference point (3,) [mm] of the grid of a side's rotary axes: the `point` of the axis nearest the bed."""
    return np.asarray(machine.axis(rotary_letters(machine, side)[-1 if side == TABLE else 0]).point, dtype=float)


def turning_linear_axes(machine: Machine) -> tuple[str, ...]:
    """Linear axes whose errors turn with a rotary axis: between workpiece and rotary table, or between head and tool."""
    table = [machine.index(a) for a in rotary_letters(machine, TABLE)]
    head = [machine.index(a) for a in rotary_letters(machine, HEAD)]
    return tuple(
        a.letter
        for i, a in enumerate(machine.axes)
        if a.is_linear and ((table and i < max(table)) or (head and i > min(head)))
    )
