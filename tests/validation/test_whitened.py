"""Generalised chi-square, E_n and the search for causes against dense closed forms."""

from types import SimpleNamespace

import numpy as np
import pytest

from volid.fitting.diagnosis.alternatives.base import Alternative, judged, with_unknowns
from volid.fitting.diagnosis.around import Around
from volid.fitting.diagnosis.outcome import Outcome
from volid.validation.readings.chi_squares import Split, smallest
from volid.validation.readings.whitened import Whitened

N, G, B = 60, 12, 5


@pytest.fixture
def dense():
    """Readings r with covariance C = 1 + G Gᵀ, own unknowns B, and the projected inverse P of C."""
    rng = np.random.default_rng(4)
    known, own = rng.standard_normal((N, G)) * np.geomspace(0.01, 100.0, G), rng.standard_normal((N, B))
    covariance = np.eye(N) + known @ known.T
    inverse = np.linalg.inv(covariance)
    own /= np.linalg.norm(own, axis=0)
    middle = np.linalg.inv(own.T @ inverse @ own)
    projected = inverse - inverse @ own @ middle @ own.T @ inverse
    r = rng.multivariate_normal(np.zeros(N), covariance) + own @ rng.standard_normal(B)
    units = 10.0 ** np.arange(-6.0, 4.0, 2.0)  # of the unknowns: nothing may depend on them
    return SimpleNamespace(
        r=r, known=known, open=own * units, covariance=covariance, middle=middle, projected=projected, own=own
    )


def test_chi_square_and_residuals_are_those_of_generalised_least_squares(dense):
    found = Whitened.of(dense)
    assert found.freedom == N - B
    assert found.v @ found.v == pytest.approx(dense.r @ dense.projected @ dense.r, rel=1e-7)
    # d = r - B b, b of generalised least squares: C P r
    np.testing.assert_allclose(found.residual, dense.covariance @ dense.projected @ dense.r, rtol=1e-6, atol=1e-6)
    variance = np.diagonal(dense.covariance - dense.own @ dense.middle @ dense.own.T)
    np.testing.assert_allclose(found.variance, variance, rtol=1e-6, atol=1e-9)
    rows = found.leverage_rows
    np.testing.assert_allclose(np.eye(N) - rows @ rows.T, dense.projected, atol=1e-7)


def test_a_change_that_own_unknowns_take_up_is_never_found(dense):
    found = Whitened.of(dense)
    split = Split(found, (np.zeros((N, 0)), np.zeros((N, 0))), ())
    assert smallest(split, dense.open @ np.arange(1.0, B + 1.0), 0.95) == np.inf
    assert 0.0 < smallest(split, np.ones(N), 0.95) < np.inf


def test_smallest_change_is_found_in_nine_of_ten_draws(dense):
    """The stated power against draws: noncentral chi-squares of three parts, one of which knows the change."""
    whitened, rng = Whitened.of(dense), np.random.default_rng(8)
    column, others = rng.standard_normal(N), rng.standard_normal((N, 8))
    first = whitened.span(column[:, None] + 0.3 * others[:, :1], np.zeros((N, 0)))
    split = Split(whitened, (first, whitened.span(others, first)), ())
    size, limits = smallest(split, column, 0.95), split.limits(0.95)
    draws = 4000
    noise = dense.known @ rng.standard_normal((G, draws)) + rng.standard_normal((N, draws))
    found = [np.any(split.parts(whitened.free(x)) > limits) for x in (noise + size * column[:, None]).T]
    false = [np.any(split.parts(whitened.free(x)) > limits) for x in noise.T]
    assert abs(np.mean(found) - 0.90) < 4 * np.sqrt(0.09 / draws)
    assert abs(np.mean(false) - 0.05) < 4 * np.sqrt(0.0475 / draws)


def test_what_a_first_cause_explains_is_not_explained_again_beside_prior_knowledge(dense):
    """With prior knowledge 1 - H is no projection; the second drop is that of both unknowns together less the first."""
    rows = Whitened.of(dense).leverage_rows
    rng = np.random.default_rng(5)
    first, second = rng.standard_normal((N, 1)), rng.standard_normal((N, 2))
    v = dense.projected @ (dense.r + 8.0 * first[:, 0])
    nothing = Outcome.nothing(rows.shape[1])
    start = Around(None, 1.0, v, rows, np.ones(N), None, nothing, 1e6, N - B)
    one = next(judged(start, [Alternative("", "", "", first)]))
    then = with_unknowns(start, one)

    def drop(columns):
        pull = columns.T @ v
        return pull @ np.linalg.solve(columns.T @ dense.projected @ columns, pull)

    (after,) = judged(then, [Alternative("", "", "", second)])
    assert after.drop == pytest.approx(drop(np.hstack([first, second])) - drop(first), rel=1e-6)
    again = list(judged(then, [Alternative("", "", "", first)]))
    assert not again or again[0].drop < 1e-6
