"""Studies: the same numbers whatever carries them out, a worker killed, an interruption, failures as rows, clear messages.

Also Monte Carlo on a cluster of which a worker is killed.
"""

import csv
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from distributed import LocalCluster
from support.campaign_files import MACHINE, edited
from support.places import BUNDLED, SOURCE

from volid.backend.processes import ONE_THREAD
from volid.cli import main
from volid.exceptions import InputError, VolidError
from volid.fitting.fit import fit
from volid.fitting.solution import Solution
from volid.io.machines import parse_machine
from volid.io.studies import read_study
from volid.io.study_results import CampaignFolder, places
from volid.model.machine import Datum
from volid.planning.standard import standard_plan
from volid.study.campaigns import COLUMNS, Study, Task, Truths, run_campaign, run_study, scaled_noise
from volid.study.summary import FIELD, SUMMARY, summary
from volid.uncertainty.trials import distributed, monte_carlo, run
from volid.virtual.comparison import compare, covered
from volid.virtual.random_truth import random_truth
from volid.virtual.simulate import simulate
from volid.virtual.truth import truth_of_solution

SMALL = (
    edited(MACHINE, "Test machine", "small")
    + """[model]
segments = 4
[model.functions]
"E[ABC][XYZ]" = false
"""
)
STUDY = """format = "volid-study/1"
machines = ["small.toml"]
noise = [1.0, 2.0]
seeds = [0, 1, 5]
segments = 2
[truth]
scale = 0.2
waviness = 0.1
[[design]]
name = "few"
n_per_station = 40
"""


def study_file(folder: Path, text: str = STUDY) -> Path:
    (folder / "small.toml").write_text(SMALL, encoding="utf-8")
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


def untimed(records) -> str:
    """Records to the last digit, but for the computing time."""
    return json.dumps([{k: v for k, v in r.items() if k != "seconds"} for r in records])


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Study:
    return read_study(study_file(tmp_path_factory.mktemp("study")))


@pytest.fixture(scope="module")
def serial(study):
    """Records of one process."""
    return run_study(study, workers=1)


CLUSTER = """
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        print(cluster.scheduler_address, flush=True)
        while input():
            print(cluster.workers[1].process.pid, flush=True)
"""


class Cluster:
    """A real cluster: two worker processes, each watched by a nanny.

    In a process of its own: Dask puts OMP_NUM_THREADS, PYTHONHASHSEED and more into the environment of the process that starts
    workers, and leaves them there.
    """

    def __init__(self, script: Path) -> None:
        script.write_text(CLUSTER)
        environment = os.environ | {"PYTHONPATH": str(SOURCE)}
        self._process = subprocess.Popen(
            [sys.executable, script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )
        self.address = self._process.stdout.readline().strip()

    def a_worker(self) -> int:
        """Process id of one of the workers."""
        self._process.stdin.write("which\n")
        self._process.stdin.flush()
        return int(self._process.stdout.readline())

    def close(self) -> None:
        self._process.communicate("\n", timeout=60)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    cluster = Cluster(tmp_path_factory.mktemp("cluster") / "cluster.py")
    yield cluster
    cluster.close()


def a_fit(study: Study) -> Solution:
    machine = study.machine(study.tasks[0])
    campaign, _ = simulate(standard_plan(machine, 40), random_truth(machine, 1, scale=0.2, waviness=0.1), seed=1)
    return fit(campaign)


class Killer:
    """Kills a worker process when the first result arrives."""

    def __init__(self, cluster) -> None:
        self.cluster, self.killed = cluster, 0

    def __call__(self, *_) -> None:
        if not self.killed:
            self.killed = self.cluster.a_worker()
            os.kill(self.killed, 9)


# ---------------------------------------------------------------------------------------------------- the same numbers


def test_two_processes_give_the_same(study, serial):
    messages = []
    assert untimed(run_study(study, workers=2, progress=messages.append)) == untimed(serial)
    assert messages[0] == "6 campaigns" and messages[-1] == "6 of 6 campaigns (100 %)"
    assert [(r["noise"], r["seed"]) for r in serial] == [(n, s) for n in (1.0, 2.0) for s in (0, 1, 5)]


def test_a_cluster_whose_worker_is_killed_gives_the_same(study, serial, cluster):
    kill = Killer(cluster)
    found = run_study(study, scheduler=cluster.address, save=kill)
    assert kill.killed and not Path(f"/proc/{kill.killed}/cmdline").exists()
    assert untimed(found) == untimed(serial)


def test_monte_carlo_on_a_cluster_whose_worker_is_killed_gives_the_same(study, cluster, monkeypatch):
    for module in (monte_carlo, distributed, run):
        monkeypatch.setattr(module, "BATCH", 32)
    solution = a_fit(study)
    here = monte_carlo.monte_carlo(solution, 190, seed=4).samples
    kill = Killer(cluster)

    def progress(message):
        if " of 6 batches" in message:
            kill()

    there = monte_carlo.monte_carlo(solution, 190, seed=4, scheduler=cluster.address, progress=progress).samples
    assert kill.killed and there.trials == 190
    calm = monte_carlo.monte_carlo(solution, 190, seed=4, scheduler=cluster.address).samples
    first, second, third = (np.concatenate(list(s.batches())) for s in (here, there, calm))
    np.testing.assert_array_equal(second, third)  # identical with and without a death
    assert first.shape == second.shape
    u = np.sqrt(np.maximum(np.diag(np.asarray(solution.covariance)), 1e-30))
    # drawn alike; the two processes may share out a matrix product among different numbers of threads
    assert np.abs((second - first) / u).max() < 1e-6
    np.testing.assert_array_equal(here.outliers, there.outliers)


def test_a_scheduler_that_is_not_there(study):
    with pytest.raises(InputError, match=r"`workers=2`: the scheduler has its own"):
        run_study(study, workers=2, scheduler="tcp://127.0.0.1:1")
    with pytest.raises(InputError, match="`workers=0`: expected at least 1"):
        run_study(study, workers=0)


def test_the_environment_stays_while_worker_processes_are_at_work(study):
    before, seen = dict(os.environ), []
    run_study(replace(study, noise=study.noise[:1]), workers=2, progress=lambda _: seen.append(dict(os.environ)))
    assert seen and all(environment == before for environment in seen) and dict(os.environ) == before


def test_a_worker_within_this_process_leaves_no_variables(study, monkeypatch):
    for name in ONE_THREAD:
        monkeypatch.delenv(name, raising=False)
    before = dict(os.environ)
    with LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0") as cluster:
        assert cluster.scheduler_address.startswith("inproc://") and dict(os.environ) == before
        records = run_study(replace(study, noise=study.noise[:1]), scheduler=cluster.scheduler_address)
        solution = a_fit(study)
        monte_carlo.monte_carlo(solution, 20, seed=4, scheduler=cluster.scheduler_address)
        assert dict(os.environ) == before
    assert [r["error"] for r in records] == 3 * [""]


# ------------------------------------------------------------------------------------------------------------- numbers


def test_difference_from_its_own_truth_is_nothing_in_every_datum(study):
    machine = study.machine(study.tasks[0])
    campaign, truth = simulate(standard_plan(machine, 40), random_truth(machine, 1, scale=0.2), seed=1)
    solution = fit(campaign)
    own = compare(solution, truth_of_solution(solution))
    assert np.abs(own.field).max() < 1e-9  # mm
    assert all(np.abs(d).max() < 1e-9 for d in own.functions.values())
    found = compare(solution, truth)
    moved = compare(solution.in_datum(Datum("Z", "X", "end_point")), truth)
    # a datum is a rigid motion of the first order: 30 µrad squared over 1 m is 1e-6 mm
    np.testing.assert_allclose(moved.field, found.field, atol=1e-6)
    np.testing.assert_allclose(moved.field_u, found.field_u, rtol=1e-4)


def test_what_the_datum_fixes_does_not_count_as_covered():
    np.testing.assert_array_equal(
        covered(np.array([0.0, 1.9, 2.0, np.nan]), np.array([0.0, 1.0, 1.0, 1.0])), [np.nan, 1.0, 0.0, np.nan]
    )


def test_noise_factor_multiplies_noise_and_stated_u(study):
    machine = study.machine(study.tasks[0])
    plan, truth = standard_plan(machine, 10), random_truth(machine, 3)
    exact = simulate(plan, truth, seed=3, noise=False)[0].sets[0]
    noisy = [simulate(scaled_noise(plan, f), truth, seed=3)[0].sets[0] for f in (1.0, 2.0)]
    np.testing.assert_allclose(noisy[1].readings - exact.readings, 2 * (noisy[0].readings - exact.readings), atol=1e-10)
    np.testing.assert_allclose(noisy[1].u, 2 * noisy[0].u, rtol=1e-5)


def test_summary_by_hand(study, serial):
    rows = summary(serial)
    field = [r for r in rows if r["quantity"] == FIELD]
    assert [(r["noise"], r["campaigns"], r["failed"]) for r in field] == [(1.0, 3, 0), (2.0, 3, 0)]
    assert {r["quantity"] for r in rows} == {FIELD, *serial[0]["differences"]} and list(rows[0]) == list(SUMMARY)
    d = np.array([r["differences"][FIELD] for r in serial[:3]]).reshape(3, -1, 3)
    assert field[0]["bias"] == pytest.approx(np.sqrt(np.mean(np.sum(d.mean(axis=0) ** 2, axis=1))))
    assert field[0]["spread"] == pytest.approx(np.sqrt(np.mean(np.sum(d.var(axis=0, ddof=1), axis=1))))
    assert field[0]["rms"] == pytest.approx(np.sqrt(np.mean([r["rms"] ** 2 for r in serial[:3]])))
    assert field[0]["coverage"] == pytest.approx(np.mean([r["coverage_field"] for r in serial[:3]]))
    # truth nearly in the span of the model: 6 campaigns of some 15 independent values each, 95 % ± 2.3 %; three sigma
    assert 0.88 < np.mean([r["coverage_field"] for r in serial]) < 1.0
    assert 0.88 < np.mean([r["coverage_functions"] for r in serial]) < 1.0
    assert all(r["converged"] and not r["rejected"] for r in serial)
    # the same random numbers, twice as large, on the same truth
    assert serial[3]["u"] == pytest.approx(2 * serial[0]["u"], rel=1e-2)


def test_one_truth_for_all_seeds(study):
    task = study.tasks[0]
    fixed = replace(study, truths=Truths(0.2, 0.1, seed=0))
    assert untimed([run_campaign(fixed, task)]) == untimed([run_campaign(study, task)])
    assert fixed.fingerprint(task) != study.fingerprint(task)


# ------------------------------------------------------------------------------------------------------------ the verb


def read_csv(path: Path) -> list[dict[str, str]]:
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def test_an_interrupted_study_goes_on(study, serial, tmp_path, capsys):
    path = study_file(tmp_path)
    output = tmp_path / "results.h5"
    folder = CampaignFolder(places(output).folder, study, resume=False)
    kept = []

    def save(task, record):
        folder.save(task, record)
        kept.append(record)
        if len(kept) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(study, workers=1, save=save)
    assert len(folder.done()) == 4 and len(list(folder.path.iterdir())) == 4
    assert main(["study", str(path), "-o", str(output)]) == 2
    assert "results.campaigns holds campaigns of an interrupted study; go on with --resume" in capsys.readouterr().err
    assert main(["study", str(path), "-o", str(output), "--resume", "--workers", "1"]) == 0
    assert "deviation field" in capsys.readouterr().out
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "results.csv", "results.h5", "results.summary.csv", "small.toml", "study.toml",
    ]  # fmt: skip
    rows = read_csv(tmp_path / "results.csv")
    assert list(rows[0]) == list(COLUMNS) and len(rows) == 6
    with h5py.File(output) as file:
        assert file.attrs["format"] == "volid-study-results/1" and "sha256 " + str(path) in file["provenance"].attrs
        for name, (kind, unit) in COLUMNS.items():
            values = file["campaigns"][name][()]
            texts = values.astype(str).tolist() if kind is str else [str(kind(v)) for v in values]
            assert texts == [str(kind(int(r[name])) if kind is bool else r[name]) for r in rows]
            assert file["campaigns"][name].attrs.get("unit", "") == unit
            if name != "seconds":
                assert texts == [str(r[name]) for r in serial]
        assert set(file["campaigns/seconds"][:4]) == {r["seconds"] for r in kept}, "kept, not done again"
        assert len(file["summary/quantity"]) == len(read_csv(tmp_path / "results.summary.csv"))


def test_a_failed_campaign_is_a_row(tmp_path, capsys):
    path = study_file(tmp_path, STUDY.replace("[0, 1, 5]", "1") + '[[design]]\nname = "too few"\nn_per_station = 3\n')
    status = main(["study", str(path), "-o", str(tmp_path / "r.csv"), "--workers", "1", "--json"])
    captured = capsys.readouterr()
    assert status == 1
    named = "attention: machine small, design too few, noise 2, seed 0 failed: standard plan: 18 readings for "
    assert named in captured.err
    found = json.loads(captured.out)
    assert found["campaigns"] == 4 and [r["noise"] for r in found["failed"]] == [1.0, 2.0]
    assert [r["failed"] for r in found["summary"] if r["quantity"] == FIELD] == [0, 0, 1, 1]
    rows = read_csv(tmp_path / "r.csv")
    assert [bool(r["error"]) for r in rows] == [False, False, True, True] and rows[2]["rms"] == ""


BAD = {
    "study.toml: key 'machines' is missing": ('machines = ["small.toml"]\n', ""),
    "study.toml: machines is []; expected a list of machine files": ('["small.toml"]', "[]"),
    "study.toml: machines: .*other.toml: there is no such file": ("small.toml", "other.toml"),
    "study.toml: machines has two files called 'small'": ('["small.toml"]', '["small.toml", "./small.toml"]'),
    "study.toml: noise is \\[1.0, 0.0\\]; expected a number > 0": ("2.0]", "0.0]"),
    "study.toml: seeds is 0; expected how many": ("[0, 1, 5]", "0"),
    "study.toml: seeds is \\[0, 1, 1\\]; expected how many .* or a list of different": ("5]", "1]"),
    'study.toml: segments is "many"; expected a whole number from 1 to 1000 or "auto"': (
        "segments = 2",
        'segments = "many"',
    ),
    "study.toml: unknown key 'seed'; did you mean 'seeds'": ("seeds", "seed"),
    "study.toml, \\[truth\\]: waviness is 0; expected a finite number > 0": ("waviness = 0.1", "waviness = 0"),
    "study.toml: \\[\\[design\\]\\] is missing": ('[[design]]\nname = "few"\nn_per_station = 40\n', ""),
    "study.toml, design 'few': n_per_station is 0; expected a whole number from 1 to 1000000": ("= 40", "= 0"),
    "study.toml, design 'few': n_per_station belongs to the standard plan": ("= 40", '= 40\nplan = "plan.toml"'),
    "study.toml, design 'few': plan: .*plan.toml: there is no such file": ("n_per_station = 40", 'plan = "plan.toml"'),
    "study.toml, design 'few': name 'few' is taken": ("= 40", '= 40\n[[design]]\nname = "few"'),
    "study.toml: this is a campaign .*; expected a study, written by hand": ("volid-study/1", "volid-campaign/1"),
    "study.toml, line 4: not valid TOML": ("seeds = [0", "seeds = = [0"),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_input_is_named(message, tmp_path):
    path = study_file(tmp_path, STUDY.replace(*BAD[message], 1))
    with pytest.raises(InputError, match=message.replace("[]", r"\[\]")):
        read_study(path)


def test_bad_input_on_the_command_line(tmp_path, capsys):
    path = study_file(tmp_path, STUDY.replace("seeds = [0, 1, 5]", "seeds = 1.5"))
    assert main(["study", str(path), "-o", str(tmp_path / "r.h5")]) == 2
    assert "study.toml: seeds is 1.5; expected how many" in capsys.readouterr().err
    assert main(["study", str(path), "-o", str(tmp_path / "r.txt")]) == 2
    assert "r.txt: expected a name ending in .h5 or .csv" in capsys.readouterr().err


def test_a_plan_of_ones_own(tmp_path):
    plan = BUNDLED
    text = STUDY.replace("n_per_station = 40", f'plan = "{plan}"')
    study = read_study(study_file(tmp_path, text))
    task = Task("small", "few", 2.0, 0)
    planned = study.design(task).on(study.machine(task))
    assert planned.machine.name == "small" and planned.n_readings == 2400
    two = SMALL.replace("w b X Y Z t", "w b X Y t").replace("[axis.Z]\ntravel = [-500.0, 0.0]\n", "")
    parse_machine(two, "two")
    (tmp_path / "two.toml").write_text(two)
    path = tmp_path / "study.toml"
    path.write_text(text.replace('"small.toml"', '"small.toml", "two.toml"'))
    with pytest.raises(InputError, match=r"study.toml, design 'few': plan does not fit machines 'two': .*same axes"):
        read_study(path)


def test_segments_of_the_study_win(study):
    assert study.machine(study.tasks[0]).model.segments == 2
    assert replace(study, segments=None).machine(study.tasks[0]).model.segments == 4


def test_a_cluster_that_is_not_there_is_named(study):
    with pytest.raises(VolidError, match="no Dask scheduler answers there"):
        run_study(study, scheduler="nonsense")
