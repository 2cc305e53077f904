"""The prior of smooth functions: kernel, pseudo-readings and their tables, against other formulas of the same."""

import numpy as np
import pytest
from scipy.special import gamma, kv

from volid.fitting.smoothness.covariance import (
    NUGGET,
    correlation,
    free_functions,
    greville_points,
    matern,
    unit_precision,
    unit_rows,
    values_at_greville,
)
from volid.model.splines import Spline, design_matrix

LINE = Spline(0, -100.0, 300.0, 20, 3)
TURN = Spline(0, -180.0, 180.0, 24, 3, True)


def test_the_kernel_is_that_of_order_thirteen_halves():
    """The general formula of the Matérn family, with a Bessel function."""
    nu, length, d = 6.5, 0.3, np.linspace(0.01, 2.0, 50)
    r = np.sqrt(2.0 * nu) * d / length
    np.testing.assert_allclose(matern(d, length), 2.0 ** (1.0 - nu) / gamma(nu) * r**nu * kv(nu, r), rtol=1e-10)


@pytest.mark.parametrize("spline", [LINE, TURN], ids=["line", "turn"])
def test_pseudo_readings_leave_free_what_is_free(spline):
    rows = unit_rows(spline, 0.3)
    free = np.linalg.solve(values_at_greville(spline), free_functions(spline))
    assert rows.shape == (spline.size - free.shape[1], spline.size)
    assert np.abs(rows @ free).max() < 1e-6 * np.abs(rows).max()


@pytest.mark.parametrize("spline", [LINE, TURN], ids=["line", "turn"])
def test_functions_of_the_process_have_pseudo_readings_of_unit_variance(spline):
    """10,000 functions drawn from the covariance: W c has covariance 1, whatever line is added."""
    rng = np.random.default_rng(3)
    lower = np.linalg.cholesky(correlation(spline, 0.4))
    free = free_functions(spline)
    values = lower @ rng.standard_normal((spline.size, 10_000)) + free @ rng.normal(0.0, 50.0, (free.shape[1], 10_000))
    found = unit_rows(spline, 0.4) @ np.linalg.solve(values_at_greville(spline), values)
    np.testing.assert_allclose(found @ found.T / 10_000, np.eye(len(found)), atol=0.06)


def test_the_process_on_the_circle_has_period_one_turn_and_no_constant():
    """What the wrapped covariance lacks against the sum over all turns of that on the line is a constant."""
    x = greville_points(TURN)
    d = x[:, None] - x[None, :]
    wrapped = sum(matern(d + k, 0.5) for k in range(-12, 13))
    found = correlation(TURN, 0.5) - NUGGET * np.eye(len(x))
    scale = np.ptp(wrapped) / np.ptp(found)
    assert np.ptp(wrapped - scale * found) < 1e-9 * scale
    assert np.abs(found.sum(axis=0)).max() < 1e-6


@pytest.mark.parametrize("spline", [LINE, TURN], ids=["line", "turn"])
@pytest.mark.parametrize("length", [0.07, 0.31, 1.3])
def test_precision_from_the_table_is_that_of_the_rows(spline, length):
    rows = unit_rows(spline, length)
    exact = rows.T @ rows
    found, slope = unit_precision(spline, float(np.log(length)))
    scale = np.sqrt(np.diagonal(exact))
    assert np.abs((found - exact) / np.outer(scale, scale)).max() < 2e-3
    step = 1e-3
    both = [unit_precision(spline, float(np.log(length)) + s)[0] for s in (step, -step)]
    np.testing.assert_allclose(slope, (both[0] - both[1]) / (2 * step), rtol=1e-3, atol=1e-3 * np.abs(slope).max())


def test_posterior_is_kriging_between_the_positions():
    """Eight noisy values of a function: the spline with its pseudo-readings predicts as universal kriging does."""
    rng = np.random.default_rng(5)
    size, length, noise = 3e-3, 0.35, 2e-4
    at, x = np.linspace(-100.0, 300.0, 8), np.linspace(-95.0, 295.0, 60)
    y = 2e-3 * np.sin(at / 60.0) + 1e-5 * at + noise * rng.standard_normal(8)
    rows, basis = unit_rows(LINE, length) / size, design_matrix(LINE, at)
    covariance = np.linalg.inv(rows.T @ rows + basis.T @ basis / noise**2)
    design = design_matrix(LINE, x)
    mean, u = (
        design @ covariance @ basis.T @ y / noise**2,
        np.sqrt(np.einsum("ij,jk,ik->i", design, covariance, design)),
    )

    def kernel(a, b):
        return size**2 * matern((a[:, None] - b[None, :]) / 400.0, length)

    line = np.stack([np.ones(8), at], axis=1)
    system = np.block([[kernel(at, at) + noise**2 * np.eye(8), line], [line.T, np.zeros((2, 2))]])
    right = np.vstack([kernel(at, x), np.ones(len(x)), x])
    weights = np.linalg.solve(system, right)
    np.testing.assert_allclose(mean, weights[:8].T @ y, atol=0.02 * u.max())
    expected = np.sqrt(size**2 - np.einsum("ij,ij->j", weights, right))
    np.testing.assert_allclose(u, expected, rtol=0.03)
