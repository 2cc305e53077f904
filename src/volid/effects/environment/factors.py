"""By what factor the lengths of a set are too long for the air and the temperatures at which they were read.

    reading in vacuum wavelengths = given · reading,     path in air at 20 °C = (path in vacuum wavelengths) / factor

of light: factor = n(t) · (1 + α_m (T_m(t) - 20 °C)), n the refractive index, α_m and T_m of the machine's scales; n = 1 where
the instrument has corrected already. `given` is the refractive index by which the instrument has divided, 1 where it has not.
Of an artefact that is as long as calibrated at 20 °C: factor = (1 + α_m (T_m - 20 °C)) / (1 + α_a (T_a - 20 °C)).
ISO 1; ISO 230-2 3 (readings are referred to 20 °C); Ciddor (1996).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from volid.campaign import AIR, Environment
from volid.effects.environment.ciddor import U_FORMULA, refractivity
from volid.effects.environment.matching import OWN, Matched, at_readings, column_of
from volid.observations.base import LIGHT

REFERENCE_TEMPERATURE = 20.0  # °C, ISO 1
INDEX = "refractive_index"
TYPICAL_U = {
    "air_temperature_C": 0.1,
    "pressure_hPa": 0.3,
    "humidity_percent": 5.0,
}  # of the sensors of a compensation unit
SIGN = {"machine": 1, "artefact": -1}


class Factors(NamedTuple):
    """Factors of a set of m rows.

    `factor`: (m,). `mean`: the same for the mean of the log, one number for all parts of a set. `given`: as above.
    `refractivity`: n - 1 of the air, (m,), also where the instrument has corrected; None without light or air. `temperatures`:
    of the bodies, (m,) [°C].
    """

    factor: np.ndarray
    mean: float
    given: float
    refractivity: np.ndarray | None
    temperatures: Mapping[str, np.ndarray]


def factors_of(match: Matched) -> Factors:
    """Factors of a set in its environment. Raises `InputError` for readings for which the log has no entry."""
    environment = match.environment
    factor, mean, index = np.ones(len(match.observations)), 1.0, None
    if match.medium == LIGHT and environment.has_air:
        index = index_of(environment, lambda column: at_readings(match, column))
        if not environment.corrected:
            factor, mean = 1.0 + index, float(1.0 + index_of(environment, lambda column: mean_of(environment, column)))
    temperatures = {name: at_readings(match, column_of(environment, body)) for name, body in match.bodies.items()}
    for name, body in match.bodies.items():
        grown = 1.0 + body.expansion * (temperatures[name] - REFERENCE_TEMPERATURE)
        around = 1.0 + body.expansion * (mean_of(environment, column_of(environment, body)) - REFERENCE_TEMPERATURE)
        factor, mean = factor * grown ** SIGN[name], mean * around ** SIGN[name]
    return Factors(factor, mean, given_index(environment) if index is not None else 1.0, index, temperatures)


def index_of(environment: Environment, value: Callable[[str], np.ndarray | float]) -> np.ndarray:
    """n - 1 of the air, `value` giving each of its columns."""
    temperature, pressure, humidity = (value(column) for column in AIR)
    light = {"wavelength": environment.wavelength, "co2": environment.co2}
    return refractivity(temperature, pressure, humidity, **light, group=environment.group)


def mean_of(environment: Environment, column: str) -> float:
    """Mean of a column of the log; 20 °C for one of the readings' own."""
    return REFERENCE_TEMPERATURE if column == OWN else float(np.nanmean(environment.log[column]))


def given_index(environment: Environment) -> float:
    """The refractive index by which the instrument has divided, where it is to be undone; else 1."""
    if not environment.at:
        return 1.0
    if INDEX in environment.at:
        return float(environment.at[INDEX])
    return float(1.0 + index_of(environment, lambda column: float(environment.at[column])))


def u_of_index(environment: Environment, u: Mapping[str, float]) -> float:
    """Standard uncertainty of the refractive index: that of the columns of air, by central differences, and of the formula."""
    variance = U_FORMULA**2
    for column in AIR:
        step = u.get(column, 0.0)
        here = {name: mean_of(environment, name) for name in AIR}
        ends = [
            index_of(environment, {**here, column: here[column] + d}.__getitem__) for d in (-0.5 * step, 0.5 * step)
        ]
        variance += float(ends[1] - ends[0]) ** 2
    return float(np.sqrt(variance))
