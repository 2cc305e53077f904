"""Coverage intervals in tables, and the budget on the command line: samples of a known distribution, sums worked out by hand."""

import csv
import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from volid.cli import main
from volid.compensation.grids.intervals import with_intervals
from volid.compensation.grids.rotary import rotary_grids
from volid.io.functions_csv import DEVIATIONS, read_deviations, read_functions
from volid.io.grid_reader import read_grid
from volid.io.solutions import write_solution
from volid.uncertainty.budget import Line
from volid.uncertainty.intervals import deviation_intervals, function_intervals
from volid.uncertainty.statement import statement
from volid.uncertainty.trials.samples import Samples

TRIALS = 4000
# of an end point at 2.5 %, in u: sqrt(0.025 · 0.975/M)/φ(1.96) = 0.042; five times that over hundreds of values
SAMPLING = 0.21


def with_samples(solution, draws: np.ndarray):
    """The solution with samples x0 + L draws, (M, r), C = L Lᵀ."""
    values, vectors = np.linalg.eigh(np.asarray(solution.covariance))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    centre = np.concatenate([np.asarray(solution.parameters), np.asarray(solution.nuisance)])
    x = centre + draws @ root.T
    column = np.zeros(len(x))
    samples = Samples(
        len(x), lambda: iter(np.array_split(x, 3)), column, column, column > 0, column.astype(int), seed=0
    )
    return replace(solution, samples=samples)


@pytest.fixture(scope="module")
def sampled(solution):
    """Samples exactly as the covariance says: intervals must be value ± 1.96 u."""
    size = np.asarray(solution.covariance).shape[0]
    return with_samples(solution, np.random.default_rng(1).standard_normal((TRIALS, size)))


@pytest.fixture(scope="module")
def sampled_file(sampled, tmp_path_factory):
    path = tmp_path_factory.mktemp("sampled") / "s.h5"
    write_solution(sampled, path)
    return path


def test_intervals_of_functions_are_those_of_a_normal_distribution(sampled):
    rows = sampled.functions(points=5)
    found = function_intervals(sampled, rows)
    value, u = np.array([r.value for r in rows]), np.array([r.u for r in rows])
    assert np.abs(found.low - (value - 1.96 * u)).max() <= SAMPLING * u.max()
    assert (np.abs(found.low - (value - 1.96 * u)) <= SAMPLING * u + 1e-15).all()
    assert (np.abs(found.high - (value + 1.96 * u)) <= SAMPLING * u + 1e-15).all()
    shortest = found.shortest_high - found.shortest_low
    assert (shortest <= found.high - found.low + 1e-15).all()
    assert (shortest >= 0.9 * 3.92 * u - 1e-15).all(), (
        "the shortest interval of 95 % of a normal one is not much shorter"
    )


def test_intervals_of_deviations_by_the_model_itself(sampled):
    """Against the nonlinear model at every sample: nothing is lost by taking it linear."""
    q = np.array([[100.0, 50.0, -20.0], [600.0, 900.0, -480.0]])
    tool, still = np.array([[0.0, 0.0, -150.0], [80.0, 0.0, -250.0]]), np.zeros((2, 3))
    found = deviation_intervals(sampled, sampled.evaluate(q, tool).values, q, tool, still)
    n = sampled.model.n_parameters
    at = jax.vmap(lambda parameters: replace(sampled, parameters=parameters).deviation(q, tool))
    direct = np.asarray(at(jnp.asarray(few(sampled, 400)[:, :n])))
    first = replace(sampled, samples=replace(sampled.samples, trials=400, batches=lambda: iter([few(sampled, 400)])))
    some = deviation_intervals(first, sampled.evaluate(q, tool).values, q, tool, still)
    ordered = np.sort(direct, axis=0)  # q = 380 inside, r = 10: y(10) and y(390), JCGM 101 7.7.2
    second_order = (5e-6) ** 2 * 2000.0  # mm: rotations uncertain by 5 µrad, twice, over 2 m: 0.05 nm
    np.testing.assert_allclose(some.low, ordered[9], rtol=0, atol=second_order)
    np.testing.assert_allclose(some.high, ordered[389], rtol=0, atol=second_order)
    u = sampled.evaluate(q, tool).u
    assert (np.abs(found.high - found.low - 3.92 * u) <= 2 * SAMPLING * u).all()


def few(solution, count: int) -> np.ndarray:
    return np.concatenate(list(solution.samples.batches()))[:count]


def test_a_skew_distribution_has_skew_intervals(solution):
    """One-sided scatter of every parameter along one direction: the shortest interval starts at the edge."""
    size = np.asarray(solution.covariance).shape[0]
    draws = np.zeros((TRIALS, size))
    draws[:, -1] = np.random.default_rng(2).exponential(size=TRIALS)
    skew = with_samples(solution, draws)
    rows = skew.functions(points=3)
    found = function_intervals(skew, rows)
    value = np.array([r.value for r in rows])
    spread = found.high - found.low
    seen = spread > 1e-3 * spread.max()
    lower, upper = np.minimum(np.abs(found.low - value), np.abs(found.high - value)), spread
    # exponential: symmetric 95 % from 0.0253 to 3.689, shortest from 0 to 2.996
    np.testing.assert_allclose((lower / upper)[seen], 0.0253 / 3.664, atol=0.004)
    np.testing.assert_allclose(((found.shortest_high - found.shortest_low) / spread)[seen], 2.996 / 3.664, atol=0.05)


def test_tables_carry_intervals_and_can_be_read_back(sampled_file, sampled, tmp_path):
    out = tmp_path / "f.csv"
    assert main(["functions", str(sampled_file), "-o", str(out)]) == 0
    table = [line for line in out.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    assert table[0] == "function,axis,position,direction,value,u,U,low,high,shortest_low,shortest_high"
    row = next(csv.DictReader(table[:1] + [line for line in table if line.startswith("EC0Y")]))
    assert float(row["U"]) == 2 * float(row["u"]) and float(row["low"]) < float(row["value"]) < float(row["high"])
    assert len(read_functions(out)) == len(table) - 1
    points = tmp_path / "p.csv"
    points.write_text("X,Y,Z,tool_x,tool_y,tool_z\n500,100,-100,0,0,-150\n")
    out = tmp_path / "e.csv"
    assert main(["errors", str(sampled_file), "--at", str(points), "-o", str(out)]) == 0
    (row,) = csv.DictReader(line for line in out.read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
    for name in DEVIATIONS:
        assert float(row[f"low_{name}"]) <= float(row[name]) <= float(row[f"high_{name}"])
    assert len(read_deviations(out, sampled.machine)[0].positions) == 1


def test_intervals_of_grid_values(sampled_file, sampled, tmp_path, capsys):
    """Compensation values: the ends change places with the sign; between them 3.92 u, as samples of the covariance must have."""
    out, errors = tmp_path / "g.csv", tmp_path / "e.csv"
    assert main(["grid", str(sampled_file), "--points", "3", "--intervals", "-o", str(out)]) == 0
    assert main(["grid", str(sampled_file), "--points", "3", "--intervals", "--errors", "-o", str(errors)]) == 0
    plus, minus = (read_rows(path) for path in (errors, out))
    assert len(plus) == 27
    for name in ("dX", "dY", "dZ", "dA", "dB", "dC"):
        for e, c in zip(plus, minus, strict=True):
            assert e[f"low_{name}"] == -c[f"high_{name}"] and e[f"shortest_high_{name}"] == -c[f"shortest_low_{name}"]
            assert e[f"low_{name}"] <= e[name] <= e[f"high_{name}"] and abs(e[f"U_{name}"] - 2 * e[f"u_{name}"]) < 2e-9
            width = e[f"high_{name}"] - e[f"low_{name}"]
            assert width == pytest.approx(3.92 * e[f"u_{name}"], abs=2 * SAMPLING * e[f"u_{name}"] + 1e-9)
    grid = read_grid(out)
    np.testing.assert_allclose(grid.values, read_grid(errors).values, rtol=0, atol=2e-9)
    assert main(["grid", str(sampled_file), "--intervals", "--rigid"]) == 2
    assert "--intervals and --rigid exclude each other" in capsys.readouterr().err


def read_rows(path) -> list[dict[str, float]]:
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return [{key: float(v) for key, v in row.items()} for row in csv.DictReader(lines)]


def test_a_grid_without_samples_has_no_intervals(solution_file, capsys):
    assert main(["grid", str(solution_file), "--points", "3", "--intervals"]) == 2
    assert "coverage intervals need Monte Carlo samples; run volid uncertainty" in capsys.readouterr().err


def test_intervals_of_a_rotary_grid(rotary_solution):
    size = np.asarray(rotary_solution.covariance).shape[0]
    sampled = with_samples(rotary_solution, np.random.default_rng(3).standard_normal((TRIALS, size)))
    (grid,) = rotary_grids(sampled, points=5, reference_point=(100.0, 50.0, 0.0))
    bands = with_intervals(sampled, grid).bands
    known = np.isfinite(grid.u)
    assert (np.abs(bands[1] - bands[0] - 3.92 * grid.u) <= 2 * SAMPLING * grid.u + 1e-15)[known].all()
    assert (bands[0] <= grid.values)[known].all() and (grid.values <= bands[1])[known].all()


def test_many_outputs_go_through_memory_in_parts(sampled, monkeypatch):
    whole = statement(sampled)
    monkeypatch.setattr("volid.uncertainty.trials.samples.LARGEST", 3 * TRIALS)
    parts = statement(sampled)
    numbers = (np.array([r[2:10] for r in s.rows]) for s in (parts, whole))
    np.testing.assert_allclose(*numbers, rtol=1e-12)  # a matrix product of another width differs in its last digit


def test_budget_on_the_command_line(solution_file, tmp_path, capsys):
    out = tmp_path / "budget.csv"
    assert main(["budget", str(solution_file), "-o", str(out)]) == 0
    text = capsys.readouterr().out
    assert "EC0Y" in text and "readings of set 'volume'" in text and "largest deviation" in text
    rows = list(csv.DictReader(r for r in out.read_text(encoding="utf-8").splitlines() if not r.startswith("#")))
    assert tuple(rows[0]) == Line._fields
    sums: dict[tuple[str, str], float] = {}
    for row in rows:
        key = row["output"], row["position"]
        sums[key] = sums.get(key, 0.0) + float(row["contribution"]) ** 2
    for row in rows:
        assert sums[row["output"], row["position"]] == pytest.approx(float(row["u"]) ** 2, rel=1e-6, abs=1e-24)
    assert main(["budget", str(solution_file), "-o", str(out)]) == 2
    assert "exists" in capsys.readouterr().err


def test_budget_of_points_agrees_with_errors(solution, solution_file, tmp_path, capsys):
    points = tmp_path / "p.csv"
    points.write_text("X,Y,Z,tool_x,tool_y,tool_z\n500,100,-100,0,0,-150\n")
    assert main(["budget", str(solution_file), "--at", str(points), "--json"]) == 0
    lines = json.loads(capsys.readouterr().out)["lines"]
    u = solution.evaluate(solution.machine.order(X=500.0, Y=100.0, Z=-100.0), (0.0, 0.0, -150.0)).u[0]
    # one source only, the readings, so that the budget is the covariance once more
    np.testing.assert_allclose([line["u"] for line in lines], u, rtol=1e-5)


def test_the_largest_deviation_is_linearised_where_it_is(sampled):
    """Budget's u of largest, RMS and ranges against the spread of the samples themselves."""
    from volid.uncertainty.budget import budget, budget_lines, headline_rows
    from volid.uncertainty.outputs import FIELD, headline_outputs

    outputs = headline_outputs(sampled)
    lines = {line.output: line.u for line in budget_lines(budget(sampled), headline_rows(sampled, outputs))}
    spread = sampled.samples.outputs(outputs.field_values).std(axis=0)
    for name, s in zip(FIELD, spread, strict=True):
        # a maximum over places is linear only where one place stands out; 10 % is what that costs here
        assert lines[name] == pytest.approx(s, rel=0.1), name
