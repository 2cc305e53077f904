"""The path without compiled programs gives what the compiled one gives, for every kind of observation and the whole fit."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import random_truth
from support.every_form import everything
from support.machines import LAYOUTS, VERTICAL, exact_machine, fixed
from support.rtests import rtest
from support.trackers import simulated

from volid.backend.reverse import Recorded, gradients
from volid.effects.prediction import predict_readings
from volid.fitting.diagnosis.hold_out import _projected
from volid.fitting.equations import interpreted as interpreted_module
from volid.fitting.equations.compiled import (
    jacobian,
    normal_equations,
    nuisance_equations,
    predict_all,
    quadratic_forms,
    slope,
)
from volid.fitting.equations.interpreted import interpreted
from volid.fitting.equations.problem import build_problem
from volid.fitting.fit import fit
from volid.fitting.prediction import deviations as prediction
from volid.model.error_model import coefficient_rows, error_values, evaluate_bases


def five_axis():
    """A head and a table, sensor rotation and scale unknown."""
    exact = exact_machine(LAYOUTS["split C and B"])
    truth = random_truth(exact, np.random.default_rng(1))
    campaign = rtest(exact, truth, n=(3, 4), extra="[model]\nsegments = 2\n", rotation_u=1e-3, scale_u=1e-3, nest_u=0.1)
    from volid.model.error_functions import motion_names
    from volid.model.error_model import build_model

    model = build_model(campaign.machine, {n: (4,) for n in motion_names(campaign.machine)})
    problem = build_problem(campaign, model)
    rng = np.random.default_rng(2)
    return problem, problem.start + 1e-4 * rng.standard_normal(len(problem.start))


@pytest.fixture(scope="module", params=["three axes, every form", "five axes, displacements"])
def case(request):
    if request.param.startswith("five"):
        return five_axis()
    _, problem, z, _ = everything()
    return problem, z


def close(a, b):
    for x, y in zip(a, b, strict=True):
        x, y = np.asarray(x), np.asarray(y)
        np.testing.assert_allclose(x, y, rtol=1e-9, atol=1e-11 * np.abs(y).max(initial=1e-300))


def both(function):
    with interpreted(True):
        first = function()
    with interpreted(False):
        return first, function()


def test_nuisance_parameters_alone_are_a_part_of_the_whole(case):
    """In both paths: the corner of the normal equations."""
    problem, z = case
    n = problem.system.layout.n_coefficients
    whole = both(lambda: normal_equations(problem.system, z))[0]
    for found in both(lambda: nuisance_equations(problem.system, z)):
        close(found, (whole.cost, np.asarray(whole.gradient)[n:], np.asarray(whole.matrix)[n:, n:]))


def test_a_fold_takes_its_own_readings_only(case):
    """A third of the readings with a weight, spread over every chunk; the last rows have none."""
    problem, z = case

    def thinned(block):
        weight = np.asarray(block.weight)
        return replace(block, weight=np.where(np.arange(weight.shape[2]) % 3 == 1, weight, 0.0))

    blocks = tuple(thinned(b) for b in problem.system.blocks)
    system = replace(problem.system, blocks=blocks, tiles=(None,) * len(blocks))
    assert any(isinstance(c, interpreted_module._Some) for b in blocks for c in interpreted_module.chunks_of(b, True))
    for function in (normal_equations, slope):
        close(*both(lambda f=function: f(system, z)))


def test_rough_normal_equations_have_the_exact_gradient(case):
    """Single precision stands in JᵀJ alone: to 1e-5 of its diagonal, and not closer, or it would not be single."""
    problem, z = case
    whole = both(lambda: normal_equations(problem.system, z))[0]
    scale = np.sqrt(np.diagonal(np.asarray(whole.matrix)))
    scale = np.where(scale > 0, scale, 1.0)
    for found in both(lambda: normal_equations(problem.system, z, rough=True)):
        close(found[:2], whole[:2])
        away = np.abs((np.asarray(found.matrix) - whole.matrix) / np.outer(scale, scale)).max()
        assert 1e-10 < away < 1e-5


def test_second_derivatives_bend_the_predictions(case):
    """p(w + δ) + p(w - δ) - 2 p(w) = δᵀH δ for tenths of a millimetre and of a milliradian in all values at once."""
    problem, z = case
    system, n = problem.system, problem.system.layout.n_coefficients
    rows = tuple(sorted({t.row for t in system.layout.terms}))
    rng = np.random.default_rng(0)
    for block in system.blocks:
        chunk = next(interpreted_module.chunks_of(block))
        units = [problem.nuisance[i].unit for i in np.asarray(block.slots)[0, :, 0]]
        steps = np.array([1.0 if r % 6 < 3 else 1e-3 for r in rows] + [1.0 if u == "mm" else 1e-3 for u in units])
        found = interpreted_module.second_derivatives(system, block.form, chunk, z, rows, 1e-4 * steps).astype(float)
        errors = error_values(system.layout, z[:n], evaluate_bases(system.layout, chunk.q, chunk.direction))
        places, whole = (
            [*rows, *range(len(errors), len(errors) + len(chunk.slots))],
            np.vstack([errors, z[n + chunk.slots]]),
        )
        delta = np.zeros_like(whole)
        delta[places] = 0.1 * steps[:, None] * rng.standard_normal((len(places), chunk.m))

        def whitened(w, form=block.form, chunk=chunk, split=6 * (problem.system.layout.n_axes + 1)):
            tool, constants = tuple(chunk.tool), tuple(chunk.constants)
            return chunk.weight * predict_readings(system.machine, form, chunk.q, tool, w[:split], w[split:], constants)

        up, down, middle = whitened(whole + delta), whitened(whole - delta), whitened(whole)
        d = delta[places].T
        bent = np.einsum("mi,kmij,mj->km", d, found[:, :, :-1], d)
        along = np.einsum("kmj,mj->km", found[:, :, -1], d)
        np.testing.assert_allclose(up - down, 2.0 * along, atol=2e-4 * np.abs(along).max())
        np.testing.assert_allclose(
            up + down - 2.0 * middle, bent, atol=2e-3 * np.abs(bent).max() + 1e-9 * np.abs(middle).max()
        )


def test_normal_equations_slope_predictions_jacobian_and_leverages_agree(case):
    problem, z = case
    close(*both(lambda: normal_equations(problem.system, z)))
    close(*both(lambda: slope(problem.system, z)))
    close(*both(lambda: predict_all(problem.system, z)))
    close(*both(lambda: jacobian(problem.system, z)))
    factor = np.random.default_rng(0).standard_normal((3, problem.system.size))
    close(*both(lambda: quadratic_forms(problem.system, z, factor)))
    close(*both(lambda: _projected(problem.system, z, factor)))


def test_slope_is_the_gradient_of_the_normal_equations(case):
    problem, z = case
    for path in (True, False):
        with interpreted(path):
            normal, (cost, gradient) = normal_equations(problem.system, z), slope(problem.system, z)
        assert float(cost) == pytest.approx(float(normal.cost), rel=1e-12)
        scale = np.sqrt(np.diagonal(np.asarray(normal.matrix)) * float(normal.cost))
        assert np.all(np.abs(np.asarray(gradient) - np.asarray(normal.gradient)) <= 1e-10 * scale + 1e-300)


def test_the_whole_fit_agrees(monkeypatch):
    campaign, _, _ = simulated(VERTICAL, 4, extra=fixed(2), n_per_station=80, waviness=0.1)
    first = fit(campaign)
    monkeypatch.setattr(interpreted_module, "LARGEST", 0)
    second = fit(campaign)
    u = np.sqrt(np.diagonal(np.asarray(first.covariance)))
    both = [np.concatenate([np.asarray(s.parameters), np.asarray(s.nuisance)]) for s in (first, second)]
    # the iteration stops 1e-7 conditional u from the minimum, a hundred times less than u where parameters are correlated
    assert np.all(np.abs(both[0] - both[1]) <= 1e-5 * u), "what is held is 0 in both"
    away = np.abs(np.asarray(first.covariance) - np.asarray(second.covariance))
    assert np.all(away <= 1e-5 * np.outer(u, u))
    assert first.adequacy.verdict == second.adequacy.verdict


@pytest.mark.parametrize("grid", [True, False])
def test_uncertainty_through_error_values_is_that_of_the_gradient(monkeypatch, grid):
    """On a grid (tables of pairs) and at scattered points (no tables), compiled and not, reversal and cross effects included."""
    _, problem, _, _ = everything()
    model, rng = problem.model, np.random.default_rng(5)
    root = rng.standard_normal((model.n_parameters, 7))
    theta = 1e-4 * rng.standard_normal(model.n_parameters)
    low = np.array([a.travel[0] for a in model.machine.axes])
    length = np.array([a.length for a in model.machine.axes])
    at = rng.integers(0, 4, (120, len(low))) / 3.0 if grid else rng.random((120, len(low)))
    tool, way = rng.normal(size=(120, 3)) * 100.0, rng.choice([-1.0, 0.0, 1.0], (120, len(low))) * grid
    gradient = prediction.gradient_matrix(model, theta, low + at * length, tool, way)
    expected = np.linalg.norm(gradient @ root, axis=2)
    for limit in (10_000, 0):
        monkeypatch.setattr(prediction, "INTERPRETED", limit)
        found = prediction.standard_uncertainties(model, theta, root @ root.T, low + at * length, tool, way)
        scale = expected.max(axis=0)
        np.testing.assert_allclose(found / scale, expected / scale, rtol=1e-7, atol=1e-7)


def test_recorded_operations_have_their_derivatives():
    rng, notes = np.random.default_rng(0), []
    values = rng.uniform(1.0, 2.0, (3, 5))
    a, b, c = (Recorded(v, notes) for v in values)

    def formula(a, b, c):
        root = (a * b + 2.0 * c).sqrt() if isinstance(a, Recorded) else np.sqrt(a * b + 2.0 * c)
        return 3.0 - (root - a) * values[0] + (-b) * c * 1.0 + c * 0.0 + 0.0

    found = gradients(formula(a, b, c), [a, b, c], 5)
    for i in range(3):
        step = 1e-30j * (np.arange(3) == i)[:, None]
        np.testing.assert_allclose(found[i], formula(*(values + step)).imag / 1e-30, rtol=1e-13)


def test_coefficient_rows_sum_to_summed_rows(case):
    from volid.model.error_model import evaluate_bases, summed_rows

    problem, _ = case
    block, layout = problem.system.blocks[0], problem.system.layout
    bases = evaluate_bases(layout, block.q[0], block.direction[0])
    partials = np.random.default_rng(0).standard_normal((6 * (layout.n_axes + 1), block.q.shape[2]))
    np.testing.assert_allclose(
        summed_rows(layout, partials, bases),
        coefficient_rows(layout, partials, bases).sum(axis=1),
        rtol=1e-9,
        atol=1e-9,
    )
