"""What one axis of a control is moved by, over the position of an axis.

A control without a kinematic model adds to the command of one axis a correction that depends on the position of one axis, its own
(pitch table) or another one (cross table). Some controls multiply two such tables, so that a rotation can act through a lever arm
that grows with a third axis:

    deviation of the output axis = f(argument) · g(factor axis).

Not modelled: what the control does between two directions (its ramp at reversal).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from volid.compensation.grids.interpolation import into_period

if TYPE_CHECKING:
    from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class Factor:
    """What the value of an `AxisTable` is multiplied by: a function of a further axis, linear between its positions.

    Args:
        axis: Letter of the axis.
        positions: Rising positions of that axis, shape (k,) [mm or °].
        values: Factors there, shape (k,) [mm for a lever arm, else 1].

    >>> Factor("Z", np.array([-500.0, 0.0]), np.array([-500.0, 0.0])).at(np.array([-250.0])).tolist()
    [-250.0]
    """

    axis: str
    positions: Float[np.ndarray, " k"]
    values: Float[np.ndarray, " k"]

    def at(self, positions: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """The factor at positions of the axis, shape (m,) [mm or °]; end values are held outside."""
        return np.asarray(np.interp(positions, self.positions, self.values))


@dataclass(frozen=True, eq=False)
class AxisTable:
    """Deviation that a control expects of one axis, over the position of an axis.

    Args:
        output: Letter of the axis that is moved.
        argument: Letter of the axis whose position is looked up.
        positions: Rising positions of the argument, shape (n,) [mm or °].
        forward, reverse: ERROR values (actual - nominal) of the output axis for motion of the argument in + and in -, shape (n,);
            in mm for a linear output axis, in rad for a rotary one; with a `factor` that is a lever arm, in rad.
        factor: What the value is multiplied by; None: nothing.
        source: The error functions that it holds, such as "EXY" or "EAY".
        period: 360 where the positions close a full turn, else 0 [°].
        notes: What else a user should know.

    >>> x, e = np.array([0.0, 100.0]), np.array([0.0, 0.010])
    >>> table = AxisTable("X", "X", x, e, e - 0.002)
    >>> table.at({"X": np.array([50.0, 50.0, 50.0])}, {"X": np.array([1.0, -1.0, 0.0])}).round(6).tolist()
    [0.005, 0.003, 0.004]
    """

    output: str
    argument: str
    positions: Float[np.ndarray, " n"]
    forward: Float[np.ndarray, " n"]
    reverse: Float[np.ndarray, " n"]
    factor: Factor | None = None
    source: str = ""
    period: float = 0.0
    notes: tuple[str, ...] = field(default_factory=tuple)

    @property
    def is_pitch(self) -> bool:
        """Whether the axis corrects itself by its own position."""
        return self.output == self.argument and self.factor is None

    @property
    def has_reversal(self) -> bool:
        """Whether the direction of the argument's motion matters."""
        return bool(np.any(self.forward != self.reverse))

    @property
    def mean(self) -> Float[np.ndarray, " n"]:
        """Mean of both directions, shape (n,) [mm or rad]."""
        return np.asarray(0.5 * (self.forward + self.reverse))

    @property
    def reversal_value(self) -> float:
        """Mean over the positions of B = E(+) - E(-), error sense [mm or rad]."""
        return float(np.mean(self.forward - self.reverse))

    def of_argument(
        self, positions: Float[np.ndarray, " m"], direction: Float[np.ndarray, " m"]
    ) -> Float[np.ndarray, " m"]:
        """f(argument) alone, without the factor, shape (m,); `direction`: +1, -1, or 0 for the mean of both."""
        x = into_period(np.asarray(positions, dtype=float), self.positions[0], self.positions[-1], self.period)
        up, down = (np.interp(x, self.positions, v) for v in (self.forward, self.reverse))
        return np.asarray(0.5 * (up + down) + 0.5 * np.sign(direction) * (up - down))

    def at(
        self, positions: Mapping[str, Float[np.ndarray, " m"]], direction: Mapping[str, Float[np.ndarray, " m"]]
    ) -> Float[np.ndarray, " m"]:
        """Expected deviation of the output axis, shape (m,) [mm or rad], by linear interpolation, end values held outside.

        Args:
            positions: Positions by axis letter, shape (m,) each [mm or °].
            direction: Directions of motion by axis letter, shape (m,) each: +1, -1, or 0 for the mean of both.
        """
        value = self.of_argument(positions[self.argument], direction[self.argument])
        return value if self.factor is None else value * self.factor.at(positions[self.factor.axis])
