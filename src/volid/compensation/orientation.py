"""Orientation corrected by rotary axes (type FOR): damped inverse kinematics, and the poles where it cannot work.

The spindle turns about the tool axis k, so only the two components of the orientation error ω across k matter. With a_i the
directions of the rotary axes and P = I - k kᵀ, the turns are δ = -(P A)⁺ ω. Where a singular value s of P A vanishes, a
*kinematic pole*, a rotary axis stands parallel to the spindle: no axis turns the tool about one direction, and close by the
turns asked for grow like 1/s. There the pseudo-inverse is damped, s/(s² + λ²) with λ² = (s₀/2)² (1 - (s/s₀)²) for s < s₀ =
sin(margin); outside it is exact. Nakamura and Hanafusa 1986; Chiaverini 1997.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from volid.compensation.grids.sides import full_positions
from volid.exceptions import InputError
from volid.model.jacobian import axis_directions
from volid.model.kinematics import side_rotation
from volid.model.machine import Machine

LIMIT, KEEP_OUT = "limit", "keep out"
SPINDLE_AXIS = np.array([0.0, 0.0, 1.0])  # ISO 841: Z lies along the spindle
_SCAN = 1.0  # degrees, of the search for poles
_POLE = 0.03  # singular value below which a scanned place, half a step beside a pole at worst, is looked at


@dataclass(frozen=True)
class PoleRule:
    """What a control does near a pole.

    `margin`: angle between rotary axis and spindle below which it begins [°]. `mode`: "limit" damps the turns, "keep out" leaves
    the direction of the pole uncorrected. Raises `InputError` for another mode or a margin beyond 0 … 45.
    """

    margin: float = 5.0
    mode: str = LIMIT

    def __post_init__(self) -> None:
        if self.mode not in (LIMIT, KEEP_OUT):
            raise InputError(f"`poles={self.mode}`; expected '{LIMIT}' or '{KEEP_OUT}'")
        if not 0.0 < self.margin <= 45.0:
            raise InputError(f"pole margin {self.margin:g}; expected an angle above 0 and up to 45 degrees")

    def gain(self, s: np.ndarray) -> np.ndarray:
        """Inverse of singular values, damped or cut below sin(margin)."""
        limit = np.sin(np.deg2rad(self.margin))
        damping = np.where(s < limit, (0.5 * limit) ** 2 * (1.0 - (s / limit) ** 2), 0.0)
        safe = np.maximum(s, 1e-12)
        if self.mode == KEEP_OUT:
            return np.where(s < limit, 0.0, 1.0 / safe)
        return np.asarray(np.where(s < limit, s / (s**2 + np.maximum(damping, 1e-300)), 1.0 / safe))


@dataclass(frozen=True)
class Pole:
    """A kinematic pole: `position` of the axes that lead to it [°], the axis that stands parallel to the spindle there, and the
    machine-frame direction (3,) about which no rotary axis turns the tool."""

    position: tuple[tuple[str, float], ...]
    axis: str
    direction: tuple[float, float, float]

    def __str__(self) -> str:
        at = ", ".join(f"{letter} = {value:g}°" for letter, value in self.position)
        about = ", ".join(f"{v + 0.0:.3g}" for v in self.direction)
        return f"{at}: {self.axis} is parallel to the spindle; no axis turns the tool about ({about})"


def orientation_between(machine: Machine, commanded: np.ndarray, altered: np.ndarray) -> np.ndarray:
    """Rotation vector from the nominal orientation at `commanded` to that at `altered`, machine frame, (m, 3) [rad]."""
    table, head = (
        [side_rotation(machine, q, primed) for q in (commanded, altered)] for primed in (True, False)
    )  # of both positions
    before, after = table[0] @ head[0], table[1] @ head[1]
    from scipy.spatial.transform import Rotation  # slow to import, and few need it

    turn = Rotation.from_matrix(after @ before.transpose(0, 2, 1)).as_rotvec()
    return np.asarray(np.einsum("mji,mj->mi", table[0], turn))


def rotary_turns(
    machine: Machine, positions: np.ndarray, orientation: np.ndarray, rule: PoleRule, clamped: Sequence[str] = ()
) -> np.ndarray:
    """Turns of the rotary axes against an orientation error, (m, n_axes) [°], 0 for linear axes.

    `orientation`: rotation vector, machine frame (m, 3) [rad]. The component about the tool axis, and near a pole that about the
    pole's direction, stay. Axes `clamped` do not turn; the others do what they can alone.
    """
    rotary = [i for i, a in enumerate(machine.axes) if not a.is_linear]
    u, s, vt = _across(machine, positions, clamped)
    inverse = np.einsum("mri,mr,mjr->mij", vt, rule.gain(s), u)
    turns = np.zeros(positions.shape)
    turns[:, rotary] = -np.rad2deg(np.einsum("mij,mj->mi", inverse, orientation))
    return turns


def _across(
    machine: Machine, positions: np.ndarray, clamped: Sequence[str] = ()
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """SVD of P A, the axes' directions across the tool axis, 0 for clamped ones; the two largest singular values."""
    rotary = [i for i, a in enumerate(machine.axes) if not a.is_linear]
    free = np.array([machine.axes[i].letter not in clamped for i in rotary])
    directions = axis_directions(machine, positions)[:, :, rotary] * free
    k = side_rotation(machine, positions, False) @ SPINDLE_AXIS
    across = directions - k[:, :, None] * np.einsum("mi,mij->mj", k, directions)[:, None, :]
    u, s, vt = np.linalg.svd(across, full_matrices=False)
    return u[:, :, :2], s[:, :2], vt[:, :2]


def distance_from_pole(machine: Machine, positions: np.ndarray) -> np.ndarray:
    """Angle between the nearest-to-parallel rotary axis and the spindle as the pseudo-inverse feels it: asin of the smaller
    singular value, (m,) [°]."""
    return np.asarray(np.rad2deg(np.arcsin(np.clip(_across(machine, positions)[1][:, -1], 0.0, 1.0))))


def poles(machine: Machine) -> tuple[Pole, ...]:
    """Kinematic poles within the travel: named positions of the axis that leads there, by a scan of 1° and refinement."""
    found: list[Pole] = []
    for axis in (a for a in machine.axes if not a.is_linear):
        low, high = axis.travel
        q = np.union1d(np.linspace(low, high, int(np.ceil((high - low) / _SCAN)) + 1), np.clip([0.0], low, high))
        s = _across(machine, full_positions(machine, (axis.letter,), q[:, None]))[1][:, -1]
        if s.max() < _POLE:
            continue  # turning this axis alone does not leave the pole: another one leads there
        inner = np.pad(s, 1, constant_values=np.inf)
        for i in np.flatnonzero((s < _POLE) & (s <= inner[:-2]) & (s < inner[2:])):
            found += _refined(machine, axis.letter, q, int(i))
    return tuple(found)


def _refined(machine: Machine, letter: str, q: np.ndarray, i: int) -> list[Pole]:
    fine = np.linspace(q[max(i - 1, 0)], q[min(i + 1, len(q) - 1)], 2001)
    positions = full_positions(machine, (letter,), fine[:, None])
    u, s, _ = _across(machine, positions)
    best = int(np.argmin(s[:, -1]))
    if s[best, -1] > 1e-3:
        return []
    at = positions[best : best + 1]
    k = (side_rotation(machine, at, False) @ SPINDLE_AXIS)[0]
    rotary = [j for j, a in enumerate(machine.axes) if not a.is_linear]
    along = np.abs(axis_directions(machine, at)[0][:, rotary].T @ k)
    about = u[best, :, 1] * (1.0 if u[best, np.argmax(np.abs(u[best, :, 1])), 1] > 0 else -1.0)
    place = ((letter, round(float(fine[best]), 3) + 0.0),)
    x, y, z = np.round(about, 6).tolist()
    return [Pole(place, machine.axes[rotary[int(np.argmax(along))]].letter, (x, y, z))]
