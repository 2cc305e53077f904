"""The solver against SciPy on the same problem, and from a start that is far off."""

from functools import cache

import numpy as np
import pytest
from exact_chain import ExactMachine
from scipy.optimize import least_squares
from support.machines import fixed
from support.trackers import simulated

from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.fitting.equations.choice import engine_named
from volid.fitting.equations.free_directions import FreeDirections
from volid.fitting.equations.optimistix_solver import solve_by_optimistix
from volid.fitting.equations.problem import build_problem, scatter
from volid.fitting.equations.solver import Objective, solve
from volid.fitting.equations.system import Normal
from volid.fitting.fit import fit
from volid.fitting.starts import find_starts
from volid.model.error_functions import motion_names
from volid.model.error_model import build_model

EXACT = ExactMachine("w X' b Y Z t", {"X": (0, 700), "Y": (0, 400), "Z": (-400, 0)})


@cache
def small_campaign(off_by=5.0) -> Campaign:
    plan = dict(n_per_station=60, every_station_sees_every_tool=True)
    return simulated(EXACT, 11, extra=fixed(2), waviness=0.3, off_by=off_by, **plan)[0]


def problem_of(campaign, starts):
    model = build_model(campaign.machine, {name: (2,) for name in motion_names(campaign.machine)})
    return build_problem(campaign, model, starts)


@cache
def solved():
    problem = problem_of(small_campaign(), find_starts(small_campaign()))
    return problem, solve(problem)


def uncertainties(problem, optimum):
    """u of every unknown z from the normal equations, for comparisons in units of u."""
    covariance = np.linalg.inv(optimum.normal.matrix)
    return np.sqrt(np.einsum("ij,jk,ik->i", problem.free, covariance, problem.free))


def difference(problem, a, b, u):
    """Largest difference of two z in units of u, coefficients by their free combinations."""
    away = np.abs(problem.free.T @ (a - b))
    return np.max(away / (problem.free.T**2 @ u**2) ** 0.5)


def test_same_answer_as_scipy():
    problem, optimum = solved()
    campaign = small_campaign()
    scale = 1 / np.sqrt(np.diagonal(optimum.normal.matrix))

    def of(y):
        return problem.start + problem.free @ (scale * y)

    def residual(y):
        predicted = scatter(problem, campaign, problem.equations.predictions(of(y)))[0]
        return ((predicted - campaign.sets[0].readings) / campaign.sets[0].u)[:, 0]

    def slopes(y):
        (rows,) = problem.equations.jacobian(of(y))
        rows = np.asarray(rows).transpose(0, 2, 1).reshape(-1, problem.system.size)[: len(campaign.sets[0])]
        return rows @ problem.free * scale

    found = least_squares(residual, np.zeros(len(scale)), slopes, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert optimum.converged and optimum.iterations < 12
    assert float(optimum.normal.cost) == pytest.approx(found.cost, rel=1e-10)
    u = uncertainties(problem, optimum)
    assert difference(problem, optimum.z, np.asarray(of(found.x)), u) < 1e-6


def test_same_answer_as_the_optimistix_solver():
    """One assembly of JᵀJ a step, compiled as a whole, against the loop of few assemblies."""
    problem, optimum = solved()
    own = problem._replace(equations=engine_named("compiled").equations(problem.system))
    other = solve_by_optimistix(own)
    assert other.converged and other.iterations < 12
    assert other.cost == pytest.approx(optimum.cost, rel=1e-10)
    assert difference(problem, optimum.z, other.z, uncertainties(problem, optimum)) < 1e-6


def test_a_whole_fit_by_optimistix():
    chord, other = (fit(small_campaign(), solver=name) for name in ("chord", "optimistix"))
    u = np.sqrt(np.diagonal(np.asarray(chord.covariance)))
    both = [np.concatenate([np.asarray(s.parameters), np.asarray(s.nuisance)]) for s in (chord, other)]
    assert np.abs((both[0] - both[1]) / u).max() < 1e-5
    np.testing.assert_allclose(np.diagonal(np.asarray(other.covariance)), u**2, rtol=1e-5)
    with pytest.raises(InputError, match="solver is 'newton'; expected 'chord' or 'optimistix'"):
        fit(small_campaign(), solver="newton")
    with pytest.raises(InputError, match="engine is 'interpreted', but this solver is a compiled program"):
        fit(small_campaign(), solver="optimistix", engine="interpreted")


def test_a_path_is_no_campaign():
    with pytest.raises(InputError, match=r"fit takes a Campaign; got str.*volid.load_campaign"):
        fit("datasets/vertical_multilateration/campaign.toml")  # type: ignore[arg-type]


def test_gradient_vanishes_and_normal_equations_belong_to_the_answer():
    problem, optimum = solved()
    scale = 1 / np.sqrt(np.diagonal(optimum.normal.matrix))
    assert np.abs(scale * optimum.normal.gradient).max() < 1e-6
    again = problem.equations.normal(optimum.z)
    np.testing.assert_allclose(
        problem.free.T @ np.asarray(again.matrix) @ problem.free, optimum.normal.matrix, rtol=1e-9, atol=1e-3
    )


def test_stations_500_mm_wrong_and_dead_paths_unknown_reach_the_same_minimum():
    far = small_campaign(500.0)
    problem, optimum = solved()
    other = problem_of(far, {})  # no help from trilateration: start at the wrong positions, dead paths at 0
    wrong = solve(other)
    assert np.abs(other.start - problem.start).max() > 400
    assert wrong.converged
    assert difference(problem, wrong.z, optimum.z, uncertainties(problem, optimum)) < 1e-6


def test_start_at_the_answer_takes_two_iterations():
    problem, optimum = solved()
    again = solve(problem, start=optimum.z)
    assert again.converged and again.iterations <= 4
    assert difference(problem, again.z, optimum.z, uncertainties(problem, optimum)) < 1e-6


class _Rounded(Objective):
    """Two parameters that are known only together; every gradient has a rounding error of its own."""

    matrix = np.array([[1.0, 1.0 - 1e-6], [1.0 - 1e-6, 1.0]])

    def __init__(self):
        self.free, self.slopes = FreeDirections(np.eye(2)), 0

    def full_slope(self, z):
        self.slopes += 1
        return self.full_normal(z, False)[:2]

    def full_normal(self, z, rough):
        rounding = 1e-12 * (-1.0) ** self.slopes * np.array([1.0, -1.0])
        return Normal(0.5 * z @ self.matrix @ z, self.matrix @ z + rounding, self.matrix.copy())


def test_a_start_within_rounding_of_the_answer_is_the_answer():
    """As a streamed fit has it, whose sample is all of the campaign: steps are rounding there and never shrink."""
    objective = _Rounded()
    found = solve(solved()[0], np.zeros(2), objective=objective)
    assert found.converged and objective.slopes <= 2
    assert np.abs(found.z).max() < 1e-5


def test_held_directions_stay_where_they_start():
    """Only the directions in `free` move."""
    problem, optimum = solved()
    n = problem.model.layout.n_coefficients
    stations_only = problem.free[:, problem.model.n_parameters :]
    found = solve(problem, free=stations_only)
    assert found.converged
    np.testing.assert_array_equal(found.z[:n], problem.start[:n])
    assert float(found.normal.cost) > 10 * float(optimum.normal.cost)


def test_unsolvable_problem_says_so():
    """Readings that are no distances at all: no convergence is claimed where no finite minimum was reached."""
    problem, _ = solved()
    broken = solve(
        problem, start=np.where(np.arange(len(problem.start)) == len(problem.start) - 1, np.nan, problem.start)
    )
    assert not broken.converged
