"""One error function as a control holds it: positions, values approached from both sides, layout of ISO/TR 16907 Table 1."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from volid.compensation.grids.interpolation import into_period
from volid.compensation.smoothing import weights
from volid.model.iso230 import parse

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

MODEL, ITSELF = "kinematic model", "the axis itself"
COLUMNS, VALUE, DIFFERENCE = "columns", "value", "difference"


@dataclass(frozen=True, eq=False)
class ErrorTable:
    """One error function as a control holds it.

    Args:
        type: the compensation types whose effects it holds.
        function: ISO 230-1 symbol.
        positions: Rising positions of the axis, shape (n,) [mm or °].
        forward: ERROR values approached in +, shape (n,) [mm or rad].
        reverse: ERROR values approached in -, shape (n,) [mm or rad].
        u: Standard uncertainties of `forward` and `reverse`, shape (n, 2) [mm or rad].
        outside: True where a position lies outside what was measured, shape (n,).
        applied: "kinematic model" or "the axis itself".
        interpolation: largest deviation of linear interpolation between the points [mm or rad].
        basis: The lines, the tool vector or the elevation that the table is based on, in words.
        zero: where values are zero, in words.
        datum: The datum in words.
        period: 360 for a full turn, else 0 [°].
        notes: what else a user should know.

    >>> import numpy as np
    >>> x, e = np.array([0.0, 100.0]), np.array([0.0, 0.010])
    >>> table = ErrorTable("L-POS", "EXX", x, e, e - 0.002, np.zeros((2, 2)), x > 100.0, "kinematic model", 0.0)
    >>> table.at(np.array([50.0, 50.0, 50.0]), np.array([1.0, -1.0, 0.0])).round(6).tolist()
    [0.005, 0.003, 0.004]
    """

    type: str
    function: str
    positions: Float[np.ndarray, " n"]
    forward: Float[np.ndarray, " n"]
    reverse: Float[np.ndarray, " n"]
    u: Float[np.ndarray, "n 2"]
    outside: Bool[np.ndarray, " n"]
    applied: str
    interpolation: float
    basis: Mapping[str, str] = field(default_factory=dict)
    zero: str = ""
    datum: str = ""
    period: float = 0.0
    notes: tuple[str, ...] = ()

    @property
    def axis(self) -> str:
        """Letter of the axis whose position the control looks up; S for a constant of the tool frame."""
        return parse(self.function).axis

    @property
    def has_reversal(self) -> bool:
        """Whether the approach direction matters."""
        return bool(np.any(self.forward != self.reverse))

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return parse(self.function).unit

    def at(
        self, positions: Float[np.ndarray, " m"], direction: Float[np.ndarray, " m"], smoothing: float = 0.0
    ) -> Float[np.ndarray, " m"]:
        """Error values by linear interpolation, as a control finds them.

        Outside its positions a table keeps its end values.

        Args:
            positions: Positions of the axis, shape (m,) [mm or °].
            direction: Direction of approach, shape (m,): +1, -1, or 0 when unknown, for the mean of both.
            smoothing: Length over which the control averages, see `volid.compensation.smoothing` [mm or °].

        Returns:
            Error values, shape (m,) [mm or rad].
        """
        if smoothing:
            share = weights(self.positions, np.asarray(positions, dtype=float), smoothing, self.period)
            up, down = share @ self.forward, share @ self.reverse
            return np.asarray(0.5 * (up + down) + 0.5 * np.sign(direction) * (up - down))
        x = into_period(np.asarray(positions, dtype=float), self.positions[0], self.positions[-1], self.period)
        up, down = (np.interp(x, self.positions, v) for v in (self.forward, self.reverse))
        return np.asarray(0.5 * (up + down) + 0.5 * np.sign(direction) * (up - down))

    def table_1(
        self, reversal: str = COLUMNS, *, errors: bool = False
    ) -> tuple[tuple[str, ...], Float[np.ndarray, "n columns"]]:
        """The table of ISO/TR 16907, Table 1: columns such as X, EXX(+), EXX(-); one row per position.

        Args:
            reversal: "columns" for both directions, "difference" for EXX(+) and in a second column the reversal alone, which is
                added for motion in -, E(-) - E(+) (9.2.3), "value" for the mean alone (its one reversal value is
                `reversal_value`, of the other sign: ISO 230-2).
            errors: error values instead of compensation values.

        Returns:
            Names of the columns, and the numbers, shape (n, number of columns) [mm or °, then mm or rad].
        """
        sign = 1.0 if errors else -1.0
        up, down, f = sign * self.forward, sign * self.reverse, self.function
        if not self.has_reversal:
            return (self.axis, f), np.column_stack([self.positions, up])
        if reversal == COLUMNS:
            return (self.axis, f"{f}(+)", f"{f}(-)"), np.column_stack([self.positions, up, down])
        if reversal == DIFFERENCE:
            return (self.axis, f"{f}(+)", added_in_minus(f)), np.column_stack([self.positions, up, down - up])
        return (self.axis, f), np.column_stack([self.positions, 0.5 * (up + down)])

    @property
    def reversal_value(self) -> float:
        """Mean over the positions of B = E(+) - E(-), error sense [mm or rad]."""
        return float(np.mean(self.forward - self.reverse))

    @property
    def reversal_loss(self) -> float:
        """What one reversal value instead of two columns leaves: largest |B - mean B| / 2 [mm or rad]."""
        return float(np.abs(self.forward - self.reverse - self.reversal_value).max() / 2.0)


def added_in_minus(function: str) -> str:
    """Name of the column of reversal that is added for motion in -: "EXX(-)-EXX(+)"."""
    return f"{function}(-)-{function}(+)"


def with_one_reversal(table: ErrorTable) -> ErrorTable:
    """The table of a control that has one reversal value for the entire axis."""
    mean, half = 0.5 * (table.forward + table.reverse), 0.5 * table.reversal_value
    return replace(table, forward=mean + half, reverse=mean - half)
