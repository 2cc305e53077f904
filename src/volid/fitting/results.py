"""The records that a solution consists of: deviations, values of functions, statistics and residuals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from volid.fitting.diagnosis.adequacy import SuspectReading

if TYPE_CHECKING:
    from jaxtyping import Bool, Float


PARAMETERS = ("size", "length", "change", "length of change")  # of a function's smoothness, as far as it has them


class Deviations(NamedTuple):
    """Deviations at m points, machine frame.

    `values` and `u`: translations and rotations with standard uncertainties [mm, rad], NaN where not determined.
    `outside`: True where a position lies outside what was measured. `rigid`: True where the value is known up to a rigid motion
    of the workpiece frame only (see `volid.fitting.prediction.determination`).
    """

    values: Float[np.ndarray, "m 6"]
    u: Float[np.ndarray, "m 6"]
    determined: Bool[np.ndarray, "m 6"]
    outside: Bool[np.ndarray, " m"]
    rigid: Bool[np.ndarray, " m"] | None = None


class FunctionValue(NamedTuple):
    """One row of the table of error functions [mm or rad]. A location error has position NaN; values not determined are NaN."""

    name: str
    axis: str
    position: float
    direction: int
    value: float
    u: float


class Statistics(NamedTuple):
    """Numbers about the fit: readings used, free parameters, RMS of the residuals by set [reading's unit], iterations."""

    n_readings: int
    n_parameters: int
    residual_rms: Mapping[str, float]
    iterations: int
    converged: bool


@dataclass(frozen=True, eq=False)
class SmoothPrior:
    """What a fit assumes of the smoothness of error functions, as it was estimated from the readings.

    `names`: of the parameters, such as "EXX size" [mm or rad] and "EXX length" (of the range); `values`, `u`: their logarithms
    φ and standard uncertainties. `root` W (r, n): pseudo-readings W θ = 0 with unit variance. `noise` G (r, h): because φ is
    uncertain, their covariance is 1 + G Gᵀ; `spread` (n + k, h): what G brings to the unknowns (θ, ν), so that `covariance` of
    the solution is the inverse of JᵀJ plus `spread` · `spread`ᵀ. `scatter`: standard deviation of what is independent from
    position to position, by positioning function [mm]; part of the readings' u in the fit, and of every u of a deviation.
    """

    names: tuple[str, ...]
    values: np.ndarray
    u: np.ndarray
    root: np.ndarray
    noise: np.ndarray
    spread: np.ndarray
    scatter: Mapping[str, float] = field(default_factory=dict)

    @property
    def functions(self) -> frozenset[str]:
        """Symbols of the error motions whose smoothness was estimated, short waves and reversal aside."""
        labels = (name.removesuffix(" size") for name in self.names if name.endswith(" size"))
        return frozenset(n for label in labels if " " not in label for n in label.split("+"))

    def of(self, label: str) -> np.ndarray:
        """φ of the process of that label, in the order of its parameters; empty for one that was not estimated."""
        return np.array([v for n, v in zip(self.names, self.values, strict=True) if _label(n) == label])

    def mapped(self, inverse: np.ndarray | None, full: np.ndarray, n: int) -> SmoothPrior:
        """For unknowns x' = `full` · x, with θ = `inverse` · θ' (n,); None: θ does not follow from θ', and no rows are left."""
        if inverse is None:
            return replace(self, root=np.zeros((0, n)), noise=np.zeros((0, 0)), spread=np.zeros((len(full), 0)))
        return replace(self, root=read_only(self.root @ inverse), spread=read_only(full @ self.spread))


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of every reading after the fit, one array (m, k) per set.

    `residuals`: reading - predicted. `normalised`: residual / (u sqrt(1 - h)). `outliers`: set aside by the robust fit, named
    in `outlier_readings`. `held_out`: reading - prediction by the fit to all other rotary positions, NaN where one position
    alone determines a combination of the parameters; empty without rotary axes.
    """

    residuals: tuple[np.ndarray, ...]
    normalised: tuple[np.ndarray, ...]
    outliers: tuple[np.ndarray, ...]
    outlier_readings: tuple[SuspectReading, ...] = ()
    held_out: tuple[np.ndarray, ...] = ()


def _label(name: str) -> str:
    """The functions that a parameter belongs to, and their part."""
    for what in PARAMETERS[::-1]:
        if name.endswith(f" {what}"):
            return name.removesuffix(f" {what}")
    return name


def read_only(values: Any) -> np.ndarray:
    """As NumPy array that cannot be written to."""
    kept = np.array(values, dtype=float)
    kept.setflags(write=False)
    return kept
