"""Size and length by marginal likelihood: the density against dense formulas, its slopes, and what becomes of their
uncertainty.
"""

import numpy as np
import pytest
from scipy.linalg import block_diag, null_space
from scipy.optimize import approx_fprime

from volid.fitting.smoothness.covariance import matern
from volid.fitting.smoothness.evidence import Information, _Evidence, estimate
from volid.fitting.smoothness.processes import Process
from volid.model.splines import Spline, design_matrix

FIRST, SECOND = Spline(0, 0.0, 1.0, 20, 3), Spline(1, 0.0, 1.0, 20, 3)
NOISE = 2e-4


def process(spline, start, name):
    return Process((name,), "mean", slice(start, start + spline.size), (((spline,), np.eye(spline.size)),))


PROCESSES = (process(FIRST, 0, "EXX"), process(SECOND, 23, "EYY"))


def readings(seed=1, n=60):
    """Sums of two functions at scattered positions: matrix (n, 46) and values (n,)."""
    rng = np.random.default_rng(seed)
    x = rng.random((2, n))
    matrix = np.hstack([design_matrix(FIRST, x[0]), design_matrix(SECOND, x[1])])
    y = 4e-3 * np.sin(7.0 * x[0]) + 1e-3 * np.cos(15.0 * x[1]) + NOISE * rng.standard_normal(n)
    return x, matrix, y


def information(matrix, y, basis=None):
    units = np.ones(matrix.shape[1])
    basis = np.eye(matrix.shape[1]) if basis is None else basis
    own = matrix @ basis / NOISE
    return Information(own.T @ own, own.T @ y / NOISE, basis, units)


def constant_shared():
    """What two sums determine: all but a constant that one function has more and the other less."""
    shared = np.concatenate([np.ones(23), -np.ones(23)])[:, None]
    return null_space(shared.T)


def dense_density(x, y, phi):
    """log of the restricted likelihood of y, constants and lines integrated out, by the covariance of the readings themselves."""
    n = len(y)
    covariance = NOISE**2 * np.eye(n)
    for k, own in enumerate((phi[:2], phi[2:])):
        d = x[k][:, None] - x[k][None, :]
        covariance += np.exp(2.0 * own[0]) * (matern(d, np.exp(own[1])))
    lines = np.stack([np.ones(n), x[0], x[1]], axis=1)
    inverse = np.linalg.inv(covariance)
    inner = lines.T @ inverse @ lines
    across = inverse - inverse @ lines @ np.linalg.solve(inner, lines.T @ inverse)
    return -0.5 * (np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(inner)[1] + y @ across @ y)


def test_density_is_that_of_the_readings():
    """Differences of the log density between values of φ: of the splines by their information, and of the Gaussian process
    itself.
    """
    x, matrix, y = readings()
    evidence = _Evidence(PROCESSES, information(matrix, y, constant_shared()))
    points = [np.log([3e-3, 0.3, 1e-3, 0.3]), np.log([5e-3, 0.4, 1.5e-3, 0.25]), np.log([2e-3, 0.5, 2e-3, 0.35])]

    def ours(phi):
        away = phi - evidence.median
        return -(evidence(phi)[0] - 0.5 * float(away @ evidence.known @ away))

    found = [ours(p) - ours(points[0]) for p in points[1:]]
    expected = [dense_density(x, y, p) - dense_density(x, y, points[0]) for p in points[1:]]
    np.testing.assert_allclose(found, expected, atol=0.1)
    assert np.abs(expected).min() > 2.0


@pytest.mark.parametrize("linked", [False, True])
def test_slopes_are_finite_differences(linked):
    _, matrix, y = readings()
    if not linked:  # some readings of one function alone determine the constant
        matrix[:9, 23:] = 0.0
    evidence = _Evidence(PROCESSES, information(matrix, y, constant_shared() if linked else None))
    phi = np.log([3e-3, 0.33, 1e-3, 0.27])
    numeric = approx_fprime(phi, lambda p: evidence(p)[0], 1e-5)
    np.testing.assert_allclose(evidence(phi)[1], numeric, rtol=2e-3, atol=2e-3)


def test_estimate_finds_the_best_and_says_how_well():
    """No neighbour has a higher density; functions drawn from a process have their logarithms within the stated u.

    The sizes that are returned are root mean squares, log s + σ².
    """

    def most_probable(found):
        return found.phi - np.diagonal(found.covariance) * [1.0, 0.0, 1.0, 0.0]

    _, matrix, y = readings()
    found = estimate(PROCESSES, information(matrix, y, constant_shared()))
    evidence = _Evidence(PROCESSES, information(matrix, y, constant_shared()))
    best = evidence(most_probable(found))[0]
    for step in np.vstack([np.eye(4), -np.eye(4)]) * 0.3:
        assert evidence(most_probable(found) + step)[0] > best - 0.05
    rng, true, away = np.random.default_rng(7), np.log([4e-3, 0.35, 2e-3, 0.25]), []
    for _ in range(25):
        x = rng.random((2, 300))
        y = NOISE * rng.standard_normal(300)
        for k in range(2):
            own = np.exp(2 * true[2 * k]) * matern(x[k][:, None] - x[k][None, :], np.exp(true[2 * k + 1]))
            y += np.linalg.cholesky(own + 1e-12 * np.eye(300)) @ rng.standard_normal(300)
        matrix = np.hstack([design_matrix(FIRST, x[0]), design_matrix(SECOND, x[1])])
        found = estimate(PROCESSES, information(matrix, y, constant_shared()))
        away.append((most_probable(found) - true) / np.sqrt(np.diagonal(found.covariance)))
    assert 0.6 < np.sqrt(np.mean(np.square(away))) < 1.4


def test_noise_of_the_pseudo_readings_is_what_the_uncertain_smoothness_does():
    """Against brute force: the estimate with φ drawn from its own uncertainty, mean of covariances plus covariance of means."""
    _, matrix, y = readings(n=40)
    basis = constant_shared()
    found = estimate(PROCESSES, information(matrix, y, basis))
    a, b = matrix.T @ matrix / NOISE**2, matrix.T @ y / NOISE**2

    def posterior(phi):
        q = block_diag(*(p.precision(phi[2 * i : 2 * i + 2]) for i, p in enumerate(PROCESSES)))
        covariance = basis @ np.linalg.inv(basis.T @ (a + q) @ basis) @ basis.T
        return covariance @ b, covariance

    theta, covariance = posterior(found.phi)
    rows, noise = found.rows(46), found.noise(theta)
    spread = covariance @ rows.T @ noise
    stated = covariance + spread @ spread.T
    rng = np.random.default_rng(0)
    root = np.linalg.cholesky(found.covariance)
    draws = [posterior(found.phi + root @ rng.standard_normal(4)) for _ in range(400)]
    means = np.array([m for m, _ in draws])
    expected = np.mean([c for _, c in draws], axis=0) + np.cov(means.T)
    at = design_matrix(FIRST, np.linspace(0.0, 1.0, 41))
    seen = np.hstack([at - at.mean(axis=0), np.zeros((41, 23))])
    ratio = np.sqrt(np.diagonal(seen @ stated @ seen.T) / np.diagonal(seen @ expected @ seen.T))
    assert 0.9 < np.median(ratio) < 1.1 and ratio.min() > 0.75 and ratio.max() < 1.3
