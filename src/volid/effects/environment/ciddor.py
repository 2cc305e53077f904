"""Refractive index of air from its temperature, pressure, humidity and carbon dioxide, by Ciddor's equations.

    n - 1 = (ρ_a / ρ_axs) (n_axs - 1) + (ρ_w / ρ_ws) (n_ws - 1)

ρ_a and ρ_w are the densities of the dry part and of the water vapour of the air, ρ_axs and ρ_ws those at the conditions under
which the two refractivities were measured (dry air: 15 °C, 1013.25 hPa; water vapour: 20 °C, 13.33 hPa). Phase index, as fringe
counting sees it; not the group index of modulated light.

Range of the equations: 300 to 1690 nm, -40 to 100 °C, 800 to 1200 hPa, 0 to 100 % humidity, 0 to 2000 ppm carbon dioxide;
pressures down to 500 hPa are taken too. They agree with measured air to some 1e-8. Not modelled: other gases (1e-8 in 100 ppm
of hydrocarbons and more), gradients along the beam.

The group index is that of P. E. Ciddor and R. J. Hill, Applied Optics 38 (1999) 1663, by differences.

Source: P. E. Ciddor, "Refractive index of air: new equations for the visible and near infrared", Applied Optics 35 (1996) 1566,
equations 1 to 5 and appendices A to C; constants of the density after R. S. Davis, Metrologia 29 (1992) 67 (BIPM 1981/91).
"""

from __future__ import annotations

import numpy as np

from volid.campaign import CO2, HENE

GAS = 8.314510  # J/(mol K), as in the source
KELVIN = 273.15
STEP = 0.1  # nm, of differences over the wavelength: third derivatives leave less than 1e-12
U_FORMULA = 2e-8  # standard uncertainty of n in the air of a room, other gases included; 1e-8 is claimed for clean air

_DRY = (238.0185, 5792105.0, 57.362, 167917.0)  # µm⁻²: k0 to k3 of equation 1
_VAPOUR = (295.235, 2.6422, -0.032380, 0.004028)  # powers of µm⁻²: w0 to w3 of equation 3
_SATURATION = (1.2378847e-5, -1.9121316e-2, 33.93711047, -6.3431645e3)  # of T in K
_ENHANCEMENT = (1.00062, 3.14e-8, 5.6e-7)  # of p in Pa and t² in °C²


def refractivity(
    temperature: np.ndarray | float,
    pressure: np.ndarray | float,
    humidity: np.ndarray | float,
    *,
    wavelength: float = HENE,
    co2: float = CO2,
    group: bool = False,
) -> np.ndarray:
    """n - 1 of air, n the phase refractive index, by the formula of the module; or the group index n - λ dn/dλ.

    Args:
        temperature: Of the air, any shape [°C].
        pressure: Of the air, not reduced to sea level [hPa].
        humidity: Relative humidity [%].
        wavelength: In vacuum [nm].
        co2: Carbon dioxide [ppm].
        group: Whether n is the group index, for light that is modulated, as that of absolute distance meters.

    Returns:
        n - 1, of the common shape.

    Source: Ciddor (1996).

    >>> print(f"{refractivity(20.0, 1000.0, 0.0, wavelength=633.0):.4e}")  # 26824.4e-8 in the source
    2.6824e-04
    """
    t, p = np.asarray(temperature, dtype=float), 100.0 * np.asarray(pressure, dtype=float)
    water = vapour_fraction(t, p, np.asarray(humidity, dtype=float))
    amount = _amount(t, p, water)
    of_dry, of_water = (
        (1.0 - water) * amount / _amount(15.0, 101325.0, 0.0),
        water * amount / _amount(20.0, 1333.0, 1.0),
    )

    def at(length: float) -> np.ndarray:
        dry, vapour = _standard(length, co2)
        return np.asarray(of_dry * dry + of_water * vapour)

    if not group:
        return at(wavelength)
    slope = (at(wavelength + STEP) - at(wavelength - STEP)) / (2.0 * STEP)
    return at(wavelength) - wavelength * slope


def _standard(wavelength: float, co2: float) -> tuple[float, float]:
    """n - 1 of dry air and of water vapour, each at its own conditions (equations 1 to 3)."""
    s = (1e3 / wavelength) ** 2
    k0, k1, k2, k3 = _DRY
    dry = 1e-8 * (k1 / (k0 - s) + k3 / (k2 - s)) * (1.0 + 0.534e-6 * (co2 - CO2))
    return dry, float(1.022e-8 * np.polyval(_VAPOUR[::-1], s))


def vapour_fraction(t: np.ndarray, p: np.ndarray, humidity: np.ndarray) -> np.ndarray:
    """Molar fraction of water vapour, from t [°C], p [Pa] and relative humidity [%]."""
    a, b, c, d = _SATURATION
    absolute = t + KELVIN
    saturated = np.exp(a * absolute**2 + b * absolute + c + d / absolute)  # Pa
    alpha, beta, gamma = _ENHANCEMENT
    return np.asarray(0.01 * humidity * (alpha + beta * p + gamma * t**2) * saturated / p)


def _amount(t: np.ndarray | float, p: np.ndarray | float, water: np.ndarray | float) -> np.ndarray:
    """Amount of moist air [mol/m³]. Molar masses cancel in the ratios of densities."""
    return np.asarray(p / (_compressibility(t, p, water) * GAS * (np.asarray(t) + KELVIN)))


def _compressibility(t: np.ndarray | float, p: np.ndarray | float, water: np.ndarray | float) -> np.ndarray:
    """Z of moist air (Davis 1992): t [°C], p [Pa], molar fraction of water."""
    ratio = p / (np.asarray(t) + KELVIN)
    first = 1.58123e-6 - 2.9331e-8 * np.asarray(t) + 1.1043e-10 * np.asarray(t) ** 2
    first = first + (5.707e-6 - 2.051e-8 * np.asarray(t)) * water
    first = first + (1.9898e-4 - 2.376e-6 * np.asarray(t)) * np.asarray(water) ** 2
    return np.asarray(1.0 - ratio * first + ratio**2 * (1.83e-11 - 0.765e-8 * np.asarray(water) ** 2))
