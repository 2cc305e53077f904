"""Virtual machines with rotary axes: random truth in the datum, readings of the exact chain, files that carry both."""

from dataclasses import replace

import exact_chain
import jax.numpy as jnp
import numpy as np
import pytest
from support.machines import exact_of
from support.model_files import machine_of
from support.places import MODELS
from support.plans import CASES, grid

from volid.io import read_machine
from volid.io.truths import read_truth, write_truth
from volid.model.error_model import build_model
from volid.model.splines import design_matrix
from volid.virtual.random_truth import random_truth
from volid.virtual.simulate import simulate
from volid.virtual.truth import Truth

TABLES = 1e-6  # mm: cubic interpolation in the truth's tables, as for linear axes
ZERO_AND_CROSS = '\n[model.functions]\nEC0C = true\nEXC = { over = ["C", "A"] }\nECC = { reversal = true }\n'


def exact(truth: Truth) -> tuple[exact_chain.ExactMachine, exact_chain.Truth]:
    """The same errors in the independent chain."""
    return exact_of(truth.machine), exact_chain.Truth(
        dict(truth.functions), dict(truth.constants), dict(truth.reversal), dict(truth.cross)
    )


@pytest.mark.parametrize("on_tool", [True, False])
@pytest.mark.parametrize("name", CASES)
def test_displacements_equal_those_of_the_exact_chain(name, on_tool):
    _, plan = grid(name, 5, 4)
    options = dict(plan.sets[0].options) | {"sensor_on": "tool" if on_tool else "workpiece"}
    plan = replace(plan, sets=(replace(plan.sets[0], options=options),))
    campaign, truth = simulate(plan, seed=4, noise=False)
    chain, same = exact(truth)
    readings = campaign.sets[0]
    pose = chain.pose(readings.positions, same)
    place = np.array([[truth.instruments[f"sphere {s} {c}"] for c in "XYZ"] for s in readings.labels["sphere"]])
    if on_tool:
        expected = exact_chain.apply(np.linalg.inv(pose), place) - readings.tool
    else:
        expected = exact_chain.apply(pose, readings.tool) - place
    np.testing.assert_allclose(readings.readings, expected, rtol=0, atol=TABLES)
    assert np.abs(expected).max() > 0.01  # mm: the errors are there


@pytest.mark.parametrize("name", CASES)
def test_random_truth_obeys_the_rotary_datum(name):
    machine = read_machine(MODELS / f"{name}.toml")
    truth = random_truth(machine, 8)
    chain, same = exact(truth)
    for letter in [a for a in machine.letters if a in "ABC"]:
        axis = machine.axis(letter)
        low, high = axis.travel if axis.length < 360 else (-180.0, 180.0)
        q = low + (np.arange(4000) + 0.5) * (high - low) / 4000  # midpoint rule: 1e-7 of the values
        d, sense = chain.frame[letter].T @ chain.direction[letter], -1.0 if axis.primed else 1.0
        across = np.linalg.svd(d[None])[2][1:]
        for triple, size in (("XYZ", 1e-3), ("ABC", 1e-6)):
            wrapped = np.where(q < axis.travel[0], q + 360.0, q)
            f = np.stack([same.functions[f"E{k}{letter}"](wrapped) for k in triple])
            assert 1.0 < np.abs(f).max() / size < 45.0
            for v in across:
                rotor = np.outer(v, np.cos(np.deg2rad(q))) + sense * np.outer(np.cross(d, v), np.sin(np.deg2rad(q)))
                assert abs(np.mean(v @ f)) < 1e-5 * size * 30, "mean"
                assert abs(np.mean(np.sum(rotor * f, axis=0))) < 1e-5 * size * 30, "co-rotating"
            if triple == "XYZ":
                assert abs(np.mean(d @ f)) < 1e-5 * size * 30
            else:
                at_zero = [same.functions[f"E{k}{letter}"](np.zeros(1))[0] for k in triple]
                assert abs(d @ np.array(at_zero)) < 1e-12
    primed = {a.letter: a.primed for a in machine.axes}
    head = any(not p for a, p in primed.items() if a in "ABC")
    assert ("EX0S" in truth.constants) == head
    assert all(5 <= abs(truth.constants[n]) / (1e-6 if n[1] in "ABC" else 1e-3) <= 70 for n in truth.constants)


def test_a_full_turn_is_periodic():
    truth = random_truth(read_machine(MODELS / "wbXYZCAt_fork_head.toml"), 3)
    for name in ("EXC", "EZC", "ECC", "EAC"):
        np.testing.assert_allclose(
            truth.functions[name](np.array([-365.0, -200.0, 10.0])),
            truth.functions[name](np.array([-5.0, 160.0, 370.0])),
            atol=1e-9,
        )


def test_a_fine_model_holds_the_truth():
    """The truth minus its projection on the model is what the splines cannot follow: the datum is the model's own."""
    machine = read_machine(MODELS / "wCAYXbZt_trunnion.toml")
    truth = random_truth(machine, 5)
    model = build_model(machine, dict.fromkeys(truth.functions, (30,)))
    for names, part, parameters in model.groups:
        if part != "mean" or names[0][2] not in "AC":
            continue
        q = np.linspace(*machine.axis(names[0][2]).travel, 400)
        functions = [model.by_name[name, "mean"] for name in names]
        design = np.vstack(
            [design_matrix(f.splines[0], q) @ model.parametrisation[f.coefficients, parameters] for f in functions]
        )
        wanted = np.concatenate([truth.functions[name](q) for name in names])
        left = wanted - design @ np.linalg.lstsq(design, wanted, rcond=None)[0]
        assert np.abs(left).max() < 1e-3 * np.abs(wanted).max(), names


def test_zero_cross_effect_and_reversal_of_a_rotary_axis():
    machine = machine_of("wCAYXbZt_trunnion", ZERO_AND_CROSS)
    truth = random_truth(machine, 2)
    assert set(truth.cross) == {"EXC"} and set(truth.reversal) == {"ECC"} and "EC0C" in truth.constants
    other, cross = truth.cross["EXC"]
    q = np.linspace(0.0, 360.0, 721)[:-1]
    assert other == "A"
    assert abs(np.mean(cross(q, np.full(720, -50.0)))) < 1e-6
    np.testing.assert_allclose(cross(q, np.zeros(720)), 0.0, atol=1e-9)


def test_the_truth_file_carries_rotary_errors_and_spheres(tmp_path):
    machine, plan = grid("wCbXYZBt_nutating_head", 4, 3)
    campaign, truth = simulate(plan, seed=3)
    write_truth(truth, tmp_path / "truth.h5")
    read = read_truth(tmp_path / "truth.h5")
    assert read.machine == machine and read.constants == truth.constants and read.instruments == truth.instruments
    assert {n for n in read.constants if n.endswith("B")} == {"EX0B", "EZ0B", "EA0B", "EC0B"}
    q = jnp.asarray(campaign.sets[0].positions)
    np.testing.assert_array_equal(read.errors(q), truth.errors(q))
    again, _ = simulate(plan, read, seed=3)
    np.testing.assert_array_equal(again.sets[0].readings, campaign.sets[0].readings)


def test_an_unknown_nest_is_drawn_and_recorded():
    _, plan = grid("wCAYXbZt_trunnion", 4, 3)
    options = dict(plan.sets[0].options) | {"nest_u": np.inf, "rotation_u": 1e-3, "scale_u": 1e-4}
    name = plan.sets[0].name
    _, truth = simulate(replace(plan, sets=(replace(plan.sets[0], options=options),)), seed=1)
    assert 0 < abs(truth.instruments[f"nest {name} X"]) <= 0.1
    assert 0 < abs(truth.instruments[f"rotation {name} B"]) < 5e-3
    assert 0 < abs(truth.instruments[f"scale {name}"]) < 5e-4
