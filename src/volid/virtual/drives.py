"""Where the drives of a virtual machine go when its control compensates, and the errors that the machine then has.

The control alters the programmed position q to q + s. The pose that the machine reaches is T(q + s) with its own errors there,
and the campaign holds q. For every instrument the machine is therefore one with other errors at q: each factor of the chain with
the step s becomes the factor at q with an error motion D' instead of D (N(s): the nominal motion of the step),

    linear, tool side    N(q + s)·D = N(q)·D'      D' = N(s)·D
    linear, primed       D·N(q + s) = D'·N(q)      D' = D·N(s)
    rotary, tool side    D·N(q + s) = D'·N(q)      D' = D·N(s)
    rotary, primed       N(q + s)·D = N(q)·D'      D' = N(s)·D

so that bodies between workpiece and tool, on which levels and stations stand, are where they truly are as well. Steps of rotary
axes are exact up to `LARGEST_TURN`, see `volid.model.geometry.rotate_small`.

A drive whose axis is programmed to move has the direction that the campaign records. One whose axis rests, at the programmed
position and direction of the row before, moves by the change of its correction and then has the direction of that motion, the
whole of its reversal at once; where the correction does not change, it keeps the direction it had. Rows count in the order of
their times where all have one, else in the order of the set. Not modelled: partial reversal of motions shorter than the play,
dynamics, and what the drives do between the rows. CONVENTIONS 3; ISO/TR 16907 4 e.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from volid.campaign import End, ObservationSet
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.model.kinematics import ROWS, error_first
from volid.model.machine import Axis, Machine
from volid.virtual.truth import Truth

if TYPE_CHECKING:
    from jaxtyping import Float

NO_MOTION = 1e-9  # mm or degrees: a smaller change of a correction is arithmetic
LARGEST_TURN = 0.25  # degrees: the chain's rotations leave out θ³/6, 14 nm per metre here


class Drives(Protocol):
    """What a control of a virtual machine must tell: `volid.Control` is one."""

    @property
    def machine(self) -> Machine:
        """The machine whose axes it moves."""

    @property
    def active(self) -> tuple[str, ...]:
        """Its active compensations, in words, for the record of a campaign."""

    def command(
        self,
        positions: Float[np.ndarray, "m axes"],
        tool: Float[np.ndarray, "*m 3"] | None,
        directions: Float[np.ndarray, "m axes"] | None = None,
    ) -> Float[np.ndarray, "m axes"]:
        """Positions to which the drives go instead of the programmed ones, shape (m, n_axes) [mm or °]."""


def errors_of(truth: Truth, readings: ObservationSet, drives: Drives | None = None) -> Float[np.ndarray, "errors m"]:
    """Error values at the programmed positions of a set, those of all ends below each other, (ends · 6 · (n_axes + 1), m).

    Args:
        truth: The true errors.
        readings: A set of a campaign or plan for the truth's machine.
        drives: The control that compensates; None: the drives go where they are told.

    Raises:
        InputError: the control asks a rotary axis for more than `LARGEST_TURN`, or needs what it does not know.
    """
    if drives is None:
        return np.concatenate([truth.errors(end.positions, end.directions) for end in readings.ends])
    found = []
    for end, driven in zip(readings.ends, driven_ends(drives, readings), strict=True):
        steps = driven.positions - end.positions
        _ask_turns(truth.machine, readings, steps)
        found.append(with_steps(truth.machine, truth.errors(driven.positions, driven.directions), steps))
    return np.concatenate(found)


def driven_ends(drives: Drives, readings: ObservationSet) -> tuple[End, ...]:
    """Positions and directions of the drives for every row of a set, one `End` for each that it has."""
    ends, m = readings.ends, len(readings)
    order = _order(readings)
    q, way, tool = (np.stack([values[order] for values in part], axis=1) for part in zip(*ends, strict=True))
    q, way, tool = (values.reshape(m * len(ends), -1) for values in (q, way, tool))
    moved = np.asarray(drives.command(q, tool, way))
    taken = directions_of_drives(q, moved, way)
    back = np.argsort(order)
    shaped = [values.reshape(m, len(ends), -1)[back] for values in (moved, taken)]
    return tuple(End(shaped[0][:, k], shaped[1][:, k], end.tool) for k, end in enumerate(ends))


def directions_of_drives(
    positions: Float[np.ndarray, "m axes"],
    driven: Float[np.ndarray, "m axes"],
    directions: Float[np.ndarray, "m axes"],
) -> Float[np.ndarray, "m axes"]:
    """Directions in which the drives arrive, (m, n_axes), for programmed and driven positions in the order of the programme.

    >>> rest, driven = np.zeros((4, 1)), np.array([[0.0], [0.002], [0.002], [0.001]])
    >>> directions_of_drives(rest, driven, rest - 1.0).ravel().tolist()
    [-1.0, 1.0, 1.0, -1.0]
    """
    step = np.diff(driven, axis=0, prepend=driven[:1])
    rests = (np.diff(positions, axis=0, prepend=np.inf) == 0.0) & (np.diff(directions, axis=0, prepend=np.inf) == 0.0)
    still = rests & (np.abs(step) <= NO_MOTION)
    own = np.where(rests, np.sign(step), directions)
    rows = np.where(still, 0, np.arange(len(positions))[:, None])  # the last row at which the direction was decided
    return np.take_along_axis(own, np.maximum.accumulate(rows, axis=0), axis=0)


def with_steps(
    machine: Machine, errors: Float[np.ndarray, "errors m"], steps: Float[np.ndarray, "m axes"]
) -> Float[np.ndarray, "errors m"]:
    """Errors that put every body where it is when each axis stands `steps` farther, (6·(n_axes + 1), m); see the module.

    Args:
        machine: The machine.
        errors: Error values where the axes stand, shape (6·(n_axes + 1), m) [mm, rad].
        steps: How far the axes stand from the programmed positions, shape (m, n_axes) [mm or °].
    """
    out = errors.copy()
    for i, axis in enumerate(machine.axes):
        rows = slice(ROWS * i, ROWS * (i + 1))
        if steps[:, i].any():
            out[rows] = _with_step(axis, errors[rows].T, steps[:, i]).T
    return out


def _with_step(axis: Axis, errors: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The six errors (m, 6) of one axis with its step (m,): D' of the module's table, about the same error point."""
    e, turned = errors[:, :3] @ axis.frame.T, Rotation.from_rotvec(errors[:, 3:] @ axis.frame.T)
    point, step_last = np.asarray(axis.error_point), error_first(axis)
    if axis.is_linear:
        shift = step[:, None] * np.eye(3)[LINEAR_AXES.index(axis.letter)]
        moved = e + (shift if step_last else turned.apply(shift))
        return np.hstack([moved @ axis.frame, errors[:, 3:]])
    stepped = Rotation.from_rotvec(np.deg2rad(step)[:, None] * np.asarray(axis.unit_vector))
    centre = np.asarray(axis.point)
    if step_last:
        moved, both = centre + stepped.apply(point + e - centre) - point, stepped * turned
    else:
        moved, both = turned.apply(centre + stepped.apply(point - centre) - point) + e, turned * stepped
    return np.hstack([moved @ axis.frame, both.as_rotvec() @ axis.frame])


def _order(readings: ObservationSet) -> np.ndarray:
    """Numbers of the rows in the order in which they were approached."""
    time = readings.time
    if time is None or not np.isfinite(time).all():
        return np.arange(len(readings))
    return np.argsort(time, kind="stable")


def _ask_turns(machine: Machine, readings: ObservationSet, steps: np.ndarray) -> None:
    for i, axis in enumerate(machine.axes):
        row = int(np.argmax(np.abs(steps[:, i])))
        if not axis.is_linear and abs(steps[row, i]) > LARGEST_TURN:
            raise InputError(
                f"{readings.where(row)}: the compensation turns axis {axis.letter} by {steps[row, i]:.4g}°; expected at most "
                f"{LARGEST_TURN:g}°, to which the chain is exact. Keep out of poles (`poles`), or look for a wrong unit in the "
                "tables"
            )
