"""JᵀJ of large sets by cells of the working volume: the dense sum, with other weights too, and through the whole solver."""

import numpy as np
import pytest
from support.every_form import EXTRA
from support.machines import VERTICAL, fixed
from support.trackers import simulated

from volid.fitting.equations import tiles as tiles_module
from volid.fitting.equations.compiled import Compiled
from volid.fitting.equations.interpreted import Interpreted
from volid.fitting.equations.problem import build_problem, reweight
from volid.fitting.equations.solver import solve
from volid.fitting.equations.system import Normal
from volid.model.error_functions import motion_names, spline_axes
from volid.model.error_model import build_model

ROWS = 500  # readings per station


@pytest.fixture(scope="module", params=["plain", "reversal and cross effects"])
def tiled(request):
    """A problem with tiles, its campaign, and z away from zero."""
    extra = fixed(3) if request.param == "plain" else EXTRA
    campaign, _, _ = simulated(VERTICAL, 2, extra=extra, n_per_station=ROWS)
    segments = {n: (5, 3)[: len(spline_axes(campaign.machine, n))] for n in motion_names(campaign.machine)}
    segments["EZZ"] = (6,)  # one window of its own
    patch = pytest.MonkeyPatch()
    patch.setattr(tiles_module, "LEAST", 1000)
    problem = build_problem(campaign, build_model(campaign.machine, segments), engine=Compiled())
    assert problem.equations.tiles[0] is not None
    patch.undo()
    z = problem.start + 1e-3 * np.random.default_rng(0).standard_normal(len(problem.start))
    return problem, campaign, z


def dense_equations(problem, z):
    """The reference: all rows and all columns, as the Jacobian has them."""
    equations = Interpreted().equations(problem.system)
    rows = np.concatenate([a.transpose(0, 2, 1).reshape(-1, len(z)) for a in equations.jacobian(z)])
    predicted = equations.predictions(z)
    r = [((p - b.reading) * b.weight).ravel() for p, b in zip(predicted, problem.system.blocks, strict=True)]
    root = problem.system.prior_root
    rows, residual = np.vstack([rows, root]), np.concatenate([*r, root @ z - problem.system.prior_value])
    return Normal(0.5 * float(residual @ residual), rows.T @ residual, rows.T @ rows)


def assert_equal(problem, z):
    found, expected = problem.equations.normal(z), dense_equations(problem, z)
    scale = np.sqrt(np.diagonal(expected.matrix))
    scale = np.where(scale > 0, scale, 1.0)
    assert np.abs((np.asarray(found.matrix) - expected.matrix) / np.outer(scale, scale)).max() < 1e-12
    assert float(found.cost) == pytest.approx(expected.cost, rel=1e-12)
    slope = (np.asarray(found.gradient) - expected.gradient) / scale
    assert np.abs(slope).max() < 1e-12 * np.sqrt(expected.cost)


def test_tiles_sum_to_the_dense_normal_equations(tiled):
    problem, _, z = tiled
    assert_equal(problem, z)


def test_every_reading_stands_in_one_tile(tiled):
    problem, campaign, _ = tiled
    numbers = np.asarray(problem.equations.tiles[0].numbers)
    m = len(campaign.sets[0])
    np.testing.assert_array_equal(np.sort(numbers[numbers < m]), np.arange(m))
    assert np.all(np.asarray(problem.equations.tiles[0].chunk.weight)[:, 0][numbers == m] == 0.0)


def test_weights_reach_the_tiles(tiled):
    problem, campaign, z = tiled
    factors = [np.random.default_rng(1).uniform(0.0, 1.0, s.readings.shape) for s in campaign.sets]
    factors[0][::7] = 0.0
    assert_equal(reweight(problem, campaign, factors), z)


def test_the_minimum_is_the_same(tiled):
    problem, _, _ = tiled
    problem = problem._replace(free=problem.free[:, -20:])  # stations and dead paths
    found = solve(problem)
    expected = solve(problem._replace(equations=Interpreted().equations(problem.system)))
    assert found.converged and expected.converged
    assert found.cost == pytest.approx(expected.cost, rel=1e-9)


def test_rough_tiles_have_the_exact_gradient(tiled):
    """Single precision stands in JᵀJ alone."""
    problem, _, z = tiled
    exact, rough = problem.equations.normal(z), problem.equations.normal(z, rough=True)
    scale = np.sqrt(np.diagonal(np.asarray(exact.matrix)))
    scale = np.where(scale > 0, scale, 1.0)
    assert float(rough.cost) == pytest.approx(float(exact.cost), rel=1e-13)
    assert np.abs((rough.gradient - exact.gradient) / scale).max() < 1e-12 * np.sqrt(float(exact.cost))
    assert 1e-10 < np.abs((rough.matrix - exact.matrix) / np.outer(scale, scale)).max() < 1e-5
