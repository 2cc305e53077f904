"""Sequential step diagonals: the nine displacement functions of three linear axes from steps along four body diagonals.

The tool goes along each diagonal in steps of X, then Y, then Z, and an interferometer with a flat mirror reads its displacement
along the diagonal, of unit vector d. A step of one axis, from q to q' in the sense s, changes the reading by

    Δreading - Δnominal = s d · (D(q') - D(q)),   D = (Dx, Dy, Dz) of this axis,

so every interval of an axis has three unknowns in one equation per diagonal, which least squares solve: the separation that was
published with this test. It is linear, D = M · readings, and u of D follows from u of the readings and of the set's effects
by M. Four equations for three unknowns leave one contradiction per interval,

    (PPP + NPP) - (PNP + PPN),

which errors of position and squareness do not touch: what it holds beyond noise comes from rotations of the axes or from a
mirror that is not square to its beam, and these leak into the nine functions too (`volid.standards.step_diagonals.leak`).

Dx(x) is positioning; Dy(x) and its like hold straightness, squareness and whatever rotations the readings saw. Reversal changes
readings where axes turn back, between the steps: the nine functions are those of the mean of both senses, and reversal values
cannot be separated. Not modelled: rotations of the axes, tilt of the mirror. C. Wang, Review of Scientific
Instruments 71 (2000) 3933 (the test); M. A. V. Chapman, Precision Engineering 27 (2003) 401 (what is not modelled).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from volid.exceptions import NotDeterminedError
from volid.model.iso230 import LINEAR_AXES
from volid.standards.shared_errors import own_variance, shared_columns
from volid.standards.step_diagonals.steps import Steps

if TYPE_CHECKING:
    from jaxtyping import Float

NAMES = tuple(f"D{c}({a})" for a in "xyz" for c in "xyz")


@dataclass(frozen=True, eq=False)
class NineFunctions:
    """The nine functions, by axis X, Y, Z.

    Args:
        steps: The steps that they were separated from.
        values: Values at the nodes of each axis, 0 at the first, shape (n + 1, 3) each [mm].
        maps: What each value takes from each reading, shape (n + 1, 3, m) each.
        contradictions: Root mean square of what the four diagonals leave of each interval, shape (n,) each [mm].
        expected: What noise alone would leave, likewise [mm].
    """

    steps: Steps
    values: tuple[Float[np.ndarray, "_ 3"], ...]
    maps: tuple[Float[np.ndarray, "_ 3 m"], ...]
    contradictions: tuple[Float[np.ndarray, " _"], ...]
    expected: tuple[Float[np.ndarray, " _"], ...]

    @cached_property
    def u(self) -> tuple[Float[np.ndarray, "_ 3"], ...]:
        """Standard uncertainties of `values` from those of the readings and the set's effects, (n + 1, 3) each [mm]."""
        return tuple(np.sqrt(self.variance(m)) for m in self.maps)

    def variance(self, rows: np.ndarray) -> np.ndarray:
        """Variance of linear combinations `rows` (…, m) of the readings, (…,) [mm²]."""
        own, shared = self._errors
        return np.asarray((rows**2) @ own + np.sum((rows @ shared) ** 2, axis=-1))

    @cached_property
    def _errors(self) -> tuple[np.ndarray, np.ndarray]:
        """Variance of each reading by itself, (m,), and errors that readings share, (m, k)."""
        given = self.steps.observations, self.steps.campaign
        return own_variance(*given), shared_columns(*given)

    def of(self, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions, values and u of one function, such as "Dy(x)", (n + 1,) each [mm]."""
        axis, component = divmod(NAMES.index(name), 3)
        return self.steps.nodes[axis], self.values[axis][:, component], self.u[axis][:, component]

    def from_readings(self, readings: Float[np.ndarray, " m"]) -> tuple[np.ndarray, ...]:
        """The nine functions of other readings beyond the nominal ones (m,) of the same steps [mm]."""
        return tuple(rows @ readings for rows in self.maps)


def separate(steps: Steps) -> NineFunctions:
    """The nine functions by least squares, interval by interval.

    Raises:
        NotDeterminedError: fewer than three diagonals that lie differently cross an interval.

    >>> len(NAMES), NAMES[:4]
    (9, ('Dx(x)', 'Dy(x)', 'Dz(x)', 'Dx(y)'))
    """
    noise = own_variance(steps.observations, steps.campaign)
    parts = [_of_axis(steps, axis, noise) for axis in range(len(LINEAR_AXES))]
    values = tuple(rows @ steps.beyond_nominal for rows, _, _ in parts)
    maps, contradictions, expected = (tuple(p[i] for p in parts) for i in range(3))
    return NineFunctions(steps, values, maps, contradictions, expected)


def _of_axis(steps: Steps, axis: int, noise_of: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The map of one axis (n + 1, 3, m), the RMS contradiction of each interval, and that of noise alone, (n,) [mm]."""
    own = steps.observations
    increments = np.zeros((len(steps.nodes[axis]) - 1, 3, len(own)))
    found, noise = np.zeros(len(increments)), np.zeros(len(increments))
    for i, rows in enumerate(steps.of_axis(axis)):
        design = steps.sense[rows, None] * steps.along[rows]
        if np.linalg.matrix_rank(design, tol=1e-3) < 3:
            raise NotDeterminedError(
                f"set '{own.name}': {len(rows)} steps of {LINEAR_AXES[axis]} from {steps.nodes[axis][i]:g} to "
                f"{steps.nodes[axis][i + 1]:g} mm do not determine three functions; expected steps on all four body diagonals"
            )
        inverse = np.linalg.pinv(design)
        increments[i] = inverse @ (_picked(steps.last[rows], len(own)) - _picked(steps.first[rows], len(own)))
        left = np.eye(len(rows)) - design @ inverse
        change = steps.beyond_nominal[steps.last[rows]] - steps.beyond_nominal[steps.first[rows]]
        variance = noise_of[steps.last[rows]] + noise_of[steps.first[rows]]
        found[i] = np.sqrt(np.mean((left @ change) ** 2))
        noise[i] = np.sqrt(np.mean(left**2 @ variance))
    return np.concatenate([np.zeros((1, *increments.shape[1:])), np.cumsum(increments, axis=0)]), found, noise


def _picked(rows: np.ndarray, m: int) -> np.ndarray:
    """The matrix (k, m) that takes `rows` (k,) from m readings."""
    found = np.zeros((len(rows), m))
    found[np.arange(len(rows)), rows] = 1.0
    return found
