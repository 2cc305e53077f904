"""`volid evaluate step-diagonal` on the datasets of the published cases: table, campaign, leak, full model, tables, figure."""

from __future__ import annotations

import json

import numpy as np
import pytest
from exact_chain.step_cases import CASES, TILT, control_with, largest_of, read, separated, truth_of
from support.places import DATASETS
from support.step_diagonals import along_middle

import volid
from volid.cli import main
from volid.io.compensations import load_control
from volid.io.evaluations.step_diagonals import read_step_diagonals
from volid.io.truths import write_truth
from volid.standards.step_diagonals.model import by_model
from volid.standards.step_diagonals.separation import NAMES, separate
from volid.standards.step_diagonals.steps import step_sets, steps_of
from volid.virtual.truth import Truth as VolidTruth

FOLDER = DATASETS / "step_diagonals_800"
CASE = CASES["800"]


def run(capsys, *arguments):
    status = main(["evaluate", "step-diagonal", *map(str, arguments)])
    return status, capsys.readouterr()


def nine(campaign):
    (own,) = step_sets(campaign)
    return separate(steps_of(own, campaign))


@pytest.mark.parametrize("key", CASES)
def test_table_and_campaign_of_a_dataset_give_one_result(key):
    folder = DATASETS / f"step_diagonals_{key}"
    one = nine(read_step_diagonals(folder / "steps.csv"))
    other = nine(volid.load_campaign(folder / "campaign.toml"))
    for a, b, letter in zip(one.values, other.values, "XYZ", strict=True):
        np.testing.assert_allclose(a, b, atol=2e-5)  # readings.csv holds nanometres, whose errors add up over 40 steps
        exact = separated(CASES[key], before(key))[letter]
        np.testing.assert_allclose(a, exact, atol=1e-9)


def before(key: str, rng=None):
    """The readings of a dataset made again."""
    return read(CASES[key], truth_of(CASES[key], 1), rng or np.random.default_rng(1001), tilt=TILT)


def after(key: str):
    """Those behind the exact control with the nine functions of the ones before, noise and mirrors drawn on."""
    case, rng = CASES[key], np.random.default_rng(1001)
    control = control_with(case, separated(case, before(key, rng)))
    return read(case, truth_of(case, 1), rng, tilt=TILT, altered=control)


@pytest.mark.parametrize("key", CASES)
def test_diagonals_before_and_after_are_those_of_the_readme(key, capsys):
    """Two datasets are two draws; `benchmarks/step_diagonals.py` has fifty of each."""
    found = []
    for name in ("steps.csv", "steps_after.csv"):
        main(["evaluate", "iso230-6", str(DATASETS / f"step_diagonals_{key}" / name), "--json"])
        found.append(json.loads(capsys.readouterr().out)["E_d"]["value"])
    assert found[0] == pytest.approx(largest_of(CASES[key], before(key)), abs=1e-6)
    assert found[0] == pytest.approx(CASES[key].before, abs=0.0015)  # of readings with noise
    assert found[1] == pytest.approx(largest_of(CASES[key], after(key)), abs=1e-6)
    said = (DATASETS / f"step_diagonals_{key}" / "README.md").read_text(encoding="utf-8")
    assert f"**{1e3 * found[0]:.1f} µm before, {1e3 * found[1]:.1f} µm after**" in said


def test_quantities_leak_tables_and_figure(tmp_path, capsys):
    truth = truth_of(CASE, 1)
    machine = volid.load_machine(FOLDER / "machine.toml")
    write_truth(VolidTruth(machine, truth.functions, constants=truth.constants), tmp_path / "truth.h5")
    options = [
        "--leak",
        tmp_path / "truth.h5",
        "--tables",
        tmp_path / "tables",
        "--figure",
        tmp_path / "nine.png",
        "--json",
    ]
    status, said = run(capsys, FOLDER / "steps.csv", *options, "-o", tmp_path / "nine.csv")
    assert status == 1 and "the four diagonals contradict each other" in said.err  # mirrors of this dataset are tilted
    data = json.loads(said.out)
    assert set(NAMES) < set(data) and {"EC0Y", "EB0Z", "EA0Z", "EYX"} < set(data)
    leak = dict(zip(data["leak"]["columns"][1:], np.array([r[1:] for r in data["leak"]["rows"]], float).T, strict=True))
    causes = [r[0] for r in data["leak"]["rows"]]
    assert causes[-3:] == ["all rotations", "mirror tilt 10 µrad", "beam alone 1 mrad"]
    true = along_middle(CASE, truth)
    rotations = separated(CASE, read(CASE, truth))
    for i, name in enumerate(NAMES):
        axis, c = divmod(i, 3)
        expected = np.abs(rotations["XYZ"[axis]][:, c] - true[axis][:, c]).max()
        assert leak[name][causes.index("all rotations")] == pytest.approx(expected, rel=0.01, abs=1e-5)
    control = load_control(machine, [tmp_path / "tables"])
    assert [t.function for t in control.tables] == ["EXX", "EXY", "EXZ", "EYX", "EYY", "EYZ", "EZX", "EZY", "EZZ"]
    found = nine(read_step_diagonals(FOLDER / "steps.csv"))
    np.testing.assert_allclose(control.tables[3].forward, found.values[0][:, 1], atol=1e-9)  # EYX = Dy(x), as an error
    assert (tmp_path / "nine.png").stat().st_size > 10_000
    assert "function,axis,position_mm,value_mm,u_mm" in (tmp_path / "nine.csv").read_text()


def test_a_machine_of_other_axes_is_refused_for_the_leak(tmp_path, capsys):
    machine = volid.load_machine("models/wCAYXbZt_trunnion.toml")
    write_truth(VolidTruth(machine, {}), tmp_path / "truth.h5")
    status, said = run(capsys, FOLDER / "steps.csv", "--leak", tmp_path / "truth.h5")
    assert status == 2 and "expected the same axes" in said.err


def test_files_without_steps_are_refused(tmp_path, capsys):
    status, said = run(capsys, DATASETS / "published_positioning" / "campaign.toml")
    assert status == 2 and "holds steps of single axes along body diagonals" in said.err


@pytest.mark.slow
def test_the_full_model_knows_shapes_alone_and_knows_them_rightly(tmp_path, capsys):
    """With mirrors of unknown tilt none of the nine is determined, and the shapes that are lie within 5 u of the truth."""
    campaign = volid.load_campaign(FOLDER / "campaign.toml")
    solution = volid.fit(campaign)
    found = by_model(nine(campaign), solution)
    true, known = along_middle(CASE, truth_of(CASE, 1)), 0
    for i, name in enumerate(NAMES):
        axis, c = divmod(i, 3)
        assert not np.isfinite(found.functions[name].model).any(), name
        x, shape = CASE.nodes("XYZ"[axis]), found.shapes[name]
        straight = true[axis][:, c] - np.polyval(np.polyfit(x, true[axis][:, c], 1), x)
        has = np.isfinite(shape.model)
        known += int(has.sum())
        assert (np.abs(shape.model - straight)[has] < 5.0 * shape.u[has]).all(), name
    assert 150 < known < 300, "of 369 positions"
    solution.save(tmp_path / "s.h5")
    _, said = run(capsys, FOLDER / "campaign.toml", "--model", tmp_path / "s.h5")
    assert "beside the full model, µm" in said.out and "0 of 41" in said.out


def test_plan_simulate_evaluate_compensate_in_commands(tmp_path, capsys):
    """The loop as people run it, on a machine without rotations and with mirrors square to their beams: nothing is left."""
    model, plan, tables = "models/wXYbZt_vertical.toml", tmp_path / "plan.toml", tmp_path / "tables"
    assert main(["plan", model, "step-diagonals", "--points", "8", "--u", "1e-6", "-o", str(plan)]) == 0
    machine = volid.load_machine(model)
    square = {f"mirror step diagonals line {n} angle {i}": 0.0 for n in ("PPP", "NPP", "PNP", "PPN") for i in (1, 2)}
    functions = {"EXX": lambda x: 3e-5 * x, "EZY": lambda y: 2e-5 * y - 1e-8 * y**2}
    truth = VolidTruth(machine, functions, constants={"EC0Y": 4e-5}, instruments=square)
    write_truth(truth, tmp_path / "truth.h5")
    simulated = ["simulate", model, "--plan", str(plan), "--truth", str(tmp_path / "truth.h5"), "-o"]
    assert main([*simulated, str(tmp_path / "before.h5")]) == 0
    assert main(["evaluate", "step-diagonal", str(tmp_path / "before.h5"), "--tables", str(tables)]) in (0, 1)
    assert main([*simulated, str(tmp_path / "after.h5"), "--compensation", str(tables)]) == 0
    found = []
    for name in ("before.h5", "after.h5"):
        capsys.readouterr()
        assert main(["evaluate", "iso230-6", str(tmp_path / name), "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out)["E_d"]["value"])
    assert found[0] > 0.015 and found[1] < 1e-4
