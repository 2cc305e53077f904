"""Splines against SciPy's own B-splines and closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BSpline

from volid.model.splines import (
    Basis,
    Spline,
    design_matrix,
    end_slope_row,
    evaluate,
    refinement,
    slope_row,
    spline_values,
    value_row,
)

DEGREES = (1, 2, 3, 4, 5)
ROUNDING = 1e-12  # basis values are of order 1, and grow at most a thousandfold where they are continued outside


def scipy_values(spline, x):
    """Basis values (size, m) by SciPy, extrapolated with the end polynomials."""
    step = (spline.high - spline.low) / spline.segments
    knots = spline.low + step * np.arange(-spline.degree, spline.segments + spline.degree + 1)
    return np.array([BSpline(knots, c, spline.degree, extrapolate=True)(x) for c in np.eye(spline.size)])


def coefficients_of(spline, function):
    """Coefficients of a polynomial that the spline space contains."""
    x = np.linspace(spline.low, spline.high, 5 * spline.size)
    return np.linalg.lstsq(scipy_values(spline, x).T, function(x), rcond=None)[0]


@pytest.mark.parametrize("degree", DEGREES)
@pytest.mark.parametrize("segments", [1, 2, 7])
def test_values_are_those_of_scipy_inside_at_the_ends_and_outside(degree, segments):
    spline = Spline(0, -120.0, 480.0, segments, degree)
    x = np.concatenate([np.linspace(-120, 480, 61), [-120 - 40.0, -120 - 1e-9, 480 + 1e-9, 480 + 40.0]])
    expected = scipy_values(spline, x)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(spline_values(spline, jnp.asarray(x)), expected, atol=ROUNDING * scale)
    np.testing.assert_allclose(design_matrix(spline, x), expected.T, atol=ROUNDING * scale)


@pytest.mark.parametrize("degree", DEGREES)
def test_partition_of_unity_and_local_support(degree):
    spline = Spline(0, 0.0, 1000.0, 9, degree)
    values = np.asarray(spline_values(spline, jnp.linspace(0.0, 1000.0, 301)))
    np.testing.assert_allclose(values.sum(axis=0), 1.0, atol=1e-14)
    assert np.all((np.abs(values) > 1e-15).sum(axis=0) <= degree + 1)


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_derivatives_up_to_degree_minus_one_are_continuous_at_knots(degree):
    spline = Spline(0, 0.0, 10.0, 5, degree)
    weights = jnp.asarray(np.random.default_rng(0).normal(size=spline.size))
    derivative = lambda x: weights @ spline_values(spline, x[None])[:, 0]  # noqa: E731
    for order in range(1, degree + 1):
        derivative = jax.grad(derivative)
        left, right = (float(derivative(jnp.asarray(4.0 + side * 1e-9))) for side in (-1, 1))
        if order < degree:
            assert left == pytest.approx(right, abs=1e-6), order  # derivative of order + 1 is about 1, times 2e-9
        else:
            assert abs(left - right) > 1e-3, "the highest derivative of random coefficients jumps"


@pytest.mark.parametrize("degree", [2, 3, 5])
def test_gradient_is_the_derivative_that_scipy_gives_also_outside(degree):
    spline = Spline(0, 0.0, 10.0, 4, degree)
    c = np.random.default_rng(1).normal(size=spline.size)
    knots = 2.5 * np.arange(-degree, 4 + degree + 1)
    x = np.array([-1.0, 0.0, 0.3, 4.9, 9.99, 11.5])
    ours = jax.vmap(jax.grad(lambda x: jnp.asarray(c) @ spline_values(spline, x[None])[:, 0]))(jnp.asarray(x))
    np.testing.assert_allclose(ours, BSpline(knots, c, degree).derivative()(x), atol=1e-11)


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_value_row_of_a_polynomial(degree):
    spline = Spline(1, -300.0, 100.0, 6, degree)
    power = np.polynomial.Polynomial([1.0, -2.0, *[0.5] * (degree - 1)], domain=[-300, 100])
    c = coefficients_of(spline, power)
    for x in (-300.0, -7.0, 100.0, 130.0):
        assert value_row(spline, x) @ c == pytest.approx(power(x), abs=1e-10)


def test_least_squares_slope_of_line_parabola_and_cubic():
    # on [-h, h]: slope of x is 1, of x² 0, of x³ ∫x⁴ / ∫x² = 3h²/5
    spline, h = Spline(0, 200.0, 1000.0, 5, 3), 400.0
    for function, expected in (
        (lambda x: 7.0 + 2e-3 * x, 2e-3),
        (lambda x: ((x - 600) / h) ** 2, 0.0),
        (lambda x: ((x - 600) / h) ** 3, 3 / 5 / h),
    ):
        assert slope_row(spline, spline.low, spline.high) @ coefficients_of(spline, function) == pytest.approx(
            expected, abs=1e-15
        )


@pytest.mark.parametrize("degree", DEGREES)
def test_least_squares_slope_of_every_basis_function_by_dense_quadrature(degree):
    spline = Spline(0, -50.0, 350.0, 4, degree)
    x, w = np.polynomial.legendre.leggauss(12)  # exact to degree 23 on each interval
    x = np.concatenate([-50 + 100 * (k + 0.5) + 50 * x for k in range(4)])
    w, arm = np.tile(w, 4), x - 150.0
    expected = scipy_values(spline, x) @ (w * arm) / (w @ arm**2)
    np.testing.assert_allclose(slope_row(spline, spline.low, spline.high), expected, atol=1e-16)


def test_end_point_slope_is_the_line_through_both_ends():
    spline = Spline(0, 0.0, 800.0, 4, 3)
    c = coefficients_of(spline, lambda x: (x / 800) ** 3 - x / 400)
    assert end_slope_row(spline, spline.low, spline.high) @ c == pytest.approx((1 - 2) / 800, abs=1e-15)


@pytest.mark.parametrize("degree", [1, 3, 4])
@pytest.mark.parametrize("coarse, fine", [(1, 24), (3, 12), (8, 24), (5, 5)])
def test_refinement_gives_the_same_function(degree, coarse, fine):
    coarse, fine = (Spline(0, 0.0, 700.0, n, degree) for n in (coarse, fine))
    x = np.linspace(-20, 720, 101)
    matrix = refinement(coarse, fine)
    np.testing.assert_allclose(scipy_values(fine, x).T @ matrix, scipy_values(coarse, x).T, atol=1e-11)


def test_refinement_needs_a_multiple():
    with pytest.raises(ValueError, match="8 segments do not refine 3 segments"):
        refinement(Spline(0, 0.0, 1.0, 3, 3), Spline(0, 0.0, 1.0, 8, 3))


def test_tensor_product_linear_factor_and_direction():
    first, second = Spline(0, 0.0, 10.0, 3, 3), Spline(2, -5.0, 5.0, 2, 2)
    q = np.array([[1.0, 9.0], [7.0, 7.0], [-4.0, 0.5]])
    direction = np.array([[1.0, -1.0], [0.0, 1.0], [-1.0, 1.0]])
    expected = np.einsum("im,jm->ijm", scipy_values(first, q[0]), scipy_values(second, q[2])).reshape(-1, 2)
    np.testing.assert_allclose(evaluate(Basis((first, second)), jnp.asarray(q), None), expected, atol=ROUNDING)
    assert Basis((first, second)).size == len(expected) == 6 * 4
    line = evaluate(Basis(linear=(1, 3.0)), jnp.asarray(q), None)
    np.testing.assert_allclose(line, [[4.0, 4.0]])
    turned = evaluate(Basis((first,), directed=2), jnp.asarray(q), jnp.asarray(direction))
    np.testing.assert_allclose(turned, scipy_values(first, q[0]) * [-0.5, 0.5], atol=ROUNDING)
    np.testing.assert_allclose(evaluate(Basis(), jnp.asarray(q), None), [[1.0, 1.0]])
