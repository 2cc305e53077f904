"""What a machine really does: smooth functions that are no splines, constants, reversal, cross effects."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Smooth:
    """f(q) = sum_k amplitude_k sin(2 pi frequency_k q + phase_k) + sum_j coefficient_j ((q - centre) / width)^j."""

    amplitude: np.ndarray
    frequency: np.ndarray  # cycles per mm or degree
    phase: np.ndarray
    coefficient: np.ndarray
    centre: float = 0.0
    width: float = 1.0

    def __call__(self, q) -> np.ndarray:
        q = np.asarray(q, float)
        waves = np.sin(2 * np.pi * q[..., None] * self.frequency + self.phase) @ self.amplitude
        return waves + np.polynomial.polynomial.polyval((q - self.centre) / self.width, self.coefficient)

    def plus(self, constant: float = 0.0, slope: float = 0.0) -> "Smooth":
        """The function f(q) + constant + slope (q - centre)."""
        coefficient = np.append(self.coefficient, np.zeros(max(0, 2 - len(self.coefficient))))
        coefficient[:2] += constant, slope * self.width
        return Smooth(self.amplitude, self.frequency, self.phase, coefficient, self.centre, self.width)

    def plus_first_harmonic(self, cosine: float, sine: float) -> "Smooth":
        """The function f(q) + cosine cos(q) + sine sin(q), q in degrees."""
        return Smooth(
            np.append(self.amplitude, [cosine, sine]),
            np.append(self.frequency, [1 / 360, 1 / 360]),
            np.append(self.phase, [np.pi / 2, 0.0]),
            self.coefficient,
            self.centre,
            self.width,
        )

    def times(self, factor: float) -> "Smooth":
        """The function factor f(q)."""
        return Smooth(
            factor * self.amplitude, self.frequency, self.phase, factor * self.coefficient, self.centre, self.width
        )


@dataclass(frozen=True)
class Product:
    """Cross effect f(q, other) = own(q) across(other)."""

    own: Callable
    across: Callable

    def __call__(self, q, other) -> np.ndarray:
        return self.own(q) * self.across(other)


@dataclass
class Truth:
    """What the machine really does; every name is ISO 230-1's, every absent name is zero.

    functions: name -> f(q_own). cross: name -> (other axis, f(q_own, q_other)), added to `functions`.
    constants: EC0Y, EX0C, EA0S, ... reversal: name -> B(q_own), E(q, +-) = E(q) +- B(q)/2. [mm, rad]
    """

    functions: dict[str, Callable] = field(default_factory=dict)
    constants: dict[str, float] = field(default_factory=dict)
    reversal: dict[str, Callable] = field(default_factory=dict)
    cross: dict[str, tuple[str, Callable]] = field(default_factory=dict)
