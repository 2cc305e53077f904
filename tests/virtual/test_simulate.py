"""The virtual machine against the exact chain, its noise, its files and its command."""

import argparse
import json
from dataclasses import replace

import exact_chain
import h5py
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2
from support.campaign_files import csv_text, level_rows, volume_rows, write_files
from support.places import MODELS

from volid.campaign import Campaign, ObservationSet, Station
from volid.cli import simulate as command
from volid.exceptions import InputError, OutputError
from volid.fitting.equations.problem import build_problem, scatter
from volid.fitting.fit import fit
from volid.io import load_campaign, parse_machine, read_machine
from volid.io.solutions import write_solution
from volid.io.truths import load_truth, read_truth, write_truth
from volid.planning.standard import standard_plan
from volid.virtual.random_truth import random_truth
from volid.virtual.simulate import simulate
from volid.virtual.truth import Table, Truth, truth_of_solution

SECOND_ORDER = 1e-6  # mm: third order of rotations of 100 µrad over metres is 1e-9, the rest is interpolation
CROSS = """
[model]
segments = 4
[model.functions]
EXX = { segments = 5, degree = 1, reversal = true }
EYY = { reversal = "constant" }
EAY = { over = ["Y", "X"], segments = [3, 2] }
"""


def vertical(extra: str = ""):
    text = (MODELS / "wYXbZt_vertical.toml").read_text(encoding="utf-8")
    return parse_machine(text + extra, "vertical.toml")


def with_directions(plan: Campaign, seed: int = 0) -> Campaign:
    """The plan with approach directions +1 and -1, in its one set."""
    ways = np.random.default_rng(seed).choice([-1.0, 1.0], plan.sets[0].positions.shape)
    return replace(plan, sets=(replace(plan.sets[0], directions=ways),))


def exact(truth: Truth) -> tuple[exact_chain.ExactMachine, exact_chain.Truth]:
    """The same machine and functions in the independent chain of 4x4 matrices."""
    machine = truth.machine
    chain = exact_chain.ExactMachine(machine.structure, {a.letter: a.travel for a in machine.axes})
    functions, cross = dict(truth.functions), dict(truth.cross)
    return chain, exact_chain.Truth(functions, dict(truth.constants), dict(truth.reversal), cross)


def components(positions, component: str = "X", u: float = 1e-4) -> ObservationSet:
    """A planned component set of a vertical machine."""
    positions = np.asarray(positions, dtype=float)
    m = len(positions)
    return ObservationSet(
        name="levels",
        kind="component",
        positions=positions,
        directions=np.zeros_like(positions),
        tool=np.tile([0.0, 0.0, -150.0], (m, 1)),
        readings=np.full((m, 1), np.nan),
        u=np.full((m, 1), u),
        labels={"component": np.full(m, component), "line": np.full(m, "1")},
        options={"slope": False},
    )


# ------------------------------------------------------------------------------------------------- the readings


@pytest.mark.parametrize("model", ["wYXbZt_vertical", "wZbXYt_horizontal", "wbXYZt_gantry", "wXbZYt_moving_column"])
def test_distances_equal_those_of_the_exact_chain(model):
    machine = read_machine(MODELS / f"{model}.toml")
    truth = random_truth(machine, 5, reversal=["EXX", "EBZ"], cross={"EAY": "X", "EXZ": "Y"})
    campaign, truth = simulate(with_directions(standard_plan(machine, 30)), truth, noise=False)
    readings = campaign.sets[0]
    chain, same = exact(truth)
    target = chain.functional_point(readings.positions, readings.tool, same, readings.directions)
    station = np.array([truth.stations[name] for name in readings.labels["station"]])
    beams = zip(readings.labels["station"], readings.labels["segment"], strict=True)
    dead = np.array([truth.instruments[f"dead path {s} segment {i}"] for s, i in beams])
    expected = np.linalg.norm(target - station, axis=1) + dead
    np.testing.assert_allclose(readings.readings[:, 0], expected, rtol=0, atol=SECOND_ORDER)
    nominal = np.linalg.norm(chain.functional_point(readings.positions, readings.tool) - station, axis=1)
    assert np.abs(expected - dead - nominal).max() > 0.02  # mm: the errors are there


def test_deviation_of_the_truth_equals_that_of_the_exact_chain():
    machine = vertical()
    truth = random_truth(machine, 2, reversal=["EYY"], cross={"EAY": "X"})
    plan = with_directions(standard_plan(machine, 12)).sets[0]
    chain, same = exact(truth)
    expected = chain.deviation(plan.positions, plan.tool, same, plan.directions)
    found = truth.deviation(plan.positions, plan.tool, plan.directions)
    np.testing.assert_allclose(found[:, :3], expected[:, :3], rtol=0, atol=SECOND_ORDER)
    np.testing.assert_allclose(found[:, 3:], expected[:, 3:], rtol=0, atol=1e-9)


def test_component_readings_are_the_deviation_and_an_offset():
    machine = vertical()
    q = machine.order(X=np.linspace(0, 1000, 11), Y=300.0, Z=-250.0)
    plan = Campaign(machine, sets=(components(q, "B"),))
    campaign, truth = simulate(plan, seed=3, noise=False)
    chain, same = exact(truth)
    expected = chain.deviation(q, [0, 0, -150], same)[:, 4] + truth.instruments["offset levels line 1 B"]
    np.testing.assert_allclose(campaign.sets[0].readings[:, 0], expected, rtol=0, atol=1e-9)


def test_without_errors_distances_are_nominal():
    machine = vertical()
    campaign, truth = simulate(standard_plan(machine, 20), Truth(machine), noise=False)
    readings = campaign.sets[0]
    y, x, z = readings.positions.T
    station = np.array([truth.stations[name] for name in readings.labels["station"]])
    distance = np.linalg.norm(np.stack([x, y, z], axis=1) + readings.tool - station, axis=1)
    beams = zip(readings.labels["station"], readings.labels["segment"], strict=True)
    distance += [truth.instruments[f"dead path {s} segment {i}"] for s, i in beams]
    np.testing.assert_allclose(readings.readings[:, 0], distance, rtol=0, atol=1e-9)


def test_noise_has_the_stated_spread_constant_and_proportional():
    plan = standard_plan(vertical(), 400)
    spec = {"constant": 0.0002, "proportional": 2e-6}
    plan = replace(plan, sets=(replace(plan.sets[0], options={**plan.sets[0].options, "u": spec}),))
    clean, noisy = (simulate(plan, seed=11, noise=noise)[0].sets[0] for noise in (False, True))
    u = np.hypot(0.0002, 2e-6 * np.abs(clean.readings))
    np.testing.assert_allclose(noisy.u, u, rtol=1e-4)  # stated for the reading, which has the noise
    z = ((noisy.readings - clean.readings) / u)[:, 0]
    near = np.abs(clean.readings[:, 0]) < np.median(np.abs(clean.readings))
    for part in (near, ~near):
        low, high = chi2.ppf([5e-5, 1 - 5e-5], part.sum())
        assert low < np.sum(z[part] ** 2) < high
    assert abs(np.mean(z)) < 4 / np.sqrt(len(z))
    assert abs(np.corrcoef(z[1:], z[:-1])[0, 1]) < 4 / np.sqrt(len(z))


def test_a_seed_reproduces_everything_and_another_one_nothing():
    plan = standard_plan(vertical(), 10)
    first, again, other = (simulate(plan, seed=seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first[0].sets[0].readings, again[0].sets[0].readings)
    assert first[0].stations == again[0].stations
    assert first[1].instruments == again[1].instruments
    assert np.abs(first[0].sets[0].readings - other[0].sets[0].readings).min() > 1e-6
    given = simulate(plan, first[1], seed=4)[0]
    np.testing.assert_array_equal(given.sets[0].readings, first[0].sets[0].readings)


def test_a_further_station_changes_nothing_about_the_others():
    plan = standard_plan(vertical(), 10)
    fewer = replace(plan, stations=plan.stations[:5], sets=(_rows(plan.sets[0], slice(0, 50)),))
    all_of_them, five = simulate(plan, seed=1, noise=False), simulate(fewer, seed=1, noise=False)
    np.testing.assert_allclose(all_of_them[0].sets[0].readings[:50], five[0].sets[0].readings, rtol=0, atol=1e-10)
    assert all_of_them[0].stations[:5] == five[0].stations


def _rows(readings: ObservationSet, rows: slice) -> ObservationSet:
    arrays = {n: getattr(readings, n)[rows] for n in ("positions", "directions", "tool", "readings", "u")}
    return replace(readings, **arrays, labels={k: v[rows] for k, v in readings.labels.items()})


def test_stations_of_the_campaign_are_about_5_mm_off_known_ones_are_not():
    plan = standard_plan(vertical(), 10)
    known = replace(plan.stations[0], known=True, frame="machine")
    plan = replace(plan, stations=(known, *plan.stations[1:]))
    campaign, truth = simulate(plan, seed=2)
    assert truth.stations == {s.name: s.position for s in plan.stations}
    assert campaign.stations[0] == known
    off = np.array([s.position for s in campaign.stations[1:]]) - [s.position for s in plan.stations[1:]]
    low, high = chi2.ppf([1e-4, 1 - 1e-4], off.size)
    assert low < np.sum((off / 5.0) ** 2) < high
    assert simulate(plan, seed=2, station_error=0.0)[0].stations == plan.stations
    assert simulate(plan, seed=2, station_error=None)[0].stations[1].position is None


def test_known_stations_keep_their_shape_somewhere_near_the_machine_frame():
    plan = standard_plan(vertical(), 30)
    plan = replace(plan, stations=tuple(replace(s, known=True) for s in plan.stations))
    campaign, truth = simulate(plan, Truth(plan.machine), seed=2, noise=False)
    placement = [truth.instruments[f"placement {c}"] for c in "XYZABC"]
    assert 0.1 < np.abs(placement[:3]).max() < 5.0
    place = exact_chain.rigid(placement[3:], placement[:3])
    station = {s.name: exact_chain.apply(place, s.position)[0] for s in plan.stations}
    readings = campaign.sets[0]
    y, x, z = readings.positions.T
    ray = np.stack([x, y, z], axis=1) + readings.tool - [station[name] for name in readings.labels["station"]]
    beams = zip(readings.labels["station"], readings.labels["segment"], strict=True)
    dead = [truth.instruments[f"dead path {s} segment {i}"] for s, i in beams]
    np.testing.assert_allclose(readings.readings[:, 0], np.linalg.norm(ray, axis=1) + dead, rtol=0, atol=1e-6)


def test_a_ball_bar_has_no_dead_path_but_a_calibrated_length():
    plan = standard_plan(vertical(), 10)
    options = {"relative": False, "calibrated_u": 0.001, "u": 0.0001}
    plan = replace(plan, sets=(replace(plan.sets[0], options=options),))
    _, truth = simulate(plan, seed=2)
    assert set(truth.instruments) == {"length volume"}
    assert 0 < abs(truth.instruments["length volume"]) < 0.005


# ------------------------------------------------------------------------------------- the truth, and the fit


def test_random_truth_obeys_the_datum():
    machine = vertical(CROSS)
    truth = random_truth(machine, 8)
    assert set(truth.reversal) == {"EXX", "EYY"}
    assert set(truth.cross) == {"EAY"}
    assert set(truth.constants) == {"EC0Y", "EA0Z", "EB0Z", "EA0S", "EB0S", "EC0S"}
    for name, function in truth.functions.items():
        axis = machine.axis(name[2])
        q = np.linspace(*axis.travel, 20001)
        assert abs(function(axis.reference)) < 1e-12
        peak = np.abs(function(q)).max()
        assert 1e-6 < peak < (40e-6 if name[1] in "ABC" else 0.035)
        if name[1] in "XYZ" and name[1] != name[2]:
            # the sum over a grid is the integral to one part in its number of points
            assert abs(np.polyfit(q, function(q), 1)[0]) * axis.length < 1e-4 * peak
    edge = np.linspace(0, 600, 7)
    across = truth.cross["EAY"][1]
    np.testing.assert_allclose(across(np.full(7, 300.0), edge), 0, atol=1e-18)
    np.testing.assert_allclose(across(edge, np.full(7, 500.0)), 0, atol=1e-18)


def test_a_function_left_out_of_the_machine_file_is_no_error_of_the_machine():
    truth = random_truth(vertical('\n[model.functions]\n"E*X" = false\nEC0Y = false\n'), 1)
    assert not [n for n in truth.functions if n.endswith("X")]
    assert "EC0Y" not in truth.constants
    assert random_truth(vertical(), 1).functions["EYY"](10.0) == truth.functions["EYY"](10.0)


@pytest.fixture(scope="module")
def solution():
    """A fit with reversal and a cross effect, in a model of few segments, so that its own functions are splines."""
    machine = vertical(CROSS)
    return fit(simulate(with_directions(standard_plan(machine, 200)), seed=1)[0])


def test_the_fit_predicts_its_own_simulation_exactly(solution):
    truth = truth_of_solution(solution)
    campaign, truth = simulate(with_directions(standard_plan(solution.machine, 60), 7), truth, seed=6, noise=False)
    problem = build_problem(campaign, solution.model)
    true = {f"station {name} {c}": x for name, p in truth.stations.items() for c, x in zip("XYZ", p, strict=True)}
    nuisance = [(true | dict(truth.instruments))[entry.name] for entry in problem.nuisance]
    coefficients = solution.model.parametrisation @ np.asarray(solution.parameters)
    z = jnp.asarray(np.concatenate([coefficients, nuisance]))
    predicted = scatter(problem, campaign, problem.equations.predictions(z))[0]
    np.testing.assert_allclose(predicted, campaign.sets[0].readings, rtol=0, atol=1e-9)


def test_a_solution_as_truth_deviates_as_the_solution_does(solution, tmp_path):
    write_solution(solution, tmp_path / "solution.h5")
    truth = load_truth(tmp_path / "solution.h5")
    plan = with_directions(standard_plan(solution.machine, 10)).sets[0]
    expected = solution.deviation(plan.positions, plan.tool, plan.directions)
    found = truth.deviation(plan.positions, plan.tool, plan.directions)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


# ------------------------------------------------------------------------------------------------------ files


def test_truth_file_gives_the_truth_back(tmp_path):
    machine = vertical(CROSS)
    _, truth = simulate(standard_plan(machine, 10), seed=3)
    write_truth(truth, tmp_path / "a.truth.h5")
    read = read_truth(tmp_path / "a.truth.h5")
    plan = with_directions(standard_plan(machine, 20)).sets[0]
    np.testing.assert_array_equal(
        read.errors(plan.positions, plan.directions), truth.errors(plan.positions, plan.directions)
    )
    assert read.constants == truth.constants
    assert read.stations == truth.stations
    assert read.instruments == truth.instruments
    assert read.seed == 3
    assert read.machine == machine
    with h5py.File(tmp_path / "a.truth.h5") as file:
        assert file.attrs["format"] == "volid-truth/1"
        assert file["functions/EXX/values"].shape == (401,)
        assert file["cross/EAY"].attrs["axis"] == "X"


def test_functions_of_ones_own_are_tabulated(tmp_path):
    machine = vertical()
    own = Truth(
        machine,
        {"EXX": lambda x: 0.005 * np.sin(x / 150.0), "EYX": lambda x: 0.002},
        cross={"EAY": ("X", lambda y, x: 1e-5 * np.sin(y / 200) * np.cos(x / 300))},
    )
    write_truth(own, tmp_path / "own.h5")
    read = read_truth(tmp_path / "own.h5")
    q = standard_plan(machine, 50).sets[0].positions
    np.testing.assert_allclose(read.errors(q), own.errors(q), rtol=0, atol=1e-10)


def test_what_is_wrong_with_a_truth_is_said(tmp_path):
    machine = vertical()
    with pytest.raises(InputError, match=r"'EAC' is no error motion of machine 'Cross-table.*axes Y, X, Z"):
        Truth(machine, {"EAC": np.sin})
    with pytest.raises(InputError, match="'EX0Y' is no squareness or location error"):
        Truth(machine, constants={"EX0Y": 1e-5})
    with pytest.raises(InputError, match="'EB0Y' is no squareness"):
        Truth(machine, constants={"EB0Y": 1e-5})
    table = Table(np.linspace(0, 500, 11), np.zeros(11))
    with pytest.raises(InputError, match=r"EXX is known for X = 0 … 500, but axis X .* travels 0 … 1000"):
        Truth(machine, {"EXX": table})
    with pytest.raises(InputError, match="seed is -1; expected a whole number >= 0"):
        random_truth(machine, -1)
    write_truth(Truth(machine), tmp_path / "t.h5")
    with pytest.raises(OutputError, match="exists"):
        write_truth(Truth(machine), tmp_path / "t.h5")
    (tmp_path / "text.h5").write_text("no")
    with pytest.raises(InputError, match=r"text.h5: not an HDF5 file; expected a truth, 'volid-truth/1'"):
        load_truth(tmp_path / "text.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file.attrs["format"] = "volid-campaign/1"
    with pytest.raises(InputError, match="format is 'volid-campaign/1'; expected a truth"):
        load_truth(tmp_path / "other.h5")


def test_what_is_wrong_with_a_plan_is_said():
    plan = standard_plan(vertical(), 10)
    nowhere = replace(plan, stations=(Station("S1"), *plan.stations[1:]))
    with pytest.raises(InputError, match="station 'S1': there is no position; a simulation needs the true one"):
        simulate(nowhere)
    truth = Truth(plan.machine, stations={"S1": plan.stations[0].position})
    assert simulate(nowhere, truth)[1].stations["S1"] == plan.stations[0].position
    without_u = replace(plan, sets=(replace(plan.sets[0], options={"relative": True}),))
    with pytest.raises(InputError, match="set 'volume': u is not known for every row"):
        simulate(without_u)


# ---------------------------------------------------------------------------------------------------- command


@pytest.fixture
def plan_path(tmp_path):
    """A plan as text: a manifest whose CSV files lack the readings."""
    volume, levels = volume_rows(), level_rows()
    del volume["distance"], levels["value"]
    return write_files(tmp_path / "plan", volume=csv_text(volume), levels=csv_text(levels))


def run(*arguments):
    """The command as the dispatcher calls it, except that what it raises comes through."""
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    args = parser.parse_args([str(argument) for argument in arguments])
    args.verb = "simulate"
    return command.run(args)


def test_command_writes_campaign_and_truth(plan_path, tmp_path, capsys):
    machine = plan_path.parent / "machine.toml"
    out = tmp_path / "out.h5"
    assert run(machine, "--plan", plan_path, "-o", out, "--seed", 7) == 0
    text = capsys.readouterr().out
    assert "set 'volume': 54 rows of kind distance" in text
    assert "systematic effects drawn from their u: refraction" in text
    campaign, truth = load_campaign(out), read_truth(tmp_path / "out.truth.h5")
    expected, true = simulate(load_campaign(plan_path, plan=True), seed=7)
    for found, wanted in zip(campaign.sets, expected.sets, strict=True):
        np.testing.assert_array_equal(found.readings, wanted.readings)
        np.testing.assert_array_equal(found.u, wanted.u)
    assert campaign.conditions["simulated"] is True
    assert truth.instruments == true.instruments
    assert truth.stations["S2"] == (1200.0, 650.0, -650.0)


def test_command_with_a_truth_repeats_the_readings_as_text_too(plan_path, tmp_path, capsys):
    machine, out, folder = plan_path.parent / "machine.toml", tmp_path / "out.h5", tmp_path / "text"
    run(machine, "--plan", plan_path, "-o", out, "--seed", 7)
    capsys.readouterr()
    arguments = ["--plan", plan_path, "-o", folder, "--seed", 7, "--truth", tmp_path / "out.truth.h5", "--json"]
    assert run(machine, *arguments) == 0
    done = json.loads(capsys.readouterr().out)
    assert done["campaign"] == str(folder / "campaign.toml")
    assert done["truth"] == str(folder / "campaign.truth.h5")
    assert (done["seed"], done["readings"], done["warnings"]) == (7, 64, [])
    for found, wanted in zip(load_campaign(folder / "campaign.toml").sets, load_campaign(out).sets, strict=True):
        np.testing.assert_array_equal(found.readings, wanted.readings)
        np.testing.assert_allclose(found.u, wanted.u, rtol=1e-15)


def test_command_refuses_to_overwrite_either_file(plan_path, tmp_path):
    machine, out = plan_path.parent / "machine.toml", tmp_path / "out.h5"
    (tmp_path / "out.truth.h5").write_text("mine")
    with pytest.raises(OutputError, match=r"out.truth.h5 exists; choose another name or pass `overwrite=True`"):
        run(machine, "--plan", plan_path, "-o", out)
    assert not out.exists()
    assert run(machine, "--plan", plan_path, "-o", out, "--force") == 0
    before = out.read_bytes()
    with pytest.raises(OutputError, match=r"out.h5 exists"):
        run(machine, "--plan", plan_path, "-o", out)
    assert out.read_bytes() == before
    with pytest.raises(OutputError, match=r"campaign.toml is an input of this command; choose another name"):
        run(machine, "--plan", plan_path, "-o", plan_path.parent, "--force")
    with pytest.raises(OutputError, match=r"other.toml: a manifest is always called campaign.toml; name its folder"):
        run(machine, "--plan", plan_path, "-o", tmp_path / "other.toml")


def test_command_measures_the_machine_it_is_given(plan_path, tmp_path, capsys):
    assert run(MODELS / "wYXbZt_vertical.toml", "--plan", plan_path, "-o", tmp_path / "out.h5") == 0
    assert "the plan was made for 'Test machine', w b X Y Z t" in capsys.readouterr().out
    campaign, plan = load_campaign(tmp_path / "out.h5"), load_campaign(plan_path, plan=True)
    assert campaign.machine.letters == ("Y", "X", "Z")
    np.testing.assert_array_equal(campaign.sets[0].positions, plan.sets[0].positions[:, [1, 0, 2]])
    np.testing.assert_array_equal(campaign.sets[1].directions, plan.sets[1].directions[:, [1, 0, 2]])


def test_command_names_positions_outside_the_travel(plan_path, tmp_path, capsys):
    machine = (plan_path.parent / "machine.toml").read_text().replace("[0.0, 1000.0]", "[0.0, 900.0]")
    (tmp_path / "short.toml").write_text(machine)
    assert run(tmp_path / "short.toml", "--plan", plan_path, "-o", tmp_path / "out.h5") == 1
    assert "X = 1000 … 1000 mm lies outside the travel 0 … 900" in capsys.readouterr().err
    assert (tmp_path / "out.h5").exists()


def test_command_says_what_is_wrong(plan_path, tmp_path):
    machine, out = plan_path.parent / "machine.toml", tmp_path / "out.h5"
    with pytest.raises(InputError, match=r"no.toml"):
        run(machine, "--plan", tmp_path / "no.toml", "-o", out)
    (tmp_path / "two.toml").write_text(
        'format = "volid-machine/1"\nname = "Two axes"\nstructure = "w X\' b Z t"\n'
        "[axis.X]\ntravel = [0.0, 500.0]\n[axis.Z]\ntravel = [0.0, 300.0]\n"
    )
    with pytest.raises(InputError, match=r"made for machine 'Test machine' with axes X, Y, Z, but 'Two axes' has X, Z"):
        run(tmp_path / "two.toml", "--plan", plan_path, "-o", out)
    write_truth(Truth(vertical(), {"EXX": np.sin}), tmp_path / "truth.h5")
    with pytest.raises(InputError, match=r"truth.h5: 'EXX' is known|EXX is known for X = 0 … 1000, but axis X"):
        long = (plan_path.parent / "machine.toml").read_text().replace("[0.0, 1000.0]", "[0.0, 1200.0]")
        (tmp_path / "long.toml").write_text(long)
        run(tmp_path / "long.toml", "--plan", plan_path, "-o", out, "--truth", tmp_path / "truth.h5")
    assert not out.exists()
