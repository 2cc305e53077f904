"""Cross effects of a rotary table over the axis that tilts it, measured over three turns: recovered from the exact chain."""

import numpy as np
import pytest
from exact_chain import Product, Smooth, Truth
from support.machines import STRUCTURES, resolved
from support.machines import exact_machine as usual
from support.quick_fit import quick_fit
from support.rtests import NOISE, r_test, r_test_campaign

from volid.fitting.location_errors import location_parameter

pytestmark = pytest.mark.slow

TRAVEL = (-540.0, 540.0)  # C makes three turns: its errors repeat every 360°
FUNCTIONS = "\n".join(
    [
        '"E?[XYZA]" = false',
        '"E?0[XYZS]" = false',
        *(f'{name} = {{ over = ["C", "A"], segments = [12, 2] }}' for name in ("ECC", "EXC", "EAC")),
    ]
)


def harmonics(size: float, cosine: float, sine: float) -> Smooth:
    """size (cosine (cos 2q - cos 3q) + sine sin 2q): zero mean, no co-rotating part, 0 at q = 0 for cosine alone or with sine."""
    amplitude = size * np.array([cosine, -cosine, sine])
    return Smooth(amplitude, np.array([2, 3, 2]) / 360, np.array([np.pi / 2, np.pi / 2, 0.0]), np.zeros(2), 0.0, 360.0)


def over_a(constant: float, slope: float, square: float) -> Smooth:
    """A parabola over A, which a cubic spline holds."""
    return Smooth(np.zeros(1), np.zeros(1), np.zeros(1), np.array([constant, slope, square]), 0.0, 100.0)


CROSS = {
    "ECC": Product(harmonics(12e-6, 0.5, 1.0), over_a(0.4, 0.8, -0.5)),
    "EXC": Product(harmonics(0.005, -0.7, 0.6), over_a(0.3, -1.0, 0.4)),
    "EAC": Product(harmonics(15e-6, 0.6, -0.8), over_a(-0.2, 0.7, 0.9)),
}
CONSTANTS = {"EX0C": 0.012, "EY0C": -0.008, "EA0C": 25e-6, "EB0C": -30e-6,
             "EY0A": 0.015, "EZ0A": -0.011, "EB0A": 35e-6, "EC0A": -20e-6}  # fmt: skip


def test_cross_effects_over_the_tilt_and_three_turns_of_the_table():
    exact = usual(STRUCTURES["tilting table C'A'"])
    exact.travel["C"] = TRAVEL
    truth = Truth({}, CONSTANTS, cross={name: ("A", f) for name, f in CROSS.items()})
    data = r_test(exact, truth, np.random.default_rng(4), counts={"A": 7, "C": 40})
    assert np.abs(data.q[:, exact.column("C")]).max() == 540.0
    solution = quick_fit(r_test_campaign(resolved(exact, FUNCTIONS), data))
    assert solution.statements == ()
    weight = np.sqrt(solution.adequacy.chi_square / solution.adequacy.degrees_of_freedom)
    assert 0.95 < weight < 1.05, weight  # 2520 readings of 0.5 µm: the functions leave less than a tenth of that
    for name, value in CONSTANTS.items():
        row = location_parameter(solution, name)
        assert row.u < (1e-6 if name[1] in "ABC" else 0.0002) and abs(row.value - value) < 4.0 * row.u, name
    # the functions as the machine shows them: deviation at pairs of rotary positions, a turn apart as well
    rng = np.random.default_rng(8)
    q = np.zeros((60, 5))
    q[:, exact.column("A")], q[:, exact.column("C")] = rng.uniform(-95, 95, 60), rng.uniform(-180, 180, 60)
    tool = np.array([0.0, 0.0, -150.0])
    true, found = exact.deviation(q, tool, truth), np.asarray(solution.deviation(q, tool))
    found_u = solution.evaluate(q, np.tile(tool, (60, 1))).u
    assert np.abs(true[:, :3]).max() > 0.02
    normalised = (found - true) / found_u
    assert 0.6 < np.sqrt(np.mean(normalised**2)) < 1.3 and found_u[:, :3].max() < NOISE
    for turn in (-360.0, 360.0):
        moved = q.copy()
        moved[:, exact.column("C")] += turn
        np.testing.assert_allclose(np.asarray(solution.deviation(moved, tool)), found, atol=1e-12)
