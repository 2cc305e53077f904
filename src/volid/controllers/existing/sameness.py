"""Whether two forms of one compensation move the axes alike: both controls are asked for their commands, many times."""

from __future__ import annotations

import numpy as np

from volid.backend.even_points import even_points
from volid.compensation.package import Compensation
from volid.controllers.base import COLUMNS, Declaration
from volid.controllers.existing.contents import nodes_by_axis
from volid.controllers.existing.forms import BY_DIRECTION
from volid.controllers.exported import Export
from volid.exceptions import InputError
from volid.model.machine import Machine

EXACT = 1e-6  # mm or °: two forms of one compensation may differ so much by the digits of the files
SAMPLES = 400  # positions between the nodes at which both are compared


def refuse_change(before: Compensation, found: Export, declared: Declaration, tool: np.ndarray) -> None:
    """Raises `InputError` where the converted files move an axis otherwise than the old ones, beyond what rounding explains."""
    apart, at = largest_change(before, found, tool, shifted=declared.zero_fixed)
    count = len(before.axis_tables) + len(before.tables) + len(before.grids)
    if not apart <= EXACT + max(count, 1) * found.written.rounding:
        bent = any(t.has_reversal for t in before.tables) or any(t.has_reversal for t in before.axis_tables)
        why = (
            f"Tables of these files {BY_DIRECTION}, which it does not hold as they do"
            if bent and declared.reversal != COLUMNS
            else declared.nearest
        )
        raise InputError(
            f"{declared.name} would move the axes otherwise than these files: by up to {1e3 * apart:.1f} µm at {at}. {why}"
        )


def shift_notes(before: Compensation, found: Export, declared: Declaration, tool: np.ndarray) -> list[str]:
    """Notes about axes that are shifted as a whole, by a control that makes the value 0 at its own zero."""
    if not declared.zero_fixed:
        return []
    q, machine = _places(before, found.job.machine), found.job.machine
    shift = _moves(found.held, machine, q, tool, 1.0)[0] - _moves(before, machine, q, tool, 1.0)[0]
    return [
        f"{a.letter} is shifted as a whole by {1e3 * s:+.2f} {'µm' if a.is_linear else 'm°'}: {declared.name} makes the value "
        "0 at its own zero; a work offset takes that"
        for a, s in zip(machine.axes, shift, strict=True)
        if abs(s) > EXACT + found.written.rounding
    ]


def _moves(made: Compensation, machine: Machine, q: np.ndarray, tool: np.ndarray, way: float) -> np.ndarray:
    """What a control adds to its commands, shape of q [mm or °]."""
    return made.control(machine).command(q, tool, np.full_like(q, way)) - q


def largest_change(
    before: Compensation, found: Export, tool: np.ndarray, *, shifted: bool = False
) -> tuple[float, str]:
    """By how much the commands of two forms of one compensation differ at most [mm or °], and where.

    At all nodes on the axes' own lines, and at positions spread evenly over all of them, in both directions. `shifted`: a
    constant shift of each axis does not count.
    """
    machine = found.job.machine
    q = _places(before, machine)
    worst, at, shift = 0.0, "any position", np.zeros(len(machine.axes))
    for way in (1.0, -1.0):
        apart = _moves(found.held, machine, q, tool, way) - _moves(before, machine, q, tool, way)
        if shifted and way > 0.0:
            shift = apart[0]
        size = np.abs(apart - shift).max(axis=1)
        i = int(np.argmax(size))
        if not size[i] <= worst:
            worst = float(size[i])
            places = zip(machine.letters, q[i], strict=True)
            at = ", ".join(f"{a} {v:g}" for a, v in places) + f", moving in {'+' if way > 0 else '-'}"
    return worst, at


def _places(made: Compensation, machine: Machine) -> np.ndarray:
    nodes = nodes_by_axis(made)
    lows, highs = (
        np.array([nodes[a.letter][end] if a.letter in nodes else a.reference for a in machine.axes]) for end in (0, -1)
    )
    q = lows + even_points(SAMPLES, len(machine.axes)) * (highs - lows)
    lines = []
    for letter, positions in nodes.items():
        line = np.tile(q[len(q) // 2], (len(positions), 1))
        line[:, machine.index(letter)] = positions
        lines.append(line)
    return np.concatenate([q, *lines])
