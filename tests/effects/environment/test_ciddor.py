"""Ciddor's equations against published values and against another formula."""

import numpy as np
import pytest
from support.days import edlen

from volid.effects.environment.ciddor import refractivity

# Dry air, 450 ppm CO2, 633 nm: (n - 1)·1e8 by temperature [°C] and pressure [kPa]. From the tables that compare equations in
# Ciddor, Applied Optics 35 (1996) 1566; quoted from memory of them.
DRY = [
    (20.0, 80.0, 21458.0),
    (20.0, 100.0, 26824.4),
    (20.0, 120.0, 32191.6),
    (10.0, 100.0, 27774.7),
    (30.0, 100.0, 25937.2),
]
# Moist air at 1013.25 hPa, 633 nm: temperature [°C], humidity [%], n. Printed on the page of the program ref_index (PyPI), which
# follows the documentation of the refractive index calculator in NIST's Engineering Metrology Toolbox.
MOIST = [(20.0, 20.0, 1.0002716285340578), (20.0, 80.0, 1.0002711183472626), (60.0, 80.0, 1.0002340241754055)]


@pytest.mark.parametrize(("temperature", "kilopascal", "expected"), DRY)
def test_dry_air_is_as_tabulated(temperature, kilopascal, expected):
    """To the last digit that is printed."""
    found = refractivity(temperature, 10.0 * kilopascal, 0.0, wavelength=633.0)
    assert abs(1e8 * found - expected) < 0.06


@pytest.mark.parametrize(("temperature", "humidity", "expected"), MOIST)
def test_moist_air_is_as_another_program_computes_it(temperature, humidity, expected):
    """It takes another formula of the saturated vapour (IAPWS), which differs by more at 60 °C."""
    found = refractivity(temperature, 1013.25, humidity, wavelength=633.0)
    assert abs(1.0 + found - expected) < (1e-10 if temperature < 50.0 else 3e-10)


def test_it_agrees_with_edlens_equation_over_the_air_of_workshops():
    """Both formulas claim some 1e-8 there; the constants, the way to the density and the vapour's pressure differ."""
    t, p, h = (
        g.ravel() for g in np.meshgrid([15.0, 20.0, 25.0, 30.0], [800.0, 950.0, 1030.0], [0.0, 30.0, 60.0, 90.0])
    )
    assert np.abs(refractivity(t, p, h) - edlen(t, p, h)).max() < 1e-8


@pytest.mark.parametrize("wavelength", [633.0, 780.0, 850.0])
def test_the_group_index_is_that_of_geodesists(wavelength):
    """N = 287.6155 + 4.88660/λ² + 0.06800/λ⁴ at 0 °C, 1013.25 hPa, 375 ppm CO2, dry, λ in µm: resolution 3 of the International
    Association of Geodesy, Birmingham 1999, said to be within 0.25 µm/m of Ciddor and Hill over all weathers."""
    length = 1e-3 * wavelength
    expected = 287.6155 + 4.88660 / length**2 + 0.06800 / length**4
    found = 1e6 * refractivity(0.0, 1013.25, 0.0, wavelength=wavelength, co2=375.0, group=True)
    assert abs(found - expected) < 0.1


def test_carbon_dioxide_adds_what_it_should():
    """0.534e-6 of n - 1 per ppm (equation 2), 1.4e-8 in 100 ppm, less than a tenth of what 0.1 K does."""
    change = refractivity(15.0, 1013.25, 0.0, wavelength=633.0, co2=550.0) / refractivity(
        15.0, 1013.25, 0.0, wavelength=633.0
    )
    assert change - 1.0 == pytest.approx(0.534e-4, rel=1e-6)
