"""The largest deviation is that of the whole working volume, of the full model, of all tool vectors; averages are unbiased."""

import json
from dataclasses import replace

import numpy as np
import pytest
from exact_chain import Truth
from exact_chain.machine import machine_grid
from support.compensated import MACHINES, TOOL, machine_and_solution, remaining
from support.made_up import truth_of
from support.places import ROOT

from volid.cli import main
from volid.compensation.base import base_of, model_errors
from volid.compensation.package import compensate
from volid.compensation.residual.fields import QUANTITIES, Places
from volid.compensation.residual.forecast import forecast
from volid.compensation.residual.tools import MOST, campaign_tools
from volid.compensation.residual.volume import volumetric_summary
from volid.compensation.rigid import best_rigid
from volid.fitting.results import Residuals, Statistics
from volid.io.solutions import write_solution

LARGEST, RMS = QUANTITIES.index("largest"), QUANTITIES.index("RMS")
SHARE = 0.01  # of the largest: what the search may leave, and the fit of the rigid motion to 1024 places


# ------------------------------------------------------------------------------------- against an independent evaluation


def rigid_rows(exact, q, tool):
    """What a rigid motion (t, ω) of the workpiece does to the functional point, (m, 3, 6), in plain NumPy."""
    back, f = exact.table_rotation(q).transpose(0, 2, 1), exact.functional_point(q, tool)
    turn = np.cross(np.eye(3)[None], f[:, None]).transpose(0, 2, 1)
    return np.concatenate([back, back @ turn], axis=2)


def uniform(exact, m, seed=9):
    low, high = np.array([exact.travel[a] for a in exact.axes]).T
    return np.random.default_rng(seed).uniform(low, high, (m, len(low)))


def fitted_motion(exact, q, tool, field):
    """The rigid motion that fits a field at the places q best."""
    rows = rigid_rows(exact, q, tool).reshape(-1, 6)
    scale = np.linalg.norm(rows, axis=0)
    return np.linalg.lstsq(rows / scale, field.ravel(), rcond=None)[0] / scale


def true_largest(exact, length):
    """The largest `length` of positions: over a fine grid with the ends of all axes, then around the best, ever closer."""
    q = machine_grid(exact, 33 if len(exact.axes) == 3 else 8)
    low, high = np.array([exact.travel[a] for a in exact.axes]).T
    rng, found = np.random.default_rng(4), length(q)
    for width in 0.1 * 0.6 ** np.arange(12):
        best = q[np.argsort(-found)[:12]]
        near = best[:, None] + width * (high - low) * rng.standard_normal((12, 150, len(low)))
        q = np.clip(np.concatenate([best, near.reshape(-1, len(low))]), low, high)
        found = length(q)
    return found.max()


@pytest.mark.parametrize("seed", [0, 2])
@pytest.mark.parametrize("layout", MACHINES)
def test_the_largest_is_that_of_the_exact_chain_over_a_fine_grid(layout, seed):
    """In the stated datum and with the rigid motion taken out, which is fitted to 20,000 random places there."""
    exact, solution = machine_and_solution(layout, seed=seed, u=0.02)
    truth, places = truth_of(solution), uniform(exact, 20_000)

    def deviation(q):
        return exact.deviation(q, TOOL, truth)[:, :3]

    field = deviation(places)
    motion = fitted_motion(exact, places, TOOL, field)

    def free(q):
        return np.linalg.norm(deviation(q) - rigid_rows(exact, q, TOOL) @ motion, axis=1)

    in_datum = volumetric_summary(solution, TOOL)
    (none,) = forecast(solution, [], base_of(solution, TOOL)).columns
    expected = true_largest(exact, lambda q: np.linalg.norm(deviation(q), axis=1))
    assert in_datum.before_max == pytest.approx(expected, rel=SHARE)
    assert np.linalg.norm(deviation(in_datum.before_at[None])) == pytest.approx(in_datum.before_max, abs=5e-5)
    assert none.predictions[0].exact[LARGEST] == pytest.approx(true_largest(exact, free), rel=SHARE)
    # averages are those of the volume: grids with corners have them several per cent too large
    assert in_datum.before_rms == pytest.approx(np.sqrt(np.mean(np.sum(field**2, axis=1))), rel=0.015)
    assert none.predictions[0].exact[RMS] == pytest.approx(np.sqrt(np.mean(free(places) ** 2)), rel=0.015)


def only_linear_in_x(slope, reversal=0.0):
    """A three-axis machine whose only errors are EXX = slope · (X - reference) and the reversal B of EXX, the same everywhere."""
    settings = 'EXX = { reversal = "constant" }' if reversal else ""
    exact, solution = machine_and_solution("three-axis", functions=settings, seed=3, u=1e-6)
    theta, x = np.zeros(solution.model.n_parameters), np.linspace(*exact.travel["X"], 50)
    own = solution.model.by_name["EXX", "mean"].parameters
    rows = solution.motion_rows("EXX", x, 0)[:, own]
    theta[own] = np.linalg.lstsq(rows, slope * (x - np.mean(exact.travel["X"])), rcond=None)[0]
    if reversal:
        theta[solution.model.by_name["EXX", "reversal"].parameters] = reversal
    return exact, replace(solution, parameters=theta)


@pytest.mark.parametrize("reversal", [0.0, 0.006])
def test_largest_and_rms_in_closed_form(reversal):
    """e = s (X - m) ± B/2 over a length L: largest s L/2 + B/2 at the ends, RMS √(s² L²/12 + B²/4); no rigid motion is in it."""
    exact, solution = only_linear_in_x(5e-5, reversal)
    half = 5e-5 * np.ptp(exact.travel["X"]) / 2
    (none,) = forecast(solution, [], base_of(solution, TOOL)).columns
    exact_values = none.predictions[0].exact
    assert exact_values[LARGEST] == pytest.approx(half + reversal / 2, rel=SHARE)
    assert exact_values[RMS] == pytest.approx(np.sqrt(half**2 / 3 + reversal**2 / 4), rel=SHARE)
    assert volumetric_summary(solution, TOOL).before_max == pytest.approx(half, rel=1e-6)  # mean of both directions


# ------------------------------------------------------------------------------- rigid functions against the full model


def crossed(functions):
    """A three-axis machine with a cross effect, and the truth that equals its solution."""
    exact, solution = machine_and_solution("three-axis", functions=functions, segments=3, seed=2, u=1e-6)
    theta, truth = np.asarray(solution.parameters), truth_of(solution)
    name, other = next((n, f.over[1]) for n, f in solution.machine.model.functions.items() if f.over)
    own = exact.axes.index(name[2])
    row = 6 * own + ("EX", "EY", "EZ", "EA", "EB", "EC").index(name[:2])

    def function(q, across):
        at = np.zeros((np.size(q), 3))
        at[:, own], at[:, exact.axes.index(other)] = np.ravel(q), np.ravel(across)
        rows = model_errors(solution, at, np.zeros_like(at), lambda e: str(e) == name and not e.location)[:, row]
        return (rows @ theta).reshape(np.shape(q))

    plain = {n: f for n, f in truth.functions.items() if n != name}
    return exact, solution, Truth(plain, truth.constants, cross={name: (other, function)})


@pytest.mark.parametrize("names", [["L-POS"], ["L-VOL"], ["L-POS", "L-STR", "L-SQU", "L-ANG"]])
def test_what_rigid_functions_leave_is_that_of_the_full_machine(names):
    """EAY(y, z): tables and grids from the best rigid functions, what remains by exact matrices, for two tool vectors."""
    exact, solution, truth = crossed('EAY = { over = ["Y", "Z"], segments = [3, 3] }')
    tools = np.array([TOOL, (60.0, -40.0, -250.0)])
    rigid, _ = best_rigid(solution, tools)
    base, q = base_of(rigid, TOOL), uniform(exact, 300)
    places = Places(q, np.zeros_like(q))
    control = compensate(rigid, names, base, points=9, uncertainty=False).control(solution.machine)
    found = forecast(solution, [names], base, tools, places=places, points=9, made_from=rigid).columns[1]
    alone = forecast(rigid, [names], base, tools, places=places, points=9).columns[1]
    for tool, p, itself in zip(tools, found.predictions, alone.predictions, strict=True):
        left = remaining(exact, truth, q, control.command(q, tool), tool)[:, :3]
        free = left - rigid_rows(exact, q, tool) @ fitted_motion(exact, q, tool, left)
        assert p.exact[LARGEST] == pytest.approx(np.linalg.norm(free, axis=1).max(), abs=1e-4)
        assert p.exact[RMS] == pytest.approx(np.sqrt(np.mean(np.sum(free**2, axis=1))), abs=5e-5)
        assert abs(p.exact[LARGEST] - itself.exact[LARGEST]) > 3e-4  # judged by itself it says something else


def with_a_fit(solution):
    """The solution with what its file needs of a fit."""
    z = np.zeros((2, 3))
    return replace(
        solution, statistics=Statistics(6, 0, {"ends": 0.0}, 1, True), readings=Residuals((z,), (z,), (z > 1,))
    )


def test_residual_of_rigid_functions_says_what_the_cross_effect_leaves(tmp_path, capsys):
    """EXX(x, y) alone: the doubly centred part remains, whatever the tool; its corners are among the largest."""
    functions = 'EXX = { over = ["X", "Y"], segments = [3, 3] }\n"E[ABC]?" = false\n"E[ABC]0S" = false'
    exact, solution, truth = crossed(functions)
    own, theta = solution.model.by_name["EXX", "mean"].parameters, np.zeros(solution.model.n_parameters)
    theta[own] = np.asarray(solution.parameters)[own]
    x, y = np.meshgrid(np.linspace(*exact.travel["X"], 201), np.linspace(*exact.travel["Y"], 201), indexing="ij")
    field = truth.cross["EXX"][1](x, y)
    weight = np.ones(201)
    weight[[0, -1]] = 0.5  # trapezium rule
    weight /= weight.sum()
    over_x, over_y = (weight @ field)[None, :], (field @ weight)[:, None]
    centred = field - over_x - over_y + weight @ field @ weight
    write_solution(with_a_fit(replace(solution, parameters=theta)), tmp_path / "s.h5")
    command = ["residual", str(tmp_path / "s.h5"), "--rigid", "--type", "L-VOL", "--tool", "0,0,-150", "--tools"]
    assert main([*command, "40,0,-300", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    for p in found["columns"][1]["predictions"]:
        assert p["exact"]["largest"] == pytest.approx(np.abs(centred).max(), rel=0.02)
        assert p["exact"]["RMS"] == pytest.approx(np.sqrt(weight @ centred**2 @ weight), rel=0.03)
    assert any("what remains is that of the full model, cross effects included" in note for note in found["notes"])
    _, left = best_rigid(replace(solution, parameters=theta), np.array([TOOL]))
    assert left.maximum == pytest.approx(np.abs(centred).max(), rel=0.02)


# ------------------------------------------------------------------------------------------------------- tool vectors


def test_the_largest_is_that_of_all_tool_vectors(solution, solution_file, capsys):
    """Three tool vectors in the campaign: each is predicted, and the largest of all is said; one that is named stands alone."""
    tools = solution.campaign.tool_vectors()
    assert len(tools) == 3
    assert main(["residual", str(solution_file), "--type", "L-POS", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {tuple(t) for t in found["tools"]} == {tuple(t) for t in tools.tolist()}
    each = [
        forecast(solution, [["L-POS"]], base_of(solution, solution.most_used_tool()), t[None])
        .columns[1]
        .predictions[0]
        .value[0]
        for t in tools
    ]
    over = found["largest_over_tools"]["L-POS"]
    assert over["value"] == pytest.approx(max(each), rel=1e-9)
    assert over["tool"] == tools[int(np.argmax(each))].tolist()
    assert main(["residual", str(solution_file), "--type", "L-POS"]) == 0
    text = capsys.readouterr().out
    row = next(r for r in text.split("largest of 3 tool vectors")[1].splitlines() if r.startswith("L-POS"))
    assert float(row.split()[1]) == pytest.approx(1e3 * max(each), abs=0.006)
    assert main(["residual", str(solution_file), "--type", "L-POS", "--tool", "0,0,-150"]) == 0
    assert "tool vectors" not in capsys.readouterr().out


def test_many_tool_vectors_are_represented_by_those_farthest_apart(solution):
    """Of 27 on a cube: the first, and its corners as far as there are places."""
    cube = 50.0 * np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    (s,) = solution.campaign.sets
    tool = cube[np.arange(len(s.tool)) % len(cube)]
    many = replace(solution, campaign=replace(solution.campaign, sets=(replace(s, tool=tool),)))
    found = campaign_tools(many, cube[13])
    assert len(found) == MOST and found[0].tolist() == cube[13].tolist()
    assert np.all(np.abs(found[1:]) == 50.0) and len(np.unique(found, axis=0)) == MOST


# ---------------------------------------------------------------------------------------------- sentences in two outputs


def test_summary_and_residual_bridge_their_largest_deviations(solution_file, capsys):
    """Both say both numbers: in the stated datum, and with the rigid motion taken out, where they agree; L-VOL as well."""
    assert main(["summary", str(solution_file)]) == 0
    summary = " ".join(capsys.readouterr().out.split())
    assert main(["residual", str(solution_file), "--type", "L-VOL", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert main(["residual", str(solution_file), "--type", "L-VOL"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    none, after = (1e3 * c["predictions"][0]["value"]["largest"] for c in found["columns"])
    datum = 1e3 * found["largest_in_datum"][0]
    assert f"deviation largest {datum:.1f} µm at" in summary
    assert f"rigid motion taken out largest {none:.1f} µm (95 %:" in summary
    assert "the deviation above contains the workpiece's motion, what follows and volid residual do not" in summary
    assert f"after L-VOL, expected largest {after:.1f} µm" in summary
    assert f"In the stated datum the largest deviation is {datum:.2f} µm, as volid summary has it" in text
    assert f"the {none:.2f} µm of the row none are without that motion" in text
    assert datum > 1.05 * none  # two numbers that need a sentence


@pytest.fixture(scope="module")
def untested(tmp_path_factory):
    """Solution file of a campaign with as many parameters as readings."""
    path = tmp_path_factory.mktemp("untested") / "s.h5"
    main(["fit", str(ROOT / "datasets/published_positioning/campaign.toml"), "-o", str(path)])
    return path


@pytest.mark.parametrize(
    ("verb", "options"),
    [
        ("summary", ""),
        ("functions", ""),
        ("budget", ""),
        ("residual", "--type L-VOL"),
        ("residual", "--type L-VOL -o OUT.csv"),
        ("uncertainty", "--trials 20 -o OUT.h5"),
        ("grid", "--type L-VOL --points 3 --extrapolate -o OUT.csv"),
        ("tables", "--type L-POS -o OUT"),
        ("errors", "--at POINTS.csv -o OUT.csv"),
    ],
)
def test_without_redundancy_every_output_says_not_testable(untested, tmp_path, capsys, verb, options):
    (tmp_path / "POINTS.csv").write_text("X,Y,Z,tool_x,tool_y,tool_z\n100,100,100,0,0,0\n", encoding="utf-8")
    words = options.replace("OUT", str(tmp_path / "OUT")).replace("POINTS", str(tmp_path / "POINTS")).split()
    assert main([verb, str(untested), *words]) in (0, 1)
    texts = [capsys.readouterr().out]
    texts += [p.read_text(encoding="utf-8") for p in tmp_path.rglob("OUT*") if p.suffix == ".csv"]
    texts += [p.read_text(encoding="utf-8") for p in tmp_path.glob("OUT/*.csv")]
    said = "\n".join(texts)
    assert "not testable: there are no more readings than unknowns" in said
    assert "none found" not in said and "unit weight nan" not in said
