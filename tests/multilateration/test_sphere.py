"""Spheres fitted to touch points: closed-form covariances, the conditions of a minimum, poor coverage, outlying touches."""

import numpy as np
import pytest

from volid.exceptions import InputError, NotDeterminedError
from volid.multilateration.sphere import fit_sphere
from volid.multilateration.sphere_scatter import fit_spheres

R = 12.7
CENTRE = np.array([420.0, -310.0, -95.0])
SIX = np.concatenate([np.eye(3), -np.eye(3)])
FIVE = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], dtype=float)


def cap(n, opening, rng, axis=2):
    """Unit vectors within `opening` degrees of an axis."""
    height = rng.uniform(np.cos(np.deg2rad(opening)), 1.0, n)
    angle = rng.uniform(0.0, 2 * np.pi, n)
    ring = np.sqrt(1 - height**2)
    return np.roll(np.column_stack([ring * np.cos(angle), ring * np.sin(angle), height]), axis - 2, axis=1)


def touched(directions, noise=0.0, rng=None, radius=R):
    out = radius + (noise * rng.standard_normal(len(directions)) if noise else 0.0)
    return CENTRE + directions * np.broadcast_to(out, len(directions))[:, None]


@pytest.mark.parametrize("radius", [None, R])
def test_exact_touches_give_the_sphere(radius):
    directions = cap(9, 80.0, np.random.default_rng(1))
    sphere = fit_sphere(touched(directions), radius)
    assert np.abs(sphere.centre - CENTRE).max() < 1e-9 and sphere.radius == pytest.approx(R, abs=1e-9)
    assert np.abs(sphere.residuals).max() < 1e-10


@pytest.mark.parametrize(
    ("directions", "radius", "variances"),
    [  # (AᵀA)⁻¹ by hand
        (SIX, None, (1 / 2, 1 / 2, 1 / 2, 1 / 6)),
        (SIX, R, (1 / 2, 1 / 2, 1 / 2)),
        (FIVE, None, (1 / 2, 1 / 2, 5 / 4, 1 / 4)),  # height and radius: inverse of [[1, 1], [1, 5]]
        (FIVE, R, (1 / 2, 1 / 2, 1)),
    ],
)
def test_cofactors_in_closed_form(directions, radius, variances):
    sphere = fit_sphere(touched(directions), radius)
    np.testing.assert_allclose(np.diag(sphere.cofactor), variances, atol=1e-9)
    assert sphere.degrees_of_freedom == len(directions) - len(variances)
    np.testing.assert_allclose(sphere.redundancies.sum(), sphere.degrees_of_freedom, atol=1e-9)


def test_minimum_of_the_distances_not_of_their_squares():
    """Σ v n = 0 and Σ v = 0, which the algebraic fit misses on a cap with noise."""
    rng = np.random.default_rng(4)
    points = touched(cap(25, 50.0, rng), 0.2, rng)
    sphere = fit_sphere(points)
    away = points - sphere.centre
    v = np.linalg.norm(away, axis=1) - sphere.radius
    assert abs(v.sum()) < 1e-9
    assert np.abs(v @ (away / np.linalg.norm(away, axis=1)[:, None])).max() < 1e-9


@pytest.mark.parametrize(("opening", "radius"), [(110.0, None), (45.0, None), (30.0, R)])
def test_covariance_is_the_spread_of_many_fits(opening, radius):
    rng = np.random.default_rng(5)
    directions, u = cap(12, opening, rng), 0.001
    centres = np.array([fit_sphere(touched(directions, u, rng), radius).centre for _ in range(600)])
    expected = fit_sphere(touched(directions), radius).covariance(u)
    spread = np.cov(centres.T)
    # with 600 trials a variance has a standard deviation of 5.8 %
    np.testing.assert_allclose(np.diag(spread), np.diag(expected), rtol=0.2)
    assert np.abs(centres.mean(axis=0) - CENTRE).max() < 4 * np.sqrt(np.diag(expected).max() / 600) + u / 50


def test_a_smaller_cap_gives_a_larger_u_until_it_is_refused():
    rng, largest = np.random.default_rng(6), []
    for opening in (90.0, 60.0, 30.0, 15.0):
        sphere = fit_sphere(touched(cap(12, opening, rng)))
        largest.append(float(np.sqrt(np.linalg.eigvalsh(sphere.covariance(0.002))[-1])))
    assert largest == sorted(largest) and largest[0] < 0.005
    sphere.check_coverage(0.002)
    tiny = fit_sphere(touched(cap(12, 3.0, rng), 0.002, rng))
    with pytest.raises(
        NotDeterminedError, match=r"cover too small a part of the sphere: with u = 2 µm .* Touch the pole"
    ):
        tiny.check_coverage(0.002)


@pytest.mark.parametrize("radius", [None, R])
@pytest.mark.parametrize("latitude", [0.0, 35.0])
def test_touches_on_one_circle_are_refused(latitude, radius):
    angle, rng = np.linspace(0, 2 * np.pi, 9)[:-1], np.random.default_rng(7)
    height = np.sin(np.deg2rad(latitude))
    ring = np.sqrt(1 - height**2)
    circle = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), np.full(8, height)])
    with pytest.raises(NotDeterminedError, match="touch the pole"):
        fit_sphere(touched(circle), radius)
    for _ in range(20):  # noise must not make a centre out of nothing
        with pytest.raises(NotDeterminedError, match="the pole"):
            fit_sphere(touched(circle, 0.002, rng), radius).check_coverage(0.002)


def test_bad_input_is_refused():
    with pytest.raises(NotDeterminedError, match="3 touches; a sphere needs at least four"):
        fit_sphere(touched(SIX[:3]))
    with pytest.raises(NotDeterminedError, match="one line"):
        fit_sphere(np.outer(np.arange(5.0), [1.0, 2.0, 3.0]))
    with pytest.raises(InputError, match=r"`points` has shape \(6, 2\)"):
        fit_sphere(touched(SIX)[:, :2])
    with pytest.raises(InputError, match="not finite"):
        fit_sphere(np.where(np.eye(6)[:, :3] > 0, np.nan, 1.0))
    with pytest.raises(InputError, match="`radius` is -3"):
        fit_sphere(touched(SIX), -3.0)
    for same in (np.zeros((5, 3)), np.repeat(touched(SIX[:2]), 3, axis=0)):
        with pytest.raises(NotDeterminedError):
            fit_sphere(same)


def many(rng, n=40, noise=0.002, touches=9):
    return [touched(cap(touches, 95.0, rng), noise, rng) for _ in range(n)]


def test_scatter_comes_from_all_spheres_together():
    fits = fit_spheres(many(np.random.default_rng(8)))
    assert fits.degrees_of_freedom == 40 * 5 and not fits.outliers
    assert fits.u == pytest.approx(0.002, rel=3 / np.sqrt(2 * 200))  # three standard deviations of s


def test_an_outlying_touch_is_named_and_left_out():
    rng = np.random.default_rng(9)
    groups = many(rng)
    away = groups[7][3] - CENTRE
    groups[7][3] = CENTRE + away * (1 + 0.05 / np.linalg.norm(away))  # a chip of 50 µm
    fits = fit_spheres(groups)
    assert fits.outliers == ((7, 3),) and fits.reasons == ("",) * 40
    sphere = fits.spheres[7]
    assert np.abs(sphere.centre - CENTRE).max() < 4 * np.sqrt(np.diag(sphere.covariance(fits.u)).max())
    assert sphere.residuals[3] == pytest.approx(0.05, abs=0.015)


def test_good_touches_are_rarely_named():
    """At 1 % for a whole file: in 60 files, more than four with a named touch have a chance of 3e-4."""
    rng = np.random.default_rng(10)
    named = sum(bool(f.outliers or any(f.reasons)) for f in (fit_spheres(many(rng, 8)) for _ in range(60)))
    assert named <= 4


def test_a_contradiction_that_several_touches_explain_loses_the_sphere():
    rng = np.random.default_rng(11)
    groups = [touched(FIVE, 0.001, rng) for _ in range(12)]
    groups[4][0, 0] += 0.08
    fits = fit_spheres(groups)
    assert fits.spheres[4] is None and sum(s is None for s in fits.spheres) == 1
    assert "one of the touches 1, 2, 3, 4 contradicts the others" in fits.reasons[4]
    assert "they do not tell which; touch more points" in fits.reasons[4]


def test_without_redundancy_u_must_be_stated():
    groups = [touched(FIVE[[0, 1, 2, 4]])]
    with pytest.raises(NotDeterminedError, match="state the standard uncertainty of a touch as `touch_u`"):
        fit_spheres(groups)
    assert fit_spheres(groups, u=0.003).u == 0.003


def test_few_touches_that_agree_by_chance_do_not_promise_more_than_they_know():
    """Six spheres of five touches, six degrees of freedom: errors over u are 1 (rms), where the bare scatter gives √(6/4)."""
    rng, squares = np.random.default_rng(7), []
    for _ in range(400):
        fits = fit_spheres([touched(FIVE, 0.001, rng) for _ in range(6)])
        errors = [(s.centre - CENTRE, s.covariance(fits.u)) for s in fits.spheres if s is not None]
        squares += [error @ np.linalg.solve(covariance, error) / 3.0 for error, covariance in errors]
    assert len(squares) > 2300 and np.sqrt(np.mean(squares)) == pytest.approx(1.0, abs=0.1)
    with pytest.raises(NotDeterminedError, match=r"5 touches, 1 more than unknowns.*`touch_u`"):
        fit_spheres([touched(FIVE, 0.001, rng)])


def test_undetermined_spheres_say_why():
    fits = fit_spheres([touched(SIX), touched(SIX[:3]), touched(SIX[[0, 1, 3, 4]])], u=0.001)
    assert [s is None for s in fits.spheres] == [False, True, True]
    assert "3 touches" in fits.reasons[1] and "circle" in fits.reasons[2]
