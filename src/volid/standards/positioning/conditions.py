"""What makes a positioning test uncertain: instrument, alignment, temperature, drift, set-up.

| condition | what it adds to deviation X_ij at target p_i | acts on |
|---|---|---|
| device at a target | one number per target, alike in all runs | E, A, M |
| device per length | factor · (p_i - p_1) | E, A, M |
| misalignment, angle γ within ± `misalignment` | -γ²/2 · (p_i - p_1): the beam's path is longer than the axis's | E, A, M |
| temperature of the machine's scale or workpiece | (α δT + (T - 20 °C) δα) (p_i - p_1) | E, A, M |
| drift "independent" | anew at every approach within a range | all, R most |
| drift "linear" | evenly from the first approach to the last, runs up and down in turn | all |
| set-up | one number per run, there and back | R, A |
| noise | anew at every approach, normal | all, R most |

Not modelled: a squareness of the measuring line that depends on another axis, an instrument's hysteresis. Source: the
contributions that ISO/TR 230-9 and the annex of ISO 230-2 name (recalled); for the drift test ISO 230-3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from volid.exceptions import InputError
from volid.standards.positioning.runs import DOWN, PositioningRuns
from volid.standards.positioning.uncertainty import Contribution

INDEPENDENT, LINEAR = "independent", "linear"
FORMS = (INDEPENDENT, LINEAR)
REFERENCE = 20.0  # °C, ISO 1


@dataclass(frozen=True)
class Conditions:
    """Conditions of a test; what is 0 adds nothing. Standard uncertainties, but for the two that are half widths or ranges.

    Args:
        device: Of the instrument at every target [mm or degrees].
        device_scale: Of the instrument's scale, a ratio (mm/mm).
        misalignment: Half width of the angle between measuring line and axis [rad]; linear axes only.
        temperature_u: Of the temperature at which lengths are reduced to 20 °C [K].
        temperature: That temperature [°C].
        expansion: Coefficient by which they are reduced [1/K].
        expansion_u: Of that coefficient [1/K].
        drift: Range of the drift during the test (environmental variation) [mm or degrees].
        drift_form: "independent" or "linear".
        setup: Of what each run has in common [mm or degrees].
        noise: Of a single reading [mm or degrees].

    >>> runs = PositioningRuns("X", np.array([0.0, 1000.0]), np.zeros((2, 2, 5)))
    >>> [c.name for c in contributions_of(Conditions(device_scale=3e-7, drift=1e-3), runs)]
    ["the instrument's scale", 'drift']
    """

    device: float = 0.0
    device_scale: float = 0.0
    misalignment: float = 0.0
    temperature_u: float = 0.0
    temperature: float = REFERENCE
    expansion: float = 0.0
    expansion_u: float = 0.0
    drift: float = 0.0
    drift_form: str = INDEPENDENT
    setup: float = 0.0
    noise: float = 0.0


def contributions_of(conditions: Conditions, runs: PositioningRuns) -> tuple[Contribution, ...]:
    """What the conditions add to the deviations of `runs`.

    Raises `InputError` for a rotary axis with a misalignment or a temperature, which change lengths.
    """
    c, (t, _, n) = conditions, runs.deviations.shape
    if runs.is_rotary and (c.misalignment or c.temperature_u or c.expansion_u):
        raise InputError(
            f"axis {runs.axis} is rotary; misalignment and temperature of a test change lengths; state only device, drift, "
            "setup and noise"
        )
    way = (runs.targets - runs.targets[0])[:, None, None]
    warm = c.temperature - REFERENCE
    draws = (
        ("the instrument at each target", c.device, lambda g, k: g.standard_normal((k, t, 1, 1))),
        ("the instrument's scale", c.device_scale, lambda g, k: g.standard_normal((k, 1, 1, 1)) * way),
        ("misalignment", 0.5 * c.misalignment**2, lambda g, k: -(g.uniform(-1.0, 1.0, (k, 1, 1, 1)) ** 2) * way),
        ("temperature", c.expansion * c.temperature_u, lambda g, k: g.standard_normal((k, 1, 1, 1)) * way),
        ("expansion coefficient", abs(warm) * c.expansion_u, lambda g, k: g.standard_normal((k, 1, 1, 1)) * way),
        ("drift", c.drift, lambda g, k: _drift(g, k, runs, c.drift_form)),
        ("set-up of a run", c.setup, lambda g, k: g.standard_normal((k, 1, 1, n))),
        ("noise of readings", c.noise, lambda g, k: g.standard_normal((k, t, 2, n))),
    )
    return tuple(Contribution(name, _times(size, draw)) for name, size, draw in draws if size > 0.0)


def _times(size: float, draw):  # type: ignore[no-untyped-def]
    return lambda rng, trials: size * draw(rng, trials)


def _drift(rng: np.random.Generator, trials: int, runs: PositioningRuns, form: str) -> np.ndarray:
    """Drift of a range of 1, (trials, t, 2, n): within ± 1/2 at every approach, or from 0 to ± 1 at the last one."""
    if form == INDEPENDENT:
        return rng.uniform(-0.5, 0.5, (trials, *runs.deviations.shape))
    return rng.uniform(-1.0, 1.0, (trials, 1, 1, 1)) * passed(runs)


def passed(runs: PositioningRuns) -> np.ndarray:
    """Share of the test that has passed at each approach, (t, 2, n): each run goes up and comes back down."""
    t, _, n = runs.deviations.shape
    at = np.arange(t)
    there_and_back = np.stack([at, 2 * t - 1 - at], axis=1) if DOWN in runs.directions else np.stack([at, at], axis=1)
    length = t * len(runs.directions)
    order = there_and_back[:, :, None] + length * np.arange(n)
    return np.asarray(order / max(length * n - 1, 1))
