"""Where the bodies of a machine stand in its drawing: one upright stack from the bed to the workpiece, and down from the bed to
the tool.

The bed has the shape of a C. On its base stand the bodies that carry the workpiece, the one nearest to the bed lowest; from its
arm hang the bodies that carry the tool, the one nearest to the bed highest. So the drawing, read from the workpiece downwards to
the base, and then from the arm downwards to the tool, is the structural code. Sizes say what kind of axis moves a body, not how
large it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from volid.model.machine import Axis, Machine

PRIME = "\N{PRIME}"
ROW, ROTARY_ROW, INCLINED_ROW = (
    0.86,
    1.0,
    1.24,
)  # height of a row in units of the drawing: room for two, three or four lines of text
GAP = 1.5  # between workpiece and tool
BELOW_ARM = 0.4  # room for the front of the arm, which hangs into the drawing
BED = 0.7  # height of base and arm
_LINEAR = {"X": (2.1, 1.1, 0.62), "Y": (1.2, 2.1, 0.62), "Z": (1.15, 1.15, 0.78)}


@dataclass(frozen=True)
class Body:
    """One element of the structural code, and its place.

    Args:
        token: As in the structural code: "w", "X'", "(C)", "t".
        role: "workpiece", "tool", "spindle", "linear" or "rotary".
        axis: The axis that moves it; None for what no axis moves.
        height: Height of its centre in the drawing.
        carries_workpiece: Whether it stands on the workpiece's side of the bed.
    """

    token: str
    role: str
    axis: Axis | None
    height: float
    carries_workpiece: bool

    @property
    def label(self) -> str:
        """The token with a typographic prime."""
        return self.token.replace("'", PRIME)

    @property
    def size(self) -> tuple[float, float, float]:
        """Edges of the body of a linear axis."""
        return _LINEAR[self.token[0]]

    @property
    def row(self) -> float:
        """Height of its row."""
        if self.role != "rotary":
            return ROW
        return INCLINED_ROW if self.is_inclined else ROTARY_ROW

    @property
    def is_inclined(self) -> bool:
        """Whether its axis has another direction than its letter promises."""
        return self.axis is not None and has_own_direction(self.axis)

    @property
    def motion(self) -> np.ndarray:
        """Direction in which the axis moves its body as seen from the bed, or about which it turns it, when the commanded
        position grows; shape (3,). An axis that carries the workpiece moves against the machine's coordinate (ISO 841)."""
        if self.axis is None:
            return np.zeros(3)
        sense = -1.0 if self.axis.primed else 1.0
        return sense * np.asarray(self.axis.unit_vector)


def has_own_direction(axis: Axis) -> bool:
    """Whether an axis has another direction than its letter promises."""
    return not np.allclose(axis.unit_vector, replace(axis, direction=(0.0, 0.0, 0.0)).unit_vector)


@dataclass(frozen=True)
class Layout:
    """Every body but the bed in the order of the structural code, and the height of the arm's lower side."""

    bodies: tuple[Body, ...]
    arm: float

    def of_side(self, carries_workpiece: bool) -> tuple[Body, ...]:
        """The bodies of one side, in the order of the structural code."""
        return tuple(b for b in self.bodies if b.carries_workpiece == carries_workpiece)


def tokens_of(machine: Machine) -> list[str]:
    """The elements of the structural code, from w to t."""
    return machine.structure.strip().removeprefix("[").removesuffix("]").split()


def layout(machine: Machine) -> Layout:
    """Where the bodies stand; the base's upper side is at height 0."""
    tokens = tokens_of(machine)
    bed = tokens.index("b")
    stack = [*reversed(tokens[:bed]), *reversed(tokens[bed + 1 :])]  # from the base to the arm
    places, arm = _heights(machine, stack, bed)
    order = [*range(bed - 1, -1, -1), *range(len(stack) - 1, bed - 1, -1)]
    bodies = (_body(machine, stack[i], places[i], i < bed) for i in order)
    return Layout(tuple(bodies), arm)


def _heights(machine: Machine, stack: list[str], bed: int) -> tuple[list[float], float]:
    """Height of the centre of each element, and of the arm."""
    places, level = [], 0.0
    for i, token in enumerate(stack):
        level += GAP if i == bed else 0.0
        row = _body(machine, token, 0.0, i < bed).row
        places.append(level + 0.5 * row)
        level += row
    return places, level + BELOW_ARM


def _body(machine: Machine, token: str, height: float, carries_workpiece: bool) -> Body:
    fixed = {"w": "workpiece", "t": "tool"}
    if token in fixed or token.startswith("("):
        return Body(token, fixed.get(token, "spindle"), None, height, carries_workpiece)
    axis = machine.axis(token[0])
    return Body(token, "linear" if axis.is_linear else "rotary", axis, height, carries_workpiece)


def upwards(found: Layout) -> list[Body]:
    """The bodies from the lowest to the highest: the order of drawing."""
    return sorted(found.bodies, key=lambda b: b.height)
