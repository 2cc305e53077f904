"""Error functions of ISO 230 as a control with a kinematic model counts them, from those of volid, and back.

Vendors' pages name the parameters (EXX, EAX, X0C, …) and the order of the axes, but not the points about which rotations act,
nor whose errors those of a table are. The convention here is inferred (INFERRED, see `FACTS`):

- axis of X, Y, Z, wherever it stands in the machine: x -> q d + x + e + ω × x, tool relative to workpiece, x counted in the
  carriage, whose origin is the machine's when all axes are at 0 (lever arms do not contain the axis's own position);
- rotary axis of the tool side: x -> c + R (x - c) + e + ω × R (x - c), errors after the ideal rotation, c its centre;
- rotary axis of the table: the same for the table itself in the machine, so that e and ω are minus those of tool relative to
  workpiece, as the symbols of location errors of ISO 230-1 mean it (X0C: where the axis average line stands).

volid's functions (CONVENTIONS 3) differ by lever arms alone, to first order: e_file = ± (e + ω × s(q)) and ω_file = ± ω with

    s = -p for a linear axis of the tool side,  q d - p for one that carries the workpiece,  c - p for a rotary axis,

p its error point. A function of q times q is no straight line between two positions; points are added until it is one
within `BOUND`. Constants of the tool frame, S, are added to the last axis. Not modelled: terms of second order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from volid.compensation.tables.error_table import ErrorTable
from volid.controllers.base import DOCUMENTED, INFERRED, OPEN, Fact
from volid.exceptions import InputError
from volid.model.iso230 import SPINDLE, parse
from volid.model.kinematics import ROWS
from volid.model.machine import Axis, Machine

BOUND = 1e-5  # mm between the points, at `ARM` for rotations: far below what any drive does
ARM = 1000.0  # mm
HALVINGS = 8
AXIS_LINE, RELATIVE = "table", "tool relative to workpiece"
_ALTERNATIVE = "isg-stuttgart.de kernel-html de-DE 296395531"

FACTS = (
    Fact(
        "names of errors are those of ISO 230-1 and ISO 230-7; values in mm and rad, arguments in mm and degrees",
        DOCUMENTED,
        "Beckhoff TF5280, 296423819, 296426379",
    ),
    Fact(
        "values are errors, actual - nominal, as the name error parameters says; a switch of the list, negate, "
        "turns single axes",
        INFERRED,
        "Beckhoff TF5280, 296423819, P-VOLC-00009",
    ),
    Fact(
        "a location error of a rotary axis is the mean of its error function of the same kind", DOCUMENTED, _ALTERNATIVE
    ),
    Fact("a rotary axis turns about its ideal line, and its errors act after the rotation", DOCUMENTED, _ALTERNATIVE),
    Fact(
        "the first axes of the chain, as many as workpiece_axes says, carry the workpiece",
        DOCUMENTED,
        "P-VOLC-00008, isg-stuttgart.de kernel-html de-DE 296411019",
    ),
    Fact(
        "the chain goes from the workpiece to the tool, as that of the vendor's universal kinematics does",
        INFERRED,
        "isg-stuttgart.de kernel-html 278706443",
    ),
    Fact(
        "errors of linear axes are tool relative to workpiece, with lever arms counted in the carriage",
        INFERRED,
        "ISO 230-1 defines them for the functional point; Beckhoff TF5280, 296411019: an axis that is measured "
        "as one of the tool side stands there",
    ),
    Fact(
        "errors of a rotary axis that carries the workpiece are those of the table itself, as location errors "
        "of ISO 230-1 are; the option table_errors turns them",
        INFERRED,
        "ISO 230-1:2012, location errors of axis average lines",
    ),
    Fact(
        "whether A0Y, B0Z, … of a linear axis also turn what the axis carries; volid reads them as the "
        "direction of the axis alone",
        OPEN,
    ),
)


@dataclass(frozen=True)
class Convention:
    """How the errors in a file relate to volid's.

    Args:
        machine: The machine.
        table_errors: Whose errors those of rotary axes of the workpiece side are: `AXIS_LINE` or `RELATIVE`.
        centres: Centre of rotation by axis letter where a file states it; by default the axis's point [mm].
    """

    machine: Machine
    table_errors: str = AXIS_LINE
    centres: dict[str, np.ndarray] = field(default_factory=dict)

    def sign(self, axis: Axis) -> float:
        """-1 for a rotary axis of the table whose errors are those of the table itself."""
        own = axis.primed and not axis.is_linear and self.table_errors == AXIS_LINE
        return -1.0 if own else 1.0

    def centre(self, axis: Axis) -> np.ndarray:
        """The point about which the rotations of a rotary axis act in the file, (3,) [mm]."""
        return self.centres.get(axis.letter, np.asarray(axis.point, dtype=float))

    def to_file(self, axis: Axis, positions: np.ndarray, values: np.ndarray) -> np.ndarray:
        """volid's six values (n, 6), in the axis's frame, at positions (n,), as the file counts them."""
        e, w = values[:, :3] @ axis.frame.T, values[:, 3:] @ axis.frame.T
        return self.sign(axis) * np.hstack([e + np.cross(w, self._shift(axis, positions)), w])

    def from_file(self, axis: Axis, positions: np.ndarray, values: np.ndarray) -> np.ndarray:
        """The inverse of `to_file`."""
        e, w = self.sign(axis) * values[:, :3], self.sign(axis) * values[:, 3:]
        e = e - np.cross(w, self._shift(axis, positions))
        return np.hstack([e @ axis.frame, w @ axis.frame])

    def _shift(self, axis: Axis, positions: np.ndarray) -> np.ndarray:
        """s(q), (n, 3) [mm]."""
        point = np.asarray(axis.error_point, dtype=float)
        if not axis.is_linear:
            return np.tile(self.centre(axis) - point, (len(positions), 1))
        along = positions[:, None] * np.asarray(axis.unit_vector) if axis.primed else np.zeros((len(positions), 3))
        return np.asarray(along - point)

    def tool_frame(self, axis: Axis, positions: np.ndarray, constants: np.ndarray) -> np.ndarray:
        """What constants of the tool frame (6,) add to the last axis, as the file counts it, (n, 6)."""
        if axis.is_linear:
            return np.tile(constants, (len(positions), 1))
        turn = Rotation.from_rotvec(np.deg2rad(positions)[:, None] * np.asarray(axis.unit_vector))
        moved = constants[:3] + np.cross(constants[3:], self.centre(axis))
        return np.hstack([turn.apply(np.tile(v, (len(positions), 1))) for v in (moved, constants[3:])])


@dataclass(frozen=True, eq=False)
class AxisErrors:
    """Errors of one axis, as a file counts them: at positions (n,) [mm or °], six values (n, 6) [mm, rad]."""

    axis: Axis
    positions: np.ndarray
    values: np.ndarray


def refined(nodes: np.ndarray, function: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """`nodes` (n,), with middles added until straight lines between them follow the function (m,) -> (m, 6) within `BOUND`."""
    scale = np.array([1.0] * 3 + [ARM] * 3)
    for _ in range(HALVINGS):
        ends, middle = function(nodes), 0.5 * (nodes[1:] + nodes[:-1])
        off = np.abs(function(middle) - 0.5 * (ends[1:] + ends[:-1])) * scale
        rough = off.max(axis=1, initial=0.0) > BOUND
        if not rough.any():
            break
        nodes = np.sort(np.concatenate([nodes, middle[rough]]))
    return nodes


def table_axes(machine: Machine) -> tuple[str, ...]:
    """Letters of the rotary axes that carry the workpiece, from the workpiece on.

    Raises `InputError` where a linear axis stands among them or before them: what X, Y and Z then mean is not stated.
    """
    found = tuple(a.letter for a in machine.axes if a.primed and not a.is_linear)
    if machine.letters[: len(found)] != found:
        raise InputError(
            f"machine '{machine.name}' [{machine.structure.strip().strip('[]')}]: a linear axis stands between "
            "workpiece and rotary table; public sources do not say in which directions the control then counts X, Y and Z. "
            "heidenhain-kinematicscomp and csv carry tables of error functions there"
        )
    return found


def axis_errors(convention: Convention, tables: Sequence[ErrorTable]) -> list[AxisErrors]:
    """Error functions of all axes as a file counts them, means of both directions.

    Raises `InputError` for an order of axes that the file cannot say.
    """
    table_axes(convention.machine)
    constants, last = np.zeros(ROWS), convention.machine.axes[-1]
    for t in tables:
        if t.axis == SPINDLE:
            constants[parse(t.function).component] += 0.5 * (t.forward[0] + t.reverse[0])
    found = []
    for axis in convention.machine.axes:
        own = [t for t in tables if t.axis == axis.letter]
        added = constants if axis is last else np.zeros(ROWS)
        if own or added.any():
            found.append(_of_axis(convention, axis, own, added))
    return found


def _of_axis(convention: Convention, axis: Axis, tables: Sequence[ErrorTable], constants: np.ndarray) -> AxisErrors:
    def function(q: np.ndarray) -> np.ndarray:
        values = np.zeros((len(q), ROWS))
        for t in tables:
            values[:, parse(t.function).component] += t.at(q, np.zeros(len(q)))
        found = convention.to_file(axis, q, values)
        return found + convention.tool_frame(axis, q, constants) if constants.any() else found

    nodes = np.asarray(axis.travel, dtype=float) if not tables else tables[0].positions
    for t in tables[1:]:
        nodes = np.union1d(nodes, t.positions)
    nodes = refined(nodes, function)
    return AxisErrors(axis, nodes, function(nodes))
