"""Both engines give the same numbers, for every kind of observation, for tiles of any size, and for the whole fit."""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import random_truth
from support.every_form import everything
from support.machines import LAYOUTS, VERTICAL, exact_machine, fixed
from support.rtests import rtest
from support.trackers import simulated

from volid.backend.pytrees import map_arrays
from volid.backend.reverse import Recorded, gradients
from volid.effects.prediction import predict_readings
from volid.exceptions import InputError
from volid.fitting.equations import arranged as arranged_module
from volid.fitting.equations import choice
from volid.fitting.equations import interpreted as interpreted_module
from volid.fitting.equations.compiled import Compiled
from volid.fitting.equations.interpreted import Interpreted
from volid.fitting.equations.problem import build_problem
from volid.fitting.equations.second_derivatives import second_derivatives
from volid.fitting.fit import fit
from volid.fitting.prediction import deviations as prediction
from volid.model.error_values import coefficient_rows, error_values, evaluate_bases


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


def both(system, function):
    """`function` of the equations of a system, by each engine."""
    return [function(engine.equations(system)) for engine in (Interpreted(), Compiled())]


@pytest.fixture(params=[None, 1, 3], ids=["cells by cost", "cells of one interval", "cells of three"])
def cells(request, monkeypatch):
    """Tiles of the interpreted engine as it chooses them, and small ones: windows, pieces of several tiles, two threads."""
    if request.param:
        monkeypatch.setattr(arranged_module, "SHARES", (request.param,))
        monkeypatch.setattr(arranged_module, "PIECE", 16)
        monkeypatch.setattr(interpreted_module, "SHARED", 1)


def test_nuisance_parameters_alone_are_a_part_of_the_whole(case, cells):
    """In both engines: the corner of the normal equations."""
    problem, z = case
    n = problem.system.layout.n_coefficients
    whole = both(problem.system, lambda e: e.normal(z))[0]
    for found in both(problem.system, lambda e: e.nuisance(z)):
        close(found, (whole.cost, whole.gradient[n:], whole.matrix[n:, n:]))


def changed(system):
    """The system with a third of the readings, spread over all chunks, with other values and weights."""
    rng = np.random.default_rng(8)

    def of(block):
        weight = np.where(np.arange(block.weight.shape[2]) % 3 == 1, block.weight * rng.uniform(0.5, 1.0), 0.0)
        return replace(block, weight=weight, reading=block.reading + 0.01 * rng.standard_normal(block.reading.shape))

    return replace(system, blocks=tuple(map(of, system.blocks)), prior_value=system.prior_value + 1e-3)


def test_a_fold_takes_its_own_readings_only(case, cells):
    """Equations with other weights, readings and prior are those that are made of them at once."""
    problem, z = case
    system = changed(problem.system)
    factor = np.random.default_rng(0).standard_normal((3, system.size))
    questions = (
        lambda e: e.normal(z), lambda e: e.slope(z), lambda e: e.quadratic_forms(z, factor), lambda e: e.jacobian(z)
    )  # fmt: skip
    for question in questions:
        expected = question(Compiled().equations(system))
        for found in both(problem.system, lambda e, q=question: q(e.changed(system))):
            close(found, expected)


def test_rough_normal_equations_have_the_exact_gradient(case, cells):
    """Single precision stands in JᵀJ alone: to 1e-5 of its diagonal, and not closer, or it would not be single."""
    problem, z = case
    whole = both(problem.system, lambda e: e.normal(z))[0]
    scale = np.sqrt(np.diagonal(np.asarray(whole.matrix)))
    scale = np.where(scale > 0, scale, 1.0)
    for found in both(problem.system, lambda e: e.normal(z, rough=True)):
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
        chunk = map_arrays(lambda a: a[0], block)
        m = chunk.q.shape[1]
        units = [problem.nuisance[i].unit for i in np.asarray(block.slots)[0, :, 0]]
        steps = np.array([1.0 if r % 6 < 3 else 1e-3 for r in rows] + [1.0 if u == "mm" else 1e-3 for u in units])
        found = second_derivatives(system, chunk, z, rows, 1e-4 * steps).astype(float)
        errors = error_values(system.layout, z[:n], evaluate_bases(system.layout, chunk.q, chunk.direction))
        places, whole = (
            [*rows, *range(len(errors), len(errors) + len(chunk.slots))],
            np.vstack([errors, z[n + chunk.slots]]),
        )
        delta = np.zeros_like(whole)
        delta[places] = 0.1 * steps[:, None] * rng.standard_normal((len(places), m))

        def whitened(w, form=block.form, chunk=chunk, errors=errors):
            split = len(errors)
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


def test_normal_equations_slope_predictions_jacobian_and_leverages_agree(case, cells):
    problem, z = case
    factor = np.random.default_rng(0).standard_normal((3, problem.system.size))
    questions = (
        lambda e: e.normal(z), lambda e: e.slope(z), lambda e: e.predictions(z), lambda e: e.jacobian(z),
        lambda e: e.quadratic_forms(z, factor), lambda e: e.projected(z, factor),
    )  # fmt: skip
    for question in questions:
        close(*both(problem.system, question))


def test_leverages_agree(case, cells):
    """With the root of a covariance, which has more rows than a tile has columns; they lie between 0 and 1."""
    problem, z = case
    matrix = Compiled().equations(problem.system).normal(z).matrix
    scale = 1.0 / np.sqrt(np.where(np.diagonal(matrix) > 0.0, np.diagonal(matrix), 1.0))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    kept = values > 1e-9 * values[-1]
    factor = (scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])).T
    found, expected = both(problem.system, lambda e: e.quadratic_forms(z, factor))
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-7)
        assert a.min() >= 0.0 and 0.01 < a.max() < 1.0 + 1e-7


def test_sensitivities_and_readings_agree(case):
    """Of every form: predictions, and how they answer to axis positions and tool vectors."""
    problem, z = case
    system, n = problem.system, problem.system.layout.n_coefficients
    for block in system.blocks:
        c = map_arrays(lambda a: a[0], block)
        errors = error_values(system.layout, z[:n], evaluate_bases(system.layout, c.q, c.direction))
        slots = z[n + c.slots]
        found, expected = (
            [e.readings(system.machine, block.form, c.q, c.tool, errors, slots, c.constants),
             *e.sensitivities(system.machine, block.form, c.q, c.tool, slots, c.constants)]
            for e in (Interpreted(), Compiled())
        )  # fmt: skip
        close(found, expected)


def test_slope_is_the_gradient_of_the_normal_equations(case, cells):
    problem, z = case
    for normal, (cost, gradient) in both(problem.system, lambda e: (e.normal(z), e.slope(z))):
        assert float(cost) == pytest.approx(float(normal.cost), rel=1e-12)
        scale = np.sqrt(np.diagonal(normal.matrix) * float(normal.cost))
        assert np.all(np.abs(gradient - normal.gradient) <= 1e-10 * scale + 1e-300)


def test_the_whole_fit_agrees():
    campaign, _, _ = simulated(VERTICAL, 4, extra=fixed(2), n_per_station=80, waviness=0.1)
    first, second = fit(campaign, engine="interpreted"), fit(campaign, engine="compiled")
    u = np.sqrt(np.diagonal(np.asarray(first.covariance)))
    both = [np.concatenate([np.asarray(s.parameters), np.asarray(s.nuisance)]) for s in (first, second)]
    # the iteration stops 1e-7 conditional u from the minimum, a hundred times less than u where parameters are correlated
    assert np.all(np.abs(both[0] - both[1]) <= 1e-5 * u), "what is held is 0 in both"
    away = np.abs(np.asarray(first.covariance) - np.asarray(second.covariance))
    assert np.all(away <= 1e-5 * np.outer(u, u))
    assert first.adequacy.verdict == second.adequacy.verdict
    with pytest.raises(InputError, match="engine is 'fast'; expected 'compiled' or 'interpreted'"):
        fit(campaign, engine="fast")


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
        monkeypatch.setattr(choice, "POINTS", limit)
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
    cosine, sine = a.cos_sin()
    np.testing.assert_allclose(
        gradients(cosine * 2.0 + sine * b, [a], 5)[0], -2.0 * np.sin(values[0]) + np.cos(values[0]) * values[1]
    )
    for i in range(3):
        step = 1e-30j * (np.arange(3) == i)[:, None]
        np.testing.assert_allclose(found[i], formula(*(values + step)).imag / 1e-30, rtol=1e-13)


def test_coefficient_rows_sum_to_summed_rows(case):
    from volid.model.error_values import evaluate_bases, summed_rows

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
