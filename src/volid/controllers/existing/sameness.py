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
KINDS = (True, False)  # linear axes, rotary axes
NO_TRAVEL = 1e5  # mm: longer than any axis


def refuse_change(before: Compensation, found: Export, declared: Declaration, tool: np.ndarray) -> None:
    """Raises `InputError` where the converted files move an axis otherwise than the old ones, beyond what rounding explains."""
    count = max(len(before.axis_tables) + len(before.tables) + len(before.grids), 1)
    count *= 2 if declared.zero_fixed else 1  # the value that all are counted from is rounded too
    for linear in KINDS:
        apart, at = largest_change(before, found, tool, shifted=declared.zero_fixed, linear=linear)
        if apart <= EXACT + count * rounding_of(found, linear):
            continue
        bent = any(t.has_reversal for t in before.tables) or any(t.has_reversal for t in before.axis_tables)
        why = (
            f"Tables of these files {BY_DIRECTION}, which it does not hold as they do"
            if bent and declared.reversal != COLUMNS
            else declared.nearest
        )
        raise InputError(
            f"{declared.name} would move the axes otherwise than these files: by up to {in_words(apart, linear)} at {at}. {why}"
        )


def rounding_of(found: Export, linear: bool) -> float:
    """What the steps of the values explain, of linear axes [mm] or rotary ones [°]."""
    return found.written.rounding if linear else float(np.rad2deg(found.written.rounding))


def in_words(apart: float, linear: bool) -> str:
    """A difference of linear axes [mm] or rotary ones [°]."""
    return f"{1e3 * apart:.1f} µm" if linear else f"{apart:.6f}°"


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
        if abs(s) > EXACT + rounding_of(found, a.is_linear)
    ]


def _moves(made: Compensation, machine: Machine, q: np.ndarray, tool: np.ndarray, way: float) -> np.ndarray:
    """What a control adds to its commands, shape of q [mm or °]."""
    return made.control(machine).command(q, tool, np.full_like(q, way)) - q


def largest_change(
    before: Compensation, found: Export, tool: np.ndarray, *, shifted: bool = False, linear: bool = True
) -> tuple[float, str]:
    """By how much the commands of two forms differ at most, of `linear` axes [mm] or rotary ones [°], and where.

    At all nodes on the axes' own lines, and at positions spread evenly over all travels, in both directions. `shifted`: a
    constant shift of each axis does not count.
    """
    machine = found.job.machine
    q, kind = _places(before, machine), np.array([a.is_linear == linear for a in machine.axes])
    worst, at, shift = 0.0, "any position", np.zeros(len(machine.axes))
    for way in (1.0, -1.0):
        apart = _moves(found.held, machine, q, tool, way) - _moves(before, machine, q, tool, way)
        if shifted and way > 0.0:
            shift = apart[0]
        size = np.abs(apart - shift)[:, kind].max(axis=1, initial=0.0)
        i = int(np.argmax(size))
        if not size[i] <= worst:
            worst = float(size[i])
            places = zip(machine.letters, q[i], strict=True)
            at = ", ".join(f"{a} {v:g}" for a, v in places) + f", moving in {'+' if way > 0 else '-'}"
    return worst, at


def _places(made: Compensation, machine: Machine) -> np.ndarray:
    """Positions of all axes, shape (m, axes): all nodes, and even ones over the travels.

    Controls differ beyond their tables, and where lever arms grow or turn with axes over which there is no table.
    """
    nodes = nodes_by_axis(made)
    own = [nodes.get(a.letter, np.array([a.reference])) for a in machine.axes]
    ends = np.array([_ends(x, a.travel) for x, a in zip(own, machine.axes, strict=True)])
    q = ends[:, 0] + even_points(SAMPLES, len(machine.axes)) * (ends[:, 1] - ends[:, 0])
    lines = []
    for letter, positions in nodes.items():
        i = machine.index(letter)
        along = np.union1d(positions, ends[i])
        line = np.tile(q[len(q) // 2], (len(along), 1))
        line[:, i] = along
        lines.append(line)
    return np.concatenate([q, *lines])


def _ends(positions: np.ndarray, travel: tuple[float, float]) -> tuple[float, float]:
    """Lowest and highest of the positions and of the travel, where there is a machine that has one."""
    low, high = travel if travel[1] - travel[0] <= NO_TRAVEL else (positions[0], positions[-1])
    return min(float(positions[0]), low), max(float(positions[-1]), high)
