"""The records that a solution consists of: deviations, values of functions, statistics and residuals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from volid.fitting.diagnosis.adequacy import SuspectReading

if TYPE_CHECKING:
    from jaxtyping import Bool, Float


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
    """One row of the table of error functions [mm or rad]: location errors have position NaN; NaN is what is not determined."""

    name: str
    axis: str
    position: float
    direction: int
    value: float
    u: float


class Statistics(NamedTuple):
    """Numbers about the fit: readings used, free parameters, RMS of the residuals by set [reading's unit], iterations.

    `held_out_weight`: RMS of readings predicted without them over what is expected of it, in the search for the resolution; NaN
    where all resolutions are stated.
    """

    n_readings: int
    n_parameters: int
    residual_rms: Mapping[str, float]
    iterations: int
    converged: bool
    held_out_weight: float = float("nan")


@dataclass(frozen=True, eq=False)
class Residuals:
    """What is left of every reading after the fit, one array (m, k) per set.

    `residuals`: reading - predicted. `normalised`: residual / (u sqrt(1 - h)). `outliers`: set aside by the robust fit, named
    in `outlier_readings`. `held_out`: reading - prediction by the fit to all other rotary positions, NaN where one of
    them alone determines something; empty without rotary axes.
    """

    residuals: tuple[np.ndarray, ...]
    normalised: tuple[np.ndarray, ...]
    outliers: tuple[np.ndarray, ...]
    outlier_readings: tuple[SuspectReading, ...] = ()
    held_out: tuple[np.ndarray, ...] = ()


def read_only(values: Any) -> np.ndarray:
    """As NumPy array that cannot be written to."""
    kept = np.array(values, dtype=float)
    kept.setflags(write=False)
    return kept
