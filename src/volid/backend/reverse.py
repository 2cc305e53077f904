"""Reverse differentiation of the few operations a kinematic chain is made of, on NumPy arrays, without compilation.

Every operation on a `Recorded` array is noted with its partial derivatives; `gradients` goes back through the notes and adds
up, reading by reading: all arrays have one shape (m,), and entry i of a result depends on entries i of the operands alone.
Griewank and Walther, Evaluating Derivatives, 3.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np


class Recorded:
    """An array (m,) whose origin is noted: `sources` are (operand, partial derivative), the latter a number or (m,)."""

    __slots__ = ("adjoint", "notes", "sources", "value")
    __array_ufunc__ = None  # NumPy arrays leave operations with this class to it

    def __init__(self, value: Any, notes: list[Recorded], sources: tuple[tuple[Recorded, Any], ...] = ()) -> None:
        self.value, self.notes, self.sources = value, notes, sources
        self.adjoint: Any = None
        notes.append(self)

    @property
    def shape(self) -> tuple[int, ...]:
        """(m,)."""
        return np.shape(self.value)

    def _new(self, value: Any, *sources: tuple[Recorded, Any]) -> Recorded:
        return Recorded(value, self.notes, sources)

    def __add__(self, other: Any) -> Recorded:
        if isinstance(other, Recorded):
            return self._new(self.value + other.value, (self, 1.0), (other, 1.0))
        if isinstance(other, float) and other == 0.0:
            return self
        return self._new(self.value + other, (self, 1.0))

    __radd__ = __add__

    def __neg__(self) -> Recorded:
        return self._new(-self.value, (self, -1.0))

    def __sub__(self, other: Any) -> Recorded:
        if isinstance(other, Recorded):
            return self._new(self.value - other.value, (self, 1.0), (other, -1.0))
        if isinstance(other, float) and other == 0.0:
            return self
        return self._new(self.value - other, (self, 1.0))

    def __rsub__(self, other: Any) -> Recorded:
        return self._new(other - self.value, (self, -1.0))

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Recorded):
            return self._new(self.value * other.value, (self, other.value), (other, self.value))
        if isinstance(other, float) and other in (0.0, 1.0):
            return self if other else 0.0
        return self._new(self.value * other, (self, other))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Recorded:
        if isinstance(other, Recorded):
            return self * (1.0 / other)
        return self._new(self.value / other, (self, 1.0 / other))

    def __rtruediv__(self, other: Any) -> Recorded:
        quotient = other / self.value
        return self._new(quotient, (self, -quotient / self.value))

    def sqrt(self) -> Recorded:
        """Square root, derivative 1/(2 sqrt)."""
        root = np.sqrt(self.value)
        return self._new(root, (self, 0.5 / root))

    def cos_sin(self) -> tuple[Recorded, Recorded]:
        """Cosine and sine of an angle [rad], derivatives -sin and cos."""
        cosine, sine = np.cos(self.value), np.sin(self.value)
        return self._new(cosine, (self, -sine)), self._new(sine, (self, cosine))


def arctan2(y: Any, x: Any) -> Recorded:
    """Angle of (x, y) [rad], at least one of them recorded: ∂/∂y = x/(x² + y²), ∂/∂x = -y/(x² + y²)."""
    recorded = [part for part in (y, x) if isinstance(part, Recorded)]
    v, u = (part.value if isinstance(part, Recorded) else part for part in (y, x))
    square = u * u + v * v
    partials = [p for p, part in ((u / square, y), (-v / square, x)) if isinstance(part, Recorded)]
    return Recorded(np.arctan2(v, u), recorded[0].notes, tuple(zip(recorded, partials, strict=True)))


def gradients(
    result: Any, leaves: list[Recorded], m: int, seed: Any = 1.0, rows: np.ndarray | None = None
) -> np.ndarray:
    """Partial derivatives of `result`, a recorded array, with respect to `leaves`, times `seed`: shape (len(leaves), m).

    `rows`: an array to write them into.
    """
    rows = np.empty((len(leaves), m)) if rows is None else rows
    if not isinstance(result, Recorded):
        rows[:] = 0.0
        return rows
    for note in result.notes:
        note.adjoint = None
    result.adjoint = seed
    for note in reversed(result.notes):
        if note.adjoint is None:
            continue
        for source, partial in note.sources:
            share = note.adjoint if isinstance(partial, float) and partial == 1.0 else note.adjoint * partial
            source.adjoint = share if source.adjoint is None else source.adjoint + share
    for row, leaf in zip(rows, leaves, strict=True):
        row[:] = 0.0 if leaf.adjoint is None else leaf.adjoint
    return rows
