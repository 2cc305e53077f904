"""The least-squares problem: structured Jacobian against finite differences, padding, normal equations."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth, apply, rigid
from support.every_form import EXACT, STATIONS, everything
from support.judging import spline_truth
from support.machines import volid_machine

from volid.fitting.equations import problem as problems
from volid.fitting.equations.compiled import Compiled
from volid.fitting.equations.interpreted import Interpreted
from volid.fitting.equations.problem import build_problem, reweight, scatter
from volid.model.error_functions import motion_names
from volid.model.error_model import build_model


@pytest.fixture(params=[Compiled(), Interpreted()], ids=lambda engine: engine.name)
def case(request):
    """`everything`, in both engines."""
    campaign, built, z, scale = everything()
    return campaign, built._replace(equations=request.param.equations(built.system)), z, scale


def rows_by_set(campaign, built, blocks):
    """Jacobian blocks (n_chunks, size, k · chunk) as (m, size) per set, for one reading per row."""
    result = [np.full((len(s), built.system.size), np.nan) for s in campaign.sets]
    for (number, rows), values in zip(built.places, blocks, strict=True):
        result[number][rows] = np.asarray(values).transpose(0, 2, 1).reshape(-1, built.system.size)[: len(rows)]
    return result


def predictions(campaign, built, z):
    return scatter(built, campaign, built.equations.predictions(z))


def test_every_reading_is_predicted_once(case):
    campaign, built, z, _ = case
    for s, p in zip(campaign.sets, predictions(campaign, built, z), strict=True):
        assert np.all(np.isfinite(p)), s.name
    assert sum(len(rows) for _, rows in built.places) == campaign.n_readings


def test_structured_jacobian_is_the_finite_difference(case):
    campaign, built, z, scale = case
    ours = rows_by_set(campaign, built, built.equations.jacobian(z))
    for i, step in enumerate(0.01 * scale):
        shift = np.zeros_like(z)
        shift[i] = step
        high, low = (predictions(campaign, built, z + sign * shift) for sign in (1, -1))
        for s, rows, a, b in zip(campaign.sets, ours, high, low, strict=True):
            difference = (a - b)[:, 0] / (2 * step) / s.u[:, 0]
            # a distance of 1 m is rounded to 2e-13 mm; curvature of a distance: step² / (6 d²) < 1e-7
            tolerance = 4e-13 / step / s.u[:, 0] + 1e-7 * np.abs(difference)
            assert np.all(np.abs(rows[:, i] - difference) <= tolerance), (s.name, i)


def test_jacobian_reaches_every_parameter():
    campaign, built, z, _ = everything()
    total = sum(np.abs(r).sum(axis=0) for r in rows_by_set(campaign, built, built.equations.jacobian(z)))
    assert np.all(total > 0), [
        e.name for e, t in zip(built.nuisance, total[-len(built.nuisance) :], strict=True) if t == 0
    ]


# ------------------------------------------------------------------------------- readings predicted by the exact chain


@cache
def exact_prediction():
    """A smooth machine without reversal and cross effects: problem of `everything`'s sets, z, and the exact truth."""
    rng = np.random.default_rng(4)
    campaign = everything()[0]
    machine = volid_machine(EXACT)
    model = build_model(machine, {name: (2,) for name in motion_names(machine)})
    built = build_problem(replace(campaign, machine=machine), model)
    theta = rng.normal(size=model.n_parameters)
    for f in model.functions:
        theta[f.parameters] *= 1e-5 if f.name[1] in "ABC" else 5e-3
    nuisance = built.start[model.layout.n_coefficients :] + rng.uniform(-1e-4, 1e-4, len(built.nuisance))
    z = np.concatenate([model.parametrisation @ theta, nuisance])
    values = {e.name: v for e, v in zip(built.nuisance, nuisance, strict=True)}
    return campaign, predictions(campaign, built, z), spline_truth(model, theta), values


def partial_pose(truth, q, axes):
    """Exact pose, seen from the workpiece, of the body that carries the last of `axes`."""
    names = [a + "'" * (a == "Y") for a in axes]
    cut = ExactMachine(" ".join(["w", *names[:1], "b", *names[1:], "t"]), {a: EXACT.travel[a] for a in axes})
    kept = Truth(
        {k: f for k, f in truth.functions.items() if k[2] in axes},
        {k: v for k, v in truth.constants.items() if k[3] in axes},
    )
    return cut.pose(q[:, [EXACT.column(a) for a in axes]], kept)


def test_distances_are_the_exact_chains_from_any_body():
    campaign, found, truth, values = exact_prediction()
    s = campaign.sets[0]
    target = EXACT.functional_point(s.positions, s.tool, truth)
    t, w = ([values[f"placement {c}"] for c in letters] for letters in ("XYZ", "ABC"))
    stations = {"net1": t + rigid(w, np.zeros(3))[0, :3, :3] @ STATIONS["net1"].position}
    for name in ("free", "bed", "column", "exact"):
        stations[name] = np.array([values[f"station {name} {c}"] for c in "XYZ"])
    poses = {"bed": partial_pose(truth, s.positions, "Y"), "column": partial_pose(truth, s.positions, "YX")}
    for i, (name, segment) in enumerate(zip(s.labels["station"], s.labels["segment"], strict=True)):
        at = apply(poses[name][[i]], stations[name])[0] if name in poses else stations[name]
        expected = np.linalg.norm(target[i] - at) + values[f"dead path {name} segment {segment}"]
        assert found[0][i, 0] == pytest.approx(expected, abs=1e-9), name  # third order of rotations: 1e-10 mm


def test_absolute_and_calibrated_distances():
    campaign, found, truth, values = exact_prediction()
    absolute, calibrated = campaign.sets[1:3]
    free = absolute.labels["station"] == "free"
    target = EXACT.functional_point(absolute.positions, absolute.tool, truth)
    station = [values[f"station free {c}"] for c in "XYZ"]
    np.testing.assert_allclose(found[1][free, 0], np.linalg.norm(target - station, axis=1)[free], rtol=0, atol=1e-9)
    target = EXACT.functional_point(calibrated.positions, calibrated.tool, truth)
    socket = apply(partial_pose(truth, calibrated.positions, "Y"), [values[f"station bed {c}"] for c in "XYZ"])
    expected = np.linalg.norm(target - socket, axis=1) + values["length calibrated"]
    np.testing.assert_allclose(found[2][:, 0], expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("number, slope", [(3, False), (4, True)])
def test_components_are_the_exact_chains_with_offset_and_slope(number, slope):
    """value = component + offset of the line, plus slope · (moving axis - its first position on the line)."""
    campaign, found, truth, values = exact_prediction()
    s = campaign.sets[number]
    deviation = EXACT.deviation(s.positions, s.tool, truth)
    for component in set(s.labels["component"]):
        for line in "12":
            rows = np.flatnonzero((s.labels["component"] == component) & (s.labels["line"] == line))
            expected = deviation[rows, "XYZABC".index(component)] + values[f"offset {s.name} line {line} {component}"]
            if slope:
                moving = np.argmax(np.ptp(s.positions[rows], axis=0))
                arm = s.positions[rows, moving] - s.positions[rows[0], moving]
                expected = expected + values[f"slope {s.name} line {line} {component}"] * arm
            np.testing.assert_allclose(found[number][rows, 0], expected, rtol=0, atol=1e-9)


OPEN = ("offset", "scale")  # of an artefact whose lengths were measured


def test_nuisance_parameters_are_the_expected_ones():
    _, built, _, _ = everything()
    names = [e.name for e in built.nuisance]
    for station, segments in (("free", "12"), ("bed", "12"), ("column", "12")):
        assert [n for n in names if n.startswith(f"station {station} ")] == [f"station {station} {c}" for c in "XYZ"]
        assert [n for n in names if n.startswith(f"dead path {station} ")] == [
            f"dead path {station} segment {s}" for s in segments
        ]
    assert [n for n in names if n.startswith("dead path net1 ")] == [f"dead path net1 segment {s}" for s in "12"]
    assert [n for n in names if n.startswith("placement")] == [f"placement {c}" for c in "XYZABC"]
    assert not any(n.startswith(("station net", "dead path net2")) for n in names)
    prior = {e.name: e.prior_u for e in built.nuisance}
    assert prior["station exact X"] == 0.0 and prior["length calibrated"] == 0.001 and prior["station bed Z"] == np.inf
    fixed_columns = np.flatnonzero(np.abs(built.free).sum(axis=1) == 0) - built.model.layout.n_coefficients
    # nothing is read along Z on the square
    assert [names[i] for i in fixed_columns] == [*(f"station exact {c}" for c in "XYZ"), "alignment square Z"]
    assert sum(n.startswith("slope") for n in names) == 4
    assert sum(n.startswith("offset components") for n in names) == 8
    assert [n for n in names if "length " in n and "of" in n] == [
        f"{w} of length {a}" for a in ("bar", "gauge") for w in OPEN
    ]
    assert {prior[f"{w} of length bar"] for w in OPEN} == {np.inf} and prior["angle square line Y"] == 1e-5
    assert {e.prior_u for e in built.nuisance if e.name.startswith("form square")} == {1e-3}


def test_normal_equations_are_those_of_jacobian_residual_and_prior(case):
    campaign, built, z, _ = case
    J = np.concatenate(rows_by_set(campaign, built, built.equations.jacobian(z)))
    r = np.concatenate(
        [((p - s.readings) / s.u)[:, 0] for s, p in zip(campaign.sets, predictions(campaign, built, z), strict=True)]
    )
    u = np.array([e.prior_u for e in built.nuisance])
    prior = np.zeros_like(z)
    prior[built.model.layout.n_coefficients :] = np.where(
        np.isfinite(u) & (u > 0.0), 1.0 / np.maximum(u, 1e-9) ** 2, 0.0
    )
    assert prior.max() == pytest.approx(1e10)  # of the angle of the square
    normal = built.equations.normal(z)
    size = np.sqrt(np.diagonal(J.T @ J + np.diag(prior)))
    np.testing.assert_allclose(
        np.asarray(normal.matrix) / np.outer(size, size), (J.T @ J + np.diag(prior)) / np.outer(size, size), atol=1e-12
    )
    scale = size * np.linalg.norm(r)
    np.testing.assert_allclose(normal.gradient / scale, (J.T @ r + prior * z) / scale, atol=1e-12)
    assert float(normal.cost) == pytest.approx(0.5 * (r @ r + prior @ z**2), rel=1e-12)


def test_weights_of_a_reweighted_problem(case):
    campaign, built, z, _ = case
    rng = np.random.default_rng(2)
    factors = [np.where(rng.random(s.readings.shape) < 0.3, 0.0, rng.random(s.readings.shape)) for s in campaign.sets]
    J = np.concatenate(rows_by_set(campaign, built, built.equations.jacobian(z)))
    weighted = J * np.concatenate(factors)
    normal = reweight(built, campaign, factors).equations.normal(z)
    known = np.asarray(built.system.prior_root)
    expected = weighted.T @ weighted + known.T @ known
    np.testing.assert_allclose(normal.matrix, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_padding_to_chunks_changes_nothing(monkeypatch):
    campaign, built, z, _ = everything()
    sets = campaign.sets[2:3]
    one = replace(campaign, sets=sets)
    whole = build_problem(one, built.model)
    monkeypatch.setattr(problems, "CHUNK", 8)
    parts = build_problem(one, built.model)
    assert whole.system.blocks[0].weight.shape == (1, 1, 64) and parts.system.blocks[0].weight.shape == (4, 1, 8)
    z = z[: whole.system.size]
    a, b = (p.equations.normal(z) for p in (whole, parts))
    for x, y in zip(a, b, strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-10, atol=1e-12 * np.abs(np.asarray(x)).max())
    for x, y in zip(predictions(one, whole, z), predictions(one, parts, z), strict=True):
        np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize(
    "m, chunks, length", [(1, 1, 64), (65, 1, 80), (2048, 1, 2048), (2049, 2, 2048), (20000, 10, 2048)]
)
def test_chunks_hold_all_rows(m, chunks, length):
    assert problems.chunk_shape(m) == (chunks, length)
    found = problems.chunk_shape(m)
    assert found[0] * found[1] >= m
